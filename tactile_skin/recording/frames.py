"""Frames of any board from a file: MCAP, NumPy or CSV. What is repaired or dropped is said."""

from __future__ import annotations

import io
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..files import read_bytes
from ..middleware.config import SkinConfig, read_skin
from ..physics.adc import NOT_READ, Adc
from ..physics.circuit import Circuit
from .reader import Recording

KINDS = (".mcap", ".npy", ".npz", ".csv", ".txt", ".tsv")
_LARGEST = 1 << 30  # bytes of a file that is read at once
_ABSENT = {"", "-", "nan"}  # fields that stand for a crossing that was not read
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT = re.compile(
    r"(?:^|[\[(_ ])(s|ms|us|ns)[\])]?$", re.IGNORECASE
)  # at the end of a column's name
_SAMPLE = 200  # lines that tell the separator
_GAP = 5.0  # usual intervals from which on a gap is worth a word


@dataclass
class Frames:
    """Attributes:
    values: (n, rows, cols) ADC steps, or ratios from 0 to 1; NaN: not read.
    times: (n,) rising [s]; None: the file has none.
    notes: what was repaired or dropped, in words.
    """

    path: str
    values: np.ndarray
    times: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)

    def ratio(self, adc: Adc) -> np.ndarray:
        """(n, rows, cols) ADC ratio; NaN: not read.

        Raises:
            FileError: numbers beyond the ADC's range.
        """
        if self.values.dtype.kind == "f" and np.nanmax(self.values, initial=0.0) <= 1.0:
            return self.values
        self._check_range(adc.circuit)
        steps = self.values.astype(float)
        return adc.ratio(np.where(adc.unread(steps), np.nan, steps))

    def samples(self, adc: Adc) -> np.ndarray:
        """(n, rows, cols) uint16 as on skin/adc: ADC steps * 2^(16 - bits); 65535: not read.

        Raises:
            FileError: as `ratio`.
        """
        steps = self.values.astype(float)
        if self.values.dtype.kind == "f" and np.nanmax(steps, initial=0.0) <= 1.0:
            steps = adc.count(steps)
        else:
            self._check_range(adc.circuit)
        scaled = np.rint(np.maximum(steps, 0.0) * 2 ** (16 - adc.circuit.adc_bits))
        return np.where(np.isnan(scaled), NOT_READ, np.minimum(scaled, NOT_READ - 1)).astype("u2")

    def _check_range(self, circuit: Circuit) -> None:
        top = float(np.nanmax(self.values, initial=0.0))
        if top > 2**circuit.adc_bits:
            raise FileError(
                f"{self.path}: numbers up to {top:g}, but adc_bits = {circuit.adc_bits} ends at "
                f"{circuit.full_scale}: set adc_bits"
            )


def read_frames(path, circuit: Circuit | None = None, namespace: str = "") -> Frames:
    """The frames of a recording, in order.

    Args:
        path: .mcap; .npy or .npz of (n, rows, cols) or (n, rows * cols), of an .npz its `frames`
            or first array, and `times` [s] if it has them; .csv, .txt or .tsv, a frame a line,
            row by row, with or without a header, a column of times in front, and other lines.
        circuit: whose frames they are; None: as the recording says, of MCAP only.
        namespace: of the skin, of MCAP only.

    Raises:
        FileError: no such file, another size, or no frame in it; the message names it.
        OSError: it cannot be read.
    """
    kind = Path(path).suffix.lower()
    if kind not in KINDS:
        raise FileError(f"{path}: must be one of {', '.join(KINDS)}")
    if kind == ".mcap":
        return _of_recording(Recording(path, namespace), circuit)
    if circuit is None:
        raise FileError(f"{path}: does not say its rows and cols: give a configuration")
    data = read_bytes(path, _LARGEST)
    found = (
        _of_numpy(path, data, kind, circuit) if kind[:3] == ".np" else _text(path, data, circuit)
    )
    if not len(found.values):
        raise FileError(f"{path}: holds no frame")
    return _rising(found)


def recorded_skin(path) -> SkinConfig:
    """The configuration that a recording was made with; of other files, all defaults.

    Raises:
        FileError, OSError: as Recording.
    """
    return Recording(path).skin if Path(path).suffix.lower() == ".mcap" else read_skin()


def _of_recording(recording: Recording, circuit: Circuit | None) -> Frames:
    samples, skin = recording.adc, recording.skin
    circuit = circuit or skin.circuit
    if samples.shape[1:] != circuit.shape:
        raise _wrong_size(recording.path, samples.shape, circuit)
    bits = skin.circuit.adc_bits if recording.parameters else circuit.adc_bits
    steps = samples / 2.0 ** (16 - bits)
    steps[samples == NOT_READ] = np.nan
    notes = [recording.damage] if recording.damage else []
    return _rising(Frames(str(recording.path), steps, recording.times, notes))


def _of_numpy(path, data: bytes, kind: str, circuit: Circuit) -> Frames:
    times = None
    try:
        values = np.load(io.BytesIO(data), allow_pickle=False)
        if kind == ".npz":
            arrays = values
            if not arrays.files:
                raise ValueError("holds no array")
            times = arrays["times"] if "times" in arrays.files else None
            others = [name for name in arrays.files if name != "times"]
            values = arrays["frames" if "frames" in others else others[0]]
    except Exception as error:  # of whatever bytes
        raise FileError(f"{path}: cannot be read: {error}") from error
    if values.dtype.kind not in "fiu":
        raise FileError(f"{path}: holds {values.dtype}: must be numbers")
    if values.ndim == 2 and values.shape[1] == circuit.rows * circuit.cols:
        values = values.reshape(-1, *circuit.shape)
    if values.ndim != 3 or values.shape[1:] != circuit.shape:
        raise _wrong_size(path, values.shape, circuit)
    if times is not None and times.shape != values.shape[:1]:
        raise FileError(f"{path}: times has shape {times.shape}: must be {values.shape[:1]}")
    found = Frames(str(path), values, times)
    if values.dtype.kind == "f" and (odd := ~np.isfinite(values) & ~np.isnan(values)).any():
        found.values = np.where(odd, np.nan, values)
        found.notes.append(f"{odd.sum()} infinite numbers are taken as not read")
    return found


def _wrong_size(path, shape, circuit: Circuit) -> FileError:
    return FileError(
        f"{path}: holds {' x '.join(map(str, shape))} numbers, the circuit is "
        f"{circuit.rows} x {circuit.cols}: check rows and cols"
    )


# --- text ----------------------------------------------------------------------------------------


def _text(path, data: bytes, circuit: Circuit) -> Frames:
    lines = data.decode("utf-8-sig", errors="replace").splitlines()
    separator = _separator(lines[:_SAMPLE])
    wanted = circuit.rows * circuit.cols
    rows: list[tuple[int, np.ndarray, bool]] = []  # line, numbers, whether it ends in a separator
    texts: list[int] = []  # lines that hold something else
    header: list[str] = []  # the last of them before the numbers
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        words = _words(line, separator)
        numbers = _numbers(words)
        if numbers is not None:
            rows.append((number, numbers, bool(separator) and line.rstrip(" ").endswith(separator)))
        else:
            header = header if rows else words
            texts.append(number)
    if not rows:
        raise FileError(f"{path}: holds no line of numbers")
    width, _ = Counter(len(numbers) for _, numbers, _ in rows).most_common(1)[0]
    ends = all(ends for _, numbers, ends in rows if len(numbers) == width)
    trailing = ends and width > wanted
    before = width - trailing - wanted
    if before not in (0, 1):
        raise FileError(
            f"{path}: most lines hold {width - trailing} numbers, the circuit is {circuit.rows} x "
            f"{circuit.cols} = {wanted}, or one more for the time: check rows and cols"
        )
    kept = [(k, v[: before + wanted]) for k, v, _ in rows if len(v) == width]
    blind = [k for k, v in kept if np.isnan(v[before:]).all()]
    table = np.array([v for k, v in kept if k not in set(blind)]).reshape(-1, before + wanted)
    named = len(header) == width  # a name for each column
    notes = []
    for dropped, why in (
        (
            [k for k in texts if k < rows[0][0]][: -1 if named else None],
            "before the numbers: passed over",
        ),
        ([k for k in texts if k > rows[0][0]], "with text among the numbers: dropped"),
        ([k for k, v, _ in rows if len(v) != width], f"of other than {width} fields: dropped"),
        (blind, "in which no crossing was read: dropped"),
    ):
        if dropped:
            notes.append(f"{len(dropped)} lines {why} (the first: line {dropped[0]})")
    values = table[:, before:].reshape(-1, *circuit.shape)
    if absent := int(np.isnan(values).sum()):
        notes.append(f"{absent} fields without a number: taken as not read")
    found = Frames(str(path), values, None, notes)
    if before:
        found.times = _seconds(table[:, 0], header[0] if header else "", notes)
    return found


def _separator(lines: list[str]) -> str | None:
    """The one of the file; None: spaces."""
    counts = {mark: sum(line.count(mark) for line in lines) for mark in ";\t,"}
    for mark in ";\t,":  # a comma may be the point of decimals
        if counts[mark] >= len(lines) / 2 and counts[mark]:
            return mark
    return None


def _words(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    words = line.split(separator)
    return [w.strip().replace(",", ".") if separator != "," else w.strip() for w in words]


def _numbers(words: list[str]) -> np.ndarray | None:
    """Of a line; NaN: not read; None: something else."""
    try:
        numbers = [np.nan if w.lower() in _ABSENT else float(w) for w in words]
    except ValueError:
        return None
    numbers = np.array(numbers)
    return numbers if len(numbers) and not np.isinf(numbers).any() else None


def _seconds(column: np.ndarray, name: str, notes: list[str]) -> np.ndarray:
    """A column of times in seconds: the unit is the end of its name, or what its steps suggest."""
    match = _UNIT.search(name.strip())
    unit = match[1].lower() if match else None
    if unit is None:
        step = float(np.median(np.diff(column))) if len(column) > 1 else 0.0
        unit = "s" if step < 1.0 else "ms" if step < 1000.0 else "us"
        notes.append(f"the first column is taken as the time in {unit}")
    return column * _UNITS[unit]


def _rising(found: Frames) -> Frames:
    """Without frames whose time does not rise; gaps are named."""
    if found.times is None:
        return found
    times = np.asarray(found.times, float)
    latest = np.fmax.accumulate(np.r_[-np.inf, times[:-1]])
    good = times > latest
    if not good.all():
        found.notes.append(f"{(~good).sum()} frames whose time does not rise: dropped")
    found.values, found.times = found.values[good], times[good]
    steps = np.diff(found.times)
    gaps = steps > _GAP * np.median(steps) if len(steps) else np.zeros(0, bool)
    if gaps.any():
        at = found.times[:-1][gaps][0] - found.times[0]
        found.notes.append(
            f"{gaps.sum()} gaps, the longest {steps.max():.2f} s, the first after {at:.2f} s"
        )
    return found
