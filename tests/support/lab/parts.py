# SPDX-License-Identifier: Apache-2.0
"""Parts of a board that are bad: cells, wires behind diodes, a converter and its supply."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation.matrix import REST_SCATTER, Cell, Converter, Fabric, Matrix
from tactile_skin.simulation.network import Wiring

SCANS = 390  # a second, paper section III-B
_LATERAL = 0.005  # share that neighbours gain; the paper measured 0.5 %
_SCATTER = (0.05, 0.08)  # RMS of what a load adds to a cell's conductance, of boards; chosen
_LIFTS = 0.1  # chance that a loose cell changes from a picture to the next: a tenth of a second
_CHANGES = 10.0  # a second, of a loose contact
_THERMAL = 0.02569  # V, k T / q at 25 degrees
_NEWTON = 20  # steps; they converge quadratically


@dataclass
class BadFabric(Fabric):
    """Cells of which some are broken."""

    # cell -> its conductance [S], whatever is on it; added: on top of the fabric's [S]; restless:
    # relative RMS by which it changes from picture to picture; loose: share of them in which the
    # fabric does not touch the cell's electrodes. Both are drawn from `rng`.
    fixed: dict[Cell, float] = field(default_factory=dict)
    added: dict[Cell, float] = field(default_factory=dict)
    restless: dict[Cell, float] = field(default_factory=dict)
    loose: dict[Cell, float] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    _lifted: bool = field(default=False, repr=False)

    @classmethod
    def everyday(cls, circuit: Circuit, curve: PressureCurve, rng) -> BadFabric:
        """Draw one whose loads scatter by 5 to 8 %, and its cells at rest by 3 %."""
        scatter = rng.uniform(*_SCATTER)
        gain = np.exp(scatter * rng.standard_normal(circuit.shape))
        rest = np.exp(REST_SCATTER * rng.standard_normal(circuit.shape)) / curve.rest_resistance
        return cls(curve, circuit.populated, gain, rest, _LATERAL, rng=rng)

    @property
    def unsteady(self) -> bool:
        """Whether the cells change without a load that changes."""
        return bool(self.restless or self.loose)

    def conductance(self, force: np.ndarray, factor=1.0) -> np.ndarray:
        g = super().conductance(force, factor)
        for cell, siemens in self.fixed.items():
            g[(slice(None), *cell)] = siemens
        for cell, siemens in self.added.items():
            g[(slice(None), *cell)] += siemens
        for cell, share in self.restless.items():
            g[(slice(None), *cell)] *= np.exp(share * self.rng.standard_normal(len(g)))
        for cell, share in self.loose.items():
            for picture in g:
                if self.rng.random() < _LIFTS:
                    self._lifted = self.rng.random() < share
                if self._lifted:
                    picture[cell] = 0.0
        return g


class Diode(NamedTuple):
    """A diode through which a line is driven."""

    saturation: float  # current [A]
    emission: float  # coefficient of Shockley's law
    series: float  # resistance [ohm]
    supply: float = 5.0  # voltage that drives a line through it [V]

    def ratio(self, ideal: np.ndarray, circuit: Circuit) -> np.ndarray:
        """Return the ADC ratio (..., rows, cols) of lines that are driven through diodes.

        A line behind its diode is a resistor to the diode: the same voltage v scales all readings
        of the line, and v + V_diode(current per volt * v) = supply. That is concave in v, so that
        Newton's steps from the supply down end at its root.

        Args:
            ideal: the same without diodes; floating or loaded.
        """
        per_volt = ideal / circuit.r_ref  # A
        if circuit.readout == "loaded":
            across = -1 if circuit.driven == "rows" else -2
            per_volt = per_volt.sum(across, keepdims=True)
        volts, thermal = np.full_like(per_volt, self.supply), self.emission * _THERMAL
        for _ in range(_NEWTON):
            amperes = per_volt * volts
            drop = thermal * np.log1p(amperes / self.saturation) + self.series * amperes
            slope = per_volt * (thermal / (self.saturation + amperes) + self.series)
            volts -= (volts + drop - self.supply) / (1.0 + slope)
        return ideal * volts / self.supply


@dataclass
class BadMatrix(Matrix):
    """A mat whose driven lines may have a diode each; not of grounded matrices."""

    diode: Diode | None = None

    @classmethod
    def everyday(cls, circuit: Circuit, curve: PressureCurve, rng) -> BadMatrix:
        """Draw one with the scatter and the coupling of any fabric, and sound wires."""
        fabric = BadFabric.everyday(circuit, curve, rng)
        return cls(circuit, fabric, Wiring.sound(*circuit.shape))

    def _read(self, force, factor) -> np.ndarray:
        ratio = super()._read(force, factor)
        return ratio if self.diode is None else self.diode.ratio(ratio, self.circuit)


@dataclass
class BadConverter(Converter):
    """An ADC, with what may be wrong with it."""

    # RMS of a sample on top of the noise, (rows, cols) [ADC steps]
    extra_noise: np.ndarray | float = 0.0
    # gain, offset: function of a time [s] -> factor, ADC steps
    gain: Callable[[float], float] = lambda t: 1.0
    offset: Callable[[float], float] = lambda t: 0.0
    signal: bool = True  # whether it sees the matrix; else `stuck_ratio`
    stuck_ratio: float = 0.0
    # or_mask, and_mask: bits of a count that are always 1; and that may be 1
    or_mask: int = 0
    and_mask: int = -1
    settling: float = 0.0  # share of the previous reading that stays on the sampling capacitor
    # (row, column) -> share of the samples that are taken badly, what is left of them
    dips: dict[Cell, tuple[float, float]] = field(default_factory=dict)
    # (axis, line, share of time open) of a loose lead, or None
    flicker: tuple[int, int, float] | None = None
    stuck_samples: int | None = None  # what every sample reads instead, or None
    _closed: bool = field(default=True, repr=False)

    def count(self, ratio: np.ndarray, rng, t: np.ndarray | None = None) -> np.ndarray:
        """As `Converter.count`; t: (n,) that `gain` and `offset` are given [s], 0 by default."""
        t = np.zeros(len(ratio)) if t is None else t
        for cell, (share, left) in self.dips.items():
            ratio = ratio.copy()
            ratio[(rng.random(len(ratio)) < share, *cell)] *= left
        if not self.signal:
            ratio = np.full_like(ratio, self.stuck_ratio)
        if self.flicker:
            ratio = ratio * self._contact(self.flicker, ratio.shape, rng)
        if self.settling:
            flat = ratio.reshape(len(ratio), -1)
            flat = lfilter([1.0 - self.settling], [1.0, -self.settling], flat, axis=1)
            ratio = flat.reshape(ratio.shape)
        gain, offset = (np.vectorize(f)(t)[:, None, None] for f in (self.gain, self.offset))
        steps = np.minimum(ratio * gain, self.rail) * self.full_scale + offset
        steps = self._counted(ratio, steps, np.hypot(self.noise, self.extra_noise), rng)
        if self.stuck_samples is not None:
            steps[:] = self.stuck_samples
        return steps & self.and_mask | self.or_mask

    def _contact(self, flicker: tuple[int, int, float], shape, rng) -> np.ndarray:
        """(n, rows, cols), 0 while a loose contact is open; it lasts a tenth of a second or so."""
        axis, line, share = flicker
        state = np.ones(shape)
        for k, (change, chance) in enumerate(rng.random((shape[0], 2))):
            if change < _CHANGES / SCANS:
                self._closed = chance > share
            if not self._closed:
                state[k].swapaxes(0, axis)[line] = 0.0
        return state
