# SPDX-License-Identifier: Apache-2.0
"""Boards that nobody here made: their circuit, their fabric's curve and its creep are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation.textile import Textile

from .parts import BadMatrix

AT_REST = 60  # frames
_LEVEL, _TILT = 0.3, 0.3  # log of a fabric's resistance; of its change over the curve, at most
_R_PAR = 0.8, 1.2  # times the one that is supposed
_STRIPE = 15.0  # ohm, at most
_EVERYDAY = {"noise": 1.0, "scatter": 0.08, "rest": 0.03, "lateral": 0.005}
_R_DRIVE = 100.0  # ohm, at most: a multiplexer's


class Unknown:
    """A floating board.

    Args:
        ohms: times which it has all resistances of the paper's kind of board.
        fabric: times which, besides, its cells have theirs.
        fixed: of `Textile`, in place of what would be drawn.

    Attributes:
        supposed: the circuit that a skin is given.
        matrix, converter: as they truly are.
        r_par, r_line: the true ones [ohm].
        curve: the true one, of the usual cell; may be set.
    """

    def __init__(self, shape, seed: int, ohms: float = 1.0, fabric: float = 1.0, **fixed):
        rng = self._rng = np.random.default_rng(seed)
        paper = Circuit(*shape)
        self.supposed = replace(paper, r_ref=ohms * paper.r_ref, r_par=ohms * paper.r_par)
        points = PressureCurve().points
        level, tilt = np.exp(rng.uniform(-_LEVEL, _LEVEL)), rng.uniform(-_TILT, _TILT) / len(points)
        level *= ohms * fabric
        resistance = [r * level * np.exp(tilt * k) for k, (_, r) in enumerate(points)]
        curve = PressureCurve([force for force, _ in points], resistance)
        factor, line = rng.uniform(*_R_PAR), ohms * rng.uniform(0.0, _STRIPE)
        textile = Textile(**_EVERYDAY | {"r_par": factor, "line": line} | fixed)
        self.matrix = textile.draw(self.supposed, curve, np.random.default_rng(seed))
        self.converter = textile.converter(self.supposed)
        self.r_par = textile.r_par * self.supposed.r_par
        self.r_line = textile.line

    @property
    def curve(self) -> PressureCurve:
        return self.matrix.fabric.curve

    @curve.setter
    def curve(self, curve: PressureCurve) -> None:
        self.matrix.fabric.curve = curve

    def expose(self, force, factor=1.0) -> np.ndarray:
        """Return the ADC ratio (rows, cols) before noise and rounding of a load (rows, cols) [N].

        Args:
            factor: (rows, cols) times which a cell conducts otherwise.
        """
        return self.matrix.ratio(np.asarray(force)[None], factor)[0]

    def sample(self, ratio: np.ndarray) -> np.ndarray:
        """Return a reading of what `expose` gives."""
        return self.converter.frame(ratio, self._rng)

    def frames(self, force) -> np.ndarray:
        """Return (n, rows, cols) readings of loads (n, rows, cols) [N]."""
        return np.array([self.sample(self.expose(f)) for f in force])

    def at_rest(self, n: int = AT_REST) -> np.ndarray:
        """Return (n, rows, cols) readings of the untouched board."""
        ratio = self.expose(np.zeros(self.supposed.shape))
        return np.array([self.sample(ratio) for _ in range(n)])


class UnknownDriven(Unknown):
    """A loaded or grounded board: its stripes are ideal, its loads scatter by 5 to 8 %.

    Args:
        readout: and which lines are driven: for example "loaded-columns".
        r_ref: pull-up or pull-down resistor [ohm].

    Attributes:
        r_drive: of what holds a driven line of a grounded board, ideal or a multiplexer [ohm].
    """

    def __init__(self, shape, seed: int, readout: str, r_ref: float = Circuit().r_ref, **fixed):
        super().__init__(shape, seed, **{"line": 0.0} | fixed)
        readout, driven = readout.split("-")
        self.supposed = replace(self.supposed, readout=readout, driven=driven, r_ref=r_ref)
        self.r_drive = 0.0
        if readout == "grounded":
            self.r_drive = np.random.default_rng([seed, 3]).uniform(0.0, _R_DRIVE)
        true = replace(self.supposed, r_par=self.r_par, r_drive=self.r_drive)
        self.matrix = BadMatrix.everyday(true, self.curve, np.random.default_rng(seed))


class Creeping(Unknown):
    """A board whose loads gain with time, as 1 + share * log10(1 + t / time).

    Args:
        share: of a load's conductance, in a decade of time.
        time: after which it begins [s].
        cells: relative RMS scatter of the share.
        fixed: of `Unknown`.
    """

    def __init__(self, shape, seed: int, share: float, time: float, cells: float = 0.0, **fixed):
        super().__init__(shape, seed, **fixed)
        scatter = np.exp(cells * np.random.default_rng([seed, 5]).standard_normal(shape))
        self.share, self.time = share * scatter, time

    def standing(self, times: np.ndarray, force: np.ndarray, course: np.ndarray) -> np.ndarray:
        """Return readings (n, rows, cols) of a load that stands.

        Args:
            times: (n,) [s].
            force: (rows, cols) [N].
            course: (n,), in proportion to which the force is there; it may grow, and goes at once.
        """
        found, added = [], self._added(force)
        steps = np.diff(course, prepend=0.0)
        for n, t in enumerate(times):
            since = np.flatnonzero(course[: n + 1] <= 0.0)
            begun = since[-1] + 1 if since.size else 0
            # of the conductance, about in proportion to the force
            gained = steps[begun : n + 1] @ np.log10(1.0 + (t - times[begun : n + 1]) / self.time)
            gain = 1.0 + self.share * (gained / max(course[n], 1e-9))
            here = self._added(force * course[n]) if course[n] != 1.0 else added
            factor = 1.0 + (gain - 1.0) * here / (here + 1.0 / self.curve.rest_resistance)
            found.append(self.sample(self.expose(force * course[n], factor)))
        return np.array(found)

    def _added(self, force) -> np.ndarray:
        """(rows, cols) conductance of the usual cell that a load adds [S]."""
        return 1.0 / self.curve.resistance(force) - 1.0 / self.curve.rest_resistance
