# SPDX-License-Identifier: Apache-2.0
"""Frames of any board from a file: MCAP, NumPy or CSV. What is repaired or dropped is said."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..files import read_bytes, read_lines
from ..middleware.config import Part, SkinConfig, part_of, read_skin
from ..physics.adc import NOT_READ, Adc
from ..physics.circuit import Circuit
from ..readings.processed import processed, sample_of
from ..readings.scale import Numbers, scale_of, without_sentinel
from . import columns
from .columns import Column, is_label_name, is_time_name, spread
from .lines import read_text
from .reader import Recording
from .tables import Found, Rows, by_part, frames_of, keep

_PICKLES = (".pkl", ".pickle", ".p")
_PICKLED = b"\x80"  # what a pickle begins with
_NO_PICKLE = (
    "is a pickle, which may run any program when it is read: must be plain numbers, as "
    "numpy.save(path, numpy.stack(frames)) writes them"
)
KINDS = (".mcap", ".npy", ".npz", ".csv", ".txt", ".tsv", ".log", ".jsonl")
_LARGEST = 1 << 30  # bytes of a file that is read at once
_GAP = 5.0  # usual intervals from which on a gap is worth a word


@dataclass
class Frames(Found):
    """Frames of a board: their values are ADC steps or ratios, their times rise."""

    path: str = ""  # of the file
    are_ratios: bool = False  # whether `values` are ratios from 0 to 1, and not ADC steps

    def ratio(self, adc: Adc) -> np.ndarray:
        """(n, rows, cols) ADC ratio; NaN: not read (FileError: numbers beyond the ADC's range)."""
        if self.are_ratios:
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
        if self.are_ratios:
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
                f"{circuit.full_scale}: an ADC of more bits (adc_bits), millivolts "
                "(full_scale:=3300 or 5000, what an input at the supply reads), or resistances, "
                "which cannot be read?"
            )


def read_frames(
    path,
    circuit: Circuit | None = None,
    namespace: str = "",
    rate: float | None = None,
    full_scale: float | None = None,
    part: Part | None = None,
) -> Frames:
    """Return the frames of a recording, in order.

    Args:
        path: .mcap; .npy or .npz of (n, rows, cols), (rows, cols, n) or of a table, of an .npz its
            `frames` or the only array that may be readings, and `times` if it has them; .csv,
            .txt, .tsv, .log or .jsonl. A line of a table is a frame, row by row, or a row of the
            matrix, with columns of time, counter or label in front or behind, or any where a
            header names the cells; a header and other lines may stand between.
        circuit: whose frames they are; None: as the recording says, of MCAP only.
        namespace: of the skin, of MCAP only.
        rate: frames a second, where the file has no times.
        full_scale: what an input at the supply reads, where numbers are not ADC steps: 5.0 of
            volts, 1.0 of ratios; None: by what the numbers show.
        part: where the circuit's cells are in a board's frame; None: it is all of it, in order.

    Raises:
        FileError: no such file, another size, no frame in it, or most would be dropped; the
            message names it.
        OSError: it cannot be read.
    """
    kind = Path(path).suffix.lower()
    if kind in _PICKLES:
        raise FileError(f"{path}: {_NO_PICKLE}")
    if kind not in KINDS:
        raise FileError(f"{path}: must be one of {', '.join(KINDS)}")
    if kind == ".mcap":
        return _of_recording(Recording(path, namespace), circuit, part)
    if circuit is None:
        raise FileError(f"{path}: does not say its rows and cols: give a configuration")
    sent = circuit if part is None else Circuit(*part.shape, adc_bits=circuit.adc_bits)
    try:
        found = _read(path, kind, sent)
    except FileError:
        if sent.shape == circuit.shape:
            raise
        found = _read(path, kind, circuit)  # as it is exported, without these lines
    found.values = part.of(found.values) if part else found.values
    frames = Frames(**vars(found), path=str(path))
    return _timed(_scaled(frames, circuit, full_scale), rate)


def _read(path, kind: str, circuit: Circuit) -> Found:
    try:
        if kind[:3] == ".np":
            return _of_numpy(path, read_bytes(path, _LARGEST), kind, circuit)
        return read_text(partial(read_lines, path, _LARGEST), circuit)
    except FileError:
        raise
    except ValueError as error:
        raise FileError(f"{path}: {error}") from error


def _scaled(found: Frames, circuit: Circuit, full_scale: float | None) -> Frames:
    """With ADC steps or ratios; FileError: numbers that are neither, or may be two things."""
    if (
        not found.values.size
        or by_part(lambda part: np.isnan(part).all((1, 2)), found.values).all()
    ):
        return found
    found.values, absent = without_sentinel(found.values)
    if absent:
        found.notes.append(f"{absent} numbers of -1: taken as not read")
    scale = scale_of(found.values, circuit.full_scale)
    if full_scale is not None and scale.kind is not Numbers.NEGATIVE:
        if not full_scale > 0.0:
            raise ValueError(f"full_scale = {full_scale!r}: must be above 0")
        if (top := float(np.nanmax(found.values, initial=0.0))) > full_scale:
            raise FileError(
                f"{found.path}: numbers up to {top:.4g}, above full_scale = {full_scale:g}"
            )
        found.values = _scale(found.values, circuit.full_scale / full_scale)
        return found
    if refused := scale.refused():
        raise FileError(f"{found.path}: {refused}")
    if scale.kind is Numbers.STEPS:
        seen = np.where(circuit.populated, sample_of(found.values), np.nan)
        if done := processed(seen, circuit.adc_bits):
            found.notes.append(str(done))
        elif by_part(partial(_has_decimals, circuit), found.values).any():
            found.notes.append(f"decimals up to {scale.high:.4g}: taken as means of ADC steps")
    if scale.kind is Numbers.RATIOS:
        found.are_ratios = True
        found.notes.append(f"numbers up to {scale.high:.3g}: taken as ratios")
    return found


def _has_decimals(circuit: Circuit, values: np.ndarray) -> np.ndarray:
    """(n,) bool: frames that hold a decimal in a cell."""
    return ((values % 1 > 0.0) & circuit.populated).any((1, 2))


def _scale(values: np.ndarray, factor: float) -> np.ndarray:
    """Return values * factor, in place where they are no integers."""
    out = values if values.dtype.kind == "f" and values.dtype.itemsize > 2 else None
    kind = np.result_type(values.dtype, np.float32)  # of 16 bits it holds all
    return np.multiply(values, factor, out=out, dtype=kind)


def _timed(found: Frames, rate: float | None) -> Frames:
    """With times that rise; FileError: most frames would be dropped."""
    if rate is not None and not 0.0 < rate < np.inf:
        raise ValueError(f"rate = {rate!r}: must be above 0")
    if found.times is not None:
        if rate is not None:
            found.notes.append(f"rate:={rate:g} is not used: the file has times")
        _rise(found)
    elif rate := rate or found.rate:
        if rate == found.rate:
            found.notes.append(f"it says {rate:g} frames a second")
        found.times = np.arange(len(found.values)) / rate
    if not len(found.values) or found.lost > len(found.values):
        why = "holds no frame"
        if len(found.values):
            why = f"{found.lost} of {found.lost + len(found.values)} frames would be dropped"
        raise FileError(": ".join(filter(None, [found.path, why, "; ".join(found.notes)])))
    return found


def is_recording(path) -> bool:
    """Whether a file's name is that of a recording, and not of a foreign board's frames."""
    return Path(path).suffix.lower() == ".mcap"


def recorded_skin(path, config=None, namespace: str = "") -> SkinConfig:
    """Return the configuration of a parameter file, or else what a recording was made with.

    Raises:
        FileError, OSError: as Recording.
    """
    if config is None and is_recording(path):
        return Recording(path, namespace).skin
    return read_skin(config)


def _of_recording(recording: Recording, circuit: Circuit | None, part: Part | None) -> Frames:
    samples, skin = recording.adc, recording.skin
    if part:
        if recording.parameters:
            with contextlib.suppress(ValueError):  # lines that were not recorded
                part = part.within(part_of(skin.board))
        samples = part.of(samples)
    circuit = circuit or skin.circuit
    if samples.shape[1:] != circuit.shape:
        raise _wrong_size(recording.path, samples.shape, circuit)
    bits = skin.circuit.adc_bits if recording.parameters else circuit.adc_bits
    steps = samples / 2.0 ** (16 - bits)
    steps[samples == NOT_READ] = np.nan
    notes = [recording.damage] if recording.damage else []
    return _timed(Frames(steps, recording.times, notes, path=str(recording.path)), None)


def _of_numpy(path, data: bytes, kind: str, circuit: Circuit) -> Found:
    arrays, refused = _arrays(path, data, kind), {}
    fits: dict[str, Found] = {}
    for name in ["frames"] if "frames" in arrays else arrays:
        try:
            fits[name] = _of_numbers(path, arrays[name], circuit)
        except ValueError as error:
            refused[name] = error
    if any(arrays[name].ndim > 2 for name in fits):
        fits = {name: found for name, found in fits.items() if arrays[name].ndim > 2}
    if len(fits) > 1:  # pictures of the readings, in the same file
        fits = {name: found for name, found in fits.items() if _may_be_read(found, circuit)}
    there = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    if len(fits) == 1:
        ((name, found),) = fits.items()
    elif len(arrays) == 1:
        raise next(iter(refused.values()))
    else:
        raise FileError(
            f"{path}: holds {there}: which are the readings, of {circuit.rows} x {circuit.cols}? "
            "Must be named frames"
        )
    if len(arrays) > 1 and name != "frames":
        found.notes.insert(0, f"of {there}, {name} is taken")
    others = {k: a for k, a in arrays.items() if a.dtype.kind in "fiuMUS" and k != name}
    timed = {k: a for k, a in others.items() if is_time_name(k) and a.size > 1}
    if fit := {k: a for k, a in timed.items() if a.size == max(a.shape) == len(found.values)}:
        each = [_column(name, array.ravel()) for name, array in fit.items()]
        found.times = columns.times(each, found.notes, list(fit))
    elif timed:
        name, times = next(iter(timed.items()))
        raise FileError(f"{path}: {name} has shape {times.shape}: must be {found.values.shape[:1]}")
    for name, array in others.items():
        if is_label_name(name) and array.shape == found.values.shape[:1]:
            found.labels[name] = columns.texts(_column(name, array))
    return found


def _arrays(path, data: bytes, kind: str) -> dict[str, np.ndarray]:
    """Return the arrays of a file that are read without running anything, by name."""
    try:
        loaded = np.load(io.BytesIO(data), allow_pickle=False)
        if kind == ".npy":
            return {"": loaded}
        if not loaded.files:
            raise ValueError("holds no array")
        known = [k for k in loaded.files if k == "frames" or is_time_name(k) or is_label_name(k)]
        return {name: loaded[name] for name in (known if "frames" in known else loaded.files)}
    except Exception as error:  # of whatever bytes
        if "Object arrays" in str(error) or data[:1] == _PICKLED:
            raise FileError(f"{path}: {_NO_PICKLE}") from error
        raise FileError(f"{path}: cannot be read: {error}") from error


def _column(name: str, values: np.ndarray) -> Column:
    """Return the times of an array as a column: numbers, dates, or texts."""
    if values.dtype.kind in "MUS":
        return Column(name, np.full(len(values), np.nan), values.astype(str).tolist())
    return Column(name, np.where(np.abs(values) < np.inf, values, np.nan).astype(float))


def _may_be_read(found: Found, circuit: Circuit) -> bool:
    """Whether an ADC may read so, as far as that shows."""
    values = without_sentinel(found.values)[0]
    some = np.where(circuit.populated, sample_of(values), np.nan)
    held = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else np.inf
    known = held < circuit.full_scale or scale_of(values, circuit.full_scale).refused()
    return not known and not processed(some, circuit.adc_bits)


def _of_numbers(path, values: np.ndarray, circuit: Circuit) -> Found:
    """Return the frames of an array (ValueError: it holds none)."""
    if values.dtype.kind not in "fiu":
        raise FileError(f"{path}: holds {values.dtype}: must be numbers")
    odd = np.isinf(values) if values.dtype.kind == "f" else np.zeros(0, bool)
    if odd.any():
        values = np.where(odd, np.nan, values)
    found = _of_array(path, values, circuit)
    if odd.any():
        found.notes.insert(0, f"{odd.sum()} infinite numbers are taken as not read")
    return found


def _of_array(path, values: np.ndarray, circuit: Circuit) -> Found:
    """Return the frames of an array, by its shape."""
    shape, given = circuit.shape, values.shape
    if values.ndim > 3 or (values.ndim == 3 and shape not in (given[1:], given[:2])):
        values = values.reshape([n for n in given if n > 1])  # (n, 1, rows, cols) of a network
    if values.shape == shape:
        return Found(values[None])
    if values.ndim == 3 and values.shape[1:] == shape:
        return Found(values)
    if values.ndim == 3 and values.shape[:2] == shape:
        return Found(np.moveaxis(values, -1, 0), None, ["the last axis is taken as the frames"])
    if values.ndim == 2:
        return frames_of(Rows.of_numbers(values), circuit)
    raise _wrong_size(path, given, circuit)


def _wrong_size(path, shape, circuit: Circuit) -> FileError:
    turned = shape[1:] == circuit.shape[::-1]
    return FileError(
        f"{path}: holds {' x '.join(map(str, shape))} numbers, the circuit is "
        f"{circuit.rows} x {circuit.cols}: "
        + (
            "are rows and columns exchanged? transpose the array"
            if turned
            else "check rows and cols"
        )
    )


def _rise(found: Frames) -> None:
    """Drop frames whose time does not rise; gaps are named."""
    times = np.asarray(found.times, float)
    if (even := spread(times)) is not None:
        times = even
        found.notes.append("the clock is coarser than the frames: these are spread evenly")
    latest = np.fmax.accumulate(np.r_[-np.inf, times[:-1]])
    good = times > latest
    if not good.all():
        found.notes.append(f"{(~good).sum()} frames whose time does not rise: dropped")
        if (again := int((np.diff(times) < 0.0).sum())) and 2 * good.sum() < len(good):
            found.notes.append(f"it begins again {again} times: must be a file for each part")
        found.lost += int((~good).sum())
    found.values, found.times = keep(found.values, np.flatnonzero(good)), times[good]
    found.labels = {name: each[good] for name, each in found.labels.items()}
    steps = np.diff(found.times)
    if steps.sum() > 365.0 * columns.DAY:
        raise FileError(
            f"{found.path}: times from {times[good][0]:.6g} to {times[good][-1]:.6g} s: their unit "
            "is another one, or the clock was set meanwhile: must be a file for each part"
        )
    gaps = steps > _GAP * np.median(steps) if len(steps) else np.zeros(0, bool)
    if gaps.any():
        at = found.times[:-1][gaps][0] - found.times[0]
        found.notes.append(
            f"{gaps.sum()} gaps, the longest {steps.max():.2f} s, the first after {at:.2f} s"
        )
