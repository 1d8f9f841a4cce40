# SPDX-License-Identifier: Apache-2.0
"""From what the ADC reads to the circuit's ratio: scale, table, polarity, diodes, no reading.

The solvers know a ratio from 0 to 1, the voltage over the reference resistor as a share of the
divider's supply. Boards send counts, and few of them are that ratio times 2^bits - 1: an ADC may
have a reference of its own, an ESP32's is not linear and reads 0 up to 142 mV, readings fall with
pressure where the reference resistor is on the side of the supply, and a diode keeps a part of the
supply from the line that is driven through it. This is the one place that knows.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ..files import shorten
from .arrays import Bools, Floats, Value, frozen
from .circuit import Circuit

Samples: TypeAlias = npt.NDArray[np.uint16]  # of skin/adc
NOT_READ = 65535  # of skin/adc: no reading of this crossing; the largest reading is one less
_SCHOTTKY = 0.4  # V at 1 mA: Schottky diodes take less, others more
# V that such a diode, and another, takes more for e times the current, n k T / q at 25 degrees: n
# is 1.0 to 1.1 of Schottky diodes, 1.75 of a 1N4148 and 1.8 of a 1N4007 (SPICE models).
_SLOPES = 0.027, 0.045
_DIODE_AT = 1e-3  # A
_LEAST_CURRENT = 1e-9  # A: no reading says less
_DIODE_ROUNDS = 12  # of a fixed point that gains two digits each
# Tables that are shipped, name -> file: readings of _TABLE_BITS bits, their shares of the supply.
TABLES = {p.stem: p for p in sorted((Path(__file__).parent / "adc_tables").glob("*.csv"))}
_TABLE_BITS = 12
# Shares of the supply, RMS, by which chips are off a shipped table, and off it once it is bent
BENT, BETWEEN = 0.015, 0.0008
_MIDDLE = np.array([0.25, 0.75])  # of the range: between them a table's slope is taken as the usual


@dataclass(frozen=True, eq=False)
class Adc:
    """The converter of one board; by default a count is the ratio times 2^bits - 1.

    The voltage's share of the supply is (count + offset) / full_scale, or what the table has for
    count + offset, times (2^bits - 1) / full_scale. At the ends of its range a reading is a bound.

    Args:
        circuit: whose readings these are.
        offset: what the ADC reads too low [ADC steps]; negative: too high.
        full_scale: what the supply of the divider would read, were there no offset and no end of
            the range [ADC steps]; 0: 2^bits - 1.
        inverted: readings fall with pressure.
        scanned: (rows, cols) bool, crossings that the board reads; None: all of them.
        diode: forward voltage at 1 mA of the diode through which each line is driven [V]; 0: none.
        supply: of the divider [V]; only a diode needs it.
        table: of an ADC that is not linear: a name of `TABLES`, or (n, 2) readings [ADC steps],
            rising, and the shares of the supply that they stand for, not falling; None: linear.
        typical: whether the table is that of a typical chip, and this one may be `bent`.

    Raises:
        ValueError: a full scale, an offset, a diode or a table that leaves no range, a diode of a
            grounded matrix, a picture of another shape.
    """

    circuit: Circuit
    offset: float = 0.0
    full_scale: float = 0.0
    inverted: bool = False
    scanned: Bools | None = field(default=None, repr=False)
    diode: float = 0.0
    supply: float = 5.0
    table: str | Floats | None = None
    typical: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        full = self.full_scale or float(self.circuit.full_scale)
        if not 1.0 <= full < np.inf:
            raise ValueError(f"adc_full_scale = {self.full_scale!r}: must be 1 or more, or 0")
        if not abs(self.offset) < full:
            raise ValueError(
                f"adc_offset = {self.offset!r} ADC steps: "
                f"must be less than the full scale, {full:g}"
            )
        object.__setattr__(self, "full_scale", full)
        if not 0.0 <= 2.0 * self.diode < self.supply:
            raise ValueError(
                f"diode = {self.diode!r} V: must be at least 0, below half of supply = "
                f"{self.supply!r} V"
            )
        if self.diode and not self.circuit.readout_class.takes_diodes:
            raise ValueError(
                f"diode = {self.diode!r} V: must be 0 for readout = {self.circuit.readout!r}. A "
                "diode holds no line at 0 V: lines behind diodes are those of readout = 'loaded'"
            )
        if self.scanned is not None:
            scanned = np.array(self.scanned, dtype=bool)
            if scanned.shape != self.circuit.shape:
                raise ValueError(
                    f"scanned has shape {scanned.shape}: the circuit is {self.circuit.shape}"
                )
            if not scanned.any():
                raise ValueError("scanned: no crossing is read")
            object.__setattr__(self, "scanned", frozen(scanned))
        object.__setattr__(self, "typical", isinstance(self.table, str) and not self.diode)
        if self.table is not None:
            object.__setattr__(self, "table", _table(self.table, self.circuit.adc_bits))

    @cached_property
    def _sample(self) -> int:
        """Of skin/adc, in an ADC step."""
        return 1 << (16 - self.circuit.adc_bits)

    @cached_property
    def _top(self) -> int:
        """The largest count, as a sample of skin/adc."""
        return self.circuit.full_scale * self._sample

    def unread(self, samples: Samples) -> Bools:
        """(..., rows, cols) bool: crossings that are named as such, marked, or 0 with no cell.

        Args:
            samples: of skin/adc.
        """
        unread: Bools = samples == NOT_READ
        if self.circuit.mask is not None:  # through its neighbours it would read more than 0
            unread |= ~self.circuit.mask & (samples == 0)
        return unread if self.scanned is None else unread | ~self.scanned

    def marked(self, samples: Samples, unread: Bools | None = None) -> Samples:
        """Return samples as skin/adc carries them: NOT_READ where no reading is, and only there.

        Args:
            unread: (rows, cols) bool, what the board itself says that it did not read.
        """
        known = np.minimum(samples, NOT_READ - 1)
        absent = self.unread(known)
        if unread is not None:
            absent |= unread
        return np.where(absent, samples.dtype.type(NOT_READ), known) if absent.any() else known

    def ratio_of(self, samples: Samples) -> Floats:
        """skin/adc -> ADC ratio in [0, 1] for the solvers, NaN where there is no reading.

        Raises:
            ValueError: there is none at all.
        """
        absent = self.unread(samples)
        if absent.all():
            raise ValueError("no crossing of the frame was read")
        steps = samples / self._sample
        return self.ratio(np.where(absent, np.nan, steps) if absent.any() else steps)

    def ratio(self, count: Value) -> Value:
        """Turn a reading [ADC steps] into an ADC ratio in [0, 1]; noise beyond is cut off.

        The low-pass may round the largest reading up by less than a step. With a diode a picture
        is needed, (..., rows, cols): a line's current follows from all of its readings.
        """
        share = self._share_of(count)
        ratio: Value = np.minimum(np.maximum(1.0 - share if self.inverted else share, 0.0), 1.0)
        if self.diode:
            ratio = np.minimum(ratio / self._behind_diode(ratio), 1.0)
        return ratio

    def count(self, ratio: Value) -> Value:
        """Return the inverse of `ratio`, where nothing is cut off [ADC steps]."""
        share = ratio
        for _ in range(_DIODE_ROUNDS if self.diode else 0):
            share = np.multiply(ratio, self._behind_diode(share))
        return self._count_of(1.0 - share if self.inverted else share)

    def _share_of(self, count: Value) -> Value:
        """Return the voltage's share of the supply, cut off at the table's ends if there is one."""
        if self.table is None:
            return (count + self.offset) / self.full_scale
        share: Value = np.interp(count + self.offset, *np.asarray(self.table).T)
        return share * (self.circuit.full_scale / self.full_scale)

    def _count_of(self, share: Value) -> Value:
        """Return the inverse of `_share_of` [ADC steps]."""
        if self.table is None:
            return share * self.full_scale - self.offset
        at, share_there = np.asarray(self.table).T
        share = share * self.full_scale / self.circuit.full_scale
        reading: Value = np.interp(share, share_there, at)
        return reading - self.offset

    @cached_property
    def range(self) -> tuple[float, float]:
        """The ratios that the ends of the ADC's range stand for.

        A reading there says only that the ratio is not above the lower one, or not below the upper
        one: an ESP32 reads 0 for whatever is below 142 mV, and its largest number above 3.13 V.
        """
        ends = np.array([0.0, self.circuit.full_scale])
        share = np.clip(self._share_of(ends), 0.0, 1.0)
        low, high = sorted((1.0 - share if self.inverted else share).tolist())
        return low, high

    def bounds(self, ratio: Floats) -> Bools:
        """Return a bool array: readings at an end of the ADC's `range`, which are bounds only."""
        low, high = self.range
        ends = high < 1.0 or not self.circuit.has_cross_talk
        return ((ratio <= low) & (low > 0.0)) | ((ratio >= high) & ends)

    def bends(self, ratio: Floats) -> Floats:
        """Return (k, ...) what ratios are off by, for 1 of each way that this chip may be another.

        A shipped table is a typical chip's: all may read alike too high, and the end, where it is
        not straight, lie elsewhere. A gain reads as another r_par and fabric. Else k is 0.
        """
        if not self.typical:
            return np.empty((0, *np.shape(ratio)))
        high = self._share_of(np.asarray(self.table)[[1, -1], 0] - self.offset)
        knots = [high[0], high.mean(), high[1]]
        share = 1.0 - ratio if self.inverted else ratio
        return np.array([np.interp(share, knots, at) for at in ([1, 1, 1], [0, 1, 0], [0, 0, 1])])

    def straight(self, ratio: Floats, bent: Floats) -> Floats:
        """Return ratios (...) of a chip that is (k,) `bent` as they would be of this one."""
        if not len(bent):
            return ratio
        straight: Floats = np.clip(ratio - np.tensordot(bent, self.bends(ratio), 1), 0.0, 1.0)
        return straight

    def bent(self, bent: Floats) -> Adc:
        """Return the converter of a chip that is (k,) bent, with a table of its own."""
        if not len(bent):
            return self
        at = np.asarray(self.table)[:, 0]
        share = self._share_of(at - self.offset)
        ratio = self.straight(1.0 - share if self.inverted else share, bent)
        share = (
            (1.0 - ratio if self.inverted else ratio) * self.full_scale / self.circuit.full_scale
        )
        return replace(self, table=np.stack([at, np.maximum.accumulate(share)], 1))

    def _behind_diode(self, share: float | Floats) -> Any:
        """Return what the diode leaves of the supply, as share of it, by what is read behind it.

        All current of a driven line returns through the reference resistors: through one if
        floating, through those of all sense lines if loaded.
        """
        amperes = np.asarray(share) * (self.supply / self.circuit.r_ref)
        amperes = self.circuit.readout_class.through_driver(self.circuit, amperes)
        slope = _SLOPES[0] if self.diode < _SCHOTTKY else _SLOPES[1]
        more = slope * np.log(np.maximum(amperes, _LEAST_CURRENT) / _DIODE_AT)
        return 1.0 - np.maximum(self.diode + more, 0.0) / self.supply

    def share(self, steps: float) -> float:
        """So many ADC steps as a ratio: of noise, say. Of a table, where its slope is the usual."""
        slope = 1.0 / self.full_scale
        if self.table is not None:  # of the middle of its range
            slope = float(np.diff(self._share_of(_MIDDLE * self.circuit.full_scale))[0])
            slope /= float(np.diff(_MIDDLE)[0]) * self.circuit.full_scale
        return steps * slope / (1.0 - self.diode / self.supply)

    def threshold(self, steps: float) -> float:
        """Ratio up to which a board that sends nothing true below so many steps says nothing."""
        if not steps:
            return 0.0
        return float(self.share(steps) if self.inverted else self.ratio(steps))

    def rising(self, samples: Samples) -> Samples:
        """Return samples that rise with pressure whatever the polarity; 0 where not read."""
        absent = self.unread(samples)
        if self.inverted:
            samples = self._top - np.minimum(samples, self._top)
        return np.where(absent, samples.dtype.type(0), samples) if absent.any() else samples

    def rising_count(self, ratio: Value) -> Value:
        """Return what `rising` makes of a ratio, a number or (rows, cols) [ADC steps]."""
        count = self.count(ratio)
        return self.circuit.full_scale - count if self.inverted else count


def _table(given: str | npt.ArrayLike, bits: int) -> Floats:
    """Return (n, 2) readings of so many bits [ADC steps] and their shares of the supply."""
    if isinstance(given, str):
        if given not in TABLES:
            allowed = f"{', '.join(TABLES)}, or a list: reading, share of the supply, reading, ..."
            raise ValueError(f"adc_table = {given!r}: must be {allowed}")
        table = np.loadtxt(TABLES[given], delimiter=",")
        table[:, 0] *= 2.0 ** (bits - _TABLE_BITS)
    else:
        try:
            table = np.array(given, dtype=float).ravel()
        except (TypeError, ValueError):  # no numbers
            table = np.empty(0)
        if table.size < 4 or table.size % 2:
            raise ValueError(
                f"adc_table = {shorten(given)}: must be two or more pairs of a reading [ADC steps] "
                "and its share of the supply"
            )
        table = table.reshape(-1, 2)
    reading, share = table.T
    if not (np.isfinite(table).all() and (np.diff(reading) > 0.0).all()):
        raise ValueError(f"adc_table: readings {reading.tolist()}: must be finite and rise")
    if not ((np.diff(share) >= 0.0).all() and 0.0 <= share[0] < share[-1] <= 1.0):
        raise ValueError(f"adc_table: shares {share.tolist()}: must be from 0 to 1 and never fall")
    return frozen(table)
