# SPDX-License-Identifier: Apache-2.0
"""What an untouched skin reads, and what its cells then conduct, whatever curve they follow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..physics import readouts
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..solvers import compensate
from ..solvers.reading import MAX_NOISE, robust_std
from ..solvers.suspect import EXACT_NOISE
from .touched import MOVED

REST_SPAN = 500.0  # times the usual cell's resistance, either way, that a cell at rest may have
# (one that stays pressed, or is dead)
HALF_STEP = 0.5  # ADC steps that a reading of 0 may stand for
_ROUNDS = 3  # in which the readings of noisy cells are put in place
# Times the usual cell's conductance, either way, beyond which a cell at rest is pressed, or broken.
UNLIKE = 4.0
# The same of a sensor with a line of its own: an FSR rests at 0.3 and at 1.7 megohm within a
# minute, and conducts 15 times as much under 0.05 N.
_ALONE = 8.0
MAD = 0.6745  # median of the size of normal noise, over its RMS
_STRAYS = 0.02  # share of a reading by which it may stray, or drift, beside `MOVED`
NOISY = 4.0  # times the usual noise, or difference at rest, that is not of the same kind, and
NOISY_STEPS = 2.0  # ADC steps RMS at least
_COMMON = 0.03  # share of a reading by which all may drift
_MOST = 3  # readings that may be noisy, or
_FEW = 0.05  # of the cells, if that is more; and of dead ones, below the board's threshold
_TOGETHER = 0.7  # correlation above which readings of one row, or column, move together
_LOOSE = 1.1  # times what a crossing usually conducts, up to which they lose contact: none touches


@dataclass(frozen=True, eq=False)
class Rest:
    """An untouched skin.

    Attributes:
        adc: (rows, cols) mean reading, ADC ratio; NaN where a crossing was never read.
        noise: RMS of a usual single reading [ADC steps].
        frames: how many were averaged.
        conductance: (rows, cols) of the cells [S], by the circuit that was supposed; 0 where it
            has none. A noisy cell's is that of the usual cell.
        noisy: (row, column) of cells whose reading scatters by itself. It is not used.
    """

    adc: np.ndarray
    noise: float
    frames: int
    conductance: np.ndarray
    noisy: tuple[tuple[int, int], ...] = ()

    def quiet(self, frames: np.ndarray) -> np.ndarray:
        """(..., rows, cols) readings with those of noisy cells not read: NaN."""
        return np.where(mask_of(self.noisy, frames.shape[-2:]), np.nan, frames)


def measure_rest(frames, circuit: Circuit) -> Rest:
    """Return the rest of a skin that nothing touches.

    A few readings may scatter by themselves, as that of a loose contact: these are named. What
    touches changes a cell, and so the readings of its whole row and column.

    Args:
        frames: (n, rows, cols) ADC ratio, n at least 2; NaN where a crossing was not read.

    Raises:
        ValueError: another shape, values outside [0, 1], fewer than 2 frames, frames that differ
            by more than noise (something touches the skin), or readings that fit no skin.
    """
    frames = check_frames(frames, circuit)
    if len(frames) < 2:
        raise ValueError(f"{len(frames)} frame of the untouched skin: give 2 or more")
    if np.isnan(frames).all(0).any():
        row, col = np.argwhere(np.isnan(frames).all(0))[0]
        if circuit.populated[row, col]:
            raise ValueError(f"row {row}, column {col} was never read")
    frames = np.where(circuit.populated | ~np.isnan(frames), frames, 0.0)
    middle = np.nanmedian(frames, axis=0)
    off = np.nan_to_num(frames - middle) * circuit.full_scale  # ADC steps
    if min(circuit.shape) == 1:
        _check_alone(frames, middle, circuit)
        noisy: tuple = ()
        spread = np.median(np.abs(np.diff(off, axis=0)), axis=0) / (MAD * 2**0.5)
    else:
        noisy = _noisy_cells(off, middle, circuit)
        spread = np.sqrt(np.square(off).mean(0) * len(frames) / (len(frames) - 1))
    usual = circuit.populated & ~mask_of(noisy, circuit.shape)
    noise = float(np.median(spread[usual]))
    adc = np.where(usual, np.nanmean(frames, axis=0), middle)
    read = np.maximum(adc, HALF_STEP / circuit.full_scale)
    conductance = resting_conductance(read, circuit, noise / len(frames) ** 0.5, noisy)
    return Rest(adc, noise, len(frames), conductance, noisy)


def check_all_is_sent(frames: np.ndarray, circuit: Circuit, threshold: float, steps: float) -> None:
    """ValueError: the untouched cells of these frames lie below the board's threshold.

    Args:
        frames: (n, rows, cols) ADC ratio; NaN where a crossing was not read.
        threshold: ADC ratio up to which a reading says nothing; 0: all of them say something.
        steps: the same [ADC steps], for the message.
    """
    if not threshold:
        return
    silent = np.mean(np.median(np.nan_to_num(frames), axis=0)[circuit.populated] <= threshold)
    if silent > _FEW:
        raise ValueError(
            f"{silent:.0%} of the untouched cells read no more than "
            f"compensation's board_threshold = {steps:g} ADC steps: what they conduct must be "
            "known here. Let the board send all that it reads, and set board_threshold: 0"
        )


def _check_alone(frames: np.ndarray, middle: np.ndarray, circuit: Circuit) -> None:
    """ValueError: something touches one of the sensors that share one line only, or a single one.

    What touches moves one reading, as noise does, and their rest changes by half from one press to
    the next: only what conducts several times as much as usual is a touch.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        rises = circuit.two_terminal(middle) / circuit.two_terminal(frames)
    rises = np.where(circuit.populated, np.nan_to_num(rises, posinf=np.inf), 0.0)
    k, row, col = np.unravel_index(rises.argmax(), rises.shape)
    if rises[k, row, col] > _ALONE:
        raise ValueError(
            f"frame {k}, row {row}, column {col} conducts {rises[k, row, col]:.3g} times what it "
            f"usually does, {_ALONE:g} at most is a sensor at rest: does something touch it?"
        )


def _noisy_cells(off: np.ndarray, middle: np.ndarray, circuit: Circuit) -> tuple:
    """Return (row, column) of cells that scatter by themselves; ValueError: something touches.

    What touches moves the readings of its rows and columns as well. So does a cell that loses its
    contact, but it never conducts more than usual.
    """
    drift = _drift(off) / np.maximum(middle * circuit.full_scale, HALF_STEP / _COMMON)
    if abs(common := float(np.median(drift[circuit.populated]))) > _COMMON:
        raise ValueError(
            f"all readings drift by {common:+.0%} in these frames: does something touch the skin, "
            "or has it just been taken off?"
        )
    noise = _noise(off[:, circuit.populated])
    strays = _strays(off, middle, noise, circuit)
    row, col = np.nonzero(strays)
    own, calm = off[:, row, col], np.ma.array(off, mask=np.broadcast_to(strays, off.shape))
    carried = np.ma.median(calm, 2)[:, row] + np.ma.median(calm, 1)[:, col]
    with np.errstate(invalid="ignore"):  # a row of one cell carries nothing
        alike = np.abs(np.corrcoef(own.T, carried.filled(0.0).T)) > _TOGETHER
    beside = (row[:, None] == row) | (col[:, None] == col)
    beside |= np.maximum(abs(row[:, None] - row), abs(col[:, None] - col)) == 1
    together = beside & alike[: row.size, : row.size]  # each with itself, too
    power = np.square(own).sum(0)
    cells = ~(together & (power[:, None] > power)).any(0)  # others follow a stronger one
    high = (middle[row, col] + own / circuit.full_scale).max(0)
    usual = np.median(circuit.two_terminal(middle)[circuit.populated])
    touched = (together.sum(0) > 1) | alike[row.size :, : row.size].diagonal()
    touched &= circuit.two_terminal(high) < usual / _LOOSE
    most = max(_MOST, _FEW * np.count_nonzero(circuit.populated))
    if touched.any() or np.count_nonzero(cells) > most:
        k, at = np.unravel_index(np.abs(own).argmax(), own.shape)
        raise ValueError(
            f"frame {k}, row {row[at]}, column {col[at]} reads {own[k, at]:+.0f} ADC steps off "
            f"the median, noise is {noise:.1f}: does something touch the skin, or is a contact "
            "loose?"
        )
    return tuple(zip(row[cells].tolist(), col[cells].tolist(), strict=True))


def _noise(off: np.ndarray) -> float:
    """Return the RMS of a usual reading [ADC steps], of (n, cells) from their medians.

    All cells of a small skin move under a touch, but seldom from each frame to the next. Noise may
    be slow, too, a hum: the usual spread counts, up to that of the noisiest board.
    """
    quick = robust_std(np.abs(np.diff(off, axis=0))) / 2**0.5
    return max(quick, min(float(np.median(off.std(0))), MAX_NOISE))


def _strays(off: np.ndarray, middle: np.ndarray, noise: float, circuit: Circuit) -> np.ndarray:
    """Return (rows, cols) bool, readings that scatter, leave the others, or drift."""
    share = _STRAYS * middle * circuit.full_scale
    strays = np.abs(off).max(0) > MOVED * max(noise, 1.0) + share
    strays |= np.square(off).mean(0) ** 0.5 > max(NOISY * noise, NOISY_STEPS)
    slow = MOVED * noise / (len(off) / 3) ** 0.5 + NOISY_STEPS + share
    return strays | (np.abs(_drift(off)) > slow)


def _drift(off: np.ndarray) -> np.ndarray:
    """Return (rows, cols) from the first third of the frames to the last [ADC steps]."""
    third = max(len(off) // 3, 1)
    return off[-third:].mean(0) - off[:third].mean(0)


def check_frames(frames, circuit: Circuit) -> np.ndarray:
    """(n, rows, cols) floats; ValueError says what is wrong with them."""
    frames = np.asarray(frames, dtype=float)
    if frames.ndim != 3 or frames.shape[1:] != circuit.shape:
        rows, cols = circuit.shape
        raise ValueError(f"frames have shape {frames.shape}: must be (n, {rows}, {cols})")
    bad = (frames < 0.0) | (frames > 1.0) | np.isinf(frames)
    if bad.any():
        k, row, col = np.argwhere(bad)[0]
        raise ValueError(
            f"frame {k}, row {row}, column {col} = {frames[k, row, col]:g}: must be an ADC ratio "
            "from 0 to 1, or NaN if it was not read"
        )
    return frames


def check_times(name: str, times, n: int, least: float = 0.0) -> np.ndarray:
    """(n,) floats that rise, over `least` [s] or more; ValueError: they do not."""
    times = np.asarray(times, dtype=float)
    if times.shape != (n,) or not (np.diff(times) > 0.0).all():
        raise ValueError(f"{name} have shape {times.shape}: must be {n} that rise")
    if least and (not n or times[-1] - times[0] < least):
        raise ValueError(f"{name}: less than {least:g} s")
    return times


def resting_conductance(
    adc: np.ndarray, circuit: Circuit, noise: float = 0.0, noisy=()
) -> np.ndarray:
    """Return the (rows, cols) conductance [S] of the cells of a skin that reads `adc`.

    Args:
        adc: (rows, cols) ADC ratio; NaN where a crossing was not read.
        noise: of the reading [ADC steps].
        noisy: (row, column) of cells whose reading is not used, as of those that were not read:
            they conduct as the usual cell.

    Raises:
        ValueError: no cells near one another's resistance read so.
    """
    cells = circuit.populated
    unused = cells & ~np.isfinite(adc) | mask_of(noisy, circuit.shape)
    known = cells & ~unused
    usual = usual_resistance(adc, known, circuit)
    if not 0.0 < usual < np.inf:
        raise ValueError("the readings fit no skin: r_par or r_ref is wrong, or no cell")
    curve = PressureCurve((0.0, 1.0), (usual * REST_SPAN, usual / REST_SPAN))
    adc = np.where(np.isfinite(adc), adc, 0.0)
    adc = np.where(unused, np.median(adc[known]), adc)
    for _ in range(_ROUNDS if unused.any() else 1):
        found = compensate(adc, circuit, curve, "newton", noise=max(noise, EXACT_NOISE))
        if found.status == "failed":
            raise ValueError(f"the readings fit no skin: {found.message}")
        conductance = np.where(cells, 1.0 / curve.resistance(found.force), 0.0)
        conductance[unused & cells] = np.median(conductance[known])
        if unused.any():
            model = forward(circuit, 1.0 / np.where(cells, conductance, 1.0))
            adc = np.where(unused, model, adc)
    return conductance


def usual_resistance(adc: np.ndarray, known: np.ndarray, circuit: Circuit) -> float:
    """Return that of a cell [ohm], if (rows, cols) `adc` is read of equal ones, by those known.

    Foster's theorem: conductance times two-terminal resistance of equal cells is
    (rows + cols - 1) / cells.
    """
    scale, offset = readouts.apparent(circuit, np.where(known, adc, np.median(adc[known])))
    with np.errstate(divide="ignore"):
        rho = np.maximum(circuit.r_ref * scale / np.where(known, adc, 1.0) - offset, 0.0)
    return float(np.median(rho[known])) / circuit.readout_class.product(circuit)


def mask_of(cells, shape: tuple[int, int]) -> np.ndarray:
    """Return (rows, cols) bool of some (row, column)."""
    mask = np.zeros(shape, bool)
    mask[tuple(np.array(list(cells), int).reshape(-1, 2).T)] = True
    return mask


def supposing(rest: Rest, circuit: Circuit) -> Rest:
    """Return the same readings, by another circuit."""
    noise = rest.noise / rest.frames**0.5
    found = resting_conductance(rest.adc, circuit, noise, rest.noisy)
    return replace(rest, conductance=found)
