"""What the cells of an untouched skin conduct, whatever curve they follow: the exact inverse."""

from __future__ import annotations

import numpy as np

from ..physics import readouts
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from .newton import newton
from .reading import check_reading

REST_SPAN = 500.0  # times the usual cell's resistance, either way, that a cell at rest may have
# (one that stays pressed, or is dead)
_LEAST_NOISE = 1e-3  # ADC steps of a mean reading: rounding alone leaves more
_ROUNDS = 3  # in which the readings of noisy cells are put in place


def resting_conductance(
    adc: np.ndarray, circuit: Circuit, noise: float = 0.0, noisy=()
) -> np.ndarray:
    """Return the (rows, cols) conductance [S] of the cells of a skin that reads `adc`.

    Args:
        noise: of the reading [ADC steps].
        noisy: (row, column) of cells whose reading is not used: they conduct as the usual cell.

    Raises:
        ValueError: no cells near one another's resistance read so.
    """
    cells = circuit.populated
    unused = mask_of(noisy, circuit.shape)
    known = cells & np.isfinite(adc) & ~unused
    usual = usual_resistance(adc, known, circuit)
    if not 0.0 < usual < np.inf:
        raise ValueError("the readings fit no skin: r_par or r_ref is wrong, or no cell")
    curve = PressureCurve((0.0, 1.0), (usual * REST_SPAN, usual / REST_SPAN))
    adc = np.where(np.isfinite(adc), adc, 0.0)
    adc = np.where(unused, np.median(adc[known]), adc)
    for _ in range(_ROUNDS if noisy else 1):
        found = newton(check_reading(adc, circuit, curve, noise=max(noise, _LEAST_NOISE)))
        if found.status == "failed":
            raise ValueError(f"the readings fit no skin: {found.message}")
        conductance = np.where(cells, 1.0 / curve.resistance(found.force), 0.0)
        conductance[unused & cells] = np.median(conductance[known])
        model = forward(circuit, 1.0 / np.where(cells, conductance, 1.0)) if noisy else adc
        adc = np.where(unused, model, adc)
    return conductance


def usual_resistance(adc: np.ndarray, known: np.ndarray, circuit: Circuit) -> float:
    """Return that of a cell [ohm], if (rows, cols) `adc` is read of equal ones, by those known.

    Foster's theorem: conductance times two-terminal resistance of equal cells is
    (rows + cols - 1) / cells.
    """
    scale, offset = readouts.apparent(circuit, np.where(known, adc, np.median(adc[known])))
    share = 1.0
    if circuit.readout == "floating":
        share = (sum(circuit.shape) - 1) / np.count_nonzero(circuit.populated)
    with np.errstate(divide="ignore"):
        rho = np.maximum(circuit.r_ref * scale / np.where(known, adc, 1.0) - offset, 0.0)
    return float(np.median(rho[known])) / share


def mask_of(cells, shape: tuple[int, int]) -> np.ndarray:
    """Return (rows, cols) bool of some (row, column)."""
    mask = np.zeros(shape, bool)
    mask[tuple(np.array(list(cells), int).reshape(-1, 2).T)] = True
    return mask
