"""What an untouched skin reads, and what its cells then conduct, whatever curve they follow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import PressureCurve
from ..solvers import compensate

REST_SPAN = 500.0  # times the usual cell's resistance, either way, that a cell at rest may have
# (one that stays pressed, or is dead)
_STILL = 8.0, 0.02  # times the noise, and share of a reading, by which a reading may stray
_LEAST_NOISE = 1e-3  # ADC steps of a mean reading: rounding alone leaves more


@dataclass(frozen=True, eq=False)
class Rest:
    """An untouched skin.

    Attributes:
        adc: (rows, cols) mean reading, ADC ratio; NaN where a crossing was never read.
        noise: RMS of a single reading [ADC steps].
        frames: how many were averaged.
        conductance: (rows, cols) of the cells [S], by the circuit that was supposed; 0 where it
            has none.
    """

    adc: np.ndarray
    noise: float
    frames: int
    conductance: np.ndarray


def measure_rest(frames, circuit: Circuit) -> Rest:
    """The rest of a skin that nothing touches.

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
    adc = np.nanmean(np.where(circuit.populated | ~np.isnan(frames), frames, 0.0), axis=0)
    off = np.nan_to_num(frames - adc) * circuit.full_scale  # ADC steps
    spread = off.std(0)
    noise = float(np.median(spread[circuit.populated]) * (len(frames) / (len(frames) - 1)) ** 0.5)
    strayed = np.abs(off) > _STILL[0] * max(noise, 1.0) + _STILL[1] * adc * circuit.full_scale
    if strayed.any():
        k, row, col = np.argwhere(strayed)[0]
        raise ValueError(
            f"frame {k}, row {row}, column {col} reads {off[k, row, col]:+.0f} ADC steps off the "
            f"mean, noise is {noise:.1f}: does something touch the skin?"
        )
    conductance = resting_conductance(adc, circuit, noise / len(frames) ** 0.5)
    return Rest(adc, noise, len(frames), conductance)


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


def resting_conductance(adc: np.ndarray, circuit: Circuit, noise: float = 0.0) -> np.ndarray:
    """(rows, cols) conductance [S] of the cells of a skin that reads `adc`: the exact inverse.

    Args:
        noise: of the reading [ADC steps].

    Raises:
        ValueError: no cells near one another's resistance read so.
    """
    cells = circuit.populated
    known = cells & np.isfinite(adc)
    share = (sum(circuit.shape) - 1) / np.count_nonzero(cells)  # Foster: g * rho of equal cells
    usual = float(np.median(circuit.two_terminal(adc[known]))) / share  # ohm
    if not 0.0 < usual < np.inf:
        raise ValueError("the readings fit no skin: r_par or r_ref is wrong, or no cell")
    curve = PressureCurve((0.0, 1.0), (usual * REST_SPAN, usual / REST_SPAN))
    adc = np.where(np.isfinite(adc), adc, 0.0)
    found = compensate(adc, circuit, curve, "newton", noise=max(noise, _LEAST_NOISE))
    if found.status == "failed":
        raise ValueError(f"the readings fit no skin: {found.message}")
    return np.where(cells, 1.0 / curve.resistance(found.force), 0.0)


def supposing(rest: Rest, circuit: Circuit) -> Rest:
    """The same readings, by another circuit."""
    noise = rest.noise / rest.frames**0.5
    return replace(rest, conductance=resting_conductance(rest.adc, circuit, noise))
