"""One frame as the solvers see it: what was read, how well, and between which bounds to look."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..circuit import Circuit, two_terminal_resistance
from ..curve import PressureCurve
from ..files import shorten
from .estimate import Estimate

SCAN_NOISE = 0.52  # ADC steps RMS: mean of 4 samples with 1 step of noise, each rounded
ROUNDING_NOISE = 12**-0.5  # ADC steps RMS of rounding to whole steps
_FRACTION = 64  # the board sends at most 6 fractional bits (its low-pass filter's)
# N, of a prior: no cell feels more, none is known better; the squares of both stay numbers.
_MOST_MEAN, _LEAST_STD = 1e6, 1e-6


@dataclass(frozen=True, eq=False)
class Reading:
    """A checked frame.

    Attributes:
        adc: (rows, cols) ADC ratio; 0 where nothing is known.
        known: (rows, cols) bool, readings that carry a value.
        capped: (rows, cols) bool, readings known only to lie at or below `threshold`.
        threshold: ADC ratio, 0 where no reading is capped.
        noise: RMS noise of a reading, in ADC steps; 0 for an exact one.
        deadline: `time.monotonic` to stop at, infinity for none.
    """

    adc: np.ndarray
    known: np.ndarray
    capped: np.ndarray
    threshold: float
    noise: float
    deadline: float
    circuit: Circuit
    curve: PressureCurve

    @cached_property
    def steps(self) -> np.ndarray:
        """(rows, cols) the reading in ADC steps."""
        return self.adc * self.circuit.full_scale

    @cached_property
    def plain(self) -> bool:
        """Whether each crossing of the matrix was read."""
        return bool(self.known.all())

    @cached_property
    def whole(self) -> bool:
        """Whether each cell's own crossing was read."""
        return self.plain or bool((self.known | ~self.circuit.populated).all())

    @cached_property
    def told(self) -> int:
        """Number of readings that say something."""
        return self.known.size if self.plain else np.count_nonzero(self.known | self.capped)

    @property
    def fitted_noise(self) -> float:
        """RMS noise [ADC steps] that a least-squares fit supposes: of rounding, if of nothing."""
        return max(self.noise, ROUNDING_NOISE)

    @cached_property
    def rho(self) -> np.ndarray:
        """(rows, cols) measured two-terminal resistance [ohm], kept finite and above 0."""
        return np.minimum(np.maximum(self.circuit.two_terminal(self.adc), 1e-3), 1e12)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(rows, cols) conductance [S] of each cell at rest and at the curve's end."""
        ends = self.curve.rest_resistance, self.curve.least_resistance
        return np.full(self.adc.shape, 1.0 / ends[0]), np.full(self.adc.shape, 1.0 / ends[1])

    def late(self) -> bool:
        return time.monotonic() > self.deadline

    def misfit(self, adc) -> np.ndarray:
        """(rows, cols) reading minus model in ADC steps; 0 where nothing contradicts the model."""
        full_scale = self.circuit.full_scale
        misfit = (self.adc - adc) * full_scale
        if not self.plain:
            misfit *= self.known
        if self.threshold:
            over = np.minimum((self.threshold - adc) * full_scale, 0.0)
            misfit = np.where(self.capped, over, misfit)
        return misfit

    def residual(self, adc) -> float:
        """RMS of `misfit` over the readings that say something."""
        return self.rms(self.misfit(adc))

    def rms(self, misfit: np.ndarray) -> float:
        misfit = misfit.ravel()
        return float((misfit @ misfit / max(self.told, 1)) ** 0.5)

    def need_whole(self, method: str) -> None:
        """ValueError unless every cell was read: only `map` can do without."""
        if not self.whole:
            n = np.count_nonzero(self.circuit.populated & ~self.known)
            raise ValueError(
                f"method {method!r} needs a reading of every cell, {n} are missing or below the "
                "threshold: use map or auto"
            )


def check_reading(
    adc,
    circuit: Circuit,
    curve: PressureCurve,
    *,
    missing: bool = False,
    threshold: float = 0.0,
    noise: float | None = None,
    time_limit: float | None = None,
) -> Reading:
    """The frame as a `Reading`; ValueError says what is wrong with it, and where."""
    adc = np.asarray(adc, dtype=float)
    if adc.shape != circuit.shape:
        raise ValueError(f"reading has shape {adc.shape}: the circuit is {circuit.shape}")
    if not 0.0 <= threshold < 1.0:
        raise ValueError(f"threshold = {threshold!r}: must be an ADC ratio in [0, 1)")
    if noise is not None and not 0.0 <= noise < circuit.full_scale:
        raise ValueError(f"noise = {noise!r} ADC steps: must be 0 or more, below full scale")
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r} s: must be above 0")
    known, capped = _all_known(circuit.shape)
    if not (adc.min() >= 0.0 and adc.max() <= 1.0):  # NaN is neither
        known = _known(adc, circuit, missing)
        adc = np.where(known, adc, 0.0)
    if threshold:
        capped = known & (adc <= threshold)
        known = known & ~capped
        adc = np.where(known, adc, 0.0)
    if noise is None:
        noise = _noise_of(adc * circuit.full_scale)
    deadline = np.inf if time_limit is None else time.monotonic() + time_limit
    return Reading(adc, known, capped, float(threshold), noise, deadline, circuit, curve)


def check_start(start: Estimate, circuit: Circuit) -> None:
    """ValueError unless `start` is an estimate to go on from, of a skin of this shape."""
    if not isinstance(start, Estimate):
        kind = type(start).__name__
        raise ValueError(f"start is of type {kind}: must be an Estimate, that of the last frame")
    force = np.asarray(start.force)
    if force.shape != circuit.shape:
        raise ValueError(f"start has shape {force.shape}: the circuit is {circuit.shape}")
    if not (force.min() >= 0.0 and force.max() < np.inf):  # NaN is neither
        _refuse("start.force", force, (force >= 0.0) & (force < np.inf), "finite and 0 N or more")
    if start.r_par is not None and not 0.0 <= start.r_par < np.inf:
        raise ValueError(f"start.r_par = {start.r_par!r} ohm: must be finite and 0 or more")


def check_prior(prior, circuit: Circuit) -> tuple[np.ndarray, np.ndarray]:
    """(mean, std) as (rows, cols) arrays [N]; ValueError says what is wrong with them, and where.

    Where the circuit has no cell, anything is allowed.
    """
    try:
        mean, std = prior
    except (TypeError, ValueError) as error:
        raise ValueError(f"prior = {shorten(prior)}: must be two, mean and std") from error
    mean, std = _picture("prior mean", mean, circuit), _picture("prior std", std, circuit)
    known = (mean >= 0.0) & (mean <= _MOST_MEAN)
    if not known.all():
        _refuse("prior mean", mean, known, f"from 0 to {_MOST_MEAN:g} N")
    if not (std > 0.0).all():
        _refuse("prior std", std, std > 0.0, "above 0 N")
    return mean, np.maximum(std, _LEAST_STD)


def _picture(name: str, value, circuit: Circuit) -> np.ndarray:
    """A number or (rows, cols) as (rows, cols) floats, 1 where there is no cell."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal length
        array = np.array(None)
    if array.dtype.kind not in "fiu":
        kind = type(value).__name__
        raise ValueError(f"{name} is of type {kind}: must be a number or {circuit.shape} of them")
    if array.shape not in ((), circuit.shape):
        raise ValueError(f"{name} has shape {array.shape}: must be a number or {circuit.shape}")
    return np.where(circuit.populated, array, 1.0)


def _refuse(name: str, array: np.ndarray, good: np.ndarray, allowed: str):
    row, col = np.argwhere(~good)[0]
    raise ValueError(f"{name} = {array[row, col]} at row {row}, column {col}: must be {allowed}")


@lru_cache(maxsize=16)
def _all_known(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """`known` and `capped` of a frame that was read as a whole; read-only."""
    flags = np.ones(shape, bool), np.zeros(shape, bool)
    for array in flags:
        array.setflags(write=False)
    return flags


def _known(adc: np.ndarray, circuit: Circuit, missing: bool) -> np.ndarray:
    """(rows, cols) bool, what is not NaN; ValueError if anything is there that may not be."""
    unread = np.isnan(adc)
    allowed = unread if missing else unread & ~circuit.populated
    bad = ~((adc >= 0.0) & (adc <= 1.0)) & ~allowed
    if bad.any():
        row, col = np.argwhere(bad)[0]
        hint = "; say missing=True if NaN marks missing readings" if unread.any() else ""
        raise ValueError(
            f"reading: {np.count_nonzero(bad)} of {adc.size} values are not in [0, 1], "
            f"the first {adc[row, col]} at row {row}, column {col}{hint}"
        )
    return ~unread


def _noise_of(steps: np.ndarray) -> float:
    """RMS noise [ADC steps] that the grid of the values tells.

    Whole steps: one rounding. Multiples of a board's fraction of a step: a mean of noisy samples.
    Anything else came from no ADC and is taken as exact.
    """
    grid = steps * _FRACTION
    if np.abs(grid - np.rint(grid)).max() > 1e-3:
        return 0.0
    return ROUNDING_NOISE if np.abs(steps - np.rint(steps)).max() < 1e-3 else SCAN_NOISE


@lru_cache(maxsize=16)
def rest_reading(circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """(rows, cols) ADC ratio of the untouched skin."""
    g = circuit.populated / curve.rest_resistance
    adc = circuit.ratio(two_terminal_resistance(g))
    adc.setflags(write=False)
    return adc
