# SPDX-License-Identifier: Apache-2.0
"""r_par and the resistance of stripes or drivers, from frames of touches (docs/derivation.md).

Where nothing touches, the cells conduct what they did at rest, and the readings there tell what
lies in series with them. The touched cells of a frame, and their neighbours, are unknown. What
they can take of a change of the circuit is projected out of the misfit; what is left of it gathers
over the frames as a score and its information. Neither the curve nor a force is used.

All readouts determine r_par. That of a loaded matrix, its driver's, lowers the driven line's
voltage the more the harder what is touched on that line. That of a grounded one lies with r_ref,
whose voltage the touched cells of a sense line take from others; only that sum is determined, to a
share, and r_par is what is left of it; r_drive lowers the voltage of all cells of a driven line. Of
both the stripes are taken as ideal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..physics.adc import BENT, BETWEEN, Adc
from ..physics.circuit import Circuit
from ..solvers.evidence import HARD, RELEVANT, SOFT, Evidence, Supposed, series_scale
from ..solvers.reading import ROUNDING_NOISE
from ..solvers.suspect import BEYOND
from .rest import Rest, check_frames, mask_of, supposing

# Standard deviations between what is found with HARD and with SOFT from which on rims are soft: 2.5
# at most on 40 boards that bodies touch (seed 143000), 20 at least on 20 that fingers do (143500).
# SOFT tells less: a limit of 1.5 made one sound board in three a soft one.
CONTRADICTION = 3.0
_ROUNDS = 8  # over all frames, at most
_DONE = 0.2  # standard deviations by which the last round moved
# Standard deviations: of r_par, as share of `series_scale`; of others [ohm]. Arduinos' pins have 25
# ohm, a 74HC595's 20 to 70.
_PRIOR = {"r_par": 0.2, "r_line": 8.0, "r_drive": 50.0}
_TOLD = {"r_par": 0.03, "r_line": 4.0, "r_drive": 4.0}  # the same, below which it is told
# What is supposed of r_par is off so evidently, by `BEYOND` and this share of what is found, that a
# rough value is better; soft rims alone make it 20 % too high.
_FAR = 0.5
FEWEST = 3  # frames; with fewer one odd touch decides
SHELF = 4  # readings of touches at the same largest height: the converter's end


@dataclass(frozen=True, eq=False)
class Identified:
    """What frames tell of their circuit.

    Attributes:
        circuit: with r_par and r_line as found; as given where the frames do not tell.
        bent: (k,) of `Adc.bends`, by how much this chip is off a table that is shipped.
        std: name -> one standard deviation [ohm].
        told: name -> whether the frames tell it: its standard deviation is below 3 % of r_par (of
            `evidence.series_scale`), or 4 ohm of r_line or r_drive; or the supposed r_par is off by
            half of it and 5 standard deviations. r_line never if loaded.
        missing: what they do not tell, and more of them would.
        frames: how many of them say anything.
        message, advice: for a person; how touches may tell what is missing, "" if nothing is.
    """

    circuit: Circuit
    bent: np.ndarray
    std: dict[str, float]
    told: dict[str, bool]
    missing: tuple[str, ...]
    frames: int
    message: str
    advice: str = ""


def identify(
    frames, circuit: Circuit, rest: Rest, *, soft: bool = False, adc: Adc | None = None
) -> Identified:
    """Find r_par, and r_line or of a grounded matrix r_drive, by 10 to 30 frames of touches.

    Args:
        frames: (n, rows, cols) ADC ratio; NaN where a crossing was not read. Idle ones do no harm.
        circuit: what is supposed; r_par may be off by half, r_line by 15 ohm or more. Where r_line
            is one for each stripe, what is found is added to all of them.
        rest: `measure_rest` of the same skin.
        soft: whether touches have soft rims, as fingers, for sure; else it is found out.
        adc: that read the frames; None: a linear one.

    Raises:
        ValueError: another shape, values outside [0, 1], or readings that fit no skin.
    """
    frames, adc = rest.quiet(check_frames(frames, circuit)), adc or Adc(circuit)
    end, _ = converter_end(frames, circuit)
    bends = np.zeros(len(adc.bends(np.zeros(1))))
    # with an r_par that is far too large no frame of a loaded matrix is explained
    starts = (np.append(start, bends) for start in (np.zeros(2), without_r_par(circuit)))
    given, hard = (circuit, rest, adc, end), SOFT if soft else HARD
    tries = (_solve_frames(frames, start, hard, *given) for start in starts)
    first = next((found for found in tries if found is not None), None)
    if first is None:
        prior = prior_of(circuit, adc)
        nothing = Solution(np.zeros(len(prior)), prior, np.sqrt(1.0 / prior.diagonal()), 0)
        return _identified(circuit, nothing, frames)
    found = first if soft else _the_cautious(frames, first, *given)
    return _identified(circuit, found, frames)


def how_to_press(frames, circuit: Circuit) -> str:
    """Return how touches may tell more than those of (n, rows, cols) frames do."""
    ended = int(np.count_nonzero(converter_end(frames, circuit)[1]))
    if 2 * ended <= len(frames):
        return "press hard in more places, with more than a fingertip"
    return (
        f"in {ended} of {len(frames)} touches readings are at the converter's end: press less "
        "hard, with more than a fingertip"
    )


def converter_end(frames, circuit: Circuit) -> tuple[float, np.ndarray]:
    """ADC ratio at which the converter ends, and (n,) bool, frames of which readings are there.

    Its full scale, or a lower height at which several readings stop that would differ.
    """
    top = np.nanmax(frames, initial=0.0)
    stopped = frames > top - 0.5 / circuit.full_scale
    if np.count_nonzero(stopped) < SHELF or np.count_nonzero(stopped.any((1, 2))) < 2:
        stopped, top = frames > 1.0 - 0.5 / circuit.full_scale, 1.0
    return float(top), stopped.any((1, 2))


def _the_cautious(frames, sharp: Solution, *given) -> Solution:
    """Return what is found with soft rims supposed, if it contradicts what is found without."""
    soft = _solve_frames(frames, sharp.off, SOFT, *given)
    if soft is None:
        return sharp
    # of two estimates of which one uses all that the other does (Hausman)
    variance = np.maximum(np.square(soft.std) - np.square(sharp.std), (0.3 * soft.std) ** 2)
    differ = np.abs(soft.off - sharp.off) > CONTRADICTION * np.sqrt(variance)
    return soft if differ[:2].any() else sharp


class Solution(NamedTuple):
    """What frames say together.

    Attributes:
        off: (2 + k,) of `names` from what was supposed [ohm], and (k,) bends of the ADC.
        information: (2 + k, 2 + k) of the frames, and of what was supposed before [1/ohm^2].
        std, frames: (2 + k,) [ohm], and how many of them say anything.
    """

    off: np.ndarray
    information: np.ndarray
    std: np.ndarray
    frames: int

    @classmethod
    def of(
        cls, found: list[Evidence], at, circuit: Circuit, rest: Rest, supposed: Supposed, adc=None
    ):
        """Solve for what explains all frames best, to first order.

        Args:
            at: (n, 2 + k) ohm added to the circuit's, at which each was asked.
            circuit: as it was supposed before the frames.
            supposed: with which the last was asked.
        """
        information = sum(e.information for e in found) + prior_of(circuit, adc)
        pull = sum(e.score + e.information @ a for e, a in zip(found, at, strict=True))
        off = _bounded(np.linalg.solve(information, pull), information, circuit)
        here = [
            e._replace(score=e.score + e.information @ (a - off))
            for e, a in zip(found, at, strict=True)
        ]
        std = std_of(here, information, rest, supposed)
        return cls(off, information, std, len(found))


def _solve_frames(
    frames, off, hard: float, circuit: Circuit, rest: Rest, adc: Adc, end: float
) -> Solution | None:
    """Return what all frames say together, from `off` on; None: fewer than `FEWEST` do."""
    noise, rounds = max(rest.noise, ROUNDING_NOISE), []
    if off[2:].size:
        noise = float(np.hypot(noise, BETWEEN * circuit.full_scale))
    for _ in range(_ROUNDS):
        now, here = shifted(circuit, off[:2]), adc.straight(np.append(rest.adc, end), off[2:])
        untouched, top = replace(rest, adc=here[:-1].reshape(circuit.shape)), float(here[-1])
        conductance = supposing(untouched, now).conductance
        supposed = Supposed(now, conductance, hard, exact=True, end=top, adc=adc)
        each = (supposed.evidence(adc.straight(frame, off[2:]), noise) for frame in frames)
        found = [evidence for evidence in each if evidence is not None]
        if len(found) < FEWEST:
            return None
        solution = Solution.of(found, [off] * len(found), circuit, rest, supposed, adc)
        moved = np.abs((solution.off - off) * np.sqrt(solution.information.diagonal())).max()
        off = solution.off
        rounds.append(off)
        if moved < _DONE:
            return solution
    # each round takes other cells for touched ones, and leads elsewhere
    last = np.array(rounds[_ROUNDS // 2 :])
    std = np.hypot(solution.std, last.std(0, ddof=1))
    return solution._replace(off=last.mean(0), std=std)


def names(circuit: Circuit) -> tuple[str, str]:
    """Of the two resistances that frames may tell."""
    return "r_par", circuit.readout_class.second


def values(circuit: Circuit) -> tuple[float, float]:
    """Of these [ohm]; the mean of r_line."""
    one, other = (float(np.mean(getattr(circuit, name))) for name in names(circuit))
    return one, other


def prior_of(circuit: Circuit, adc: Adc | None = None) -> np.ndarray:
    """(2 + k, 2 + k) precision of what is supposed [1/ohm^2], and of an ADC's bends."""
    r_par, other = (_PRIOR[name] for name in names(circuit))
    bends = [BENT] * len(adc.bends(np.zeros(1))) if adc else []
    r_par *= series_scale(circuit)
    if bends:  # what its gain reads as
        r_par = np.hypot(r_par, BENT * circuit.r_ref)
    return np.diag([r_par**-2.0, other**-2.0, *np.square(bends) ** -1.0])


def told_below(circuit: Circuit) -> np.ndarray:
    """(2,) [ohm] standard deviation below which a resistance is told."""
    r_par, other = (_TOLD[name] for name in names(circuit))
    return np.array([r_par * series_scale(circuit), other])


def without_r_par(circuit: Circuit) -> np.ndarray:
    """(2,) ohm that lead from the circuit's to an r_par of 0.

    From there the steps lead to any r_par; cells explain no hard touch on a loaded matrix behind
    an r_par that is larger than what all of the line has.
    """
    return np.array([-circuit.r_par, 0.0])


def _bounded(off: np.ndarray, information: np.ndarray, circuit: Circuit) -> np.ndarray:
    """(2 + k,) more that explain the frames best with neither resistance below 0."""
    least = -np.array([np.min(getattr(circuit, name)) for name in names(circuit)])
    for k in (1, 0):
        if off[k] < least[k]:
            off = _held(off, information, np.arange(len(off)) == k, least[k])
    return np.append(np.maximum(off[:2], least), off[2:])


def _held(off: np.ndarray, information: np.ndarray, held: np.ndarray, at: float) -> np.ndarray:
    """Return (m,) off with those that are held `at`, and the others as they then explain most."""
    free, found = ~held, np.where(held, at, off)
    pull = information[np.ix_(free, held)] @ (off - found)[held]
    found[free] += np.linalg.solve(information[np.ix_(free, free)], pull)
    return found


def shifted(circuit: Circuit, off: np.ndarray) -> Circuit:
    """Return the circuit with (2,) ohm more, neither resistance below 0."""
    given = zip(names(circuit), off, strict=True)
    return replace(circuit, **{n: np.maximum(getattr(circuit, n) + more, 0.0) for n, more in given})


def std_of(
    found: list[Evidence], information: np.ndarray, rest: Rest, supposed: Supposed
) -> np.ndarray:
    """(2 + k,) [ohm]: by how much the frames' scores differ.

    With n frames that is known to a share of (2 n)^-0.5 only, so what noise and the model's error
    are supposed to leave counts as `FEWEST` frames more. All share one measurement of the rest,
    whose noise no scatter between them shows, and what was supposed before.

    Args:
        information: (2 + k, 2 + k) of the frames, and of what was supposed before.
    """
    scores = np.array([e.score for e in found])
    n = len(scores)
    spread = n * (scores - scores.mean(0)).T @ (scores - scores.mean(0))
    chi = sum(e.chi2 for e in found) / sum(e.count for e in found)
    of_frames = sum(e.information for e in found)
    spread = (spread + FEWEST * max(chi, 1.0) * of_frames) / (n - 1 + FEWEST)
    noise = rest.noise / rest.frames**0.5
    by_rest = np.sum([e.by_rest for e in found], axis=0)
    shared = supposed.by_reading(by_rest) * noise  # (2 + k, readings)
    unknown = _unknown_rest(rest, supposed) * by_rest.reshape(len(by_rest), -1)
    spread += shared @ shared.T + unknown @ unknown.T + information - of_frames
    inverse = np.linalg.inv(information)
    return np.sqrt((inverse @ spread @ inverse).diagonal())


def _unknown_rest(rest: Rest, supposed: Supposed) -> np.ndarray:
    """(cells,) [S] standard deviation of what noisy cells conduct at rest, 0 of all others.

    They are taken for the usual cell: what the others differ by, they do.
    """
    noisy = mask_of(rest.noisy, supposed.rest.shape)
    quiet = supposed.rest[supposed.circuit.populated & ~noisy]
    return (noisy * quiet.std()).ravel()


def reads_alike(supposed: Circuit, found: Identified) -> str:
    """Return what else than the r_par that was found explains the frames; "": it is as supposed."""
    value, given, std = found.circuit.r_par, supposed.r_par, found.std["r_par"]
    if len(found.bent):  # a chip's own gain reads so, too
        std = np.hypot(std, BENT * supposed.r_ref)
    relevant = max(CONTRADICTION * std, RELEVANT * series_scale(supposed))
    if not found.told["r_par"] or abs(value - given) <= relevant:
        return ""
    other = "another supply or adc_full_scale than entered"
    if given > 0.0 < value:
        other = f"r_ref = {supposed.r_ref * given / value:.0f} ohm, or {other}"
    return (
        f"r_par is configured as {given:.0f} ohm. With it {other} reads the same: measure these. "
        "Weights make newtons right either way; without them none of it is written."
    )


def _identified(circuit: Circuit, solution: Solution, touches: np.ndarray) -> Identified:
    """Return what was identified by (n, rows, cols) touches, in numbers and words."""
    off, information, std, frames = solution
    std, bends = std[:2], np.zeros(len(off) - 2, bool)
    told = std < told_below(circuit)
    there = series_scale(shifted(circuit, off[:2]))
    told[0] |= abs(off[0]) > max(BEYOND * std[0], _FAR * there)
    readout = circuit.readout_class
    if ideal := not (readout.knows_r_line or readout.knows_r_drive):
        told[1] = False
    # What is not told stays as it was supposed, and the other is what then explains the frames.
    off = _held(off, information, np.append(~told, bends), 0.0)
    found = shifted(circuit, off[:2])
    both = names(circuit)
    missing = tuple(n for n, yes in zip(both, told | [False, ideal], strict=True) if not yes)
    words = [
        f"{name} = {value:.1f} +- {s:.1f} ohm"
        for name, value, s, yes in zip(both, values(found), std, told, strict=True)
        if yes
    ]
    if missing:
        words.append(f"the frames do not tell {' and '.join(missing)}")
    if ideal:
        words.append(f"r_line is taken as 0 if {circuit.readout}")
    return Identified(
        found,
        off[2:],
        dict(zip(both, std.tolist(), strict=True)),
        dict(zip(both, told.tolist(), strict=True)),
        missing,
        frames,
        f"{', '.join(words)} ({frames} frames tell something)",
        how_to_press(touches, circuit) if missing else "",
    )
