# SPDX-License-Identifier: Apache-2.0
"""One frame as the solvers see it: what was read, its noise, and the bounds of each cell."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import correlate1d
from scipy.special import ndtri

from ..files import shorten
from ..physics import readouts
from ..physics.arrays import frozen
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve

SCAN_NOISE = 0.52  # ADC steps RMS: mean of 4 samples with 1 step of noise, each rounded
OUTLIER = 3.0  # standard deviations beyond which a misfit counts less than its square
MAX_NOISE = 3.5  # ADC steps RMS, above that of any board of benchmarks/accuracy/boards.py (3 steps)
NEAR_REST = 1.5  # times its conductance at rest below which a cell counts as untouched
ROUNDING_NOISE = 12**-0.5  # ADC steps RMS of rounding to whole steps
# Share of the smallest magnitudes that a standard deviation is estimated from. A median would jump
# with the steps of an ADC.
_KEPT = 0.8
# standard deviation over the mean of these, for a normal distribution
_STD_OVER_MEAN = _KEPT * (np.pi / 2) ** 0.5 / -np.expm1(-0.5 * ndtri(0.5 + 0.5 * _KEPT) ** 2)
# ADC steps below which noise of single scans is cut off at 0, so that their mean is too high, and
# up to an amplifier's end, where it is too low.
_CUT_OFF = 2.0
FEW = 8  # readings that a spread is measured by at least: it is then right to 25 %


@dataclass(frozen=True, eq=False)
class Reading:
    """A checked frame."""

    adc: np.ndarray  # (rows, cols) ADC ratio; 0 where nothing is known
    known: np.ndarray  # (rows, cols) bool, readings that carry a value
    capped: np.ndarray  # (rows, cols) bool, readings known only to lie at or below `threshold`
    # (rows, cols) bool, readings known only to lie at or above their value in `adc`
    topped: np.ndarray
    threshold: float  # ADC ratio, 0 where no reading is capped
    noise: float  # RMS noise of a reading, in ADC steps; 0 for an exact one
    deadline: float  # `time.monotonic` to stop at, infinity for none
    circuit: Circuit
    curve: PressureCurve
    noise_given: bool = True  # whether the caller gave it; if not, it is measured in the frame

    def with_noise(self, noise: float) -> Reading:
        """Return the same frame with a noise that was measured in it [ADC steps]."""
        return replace(self, noise=min(max(noise, ROUNDING_NOISE), MAX_NOISE))

    def above_cut_off(self) -> Reading:
        """Return the same frame with readings next to 0 known as that only.

        Where lines are driven, hard loads push others there.
        """
        threshold = max(self.threshold, _CUT_OFF / self.circuit.full_scale)
        low = self.known & (self.adc <= threshold)
        if not (self.circuit.readout_class.loads_lower and self.noise and low.any()):
            return self
        known, adc = self.known & ~low, np.where(low, 0.0, self.adc)
        return replace(self, adc=adc, known=known, capped=self.capped | low, threshold=threshold)

    def behind(self, added: np.ndarray) -> Reading:
        """Return the same frame if only r_par lay in series: without (rows, cols) [ohm] more."""
        r_ref = self.circuit.r_ref
        with np.errstate(divide="ignore"):
            adc = r_ref / np.maximum(r_ref / self.adc - added, r_ref)
        return replace(self, adc=adc)

    @cached_property
    def steps(self) -> np.ndarray:
        """(rows, cols) the reading in ADC steps."""
        return self.adc * self.circuit.full_scale

    @cached_property
    def all_read(self) -> bool:
        """Whether each crossing of the matrix was read."""
        return np.count_nonzero(self.known) == self.known.size

    @cached_property
    def all_cells_read(self) -> bool:
        """Whether each cell's own crossing was read."""
        return self.all_read or bool((self.known | ~self.circuit.populated).all())

    @cached_property
    def informative(self) -> np.ndarray:
        """(rows, cols) bool, readings that carry a value or a limit."""
        return self.known if self.all_read else self.known | self.capped | self.topped

    @cached_property
    def supposed(self) -> np.ndarray:
        """(rows, cols) ADC ratio that is supposed of unread cells next to touched ones; else 0.

        What the readings of a sense line leave of their sum determines its level, unless a cell
        that was not read takes part of it. Such a cell is taken for like those next to it on its
        line, which leave it no more than there is.
        """
        circuit, axis = self.circuit, self.circuit.sense_axis
        if self.all_cells_read or not circuit.readout_class.shares_sum:
            return np.zeros(self.adc.shape)
        lightest = circuit.readout_class.guess(circuit, self.adc, self.rho, self.bounds)
        read = self.known & circuit.populated
        count, near, touched = (
            correlate1d(1.0 * picture, np.ones(3), axis, mode="constant")
            for picture in (read, read * self.adc, read & (lightest > NEAR_REST * self.bounds[0]))
        )
        unread = circuit.populated & ~self.informative & (touched > 0.0)
        supposed = unread * near / np.maximum(count, 1.0)
        least = 1.0 / circuit.full_scale
        left = np.maximum(circuit.ratio(0.0) - self.adc.sum(axis, keepdims=True), least)
        return supposed * np.minimum(left / np.maximum(supposed.sum(axis, keepdims=True), least), 1)

    @property
    def n_informative(self) -> int:
        """Number of readings that carry a value or a limit."""
        return int(np.count_nonzero(self.informative))

    @property
    def may_fit_two(self) -> bool:
        """Whether a light and a hard load may read alike: drivers yield, and a reading is missing.

        All readings of a sense line together say how far the drivers yield.
        """
        return self.circuit.r_drive > 0.0 and self.n_informative < self.known.size

    @property
    def fitted_noise(self) -> float:
        """RMS noise [ADC steps] that a least-squares fit assumes: that of rounding at least."""
        return max(self.noise, ROUNDING_NOISE)

    @cached_property
    def apparent(self) -> tuple[np.ndarray | float, float]:
        """`Readout.apparent` of the frame: scale and offset of `rho`."""
        adc = self.adc
        if not self.all_read:
            adc = np.where(self.informative, adc, adc.sum() / max(self.n_informative, 1))
        return readouts.apparent(self.circuit, adc)

    @cached_property
    def rho(self) -> np.ndarray:
        """Return (rows, cols) measured resistance [ohm], kept finite and above 0.

        It is two-terminal, or as `Readout.apparent` says.
        """
        return self._rho_at(self.adc)

    def _rho_at(self, adc: np.ndarray) -> np.ndarray:
        scale, offset = self.apparent
        with np.errstate(divide="ignore"):
            rho = self.circuit.r_ref * scale / adc - offset
        return np.minimum(np.maximum(rho, 1e-3), 1e12)

    def rho_of(self, network: readouts.Readout) -> np.ndarray:
        """(rows, cols) the same of a model [ohm]: equal if the readings are."""
        if self.circuit.readout_class.two_terminal:
            return network.rho
        return self._rho_at(network.adc)

    def model(self, g: np.ndarray) -> np.ndarray:
        """(rows, cols) ADC ratio of cells that conduct g (rows, cols) [S]."""
        return readouts.solve(self.circuit, g, derivatives=False).adc

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(rows, cols) conductance [S] of each cell at rest and at the curve's end."""
        return _bounds(self.circuit.shape, self.curve)

    def late(self) -> bool:
        return time.monotonic() > self.deadline

    def misfit(self, adc) -> np.ndarray:
        """(rows, cols) reading minus model in ADC steps; 0 where nothing contradicts the model."""
        full_scale = self.circuit.full_scale
        misfit = (self.adc - adc) * full_scale
        if not self.all_read:
            misfit *= self.known
        # A capped reading contradicts the model from one standard deviation below the threshold on.
        # Those just above it are the ones that noise raised: so what both say balances, over
        # readings of all sizes.
        if self.threshold:
            over = np.minimum((self.threshold - adc) * full_scale - self.noise, 0.0)
            misfit = np.where(self.capped, over, misfit)
        if not self.all_read and self.topped.any():
            under = np.maximum((self.adc - adc) * full_scale + self.noise, 0.0)
            misfit = np.where(self.topped, under, misfit)
        return misfit

    def residual(self, adc) -> float:
        """RMS of `misfit` over the informative readings."""
        return self.rms(self.misfit(adc))

    def rms(self, misfit: np.ndarray) -> float:
        misfit = misfit.ravel()
        return float((misfit @ misfit / max(self.n_informative, 1)) ** 0.5)

    def linearised(self, g: np.ndarray, std, network=None) -> Linearised:
        """Return the model of the frame at conductances g (rows, cols) [S].

        Args:
            std: standard deviation of a reading [ADC steps], a number or (rows, cols).
            network: of g, if known.
        """
        network = network or readouts.solve(self.circuit, g)
        misfit = self.misfit(network.adc)
        misfit /= std
        weight = np.full(g.shape, self.circuit.full_scale / std)
        if not self.all_read:
            says = self.known | (misfit != 0.0)
            weight *= says | self._holds(network.adc) if self.topped.any() else says
        return Linearised(g, network, network.adc, misfit, weight)

    def _holds(self, adc: np.ndarray) -> np.ndarray:
        """(rows, cols) bool, bounds that the model only just meets: its cells stay there.

        With cross-talk a bound is one of many cells, which may well leave it.
        """
        near = (adc - self.adc) * self.circuit.full_scale < _CUT_OFF
        return self.topped & near & (not self.circuit.has_cross_talk)

    def need_all_cells(self, method: str) -> None:
        """ValueError unless every cell was read: only `map` can do without."""
        if not self.all_cells_read:
            n = np.count_nonzero(self.circuit.populated & ~self.known)
            raise ValueError(
                f"method {method!r} needs a reading of every cell, {n} are missing, below the "
                "threshold or at the ceiling: use map or auto"
            )


class Linearised(NamedTuple):
    """The circuit model of a frame and its derivative, in standard deviations of a reading.

    All but `network` are (rows, cols).
    """

    g: np.ndarray  # S, the cells' conductance
    network: readouts.Readout
    adc: np.ndarray  # ratio
    misfit: np.ndarray  # reading - model
    weight: np.ndarray  # of an ADC ratio of 1; 0 for readings that are not informative

    def jacobian(self, readings: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """(m, n) float32 d model / d g [1/S], of flat readings (m,) int32 and cells (n,)."""
        rows, cols = self.g.shape
        row, col = np.divmod(cells.astype(np.int32), np.int32(cols))
        col += np.int32(rows)
        return self.network.sensitivity(self.weight, readings, row, col)

    def information(self, cells: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """(n, n) J^T J, upper triangle, of J = d model / d g times scale (rows, cols)."""
        if (found := self.network.information(self.weight, scale, cells)) is not None:
            return found
        model, readings = self.grouped(cells)
        jacobian = model.jacobian(readings, cells)
        jacobian *= scale.flat[cells].astype(np.float32)
        return jacobian.T @ jacobian

    def grouped(self, cells: np.ndarray) -> tuple[Linearised, np.ndarray]:
        """Return a model whose few readings say of the cells what all readings say.

        Lines without one of the cells read alike: one of them has the weight of all.

        Returns:
            the model with these weights, and (m,) int32 flat readings, those with a weight.
        """
        lines = np.divmod(cells, self.g.shape[1])
        if all(np.bincount(on, None, n).all() for on, n in zip(lines, self.g.shape, strict=True)):
            return self, np.flatnonzero(self.weight).astype(np.int32)
        square, kept = np.square(self.weight), []
        for of_lines, touched in zip((square, square.T), lines, strict=True):
            alike = np.ones(len(of_lines), bool)
            alike[touched] = False
            (others,) = alike.nonzero()
            if others.size:
                one = others[others.size // 2]
                of_lines[one] = of_lines[others].sum(0)
                alike[one] = False
            kept.append((~alike).nonzero()[0])
        readings = (kept[0][:, None] * self.g.shape[1] + kept[1]).ravel()
        if not square.all():
            readings = readings[square.take(readings) > 0.0]
        return self._replace(weight=np.sqrt(square)), readings.astype(np.int32)


def check_reading(
    adc,
    circuit: Circuit,
    curve: PressureCurve,
    *,
    missing: bool = False,
    threshold: float = 0.0,
    ceiling: float = 1.0,
    noise=None,
    time_limit: float | None = None,
) -> Reading:
    """Return the frame as a `Reading`; ValueError says what is wrong with it, and where."""
    adc = np.asarray(adc, dtype=float)
    if adc.shape != circuit.shape:
        raise ValueError(f"reading has shape {adc.shape}: the circuit is {circuit.shape}")
    if not 0.0 <= threshold < 1.0:
        raise ValueError(f"threshold = {threshold!r}: must be an ADC ratio in [0, 1)")
    if not threshold < ceiling <= 1.0:
        raise ValueError(f"ceiling = {ceiling!r}: must be an ADC ratio in ({threshold:g}, 1]")
    if noise is not None and not (np.ndim(noise) == 0 and 0.0 <= noise < circuit.full_scale):
        raise ValueError(
            f"noise = {shorten(noise)} ADC steps: must be a number, 0 or more, below full scale"
        )
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r} s: must be above 0")
    known = np.ones(adc.shape, bool)
    capped = topped = ~known
    if not (adc.min() >= 0.0 and adc.max() <= 1.0):  # NaN is neither
        known = _known(adc, circuit, missing)
        adc = np.where(known, adc, 0.0)
    if threshold:
        capped = known & (adc <= threshold)
        known = known & ~capped
        adc = np.where(known, adc, 0.0)
    end = ceiling  # of an amplifier, on top of whose end the ADC's noise is
    if not (circuit.has_cross_talk or noise == 0.0):
        end -= _CUT_OFF / circuit.full_scale
    if (ceiling < 1.0 or not circuit.has_cross_talk) and (adc >= end).any():
        topped = known & (adc >= end)
        known, adc = known & ~topped, np.minimum(adc, ceiling)
    deadline = np.inf if time_limit is None else time.monotonic() + time_limit
    given = noise is not None
    noise, at = noise if given else ROUNDING_NOISE, float(threshold)
    return Reading(adc, known, capped, topped, at, noise, deadline, circuit, curve, given)


@lru_cache(maxsize=16)
def _bounds(shape: tuple[int, int], curve: PressureCurve) -> tuple[np.ndarray, np.ndarray]:
    low, high = 1.0 / curve.rest_resistance, 1.0 / curve.least_resistance
    return frozen(np.full(shape, low)), frozen(np.full(shape, high))


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


def noise_at_rest(misfit: np.ndarray) -> float | None:
    """RMS noise [ADC steps] of readings that lie below a model in which nothing can be lower.

    Noise that lifts such a reading may pass for a light touch; noise that lowers it cannot.

    Args:
        misfit: reading minus model of cells at rest [ADC steps].

    Returns:
        None: there are too few.
    """
    below = -misfit[misfit < 0.0]
    return robust_std(below) if below.size >= FEW else None


def robust_std(magnitudes: np.ndarray) -> float:
    """Return the std of normal values by their magnitudes; a fifth may be outliers."""
    kept = max(1, round(_KEPT * magnitudes.size))
    return _STD_OVER_MEAN * float(np.partition(magnitudes.ravel(), kept - 1)[:kept].mean())


def rounding_left(steps: np.ndarray) -> float:
    """RMS error that rounding leaves of mean readings [ADC steps]; NaN: not read.

    Readings that noise does not move keep what rounding cut off: their means have no fraction. By
    noise of half a step and more the means of readings of all sizes take all fractions alike,
    and what is left of rounding is noise (dither; Widrow and Kollar, Quantization Noise, 2008).
    """
    lost = 1.0 - np.nanmean(np.square(steps - np.rint(steps))) / ROUNDING_NOISE**2
    return float(ROUNDING_NOISE * max(lost, 0.0))


@lru_cache(maxsize=16)
def rest_reading(circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """(rows, cols) ADC ratio of the untouched skin."""
    return frozen(forward(circuit, np.broadcast_to(curve.rest_resistance, circuit.shape)))
