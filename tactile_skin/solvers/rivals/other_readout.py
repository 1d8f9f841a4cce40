# SPDX-License-Identifier: Apache-2.0
"""Does another readout than the circuit's explain a frame? See docs/derivation.md, "When to doubt".

Where few cells are at rest, those of a wrong readout can meet the readings as those of the right
one do, and the misfit tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN, PASSIVE
from ..estimate import Estimate
from ..fixed_point import first_guess, iterate, last_guess
from ..newton import cells_that_fit, newton
from ..prior import differences, force_of, pressed, roughness
from ..reading import Reading, check_reading, rest_reading

_SPAN = 1e3  # times the curve's rest, up and down, within which another readout's cells may rest
_REST_ERROR = 0.05  # ADC steps by which these may miss the untouched skin's readings
_LIFTED = 1.02  # times its conductance at rest from which on a cell counts as touched
# Shares of the cells that are touched:
_ASK = 0.2  # from which on the misfit may tell nothing
_HALF = 0.5  # up to which another network may be compared by cost
_COVERED = 0.75  # from which on a floating matrix' light load may be the hard one of a driven one
# By how much the fit of another must be likelier, in units of 1/2 chi^2. Chosen on pictures,
# bodies, rects, random loads and whole lines on right and exchanged readouts (seeds 57221 to
# 57251), scored on others (benchmarks/accuracy/readouts.py, wrong).
_BETTER = 15.0
_EVEN = 0.03  # least spread of neighbours' log conductance that is looked for
_NO_LEVEL = 0.02  # level of a picture that nothing touches
# Times nearer to the curve's rest that cells must be by a rival's explanation of a light load as a
# hard one. Chosen on even loads (8 x 8, seed 9) on fabrics that rest as the curve says; of those
# that rest 0.7 to 2.2 times so none was suspect.
_NEARER = {"floating": 2.0, "loaded": 1.1}
_HARDER = {"floating": 1.0, "loaded": 10.0}  # times harder that this must be
_STEPS = 8  # of the fixed point, by which a readout may be ruled out,
_FAR = 20.0  # by 1/2 chi^2 a cell that they leave

Fit = Callable[[Reading, np.ndarray], np.ndarray]


def other_readout(
    reading: Reading, estimate: Estimate, start: Estimate | None, fit: Fit
) -> Finding | None:
    """Return that a frame that is explained is rather that of another readout.

    Args:
        start: the last frame's estimate, None: there is none. A frame that is one of a touch for
            which it was asked before is not asked again.
        fit: conductances (rows, cols) [S] of the likeliest touches near given ones.
    """
    own, floating = reading.circuit, reading.circuit.readout == "floating"
    g, share = _touched(reading, estimate)
    least = _COVERED if floating else _ASK
    known = start is not None and start.status == "ok" and _touched(reading, start)[1] >= least
    if share < least or known or reading.late():
        return None
    mine = None
    for circuit, curve in _others(own, reading.curve):
        less = PASSIVE.index(own.readout) < PASSIVE.index(circuit.readout)
        light = less and share >= _COVERED  # here, and maybe a hard load there
        if light and _off(reading.curve) < _NEARER[own.readout] * _off(curve):
            continue  # light loads alone are those of either
        if not light and circuit.readout != own.readout and share > _HALF:
            continue  # of two networks the one that loads change less has them smoother
        other = replace(reading, circuit=circuit, curve=curve).above_cut_off()
        guess, _ = iterate(other, first_guess(other), _STEPS, other.fitted_noise)
        chi2 = 0.5 * np.square(other.misfit(other.model(guess)) / other.fitted_noise).sum()
        if chi2 > _FAR * guess.size:
            continue
        if light:
            # A hard load reads like an even, light one where readings change less with the loads,
            # and nothing but that reads like a load there.
            hard, here = force_of(other, guess)[0].sum(), force_of(reading, g)[0].sum()
            found = hard > _HARDER[own.readout] * here and cells_that_fit(other) is not None
        else:
            mine = _Touches(reading, fit(reading, g)) if mine is None else mine
            theirs = _Touches(other, fit(other, guess))
            found = theirs.unlikely(mine) < mine.unlikely(mine) - _BETTER
        if found:
            better = f"readout = {circuit.readout}, driven = {circuit.driven}"
            return Finding(Kind.READOUT, "frame" if floating else "frame, driven", detail=better)
    return None


def _touched(reading: Reading, estimate: Estimate) -> tuple[np.ndarray, float]:
    """(rows, cols) conductance [S] of an estimate, and the share of its cells that are touched."""
    g = last_guess(reading, estimate)
    touched = np.count_nonzero(g > _LIFTED * reading.bounds[0])
    return g, touched / np.count_nonzero(reading.circuit.populated)


class _Touches:
    """A readout's explanation of a frame.

    Attributes:
        level: mean log of what touched cells conduct over that at rest.
        spread: of the usual cell's log conductance by the noise of its reading, or `_EVEN`.
    """

    def __init__(self, reading: Reading, g: np.ndarray):
        populated = reading.circuit.populated
        self._x = pressed(reading, g)[1]
        self._between = differences(reading.circuit)
        touched = populated & (g > _LIFTED * reading.bounds[0])
        self.level = float(self._x[touched].mean()) if touched.any() else _NO_LEVEL
        misfit = reading.misfit(reading.model(g)) / reading.fitted_noise
        cells = np.flatnonzero(populated).astype(np.int32)
        jacobian = reading.linearised(g, reading.fitted_noise).jacobian(cells, cells).astype(float)
        jacobian *= g.ravel()[cells]
        precision = jacobian.T @ jacobian
        precision.flat[:: cells.size + 1] += 1.0  # what is known of a cell that is in no reading
        self.spread = max(_EVEN, float(np.median(precision.diagonal() ** -0.5)))
        # A readout whose readings change more with the loads explains a frame by loads that differ
        # less, whichever readout is right: how much the readings narrow the loads down (Laplace).
        width = float(np.linalg.slogdet(precision)[1])
        self._unlikely = 0.5 * (float(np.square(misfit).sum()) + width)

    def unlikely(self, other: _Touches) -> float:
        """Minus the log of its likelihood, but for a constant.

        How hard all of a touch is says as much as one cell, not as all of them; and noise is no
        unevenness. So the pictures are compared at one level and with one spread.

        Args:
            other: the explanation that it is compared with, which has these.
        """
        picture = self._x * (other.level / self.level)
        return self._unlikely + roughness(picture, self._between, other.spread)


def _off(curve: PressureCurve) -> float:
    """Factor by which the usual cell's rest differs from the curve's, 1 or more."""
    times = float(np.median(curve.rest_resistance)) / curve.points[0][1]
    return max(times, 1.0 / times)


@lru_cache(maxsize=16)
def _others(circuit: Circuit, curve: PressureCurve) -> list[tuple[Circuit, PressureCurve]]:
    """Driven readouts with which a skin can read at rest what this one does, and its curve then.

    No floating one: an even, light load on it explains whatever presses hard on a driven matrix.
    """
    found = []
    rest, usual = rest_reading(circuit, curve), curve.points[0][1]
    wide = PressureCurve((0.0, 1.0), (usual * _SPAN, usual / _SPAN))
    for readout in PASSIVE[1:]:
        for driven in DRIVEN:
            other = circuit.read_as(readout, driven)
            fit = newton(check_reading(rest, other, wide, noise=0.0))
            if other == circuit or fit.residual > _REST_ERROR:
                continue
            try:
                found.append((other, curve.resting_at(wide.resistance(fit.force))))
            except ValueError:  # a cell would rest as one that is pressed
                continue
    return found
