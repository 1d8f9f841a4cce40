# SPDX-License-Identifier: Apache-2.0
"""A skin on a geom of MuJoCo, in one world or many: contacts -> footprints -> fabric -> readings.

Not simulated: shear, covers that bend, hysteresis, stripes' resistance, scans that take time. The
footprint is Hertz's for a stiff ball on a soft layer, whatever touches; tangential forces and
contacts at the edge of a geom (whose normal is not the face's) press no cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from .living import Habits
from .matrix import OVERSAMPLED, REST_SCATTER, Fabric
from .simulator import FRAMES_PER_SECOND

SOFT = 0.3e6  # Pa, modulus of fabric and foam: 10 N of a ball of 30 mm sink 1 mm
SMALLEST = 1.2  # cells, radius of the smallest footprint: a point still loads its neighbours
FACING = 0.7  # cosine between a contact's normal and the face's, at least
DECADES = 5  # of time in which a load creeps, from Habits.time on


class MujocoSkin:
    """Skins of one kind, one in each world: every fabric is another.

    Attributes:
        force, raw: (worlds, rows, cols) true mean force of the last frame [N], and its ADC ratio.
        curves: what a calibration knows of each world's skin: the curve, and its own rest.
    """

    def __init__(
        self,
        model: Any,  # mujoco.MjModel
        geom: str,  # a box; its +z face senses, rows along y, columns along x
        circuit: Circuit,  # as it truly is
        curve: PressureCurve,  # of the usual cell
        worlds: int = 1,  # how many data `step` takes
        rate: float = FRAMES_PER_SECOND,
        noise: float = 1.0,  # RMS of a sample [ADC steps]
        scatter: float = 0.0,  # relative RMS of what a load adds to a cell's conductance
        creep: float = 0.0,  # share of it that a standing load gains in a decade of time
        seed: int = 0,
    ):
        self._model, self._geom = model, model.geom(geom).id
        self._circuit, self._noise, self._creep = circuit, noise, creep
        self._rng, shape = np.random.default_rng(seed), (worlds, *circuit.shape)
        rest = 1.0 / curve.rest_resistance
        rests = rest * np.exp(REST_SCATTER * self._rng.standard_normal(shape))
        gain = np.exp(scatter * self._rng.standard_normal(shape))
        self._fabric = Fabric(curve, circuit.populated, gain, rests)
        self.curves = [curve.resting_at(1.0 / own) for own in rests]
        x, y, _ = model.geom_size[self._geom]
        half, cells = np.array((y, x)), np.array(circuit.shape)
        self._pitch = 2.0 * half / cells  # m, of rows and columns
        along = zip(cells, self._pitch, strict=True)
        self._row, self._col = ((np.arange(n) + 0.5 - n / 2.0) * pitch for n, pitch in along)
        self._elliptic = model.opt.cone == 1  # mjCONE_ELLIPTIC
        self._every, self._due = 1.0 / rate, 0.0
        self._sum, self._steps = np.zeros(shape), 0
        self._crept = np.zeros((DECADES, *shape))
        self.force, self.raw = np.zeros(shape), forward(circuit, 1.0 / rests)

    def step(self, *worlds: Any) -> bool:
        """Take what presses after a step of each mujoco.MjData; return whether a frame is new."""
        self._sum += self.pressed(worlds)
        self._steps += 1
        if worlds[0].time < self._due - 1e-9:
            return False
        self._due = max(self._due, worlds[0].time - self._every) + self._every
        self.force, self._sum = self._sum / self._steps, np.zeros_like(self._sum)
        self._steps = 0
        self._read()
        return True

    def pressed(self, worlds: Sequence[Any]) -> np.ndarray:
        """Return the force on each cell now: (worlds, rows, cols) [N]."""
        found = []
        for k, data in enumerate(worlds):
            contact = data.contact
            mine = np.flatnonzero((contact.geom == self._geom).any(1) & (contact.efc_address >= 0))
            if not mine.size:
                continue
            turn = data.geom_xmat[self._geom].reshape(3, 3)
            x, y, z = turn.T @ (contact.pos[mine] - data.geom_xpos[self._geom]).T
            facing = np.abs(contact.frame[mine, :3] @ turn[:, 2]) >= FACING
            first, dim = contact.efc_address[mine], contact.dim[mine]
            size = np.where(self._elliptic | (dim == 1), 1, 2 * (dim - 1))  # forces of a normal one
            ends = np.append(first, first + size).reshape(2, -1).T.ravel()
            padded = np.append(data.efc_force, 0.0)
            newtons = np.add.reduceat(padded, ends)[::2] * facing * (z >= 0.0)
            others = contact.geom[mine].sum(1) - self._geom
            balls = self._model.geom_size[others, 0]
            found.append(np.array([np.full(len(mine), k), y, x, newtons, balls]))
        force = np.zeros_like(self.force)
        if found:
            world, y, x, newtons, ball = np.concatenate(found, 1)
            np.add.at(force, world.astype(int), self._footprints(y, x, newtons, ball))
        return force

    def _footprints(self, y, x, newtons, ball) -> np.ndarray:
        """Return m forces [N] at places [m] of balls [m] as (m, rows, cols), none of it lost."""
        radius = np.cbrt(0.75 * newtons * ball / SOFT)
        radius = np.maximum(radius, SMALLEST * self._pitch.max())[:, None]
        rows = np.square((self._row - y[:, None]) / radius)
        cols = np.square((self._col - x[:, None]) / radius)
        shape = np.sqrt(np.maximum(1.0 - rows[:, :, None] - cols[:, None], 0.0))
        shape *= self._circuit.populated
        return shape * (newtons / np.maximum(shape.sum((1, 2)), 1e-9))[:, None, None]

    def _read(self) -> None:
        """Make the frame of what pressed."""
        factor: Any = 1.0
        if self._creep:
            for k, crept in enumerate(self._crept):
                crept += (self.force - crept) * -np.expm1(-self._every / (Habits.time * 10.0**k))
            gained = self._creep * self._crept.sum(0) / np.maximum(self.force, 1e-9)
            factor = 1.0 + np.where(self.force > 0.0, gained, 0.0)
        conducts = self._fabric.conductance(self.force, factor)
        steps = self._circuit.readout_class.read(self._circuit, conducts)
        steps = OVERSAMPLED * self._circuit.full_scale * steps
        steps += self._noise * np.sqrt(OVERSAMPLED) * self._rng.standard_normal(steps.shape)
        full = OVERSAMPLED * self._circuit.full_scale
        self.raw = np.clip(np.rint(steps), 0, full) / full
