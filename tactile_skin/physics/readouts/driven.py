# SPDX-License-Identifier: Apache-2.0
"""One line is driven, and each line across it has its own reference resistor and is read."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import lapack

from ..arrays import Floats, Floats32, Ints
from .readout import Pair, Readout, blank

if TYPE_CHECKING:
    from ..circuit import Circuit

DRIVER = 1e-3  # ohm of a driver that holds its line, where it is taken as ideal
LEAST_SCALE = 1e-6  # of `apparent`: noise of a saturated frame may leave less, or less than 0


class Driven(Readout):
    """All follows from the voltages of the lines while each line in turn is driven.

    P_i: of all lines while driven line i is at the supply, behind what its driver has. K_j: of all
    lines for a current into sense line j, the driven ones being open or held. Where they are open,
    i is held by its driver while it is driven, and what is left of K_j is K_j - C_ij P_i; C is 0 if
    they are held. Then for a = (i, j), and e_b from one line of b to the other,

        adc_a = s P_ij,   d adc_a / d g_b = - s (P_i e_b) ((K_j - C_ij P_i) e_b)

    Inside, pictures are (driven, sense) and the driven lines come first.
    """

    loads_lower = True
    _p: Floats  # (driven, lines) P
    _k: Floats  # (sense, lines) K [ohm]

    def __init__(self, circuit: Circuit, g: Floats, derivatives: bool = True):
        self._turned = circuit.driven == "columns"
        self._g = g = self._turn(g)
        self._rows = rows = len(g)
        self._picture, self._lines = g.shape, sum(g.shape)
        self._shift = g.shape[0] if self._turned else 0  # of a line's number, inside
        self._load = circuit.r_ref + self._before_r_ref(circuit)
        self._s = circuit.r_ref / self._load
        self._c: Floats = np.zeros((rows, 1))  # ohm
        self._back: Floats = self._c  # ohm, K_ji
        self._held: Floats | float = 1.0  # P_ii
        self._at_sense: Floats  # ohm, K_jj
        self._v: Floats  # P_ij
        self._drive_lines(circuit)
        self.adc = self._turn(self._s * self._v)

    @abstractmethod
    def _drive_lines(self, circuit: Circuit) -> None:
        """Fill P, K and what is known of them."""

    @classmethod
    @abstractmethod
    def _before_r_ref(cls, circuit: Circuit) -> float:
        """Return what lies between a sense line and its reference resistor [ohm]."""

    @classmethod
    @abstractmethod
    def _to_idle(cls, circuit: Circuit, before: Floats) -> Floats:
        """Return what holds each driven line at 0 V while it is idle, behind its lead [S]."""

    @classmethod
    @abstractmethod
    def _from_supply(cls, circuit: Circuit, before: Floats, own: Floats) -> Floats:
        """Return what lies between the supply and a source that drives each line alone [ohm].

        Args:
            before: (driven,) leads [ohm].
            own: (..., driven) of each line to ground, not driven [ohm].
        """

    def _of_inverse(self, k: Floats, drive: Floats | float) -> None:
        """Fill P and K from the inverse; each driven line is driven through `drive` [ohm]."""
        rows = self._rows
        self._at_sense, self._back = k.diagonal()[rows:], k[:rows, rows:]
        self._p, self._k = k[:rows] / drive, k[rows:]
        self._v, self._held = self._p[:, rows:], self._p.diagonal()[:, None]

    def _inverse(self, at_drive: float) -> Floats:
        """K [ohm], where so much leads from each driven line to ground [S]."""
        rows, g = self._rows, self._g
        matrix = np.zeros((self._lines, self._lines))
        matrix[rows:, :rows] = -g.T
        ends = np.concatenate([g.sum(1) + at_drive, g.sum(0) + 1.0 / self._load])
        ends[ends == 0.0] = 1.0  # a driven line without a cell: nothing reaches another
        matrix.flat[:: self._lines + 1] = ends
        factor, _ = lapack.dpotrf(matrix, lower=1, overwrite_a=1)
        k: Floats = lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
        own = k.diagonal().copy()
        k += k.T  # above the diagonal both routines leave 0
        k.flat[:: self._lines + 1] = own
        return k

    def _turn(self, picture: Floats) -> Floats:
        """(rows, cols) to (driven, sense), and back."""
        return picture.T if self._turned else picture

    @property
    def own(self) -> Floats:
        across = self._held - self._v
        return self._turn(self._s * across * (self._at_sense - self._back + self._c * across))

    def change(self, p: Floats) -> Floats:
        rows, p = self._rows, self._turn(p)
        flow = np.concatenate(  # L(p) P
            [
                self._p[:, :rows] * p.sum(1) - self._p[:, rows:] @ p.T,
                self._p[:, rows:] * p.sum(0) - self._p[:, :rows] @ p,
            ],
            1,
        )
        lost = np.einsum("il,il->i", self._p, flow)
        return self._turn(self._s * (self._c * lost[:, None] - flow @ self._k.T))

    def pull(self, w: Floats) -> Floats:
        rows, w = self._rows, self._turn(w)
        held = (w * self._c).sum(1)[:, None] * self._p - w @ self._k
        own = np.einsum("il,il->l", self._p, held)
        between = self._p[:, :rows].T @ held[:, rows:] + held[:, :rows].T @ self._p[:, rows:]
        return self._turn(self._s * (own[:rows, None] + own[rows:] - between))

    def sensitivity(self, weight: Floats, readings: Ints, one: Ints, other: Ints) -> Floats32:
        row, col = np.divmod(readings, weight.shape[1])
        drive, sense = (col, row) if self._turned else (row, col)
        one, other = ((line + self._shift) % self._lines for line in (one, other))
        p, k = ((v[:, one] - v[:, other]).astype(np.float32) for v in (self._p, self._k))
        c = np.broadcast_to(self._c, self._picture).astype(np.float32)[drive, sense]
        out = p[drive]
        held = c[:, None] * out
        held -= k[sense]
        out *= held
        out *= (self._s * weight.ravel()[readings]).astype(np.float32)[:, None]
        return out

    def cells_for(self, cells: Ints, b: Floats) -> Floats:
        return self._solve(self._slopes(cells), cells, b)

    def readings_for(self, cells: Ints, b: Floats) -> Floats:
        return self._solve(self._slopes(cells).T, cells, b)

    def _slopes(self, cells: Ints) -> Floats32:
        """(n, n) d adc / d g, of cells and their own readings."""
        row, col = np.divmod(cells.astype(np.int32), np.int32(self.adc.shape[1]))
        col += np.int32(len(self.adc))
        return self.sensitivity(np.ones(self.adc.shape), cells, row, col)

    def _solve(self, slopes: Floats32, cells: Ints, b: Floats) -> Floats:
        picture = np.zeros(self.adc.shape)
        picture.flat[cells] = np.linalg.solve(slopes, b.flat[cells])
        return picture

    @classmethod
    def of_network(
        cls,
        circuit: Circuit,
        laplacian: Floats,
        lines: tuple[Ints, Ints],
        leads: Pair,
        r_ref: Floats,
    ) -> Floats:
        turned = circuit.driven == "columns"
        (drive, sense), (before, behind) = (lines[::-1], leads[::-1]) if turned else (lines, leads)
        load = r_ref + behind + cls._before_r_ref(circuit)  # ohm
        nodes = np.concatenate([sense, drive])  # several addresses may select one
        siemens = np.concatenate([1.0 / load, cls._to_idle(circuit, before)])
        to_ground = np.bincount(nodes[nodes >= 0], siemens[nodes >= 0], laplacian.shape[-1])
        k = np.linalg.inv(laplacian + np.diag(to_ground)).astype(np.float64, copy=False)
        at_drive = cls._from_supply(circuit, before, k[..., drive, drive])
        share = np.divide(r_ref, load, out=np.ones(len(load)), where=np.isfinite(r_ref))
        adc = share * k[..., drive[:, None], sense] / at_drive[..., None]
        return blank(adc.swapaxes(-1, -2) if turned else adc, lines)

    @classmethod
    def sharing(cls, circuit: Circuit, cells: float, picture: Floats | None) -> float:
        """All of a line share it, idle ones too: r_ref limits what a pressed one takes of it."""
        along = circuit.sense_axis if cls.shares_sum else 1 - circuit.sense_axis
        if picture is None:
            return min(cells, circuit.shape[along])
        current = circuit.populated / (picture + (0.0 if cls.shares_sum else circuit.r_ref))
        return float(current.sum(along).max() / current.max())
