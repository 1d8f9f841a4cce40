"""From a reading to the force on each cell: one entry, `compensate`, and the methods behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import network
from .circuit import Circuit, two_terminal_resistance
from .curve import PressureCurve


@dataclass(frozen=True, eq=False)
class Estimate:
    """What `compensate` found in one frame.

    Attributes:
        force: (rows, cols) force on each cell [N].
        std: (rows, cols) one standard deviation of `force` [N].
        residual: RMS misfit between the reading and the circuit model of `force`, in ADC steps.
        status: "ok", "suspect" (the circuit model does not explain the reading) or "failed".
        message: why, for a person; empty when ok.
        method: the method that was used ("auto" names its choice).
        iterations: steps that it took; 0 for a closed form.
    """

    force: np.ndarray
    std: np.ndarray
    residual: float
    status: str
    message: str
    method: str
    iterations: int


def compensate(
    adc, circuit: Circuit, curve: PressureCurve, method: str = "auto", *, weights=None
) -> Estimate:
    """Undo the cross-talk of one frame.

    Args:
        adc: (rows, cols) reading as ADC ratio, in [0, 1].
        method: "naive" (paper section V: each reading taken for its own cell), "fixed_point" (the
            literature's g <- g * rho(g) / rho_measured), "cnn" (the paper's network), or "auto".
        weights: a `network.Weights` for the learned methods; None: those shipped with the package.

    Raises:
        ValueError: wrong shape, NaN, a reading outside [0, 1], an unknown method, or weights that
            were made for another circuit or curve.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r}: must be one of {', '.join(METHODS)}")
    adc = check_reading(adc, circuit)
    return METHODS[method](adc, circuit, curve, weights)


def check_reading(adc, circuit: Circuit) -> np.ndarray:
    """The reading as a float array; ValueError says what is wrong with it, and where."""
    adc = np.asarray(adc, dtype=float)
    if adc.shape != circuit.shape:
        raise ValueError(f"reading has shape {adc.shape}: the circuit is {circuit.shape}")
    bad = ~((adc >= 0.0) & (adc <= 1.0))
    if bad.any():
        row, col = np.argwhere(bad)[0]
        raise ValueError(
            f"reading: {np.count_nonzero(bad)} of {adc.size} values are not in [0, 1], "
            f"the first {adc[row, col]} at row {row}, column {col}"
        )
    return adc


def naive(adc, circuit, curve, weights=None) -> Estimate:
    """Each reading taken for its own cell's resistance: sees ghosts where parallel paths cross."""
    force = curve.force(circuit.two_terminal(adc)) * circuit.populated
    return judge(force, adc, circuit, curve, "naive")


def fixed_point(adc, circuit, curve, weights=None) -> Estimate:
    """g <- g * rho(g) / rho_measured until the reading is met to the ADC's rounding.

    Foster's theorem (the sum of g*rho is rows + cols - 1) gives the start. Each step costs one
    small inverse; convergence is linear, and slow under a broad load.
    """
    rho_measured = np.minimum(circuit.two_terminal(adc), 1e12)
    rho_measured = np.maximum(rho_measured, 1e-3)  # a short: keep the steps finite
    populated = circuit.populated
    g = populated * (sum(circuit.shape) - 1) / np.count_nonzero(populated) / rho_measured
    iterations = 0
    while iterations < FIXED_POINT_STEPS:
        iterations += 1
        rho = two_terminal_resistance(g)
        misfit = (circuit.ratio(rho) - adc)[populated] * circuit.full_scale
        if np.square(misfit).mean() < 0.25**2:  # less than rounding to an ADC step costs
            break
        g = g * (rho / rho_measured)
    with np.errstate(divide="ignore"):
        force = curve.force(1.0 / g) * populated
    return judge(force, adc, circuit, curve, "fixed_point", iterations)


FIXED_POINT_STEPS = 60


def cnn(adc, circuit, curve, weights=None) -> Estimate:
    """The paper's network: one pass, no iteration."""
    weights = weights or network.shipped("paper")
    weights.check(circuit, curve)
    force = weights.predict(adc) * circuit.populated
    return judge(force, adc, circuit, curve, "cnn")


def auto(adc, circuit, curve, weights=None) -> Estimate:
    return cnn(adc, circuit, curve, weights)


METHODS = {"naive": naive, "fixed_point": fixed_point, "cnn": cnn, "auto": auto}


def judge(force, adc, circuit, curve, method, iterations=0) -> Estimate:
    """An Estimate of a method that does not know its own error.

    Its spread is taken from the misfit: how far each cell's resistance would have to move, alone,
    to meet that cell's own reading (d u / d log R = -g u^2 rho^2 / R_ref).
    """
    resistance = curve.resistance(force)
    g = np.where(circuit.populated, 1.0 / resistance, 0.0)
    rho = two_terminal_resistance(g)
    model = circuit.ratio(rho)
    misfit = (adc - model) * circuit.full_scale
    slope = g * np.square(model * rho) / circuit.r_ref * circuit.full_scale  # steps per log R
    shift = np.hypot(misfit, 0.5) / np.maximum(slope, 1e-9)
    factor = np.exp(np.minimum(shift, 50.0))
    std = 0.5 * (curve.force(resistance / factor) - curve.force(resistance * factor))
    residual = float(np.sqrt(np.square(misfit).mean()))
    std *= circuit.populated
    return Estimate(force, std, residual, "ok", "", method, iterations)
