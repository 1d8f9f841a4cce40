# SPDX-License-Identifier: Apache-2.0
"""Does a frame ask for another r_par than the circuit's? See docs/derivation.md, "Which R_par"."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ..estimate import Estimate
from ..evidence import RELEVANT, REST_FRAMES, SOFT, Supposed, series_scale
from ..fixed_point import last_guess
from ..reading import Reading
from ..suspect import rounded

# Of one frame: standard deviations, and share of `series_scale`, by which r_par is off. Chosen on
# frames as of benchmarks/single_frames.py, seeds 77 and 99; scored on others.
_SURE = 3.5
_TOLERANCE = 0.5  # of `series_scale`, beyond which it is another fault
# Standard deviations by noise, by the fit that there is, from which on a frame is fitted anew. That
# takes five times as long; frames of sound boards often reach 3. Chosen on bodies, blobs and
# pictures of boards with another r_par (seed 15) and on streams (benchmarks.faults, seed 91001:
# with 5 twice as many frames are silent); scored on seed 92407. With what is left of the misfit it
# must be as sure as the full look, or only once where the rest is unknown, as the shift then seems
# too small. Chosen on bodies and blobs (seed 77: of 435 frames that ask for another r_par 4 are
# missed) and on streams (seeds 501 and 502: of 333 none).
_GLANCE = 4.0
# RMS of log conductance of the cells of a sound fabric at rest, where it was not measured: 0.03 to
# 0.05 (health/rest_picture.py has the least).
_REST_SCATTER = 0.05
# Equal readings that are rounded to whole steps err equally, and do not average out: factor by
# which the standard deviation is larger.
_ROUNDED = 2.8
_BELOW_PRESSED = 0.9  # of the conductance at the curve's end, that a cell at rest keeps below

Fit = Callable[[Reading, np.ndarray], Estimate]


def with_other_r_par(reading: Reading, fit: Fit, estimate: Estimate) -> Estimate | None:
    """Return a frame with the r_par that its rest asks for, as a suspect one.

    Args:
        fit: the estimate of a reading from conductances (rows, cols) [S].
        estimate: that with the circuit's r_par.

    Returns:
        None: it asks for no other, or is explained worse by that.
    """
    found = other_r_par(reading, last_guess(reading, estimate))
    if found is None:
        return None
    better = fit(found.reading, last_guess(found.reading, estimate))
    worse = reading.n_informative * (better.residual**2 - estimate.residual**2)
    if better.status == "failed" or worse > reading.fitted_noise**2 * np.log(reading.n_informative):
        return None
    numbers = {"r_par": reading.circuit.r_par, "better": found.r_par, "std": found.std}
    iterations = estimate.iterations + better.iterations
    residual = estimate.residual  # of the circuit as it is given
    better = replace(better, r_par=found.r_par, residual=residual, iterations=iterations)
    return better.doubted(Finding(Kind.CIRCUIT, "fits better", numbers=numbers))


class OtherRPar(NamedTuple):
    """What a frame asks for in place of the circuit's r_par.

    Attributes:
        r_par, std: [ohm].
        reading: the frame as one of a board with that r_par, whose rest was measured with it.
    """

    r_par: float
    std: float
    reading: Reading


def other_r_par(reading: Reading, g: np.ndarray) -> OtherRPar | None:
    """Return the r_par that the rest of a frame asks for; None: the circuit's, or it tells none.

    Args:
        g: (rows, cols) conductance [S] of a fit of the frame.
    """
    circuit, curve = reading.circuit, reading.curve
    supposed = _supposed(circuit, curve)
    noise = reading.fitted_noise
    scatter = _REST_SCATTER if curve.offset is None else 0.0
    shift, std, left = supposed.glance(reading, g, noise, scatter)
    most = _TOLERANCE * series_scale(circuit)
    if not max(_GLANCE * std, left if scatter else _SURE * left) <= abs(shift) < most:
        return None
    found = supposed.evidence(np.where(reading.known, reading.adc, np.nan), noise, g)
    if found is None or not (information := found.information[0, 0]) > 0.0:
        return None
    shift, by_rest = found.score[0] / information, found.by_rest / information
    if scatter:
        of_rest = scatter * np.square(by_rest[0] * supposed.rest).sum() ** 0.5
    else:
        of_rest = np.square(supposed.by_reading(by_rest)[0]).sum() ** 0.5
        of_rest *= noise / REST_FRAMES**0.5
    slack = _ROUNDED if rounded(reading) else 1.0
    std = np.hypot(slack * max(found.chi2 / found.count, 1.0) ** 0.5 * information**-0.5, of_rest)
    relevant = max(_SURE * std, RELEVANT * series_scale(circuit)) < abs(shift) < most
    if not relevant or circuit.r_par + shift + _SURE * std < 0.0:
        return None
    r_par = max(circuit.r_par + shift, 0.0)
    if curve.offset is not None:
        rest = supposed.rest + (r_par - circuit.r_par) * supposed.shift
        ends = 0.1 * supposed.rest, _BELOW_PRESSED / curve.points[-1][1]  # to first order
        rest = np.where(circuit.populated, np.clip(rest, *ends), 1.0 / curve.points[0][1])
        curve = curve.resting_at(1.0 / rest)
    other = replace(reading, circuit=replace(circuit, r_par=r_par), curve=curve)
    return OtherRPar(r_par, std, other)


@lru_cache(maxsize=16)
def _supposed(circuit: Circuit, curve: PressureCurve) -> Supposed:
    return Supposed(circuit, circuit.populated / curve.rest_resistance, SOFT)
