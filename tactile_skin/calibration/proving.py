# SPDX-License-Identifier: Apache-2.0
"""Whether known weights prove a skin's newtons: how a palm is felt if something else is true.

A weight shows the sum of what its cells say, at its own pressure. An entry that is wrong changes
readings by another law than the curve that makes up for it: r_ref, the supply and the ADC's full
scale as another r_par does, exactly on a floating matrix, and so does r_par itself. So each r_par
above the one that is used, and that neither the touches nor the weights exclude, is given the curve
that the weights have with it; a palm on that skin is read, and felt by what is used.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..physics.proof import CONFIDENCE, MOST
from ..solvers import compensate
from ..solvers.evidence import SOFT, Supposed, series_scale
from ..solvers.reading import ROUNDING_NOISE
from ..solvers.suspect import BEYOND
from .curve_fit import FittedCurve
from .identify import CONTRADICTION, FEWEST, converter_end, prior_of, std_of
from .rest import Rest, supposing

# Relative standard deviation of the force of one press on real fabric that was calibrated in the
# same session: 2 to 5 % in the median and up to 15 % at the 90th percentile on Velostat at one
# place, 8 to 15 % in the median over all places (seven public data sets).
REPEATABLE = 0.1
# Standard deviation of the power of its conductance as which a fabric's force rises beyond what a
# weight has shown, chosen: those of Velostat and of force-sensing resistors are 0.8 to 1.2.
_POWER = 0.15
# Of a factor on the curve by one weight, beyond which an entry is off.
LEAST_FACTOR = 0.5
MOST_FACTOR = 2.0
MOST_ERROR = (MOST - 1.0) / CONFIDENCE  # a stop that counts `MOST` at most covers no more
PALM = 45.0  # N: a person who is pressed, below the 65 N of ISO/TS 15066 for hands
_WIDE = 0.02  # m, standard deviation of its pressure: a palm is some 80 mm wide
LEAST = 2.0 / 3.0  # share of it that is to be felt
_PLACES = (0.5, 0.5), (0.3, 0.65)  # share of the rows and columns before its centre
_FIRST = 0.25  # of `series_scale`: the first step to another r_par,
_FURTHER = 1.5  # and the factor of each further step
_NARROW = 2.0  # largest over smallest weight up to which they say nothing of the curve's shape
_ROUNDS = 2  # in which a factor is found
_FINEST = 0.06  # of it, a step that is not halved any more
_TRIED = 12  # r_par at most: to 40 times `series_scale`
# Twice the logarithm of a likelihood ratio below which weights exclude nothing: 3 standard
# deviations.
_EXCLUDED = 9.0

# (circuit, rest by it) -> the curve that the weights have with it, and the (n,) relative errors
# that it leaves of them; none: they can leave none
CurveBy = Callable[[Circuit, Rest], tuple[PressureCurve, np.ndarray]]
Refit = Callable[[Circuit, Rest], FittedCurve]


@dataclass(frozen=True)
class Tried:
    """A circuit, the rest by it, and a curve.

    Attributes:
        off: (n,) relative errors that the curve leaves of the weights.
    """

    circuit: Circuit
    rest: Rest
    curve: PressureCurve
    off: np.ndarray

    def resting(self, most: float) -> PressureCurve:
        """Return the curve of its cells, up to `most` [N] at least."""
        cells = self.circuit.populated
        usual = float(np.median(self.rest.conductance[cells]))  # S
        at_rest = 1.0 / np.where(cells, self.rest.conductance, usual)
        return self.curve.up_to(most).resting_at(at_rest)

    def read(self, force: np.ndarray) -> np.ndarray:
        """(..., rows, cols) [N] -> ADC ratio."""
        return np.clip(forward(self.circuit, self.resting(force.max()).resistance(force)), 0.0, 1.0)

    def cells(self, adc: np.ndarray, most: float) -> np.ndarray:
        """(..., rows, cols) ADC ratio -> force [N], up to `most` at least."""
        return compensate(adc, self.circuit, self.resting(most), "map", missing=True).force

    def felt(self, adc: np.ndarray, most: float) -> np.ndarray:
        """(n, rows, cols) ADC ratio -> (n,) total force [N]."""
        return self.cells(adc, most).sum((1, 2))


@dataclass(frozen=True)
class Known:
    """What was known before one weight was laid on.

    Attributes:
        error: relative standard deviation that weights have proved; None: the curve is of some
            other fabric.
        r_par_std: of r_par, as touches found it then [ohm].
    """

    error: float | None = None
    r_par_std: float = np.inf


class Gain(NamedTuple):
    """What one weight shows.

    Attributes:
        factor: on the curve.
        error: relative standard deviation of a force.
        why: it is no proof; "": it is one.
        more: whether more touches may make it one.
    """

    factor: float
    error: float
    why: str
    more: bool


def times(curve: PressureCurve, factor: float, shape: tuple[int, int]) -> PressureCurve:
    """Return the curve of cells that bear `factor` times the force, to the same end."""
    gain = np.ones(shape) if curve.gain is None else curve.gain
    return curve.with_gain(factor * gain).up_to(curve.max_force)


def palms(circuit: Circuit, pitch: float) -> np.ndarray:
    """(n, rows, cols) [N] palms on cells that lie `pitch` [m] from one another."""
    row, col = np.indices(circuit.shape)
    found = []
    for at in _PLACES:
        middle = np.multiply(at, np.subtract(circuit.shape, 1))
        off = np.square(row - middle[0]) + np.square(col - middle[1])
        force = np.exp(-0.5 * off * (pitch / _WIDE) ** 2) * circuit.populated
        found.append(PALM * force / max(force.sum(), 1e-9))
    return np.array(found)


def error_of(error: float, hardest: float, force: np.ndarray) -> float:
    """Return the relative standard deviation of a palm's force.

    Args:
        error: the same of a new weight.
        hardest: force on the hardest cell under the weights [N].
        force: (n, rows, cols) of palms [N].
    """
    beyond = np.log(max(float(force.max()) / hardest, 1.0))
    return float(np.hypot(max(error, REPEATABLE), _POWER * beyond))


def by_weights(
    fitted: FittedCurve, refit: Refit, circuit: Circuit, rest: Rest, frames, loads, touches, pitch
) -> tuple[float, str]:
    """Return the error that weights prove, and why they prove nothing; "": they do.

    Args:
        refit: (circuit, rest by it) -> what the same weights fit with it.
        circuit: with which the curve was fitted.
        frames: (n, rows, cols) ADC ratio of the weights, or of the hardest loads.
        loads: (m,) force of those that were used [N].
        touches: (k, rows, cols) ADC ratio of ordinary touches.
        pitch: of the cells [m].
    """
    off = np.delete(fitted.off, fitted.odd)
    used = Tried(circuit, supposing(rest, circuit), fitted.curve, off)
    force = palms(circuit, pitch)
    hardest = float(used.cells(np.asarray(frames), float(np.max(loads))).max())
    error = error_of(fitted.error, hardest, force)
    if 2 * fitted.unexplained > fitted.off.size:
        return error, f"{fitted.unexplained} of {fitted.off.size} weights do not fit the circuit"
    if np.max(loads) < _NARROW * np.min(loads):
        return error, (
            f"weights of {np.min(loads):.3g} to {np.max(loads):.3g} N are too alike: add one of "
            f"{_NARROW * np.min(loads):.3g} N or more"
        )
    if fitted.error > MOST_ERROR:
        return error, (
            f"a new weight would be off by {fitted.error:.0%}, {MOST_ERROR:.0%} at most is a "
            "proof: check the weights, r_ref, adc_full_scale and the supply"
        )

    def refitted(circuit: Circuit, rest: Rest) -> tuple[PressureCurve, np.ndarray]:
        found = refit(circuit, rest)
        return found.curve, np.delete(found.off, found.odd)

    return error, doubt(used, refitted, [*touches, *frames], error, hardest, force)[0]


def by_one_weight(skin: Tried, frame, weight: float, touches, known: Known, pitch: float) -> Gain:
    """Return what one weight shows.

    Args:
        skin: with the curve as it is configured.
        frame: (rows, cols) ADC ratio of the weight [N].
        touches: (n, rows, cols) ADC ratio of ordinary touches.
        known: what was known of curve and r_par.
        pitch: of the cells [m].

    Raises:
        ValueError: the weight is not felt.
    """

    def gained(circuit: Circuit, rest: Rest) -> tuple[PressureCurve, np.ndarray]:
        factor = _factor(replace(skin, circuit=circuit, rest=rest), frame, weight)
        return times(skin.curve, factor, circuit.shape), np.empty(0)

    factor = _factor(skin, frame, weight)
    proved = replace(skin, curve=times(skin.curve, factor, skin.circuit.shape))
    force = palms(skin.circuit, pitch)
    hardest = float(proved.cells(frame, weight).max()) if known.error is None else np.inf
    error = error_of(np.hypot(REPEATABLE, known.error or REPEATABLE), hardest, force)
    if not LEAST_FACTOR <= factor <= MOST_FACTOR:
        return Gain(
            factor,
            error,
            f"{weight:.3g} N are felt as {weight / factor:.3g} N, a factor of {factor:.2f} "
            f"({LEAST_FACTOR:g} to {MOST_FACTOR:g} is allowed): an entry is off: r_ref, "
            "adc_full_scale, supply, or the curve is another fabric's: run calibrate with weights",
            False,
        )
    by = [*touches, frame], error, hardest, force, known.r_par_std
    return Gain(factor, error, *doubt(proved, gained, *by))


def _factor(skin: Tried, frame: np.ndarray, weight: float) -> float:
    """Return times what (rows, cols) ADC ratio is felt as it weighs [N]."""
    factor = 1.0
    for _ in range(_ROUNDS):  # the prior of pictures is not quite in proportion to the force
        curve = times(skin.curve, factor, skin.circuit.shape)
        felt = float(replace(skin, curve=curve).felt(frame[None], weight)[0])
        if not felt > 0.0:
            raise ValueError("the weight is not felt: lay it on, and nothing else")
        factor *= weight / felt
    return factor


def doubt(
    used: Tried,
    curve_by: CurveBy,
    touches,
    error: float,
    hardest: float,
    force: np.ndarray,
    r_par_std: float = np.inf,
) -> tuple[str, bool]:
    """Return why the newtons of a skin are not proved, and whether more touches may do so.

    Args:
        used: with the curve by its weights.
        touches: (n, rows, cols) ADC ratio of touches and weights; NaN where not read.
        error: relative standard deviation of the palms' force.
        hardest: force on the hardest cell under a weight [N].
        force: (n, rows, cols) of palms [N].
        r_par_std: standard deviation of r_par that was found before [ohm].
    """
    if error > MOST_ERROR:
        return (
            f"no weight loaded a cell by more than {hardest:.2g} N, a palm of {PALM:g} N does by "
            f"{force.max():.2g} N: lay a heavier thing on, or one that stands on less area",
            False,
        )
    r_par = used.circuit.r_par
    wants = _wants(touches, used.circuit, used.rest)
    if abs(wants) > BEYOND:
        more = "more" if wants > 0.0 else "less"
        return (
            f"the touches show {more} resistance in series than r_par = {r_par:.0f} ohm: r_par, "
            "r_ref, adc_full_scale, adc_table or the supply is another than entered",
            False,
        )
    most = r_par + CONTRADICTION * r_par_std
    for other in _others(used, curve_by, touches, most):
        felt = used.felt(other.read(force), float(force.max())) / PALM
        if felt.min() < LEAST:
            ended = int(np.count_nonzero(converter_end(np.asarray(touches), used.circuit)[1]))
            advice = (
                f"in {ended} of {len(touches)} touches and weights readings are at the "
                "converter's end: a smaller r_ref reads harder ones"
                if 2 * ended > len(touches)
                else "press harder, at more places and with more than a fingertip, or lay heavier "
                "things on"
            )
            return (
                f"r_par may be {other.circuit.r_par:.0f} ohm as well as {r_par:.0f} (or r_ref, "
                "adc_full_scale or the supply another than entered, which reads the same); then a "
                f"palm of {PALM:g} N would be felt as {PALM * felt.min():.0f} N: {advice}",
                True,
            )
    return "", False


def _others(used: Tried, curve_by: CurveBy, touches, most: float) -> Iterator[Tried]:
    """Yield skins of a higher r_par, `most` [ohm] at most, that nothing excludes."""
    said = np.isfinite(_wants(touches, used.circuit, used.rest))
    scale, low = series_scale(used.circuit), used.circuit.r_par
    step, further = _FIRST * scale, _FURTHER
    for _ in range(_TRIED):
        circuit = replace(used.circuit, r_par=low + step)
        wants = -np.inf
        if circuit.r_par <= most:
            with contextlib.suppress(ValueError):  # no skin reads so
                rest = supposing(used.rest, circuit)
                wants = _wants(touches, circuit, rest)
        if wants < -BEYOND or (said and np.isnan(wants)):  # it is less
            step, further = 0.5 * step, 1.0
            if step < _FINEST * scale:
                return
            continue
        low, step = circuit.r_par, further * step
        if wants > BEYOND:
            continue
        with contextlib.suppress(ValueError):  # some weight does not fit
            other = Tried(circuit, rest, *curve_by(circuit, rest))
            if not _excluded(other.off, used.off):
                yield other


def _excluded(off: np.ndarray, by: np.ndarray) -> bool:
    """Whether errors (n,) of totals are those of a worse circuit."""
    if not off.size:
        return False
    likelier = np.log(np.square(off).mean() / np.square(by).mean())
    return bool(off.size * likelier > _EXCLUDED)


def _wants(touches, circuit: Circuit, rest: Rest) -> float:
    """Return by how many standard deviations touches want more r_par; NaN: they say nothing."""
    noise = max(rest.noise, ROUNDING_NOISE)
    supposed = Supposed(circuit, rest.conductance, SOFT, exact=True)
    each = (supposed.evidence(adc, noise) for adc in rest.quiet(np.asarray(touches)))
    found = [evidence for evidence in each if evidence is not None]
    if len(found) < FEWEST:
        return np.nan
    information = sum(e.information for e in found) + prior_of(circuit) * [[0.0, 0.0], [0.0, 1.0]]
    if not information[0, 0] > 0.0:
        return np.nan
    off = np.linalg.solve(information, sum(e.score for e in found))
    here = [e._replace(score=e.score - e.information @ off) for e in found]
    return float(off[0] / std_of(here, information, rest, supposed)[0])
