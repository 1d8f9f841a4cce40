"""The resistor matrix and its read-out: what the ADC sees for given cell resistances.

A skin of ``rows x cols`` cells is a bipartite resistor network: one node per stripe, one resistor
(the taxel) where a row stripe crosses a column stripe. The read-out connects one row and one
column and lets every other line float, so it sees the *two-terminal resistance* between the two
stripes, not the taxel alone: that is the cross-talk.

All readings of a frame follow from one small inverse. With the cell conductances ``g``, their row
sums ``D_r``, column sums ``D_c`` and the Schur complement ``S = D_r - g D_c^-1 g^T`` (the network
seen from the rows alone), any generalised inverse ``A`` of ``S`` gives the blocks

    C = A g D_c^-1          (rows x cols)
    D = D_c^-1 + D_c^-1 g^T C  (cols x cols)

of a generalised inverse ``[[A, C], [C^T, D]]`` of the whole Laplacian, and
``rho_ij = A_ii + D_jj - 2 C_ij`` (docs/derivation.md). The paper (section IV-B) solves one system
of ``rows*cols + 1`` equations per reading instead; it stands in the tests as the oracle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

try:  # the inner loops for small skins, where setup.py found a C compiler
    from . import _kernel as kernel
except ImportError:
    kernel = None


def compiled(shape: tuple[int, int]):
    """The compiled kernel, if there is one and it takes skins of this many (rows, cols)."""
    return kernel if kernel and sum(shape) <= kernel.LINES else None


@dataclass(frozen=True, eq=False)
class Circuit:
    """The read-out circuit of one skin (paper section III-B); the defaults are the paper's.

    Args:
        rows, cols: number of row and column stripes.
        r_ref: reference resistor of the voltage divider [ohm].
        r_par: parasitic series resistance of the multiplexers [ohm].
        adc_bits: width of the ADC; full scale reads ``2**adc_bits - 1``.
        mask: (rows, cols) bool, which crossings carry a cell; None: all of them.

    Raises:
        ValueError: a size, resistance or width outside its range, a mask of another shape, or one
            that falls into parts with no cell between them (their cells could not be told apart).
    """

    rows: int = 16
    cols: int = 16
    r_ref: float = 1780.0
    r_par: float = 326.0
    adc_bits: int = 10
    mask: np.ndarray | None = field(default=None, repr=False)

    def __post_init__(self):
        for name, low, high in (("rows", 1, 255), ("cols", 1, 255), ("adc_bits", 1, 16)):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not low <= value <= high:
                raise ValueError(f"{name} = {value!r}: must be a whole number from {low} to {high}")
        for name, low in (("r_ref", "above 0"), ("r_par", "0 or more")):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0 or (value == 0 and name == "r_ref"):
                raise ValueError(f"{name} = {value!r} ohm: must be finite and {low}")
        if self.mask is not None:
            mask = np.array(self.mask, dtype=bool)
            if mask.shape != self.shape:
                raise ValueError(f"mask has shape {mask.shape}: the circuit is {self.shape}")
            if not _connected(mask[None])[0]:
                raise ValueError("mask: the cells must connect all rows and columns to one another")
            mask.setflags(write=False)
            object.__setattr__(self, "mask", None if mask.all() else mask)

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.cols

    @cached_property
    def populated(self) -> np.ndarray:
        """(rows, cols) bool, which crossings carry a cell; read-only."""
        if self.mask is not None:
            return self.mask
        everywhere = np.ones(self.shape, bool)
        everywhere.setflags(write=False)
        return everywhere

    @property
    def full_scale(self) -> int:
        """Reading of the ADC at its reference voltage, in ADC steps."""
        return 2**self.adc_bits - 1

    def ratio(self, rho):
        """Two-terminal resistance [ohm] -> ADC ratio in [0, 1] (voltage divider)."""
        return self.r_ref / (self.r_ref + self.r_par + rho)

    def two_terminal(self, adc):
        """ADC ratio -> two-terminal resistance [ohm], the inverse of `ratio`; never negative.

        Zero reads as an infinite resistance.
        """
        with np.errstate(divide="ignore"):
            return np.maximum(self.r_ref / adc - (self.r_ref + self.r_par), 0.0)

    def describe(self) -> dict:
        """The circuit as plain numbers and strings, as it is kept beside trained weights."""
        mask = None if self.mask is None else ["".join("01"[int(c)] for c in r) for r in self.mask]
        return {
            "rows": int(self.rows),
            "cols": int(self.cols),
            "r_ref": float(self.r_ref),
            "r_par": float(self.r_par),
            "adc_bits": int(self.adc_bits),
            "mask": mask,
        }

    def __eq__(self, other):
        return isinstance(other, Circuit) and self.describe() == other.describe()

    def __hash__(self):
        return hash((self.shape, self.r_ref, self.r_par, self.adc_bits))


def circuit_from(description: dict) -> Circuit:
    """The circuit of a `Circuit.describe()`.

    Raises:
        ValueError: a key is missing or unknown, or as `Circuit`.
    """
    if (wanted := Circuit().describe().keys()) != description.keys():
        raise ValueError(f"circuit has {', '.join(description)}: must be {', '.join(wanted)}")
    mask = description["mask"]
    cells = None if mask is None else np.array([[c == "1" for c in row] for row in mask])
    return Circuit(**description | {"mask": cells})


def forward(circuit: Circuit, resistance) -> np.ndarray:
    """What the board reads, not quantised.

    Args:
        resistance: (..., rows, cols) resistance of each cell [ohm], above 0; infinity is an open
            cell. Where the circuit's mask says that there is no cell, the value is ignored.

    Returns:
        (..., rows, cols) ADC ratio in [0, 1]. A crossing with no cell is read like any other,
        through its neighbours; 0 where no path connects the two lines.

    Raises:
        ValueError: wrong shape, NaN, or a resistance that is not above 0.
    """
    resistance = np.asarray(resistance, dtype=float)
    if resistance.shape[-2:] != circuit.shape:
        raise ValueError(
            f"resistance has shape {resistance.shape}: it must end in {circuit.shape} (rows, cols)"
        )
    if circuit.mask is not None:
        resistance = np.where(circuit.mask, resistance, np.inf)
    if not (resistance > 0).all():
        bad = resistance[~(resistance > 0)].flat[0]
        raise ValueError(f"resistance of {bad} ohm: every cell's must be above 0")
    return circuit.ratio(two_terminal_resistance(1.0 / resistance))


def two_terminal_resistance(conductance: np.ndarray) -> np.ndarray:
    """Resistance between row i and column j with every other line floating.

    Args:
        conductance: (..., rows, cols) of the cells [S], 0 where there is none.

    Returns:
        (..., rows, cols) rho [ohm]; infinite where no path connects the two lines.
    """
    g = np.asarray(conductance, dtype=float)
    if (g > 0).all():
        return connected_rho(g)
    frames = g.reshape(-1, *g.shape[-2:])
    rho = np.full(frames.shape, np.inf)
    whole = _connected(frames > 0)
    rho[whole] = connected_rho(frames[whole])
    for k in np.flatnonzero(~whole):
        rho[k] = _rho_in_parts(frames[k])
    return rho.reshape(g.shape)


def jacobian(circuit: Circuit, resistance) -> np.ndarray:
    """Derivative of `forward`, exact: d adc[i, j] / d resistance[k, l].

    With t_ab = A_ik + D_jl - C_il - C_kj for a = (i, j), b = (k, l), the transfer resistance
    between two crossings: d rho_a / d g_b = -t_ab^2 (docs/derivation.md).

    Args:
        resistance: (rows, cols) [ohm], finite wherever the circuit has a cell.

    Returns:
        (rows, cols, rows, cols) [1/ohm]; 0 for cells that the mask leaves out.
    """
    resistance = np.asarray(resistance, dtype=float)
    if resistance.shape != circuit.shape:
        raise ValueError(f"resistance has shape {resistance.shape}, not {circuit.shape}")
    g = np.where(circuit.populated, 1.0 / resistance, 0.0)
    blocks = network_inverse(g)
    adc = circuit.ratio(rho_of(blocks))
    d_rho = transfer_resistance(blocks) ** 2 * g**2  # (rows, cols, rows, cols), d rho / d R
    return -(adc**2 / circuit.r_ref)[:, :, None, None] * d_rho


def network_inverse(g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Blocks A (rows, rows), C (rows, cols), D (cols, cols) of the Laplacian's inverse.

    Args:
        g: (..., rows, cols) conductances [S] of a connected network.
    """
    if g.shape[-2] > g.shape[-1]:  # eliminate the longer side: the inverse stays small
        d, c, a = network_inverse(g.swapaxes(-1, -2))
        return a, c.swapaxes(-1, -2), d
    col_sum = g.sum(-2)  # (..., cols)
    scaled = g / col_sum[..., None, :]  # g D_c^-1
    row_sum = g.sum(-1)
    # S is singular along the constant vector; a multiple of ones fills it without touching rho.
    fill = row_sum.sum(-1, keepdims=True)[..., None] / g.shape[-2] ** 2
    schur = fill - scaled @ g.swapaxes(-1, -2)
    _diagonal(schur)[...] += row_sum
    a = np.linalg.inv(schur)
    c = a @ scaled
    d = scaled.swapaxes(-1, -2) @ c
    _diagonal(d)[...] += 1.0 / col_sum
    return a, c, d


def reduced_root(g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `network_inverse` needs of one frame, in a third of its time.

    Args:
        g: (rows, cols) conductances [S] of a connected network.

    Returns:
        R (rows, rows) with A = R R^T, its triangle's ends on the diagonal; g D_c^-1 (rows, cols);
        D_c (cols,).
    """
    rows, cols = g.shape
    ones = np.ones(max(rows, cols))
    col_sum, row_sum = ones[:rows] @ g, g @ ones[:cols]  # faster than sum() at this size
    scaled = g / col_sum
    schur = scaled @ g.T
    np.subtract(float(row_sum @ ones[:rows]) / rows**2, schur, out=schur)
    schur.reshape(-1)[:: rows + 1] += row_sum
    factor, info = lapack.dpotrf(schur.T, lower=0, clean=1)
    if not info:
        return lapack.dtrtri(factor, lower=0, overwrite_c=1)[0], scaled, col_sum
    # Singular to rounding: conductances many decades apart.
    values, vectors = np.linalg.eigh(schur)
    half = vectors / np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    return np.linalg.qr(half.T, mode="r").T, scaled, col_sum


def rho_of(blocks: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """rho_ij = A_ii + D_jj - 2 C_ij of `network_inverse`'s blocks: (..., rows, cols) [ohm]."""
    a, c, d = blocks
    return _diagonal(a)[..., :, None] + _diagonal(d)[..., None, :] - 2.0 * c


def _diagonal(matrices: np.ndarray) -> np.ndarray:
    """A view of the diagonals of (..., n, n)."""
    return np.einsum("...ii->...i", matrices)


def transfer_resistance(blocks: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """t[i, j, k, l] = A_ik + D_jl - C_il - C_kj [ohm] from the blocks of one frame's inverse."""
    a, c, d = blocks
    return a[:, None, :, None] + d[None, :, None, :] - c[:, None, None, :] - c.T[None, :, :, None]


def connected_rho(g: np.ndarray) -> np.ndarray:
    """`two_terminal_resistance` of connected networks, which it does not check."""
    if g.ndim > 2:
        return rho_of(network_inverse(g))
    if fast := compiled(g.shape):
        rho = np.empty(g.shape)
        if fast.two_terminal(*g.shape, np.ascontiguousarray(g), rho):
            return rho
    if g.shape[0] > g.shape[1]:
        return connected_rho(g.T).T
    root, scaled, col_sum = reduced_root(g)
    a = root @ root.T
    rho = a @ scaled  # C
    d = np.einsum("ij,ij->j", scaled, rho)
    d += 1.0 / col_sum
    rho *= -2.0
    rho += a.diagonal()[:, None]
    rho += d
    return rho


def _row_reach(present: np.ndarray) -> np.ndarray:
    """(..., rows, rows) bool: which rows a path of cells connects."""
    p = present.astype(np.float32)
    reach = p @ p.swapaxes(-1, -2) > 0
    for _ in range(max(present.shape[-2] - 1, 1).bit_length()):
        step = reach.astype(np.float32)
        reach = step @ step > 0
    return reach


def _connected(present: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the cells of each (rows, cols) picture connect all its lines."""
    return _row_reach(present).all((-2, -1)) & present.any(-2).all(-1)


def _rho_in_parts(g: np.ndarray) -> np.ndarray:
    """rho of one frame whose network falls into parts: infinite between them."""
    rho = np.full(g.shape, np.inf)
    present = g > 0
    for reach in np.unique(_row_reach(present), axis=0):
        rows = np.flatnonzero(reach)
        cols = np.flatnonzero(present[rows].any(0)) if rows.size else rows
        if cols.size:
            part = np.ix_(rows, cols)
            rho[part] = connected_rho(g[part])
    return rho
