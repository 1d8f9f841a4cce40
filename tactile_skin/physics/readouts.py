"""How a matrix is read: from the conductances of a frame to its readings and their derivatives.

    floating   one row is driven, one column is read, all other lines are open: the paper's board
    loaded     one row is driven, each column has its own reference resistor, other rows are open
    grounded   one row is driven, each column has its reference resistor, other rows are at 0 V,
               all rows behind r_drive
    virtual_ground
               one row is driven, an amplifier with the feedback resistor r_ref holds each column at
               0 V: a reading is r_ref over its own cell, up to full scale

In the last three rows and columns may change places. `solve` gives a frame's network, `Floating`,
`Driven` or `Separate`, which answer alike (docs/derivation.md); adc_a is the reading of crossing a,
g_b the conductance of cell b:

    adc            (rows, cols) ADC ratio
    own            (rows, cols) d adc_a / d g_a [ohm]
    by_r_par       (rows, cols) d adc_a / d r_par [1/ohm]
    by_r_drive     the same of r_drive, if grounded
    change(p)      (rows, cols) sum_b d adc_a / d g_b * p_b
    pull(w)        (rows, cols) sum_a w_a * d adc_a / d g_b
    sensitivity(weight, readings, one, other)
                   (m, n) float32, weight_a times d adc_a / d (a conductance between two lines)
    cells_for(cells, b)
                   (rows, cols) p, 0 but at the flat `cells`, where change(p) is b
    readings_for(cells, b)
                   (rows, cols) w, 0 but at the flat `cells`, where pull(w) is b
"""

from __future__ import annotations

import math
from copy import copy
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from . import laplacian
from .conjugate_gradients import conjugate_gradients

PASSIVE = "floating", "loaded", "grounded"
READOUTS = *PASSIVE, "virtual_ground"
CLOSED_FORM = "grounded", "virtual_ground"  # whose cells follow from the readings, line by line
DRIVEN = "rows", "columns"
_DRIVER = 0.1  # ohm of a driver that holds its line, where it is taken as ideal
LEAST_SCALE = 1e-6  # of `apparent`: noise of a saturated frame may leave less, or less than 0


class Floating:
    """All follows from two-terminal resistances rho: d rho_a / d g_b = -t_ab^2."""

    def __init__(self, circuit, g: np.ndarray, derivatives: bool):
        if derivatives:
            self.inverse = laplacian.solve(g)
            self.rho = self.inverse.rho
        else:
            self.rho = laplacian.connected_rho(g)
        self.adc = circuit.ratio(self.rho)
        self._circuit = circuit

    def behind(self, added: np.ndarray) -> Floating:
        """The same with (rows, cols) [ohm] more before each reading."""
        other = copy(self)
        other.__dict__.pop("_slope", None)
        other.adc = self._circuit.ratio(self.rho + added)
        return other

    @cached_property
    def _slope(self) -> np.ndarray:
        """- d adc / d rho [1/ohm]."""
        slope = self.adc * self.adc
        slope /= self._circuit.r_ref
        return slope

    @property
    def own(self) -> np.ndarray:
        return self.rho * self.rho * self._slope

    @property
    def by_r_par(self) -> np.ndarray:
        return -self._slope

    def change(self, p: np.ndarray) -> np.ndarray:
        return self._slope * laplacian.hessian_product(self.inverse.k, p)

    def pull(self, w: np.ndarray) -> np.ndarray:
        return laplacian.hessian_product(self.inverse.k, w * self._slope)

    def sensitivity(self, weight, readings, one, other) -> np.ndarray:
        return laplacian.sensitivity(self.inverse.k, weight * self._slope, readings, one, other)

    def cells_for(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self._solve(cells, b / self._slope)

    def readings_for(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self._solve(cells, b) / self._slope

    def _solve(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        """t_ab^2 x_b = b_a, without the matrix."""
        picture = np.zeros(self.adc.shape)

        def product(p):
            picture.flat[cells] = p
            return laplacian.hessian_product(self.inverse.k, picture).flat[cells]

        diagonal = np.square(self.rho.flat[cells])
        x = conjugate_gradients(product, diagonal, b.flat[cells], steps=300, target=1e-6)
        picture.flat[cells] = x
        return picture


class Driven:
    """All follows from the voltages of the lines while each line in turn is driven.

    P_i: of all lines while driven line i is at the supply, behind r_par where it is loaded, behind
    r_drive where it is grounded. K_j: of all lines for a current into sense line j, the driven ones
    being open or at 0 V. Where they are open, i is held by its driver while it is driven, and what
    is left of K_j is K_j - C_ij P_i; C is 0 if grounded. Then for a = (i, j), and e_b from one line
    of b to the other,

        adc_a = s P_ij,   d adc_a / d g_b = - s (P_i e_b) ((K_j - C_ij P_i) e_b)

    Inside, pictures are (driven, sense) and the driven lines come first.
    """

    def __init__(self, circuit, g: np.ndarray):
        self._turned = circuit.driven == "columns"
        self._g = g = self._turn(g)
        self._rows = rows = len(g)
        self._picture, self._lines = g.shape, sum(g.shape)
        self._shift = g.shape[0] if self._turned else 0  # of a line's number, inside
        loaded = circuit.readout == "loaded"
        self._load = circuit.r_ref if loaded else circuit.r_ref + circuit.r_par
        self._s, self._at_drive = circuit.r_ref / self._load, None
        self._c = self._back = np.zeros((rows, 1))  # ohm; _back: K_ji
        self._held: np.ndarray | float = 1.0  # P_ii
        if circuit.has_ideal_drivers:
            self._at_sense = 1.0 / (1.0 / self._load + g.sum(0))  # ohm, K_jj
            self._v = g * self._at_sense  # P_ij
        else:
            k = self._inverse(g, 0.0 if loaded else 1.0 / circuit.r_drive)
            self._at_sense, self._back = k.diagonal()[rows:], k[:rows, rows:]
            drive: np.ndarray | float = circuit.r_drive  # ohm
            if loaded:
                drive = self._at_drive = k.diagonal()[:rows, None] + circuit.r_par
                self._c = self._back
            self._p, self._k = k[:rows] / drive, k[rows:]
            self._v, self._held = self._p[:, rows:], self._p.diagonal()[:, None]
        self.adc = self._turn(self._s * self._v)

    def _inverse(self, g: np.ndarray, at_drive: float) -> np.ndarray:
        """K [ohm], where so much leads from each driven line to ground [S]."""
        rows = self._rows
        matrix = np.zeros((self._lines, self._lines))
        matrix[rows:, :rows] = -g.T
        ends = np.r_[g.sum(1) + at_drive, g.sum(0) + 1.0 / self._load]
        ends[ends == 0.0] = 1.0  # a driven line without a cell: nothing reaches another
        matrix.flat[:: self._lines + 1] = ends
        factor, _ = lapack.dpotrf(matrix, lower=1, overwrite_a=1)
        k, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
        k += np.tril(k, -1).T
        return k

    @cached_property
    def _p(self) -> np.ndarray:  # if grounded by ideal drivers
        return np.concatenate([np.eye(self._rows), self._v], 1)

    @cached_property
    def _k(self) -> np.ndarray:  # if grounded by ideal drivers
        ends = self._at_sense
        return np.concatenate([np.zeros((len(ends), self._rows)), np.diag(ends)], 1)

    def _turn(self, picture: np.ndarray) -> np.ndarray:
        """(rows, cols) to (driven, sense), and back."""
        return picture.T if self._turned else picture

    @property
    def own(self) -> np.ndarray:
        across = self._held - self._v
        return self._turn(self._s * across * (self._at_sense - self._back + self._c * across))

    @property
    def by_r_par(self) -> np.ndarray:
        if self._at_drive is not None:
            return self._turn(-self._s * self._v / self._at_drive)
        back = self._v @ self._k[:, self._rows :]  # what is left by the other sense lines, too
        return self._turn(self._s / self._load * (back / self._load - self._v))

    @property
    def by_r_drive(self) -> np.ndarray:
        """Each driver's current, times what a volt behind that driver makes of the readings."""
        currents = -self._p[:, self._rows :] @ self._g.T
        currents += self._p[:, : self._rows] * self._g.sum(1)
        return self._turn(-self._s * currents @ self._v)

    def change(self, p: np.ndarray) -> np.ndarray:
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

    def pull(self, w: np.ndarray) -> np.ndarray:
        rows, w = self._rows, self._turn(w)
        held = (w * self._c).sum(1)[:, None] * self._p - w @ self._k
        own = np.einsum("il,il->l", self._p, held)
        between = self._p[:, :rows].T @ held[:, rows:] + held[:, :rows].T @ self._p[:, rows:]
        return self._turn(self._s * (own[:rows, None] + own[rows:] - between))

    def sensitivity(self, weight, readings, one, other) -> np.ndarray:
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

    def cells_for(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self._solve(self._slopes(cells), cells, b)

    def readings_for(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        return self._solve(self._slopes(cells).T, cells, b)

    def _slopes(self, cells: np.ndarray) -> np.ndarray:
        """(n, n) d adc / d g, of cells and their own readings."""
        row, col = np.divmod(cells.astype(np.int32), np.int32(self.adc.shape[1]))
        col += np.int32(len(self.adc))
        return self.sensitivity(np.ones(self.adc.shape), cells, row, col)

    def _solve(self, slopes: np.ndarray, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        picture = np.zeros(self.adc.shape)
        picture.flat[cells] = np.linalg.solve(slopes, b.flat[cells])
        return picture


class Separate:
    """Each reading is that of its own cell: adc = r_ref g / (1 + r_par g), as if with no end."""

    def __init__(self, circuit, g: np.ndarray):
        behind = 1.0 + circuit.r_par * g
        self.adc = circuit.r_ref * g / behind
        self.own = circuit.r_ref / np.square(behind)
        self.by_r_par = np.square(self.adc) / -circuit.r_ref

    def change(self, p: np.ndarray) -> np.ndarray:
        return self.own * p

    def pull(self, w: np.ndarray) -> np.ndarray:
        return self.own * w

    def sensitivity(self, weight, readings, one, other) -> np.ndarray:
        row, col = np.divmod(readings, weight.shape[1])
        of_cell = (row[:, None] == one) & (col[:, None] + len(weight) == other)
        return (of_cell * (weight * self.own).flat[readings][:, None]).astype(np.float32)

    def cells_for(self, cells: np.ndarray, b: np.ndarray) -> np.ndarray:
        picture = np.zeros(self.adc.shape)
        own = self.own.flat[cells]
        picture.flat[cells] = np.divide(b.flat[cells], own, out=np.zeros(own.size), where=own > 0.0)
        return picture

    readings_for = cells_for


Network = Floating | Driven | Separate


def solve(circuit, g: np.ndarray, derivatives: bool = True) -> Network:
    """The network of cells g (rows, cols) [S], 0 where there is none.

    Args:
        g: if floating, of a connected network, which is not checked.
        derivatives: whether others than `own` and `by_r_par` will be asked for.
    """
    if circuit.readout == "floating":
        return Floating(circuit, g, derivatives)
    return (Separate if circuit.readout == "virtual_ground" else Driven)(circuit, g)


def of_network(circuit, laplacian: np.ndarray, lines, leads, r_ref: np.ndarray) -> np.ndarray:
    """(rows, cols) ADC ratio of any network, of damaged wires, say: not fast.

    Args:
        laplacian: (nodes, nodes) [S].
        lines: for rows and columns, the node that each address selects; -1: none, which reads 0.
        leads: for rows and columns, what lies between each address and its node [ohm].
        r_ref: of each sense line [ohm], infinite where it is missing; of Driven only.
    """
    every = np.arange(len(laplacian))
    if circuit.readout == "floating":
        k = np.linalg.inv(laplacian + laplacian[every, every].mean() / len(every))
        (a, b), own = lines, k.diagonal()
        rho = own[a][:, None] + own[b] - 2.0 * k[np.ix_(a, b)] + leads[0][:, None] + leads[1]
        adc = circuit.ratio(rho)
        adc[a < 0], adc[:, b < 0] = 0.0, 0.0
        return adc
    if circuit.readout == "virtual_ground":
        return _of_separate(circuit, laplacian, lines, leads, r_ref)
    turned, grounded = circuit.driven == "columns", circuit.readout == "grounded"
    (drive, sense), (before, behind) = (x[::-1] if turned else x for x in (lines, leads))
    load = r_ref + behind + (circuit.r_par if grounded else 0.0)  # ohm
    siemens = np.zeros(len(laplacian))
    np.add.at(siemens, sense[sense >= 0], 1.0 / load[sense >= 0])
    driver = max(circuit.r_drive, _DRIVER)
    if grounded:
        np.add.at(siemens, drive[drive >= 0], 1.0 / (before[drive >= 0] + driver))
    k = np.linalg.inv(laplacian + np.diag(siemens))
    # a line that is held at 0 V is driven by the same driver
    at_drive = before + driver if grounded else before + circuit.r_par + k.diagonal()[drive]
    share = np.divide(r_ref, load, out=np.ones(len(load)), where=np.isfinite(r_ref))
    adc = share * k[np.ix_(drive, sense)] / at_drive[:, None]
    adc[drive < 0], adc[:, sense < 0] = 0.0, 0.0
    return adc.T if turned else adc


def _of_separate(circuit, laplacian, lines, leads, r_ref) -> np.ndarray:
    """As `of_network`; a row that is joined to a column is a short circuit."""
    (a, b), turned = lines, circuit.driven == "columns"
    g = np.where(a[:, None] == b, np.inf, -laplacian[np.ix_(a, b)])
    with np.errstate(divide="ignore"):
        ohm = 1.0 / g + circuit.r_par + leads[0][:, None] + leads[1]
        adc = np.minimum((r_ref[:, None] if turned else r_ref) / ohm, 1.0)
    adc[a < 0], adc[:, b < 0] = 0.0, 0.0
    return adc


def sharing(circuit, cells: float) -> float:
    """Cells of a square touch of `cells` cells whose current flows through what lies in series.

    An ohm there hides as much as so many ohm of each of them: of all of a line where lines are
    driven; if floating, of g * rho = cells / (its rows + its columns - 1), by Foster's theorem.
    """
    side = min(math.sqrt(cells), *circuit.shape)
    if circuit.readout == "virtual_ground":
        return 1.0
    if circuit.readout == "floating":
        return cells / (side + cells / side - 1.0)
    return side


def apparent(circuit, adc: np.ndarray) -> tuple[np.ndarray | float, float]:
    """How readings (..., rows, cols) become resistances that vary with their own cell above all.

    Returns:
        scale, to be broadcast, or a number, and offset [ohm]: r_ref * scale / adc - offset is the
        two-terminal resistance if floating, r_ref times voltage over current of the own cell if
        loaded as if no current came to its sense line from other cells, and the cell otherwise.
    """
    if circuit.readout == "virtual_ground":
        return 1.0, circuit.r_par
    if circuit.readout == "floating":
        return 1.0, circuit.r_ref + circuit.r_par
    along, across = (-1, -2) if circuit.driven == "rows" else (-2, -1)
    if circuit.readout == "loaded":  # the driven line's own voltage, behind r_par
        scale = 1.0 - circuit.r_par / circuit.r_ref * adc.sum(along, keepdims=True)
        return np.maximum(scale, LEAST_SCALE), circuit.r_ref
    total = (circuit.r_ref + circuit.r_par) / circuit.r_ref
    return np.maximum(1.0 - total * adc.sum(across, keepdims=True), LEAST_SCALE), 0.0
