# SPDX-License-Identifier: Apache-2.0
"""The characteristic curve of a taxel: force on a cell <-> its resistance (paper Fig. 5)."""

from __future__ import annotations

import copy
from os import PathLike

import numpy as np
import numpy.typing as npt

from ..errors import FileError
from ..files import shorten
from .arrays import Floats, frozen

GRAM = 9.80665e-3  # N: weight of one gram; the paper and its figures speak in grams a cell

# The paper prints its Fig. 5 as a picture only. These points meet what its text says: more than
# 10 kohm at rest, below 100 ohm pressed, loads up to 1 kg a cell.
_DEFAULT_LOAD = np.array([0, 5, 10, 20, 50, 100, 200, 500, 1000]) * GRAM  # N
_DEFAULT_RESISTANCE = (40000, 12000, 6500, 3500, 1500, 800, 420, 170, 85)  # ohm


def _pchip(x: Floats, y: Floats, at: Floats) -> Floats:
    """Return the monotone cubic through points of strictly monotone y, at places between them.

    As SciPy's PchipInterpolator, which takes 0.15 s to import, at every start of a skin. Source:
    F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300.
    """
    h, rise = np.diff(x), np.diff(y) / np.diff(x)
    slope = np.full(x.size, rise[0])
    if x.size > 2:
        near, far = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
        slope[1:-1] = (near + far) / (near / rise[:-1] + far / rise[1:])
        for end, beside in ((0, 1), (-1, -2)):
            tangent = (2.0 * h[end] + h[beside]) * rise[end] - h[end] * rise[beside]
            tangent /= h[end] + h[beside]
            slope[end] = tangent if tangent * rise[end] > 0.0 else 0.0
    k = np.clip(np.searchsorted(x, at, "right") - 1, 0, h.size - 1)
    t, left, right = at - x[k], slope[k], slope[k + 1]
    square = (3.0 * rise[k] - 2.0 * left - right) / h[k]
    cubic = (left + right - 2.0 * rise[k]) / h[k] ** 2
    found: Floats = y[k] + t * (left + t * (square + t * cubic))
    return found


class PressureCurve:
    """Resistance of one cell over the force on it, monotone, invertible to rounding.

    log(resistance) is a monotone cubic (PCHIP) over sqrt(force) through the given points,
    tabulated finely; between the table's points both directions are linear in those coordinates,
    so that each is the exact inverse of the other.

    Args:
        force: (n,) [N] per cell, rising, the first 0.
        resistance: (n,) [ohm] at those forces, falling, above 0.

    Attributes:
        points: the given (force, resistance).
        offset: (rows, cols) conductance [S] that each cell has on top of the curve's, see
            `resting_at`; None: none.
        gain: (rows, cols) force on each cell over what the curve says, see `with_gain`; None: 1.

    Raises:
        ValueError: fewer than two points, or points out of order or range.
    """

    _TABLE_POINTS = 4097

    offset: Floats | None
    gain: Floats | None

    def __init__(
        self, force: npt.ArrayLike = _DEFAULT_LOAD, resistance: npt.ArrayLike = _DEFAULT_RESISTANCE
    ) -> None:
        force, resistance = np.asarray(force, dtype=float), np.asarray(resistance, dtype=float)
        if force.ndim != 1 or force.shape != resistance.shape or force.size < 2:
            raise ValueError(
                f"curve: force has {force.size} and resistance {resistance.size} values: "
                "both need the same number, two or more"
            )
        if force[0] != 0 or not (np.diff(force) > 0).all() or not np.isfinite(force).all():
            raise ValueError(f"curve: force = {force.tolist()} N: must start at 0 and rise")
        falling = (np.diff(resistance) < 0).all() and resistance[-1] > 0
        if not falling or not np.isfinite(resistance).all():
            raise ValueError(
                f"curve: resistance = {resistance.tolist()} ohm: must fall, be finite and above 0"
            )
        self.points = tuple(zip(force.tolist(), resistance.tolist(), strict=True))
        self.offset = self.gain = None
        root = np.sqrt(force)
        # The given points stay in the table: the curve passes through them exactly.
        self._root = np.union1d(np.linspace(0.0, root[-1], self._TABLE_POINTS), root)
        with np.errstate(all="ignore"):
            self._log_g = -_pchip(root, np.log(resistance), self._root)
            falls = bool((np.diff(self._log_g) >= 0).all())  # not so where a slope is not finite
        if not falls:
            raise ValueError(
                f"curve: force = {force.tolist()} N, resistance = {resistance.tolist()} ohm: "
                "points too close to one another"
            )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> PressureCurve:
        """Read a curve from YAML: two lists, ``force`` [N] and ``resistance`` [ohm].

        Raises:
            FileError: the file is not such YAML; the message names the file and the key.
            OSError: the file cannot be read.
        """
        from ..yaml_files import read_yaml  # here, so that physics works without PyYAML

        data = read_yaml(path)
        if not isinstance(data, dict) or set(data) != {"force", "resistance"}:
            found = sorted(data) if isinstance(data, dict) else type(data).__name__
            raise FileError(f"{path}: needs the keys force [N] and resistance [ohm], has {found}")
        for name, values in data.items():
            if not isinstance(values, list) or not {type(v) for v in values} <= {int, float}:
                raise FileError(f"{path}: {name} = {shorten(values)}: must be a list of numbers")
        try:
            return cls(**data)
        except ValueError as error:
            raise FileError(f"{path}: {error}") from error

    def resting_at(self, resistance: npt.ArrayLike) -> PressureCurve:
        """Return the curve of cells that rest at (rows, cols) resistances [ohm] of their own.

        What a cell conducts more or less than the curve at rest, it does under any load: a tare.
        A pressed cell conducts a hundred times as much and hardly feels it.
        """
        resistance = np.asarray(resistance, dtype=float)
        bad = resistance[~((resistance > self.points[-1][1]) & np.isfinite(resistance))]
        if bad.size:
            raise ValueError(
                f"curve: a cell that rests at {bad[0]} ohm: must be finite and above the "
                f"curve's end, {self.points[-1][1]:g} ohm"
            )
        tared = copy.copy(self)
        tared.offset = frozen(1.0 / resistance - 1.0 / self.points[0][1])
        return tared

    def with_gain(self, gain: npt.ArrayLike | None) -> PressureCurve:
        """Return the curve of cells with (rows, cols) times the force that it says; None: 1.

        Of arrays that do not end in (rows, cols) it is that of the usual cell.
        """
        own = copy.copy(self)
        own.gain = None if gain is None else frozen(np.array(gain, dtype=float))
        if own.gain is not None:
            positive = (own.gain > 0.0) & (own.gain < np.inf)
            if not positive.all():
                bad = own.gain[~positive].flat[0]
                raise ValueError(f"curve: a cell of gain {bad:g}: must be above 0 and finite")
        return own

    def up_to(self, force: float) -> PressureCurve:
        """Return the curve with a `max_force` of `force` [N] at least.

        Beyond its last point a cell conducts more with each newton as between its last two.
        """
        end = force / (1.0 if self.gain is None else float(self.gain.min()))
        (before, _), (last, _) = self.points[-2:]
        if end <= last:
            return self
        forces, resistances = np.array(self.points).T
        conducts, most = 1.0 / resistances[-2:]
        most += (most - conducts) * (end - last) / (last - before)
        longer = PressureCurve(np.append(forces, end), np.append(resistances, 1.0 / most))
        longer.offset, longer.gain = self.offset, self.gain
        return longer

    @property
    def usual(self) -> PressureCurve:
        """That of the usual cell: without offset and gain."""
        own = self.with_gain(None)
        own.offset = None
        return own

    @property
    def max_force(self) -> float:
        """Largest force that every cell tells from a larger one [N]."""
        least = 1.0 if self.gain is None else float(self.gain.min())
        return float(self.points[-1][0] * least)

    def _gain_of(self, values: float | Floats) -> float | Floats:
        """Return the gain of the cells, if the values are theirs."""
        if self.gain is None or np.shape(values)[-2:] != self.gain.shape:
            return 1.0
        return self.gain

    @property
    def rest_resistance(self) -> float | Floats:
        """Resistance of an untouched cell [ohm]; (rows, cols) with an offset."""
        return self._with_offset(self.points[0][1])

    @property
    def least_resistance(self) -> float | Floats:
        """Resistance at `max_force` [ohm]; (rows, cols) with an offset."""
        return self._with_offset(self.points[-1][1])

    def _with_offset(self, resistance: float | Floats) -> float | Floats:
        return resistance if self.offset is None else 1.0 / (1.0 / resistance + self.offset)

    def resistance(self, force: float | Floats) -> Floats:
        """Force on a cell [N] -> its resistance [ohm]; arrays; clipped to the curve."""
        root = np.sqrt(np.maximum(force, 0.0) / self._gain_of(force))
        resistance: Floats = np.exp(-np.interp(root, self._root, self._log_g))
        return resistance if self.offset is None else 1.0 / (1.0 / resistance + self.offset)

    def force(self, resistance: float | Floats) -> Floats:
        """Resistance of a cell [ohm] -> force on it [N]; clipped to [0, max_force].

        0 ohm and infinity are allowed: a short reads as `max_force`, an open cell as 0.
        """
        with np.errstate(divide="ignore"):
            return self.force_at(-np.log(resistance))

    def force_at(self, log_g: float | Floats) -> Floats:
        """log of a cell's conductance [S] -> force on it [N], as `force`."""
        if self.offset is not None:
            with np.errstate(divide="ignore"):
                log_g = np.log(np.maximum(np.exp(log_g) - self.offset, 0.0))
        root: Floats = np.interp(log_g, self._log_g, self._root)
        return np.square(root) * self._gain_of(log_g)

    def slope(self, force: float | Floats) -> Floats:
        """d force / d log(resistance) [N], of the curve without its offset."""
        gain = self._gain_of(force)
        root = np.sqrt(np.minimum(np.maximum(force / gain, 0.0), self.points[-1][0]))
        after = np.searchsorted(self._root, root, side="right")
        k = np.minimum(np.maximum(after, 1), self._root.size - 1)
        d_root = (self._root[k] - self._root[k - 1]) / (self._log_g[k - 1] - self._log_g[k])
        slope: Floats = 2.0 * root * d_root * gain
        return slope

    def describe(self) -> dict[str, list[float]]:
        """Return the curve's points as plain lists, as trained weights keep them.

        `load` reads them. Offset and gain, which belong to one skin, are left out.
        """
        force, resistance = zip(*self.points, strict=True)
        return {"force": list(force), "resistance": list(resistance)}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PressureCurve) or self.points != other.points:
            return False
        both = (self.offset, other.offset), (self.gain, other.gain)
        return all(a is b or np.array_equal(a, b) for a, b in both)  # type: ignore[arg-type]

    def __hash__(self) -> int:
        return hash(self.points)

    def __repr__(self) -> str:
        top, rest, least = self.max_force, self.points[0][1], self.points[-1][1]
        return f"PressureCurve(0..{top:.3g} N -> {rest:.3g}..{least:.3g} ohm)"
