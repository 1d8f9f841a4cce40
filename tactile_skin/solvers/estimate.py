# SPDX-License-Identifier: Apache-2.0
"""What every method returns."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lapack

from ..findings.finding import Finding
from ..physics.circuit import Circuit
from ..physics.quadratic import factor_over

_TRIED = 17  # conductances that are tried for a cell that was not read, from end to end
_FAR = 3.0  # standard deviations from which on nothing is likely
_ROUNDING = 1e-6  # standard deviations of a reading, and a share, that are none
_SIGNS = np.array([1.0, -1.0])[:, None, None]
_AT_ONCE = 16  # such cells whose conductances are tried together
_MOST = 10.0  # standard deviations of log g: e^10 times the conductance, any force


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """What `compensate` found in one frame, or in each of n. The pictures are read-only.

    Attributes:
        force: (rows, cols) force on each cell [N]; of a batch (n, rows, cols).
        std: as `force`, one standard deviation of it [N].
        residual: RMS misfit between the reading and the circuit's model of the best fit, in ADC
            steps; of a batch (n,), as is all below.
        status: "ok", "suspect" (the circuit model does not explain the reading) or "failed".
        message: why, for a person; empty when ok.
        method: the method that was used ("auto" names its choice).
        iterations: steps that it took; 0 for a closed form.
        noise: RMS of a reading that was supposed, or measured in the frame [ADC steps].
        aside: (rows, cols) bool, readings that were set aside since a bad contact, and no cell,
            explains them; None: there are none.
        finding: what is doubted, of a suspect frame; None: nothing. Of a batch a list of them.
    """

    force: np.ndarray
    std: np.ndarray
    residual: float | np.ndarray
    status: str | np.ndarray
    message: str | np.ndarray
    method: str | np.ndarray
    iterations: int | np.ndarray
    noise: float | np.ndarray = 0.0
    aside: np.ndarray | None = None
    finding: Finding | list[Finding | None] | None = None

    def __post_init__(self):
        # Frames share pictures: an idle skin's are kept, and a frame like the last has that one's.
        for name in ("force", "std", "aside"):
            if getattr(self, name) is None:
                continue
            picture = np.asarray(getattr(self, name))
            if picture.flags.writeable:
                picture = picture.view()  # the caller's own stays as it is
                picture.setflags(write=False)
            object.__setattr__(self, name, picture)

    def __repr__(self):
        shape = self.force.shape
        cells = " x ".join(map(str, shape[-2:]))
        if len(shape) == 3:
            counts = [f"{n} {name}" for name, n in Counter(self.status.tolist()).most_common()]
            methods = ", ".join(sorted(set(self.method.tolist())))
            found = f"{methods}: {', '.join(counts)}; {shape[0]} frames of {cells} cells"
            largest = self.force.max(initial=0.0)
            return f"Estimate({found}, at most {largest:.3g} N on a cell)"
        why = f" ({self.message})" if self.message else ""
        where = ""
        if len(shape) == 2 and self.force.size and (largest := self.force.max()) > 0:
            row, col = np.unravel_index(self.force.argmax(), shape)
            where = f", most {largest:.3g} N at row {row}, column {col}"
        return (
            f"Estimate({self.method}: {self.status}{why}; {cells} cells, {self.force.sum():.3g} N "
            f"in all{where}; residual {self.residual:.3g} ADC steps, {self.iterations} iterations)"
        )


def batch_of(estimates: list[Estimate], shape: tuple[int, int]) -> Estimate:
    """Frames of (rows, cols) = `shape` as one estimate with a leading axis."""
    kinds: dict[str, type] = {"iterations": int}
    kinds |= dict.fromkeys(("force", "std", "residual", "noise"), float)
    kinds |= dict.fromkeys(("status", "message", "method"), str)
    found: dict[str, Any] = {
        name: np.array([getattr(e, name) for e in estimates], kinds[name]) for name in kinds
    }
    none = np.zeros(shape, bool)
    found["aside"] = np.array([none if e.aside is None else e.aside for e in estimates], bool)
    found["finding"] = [e.finding for e in estimates]
    for name in ("force", "std", "aside"):
        found[name] = found[name].reshape(-1, *shape)  # of no frames, too
    return Estimate(**found)


def check_start(start: Estimate, circuit: Circuit) -> None:
    """Raise ValueError unless `start` is an estimate to go on from, of a skin of this shape."""
    if not isinstance(start, Estimate):
        kind = type(start).__name__
        raise ValueError(f"start is of type {kind}: must be an Estimate, that of the last frame")
    force = np.asarray(start.force)
    if force.shape != circuit.shape:
        raise ValueError(f"start has shape {force.shape}: the circuit is {circuit.shape}")
    if not (force.min() >= 0.0 and force.max() < np.inf):  # NaN is neither
        row, col = np.argwhere(~((force >= 0.0) & (force < np.inf)))[0]
        raise ValueError(
            f"start.force = {force[row, col]} at row {row}, column {col}: must be finite and "
            "0 N or more"
        )


def spread(curve, log_g: np.ndarray, std_x: np.ndarray) -> np.ndarray:
    """(rows, cols) standard deviation of forces [N] by that of their cells' log conductance."""
    ends = curve.force_at(_SIGNS * np.minimum(std_x, _MOST) + log_g)  # both at once: half the time
    return 0.5 * (ends[0] - ends[1])


def where_unread(reading, model, force: np.ndarray, std: np.ndarray, equations=None) -> np.ndarray:
    """Return std [N] that is as large for cells that were not read as other readings leave it.

    How likely it is that such a cell conducts more or less is said by what that adds to chi^2, past
    what the other unknowns of a fit can take of it. A reading is the ratio of two linear functions
    of one conductance, so its slope and what it is with the cell at an end give all between.
    Where nothing is added, all forces are as likely.

    Args:
        model: the `Linearised` of the reading there.
        equations: `prior.NormalEquations` of the fit; None: all cells are at rest, or too many.
    """
    circuit, curve, g = reading.circuit, reading.curve, model.g
    unread = circuit.populated & ~reading.informative
    if reading.all_cells_read or not unread.any():
        return std
    cells, readings = (np.flatnonzero(a).astype(np.int32) for a in (unread, model.weight))
    touched = cells[:0] if equations is None else equations.unknowns
    touched = touched[~unread.flat[touched]]
    taken = model.jacobian(readings, touched) * g.flat[touched].astype(np.float32)
    known = taken.T @ taken  # and their log g is known to 1
    known.reshape(-1)[:: len(known) + 1] += 1.0
    factor = factor_over(known, np.ones(len(known), bool)) if known.size else None

    def chi2(left: np.ndarray) -> np.ndarray:
        if factor is not None:  # a minimum: single precision errs by its square
            shift = lapack.spotrs(factor.T, (left @ taken).T, lower=1, overwrite_b=1)[0].T
            left = np.concatenate([left - shift @ taken.T, shift], 1)
        return np.einsum("ij,ij->i", left, left)

    low, high = reading.bounds
    end = np.where(g < np.sqrt(low * high), high, low)
    slopes = (model.jacobian(readings, cells) * (end - g).flat[cells]).T
    log_g = np.linspace(np.log(low), np.log(high), _TRIED)
    parts = ((np.exp(log_g) - g) / (end - g)).reshape(_TRIED, -1).T
    offs = np.abs(curve.force_at(log_g) - force).reshape(_TRIED, -1).T[cells]
    misfit, at = model.misfit.flat[readings], np.arange(g.size).reshape(g.shape)
    before, least = chi2(misfit[None].astype(np.float32)), np.zeros(cells.size)
    for some in np.array_split(np.arange(cells.size), -(-cells.size // _AT_ONCE)):
        there = np.array([reading.model(np.where(at == cell, end, g)) for cell in cells[some]])
        there = ((there - model.adc) * model.weight).reshape(some.size, -1)[:, readings]
        # 1 + t d of a change of d, t >= 0; not where there is nothing but rounding
        bend = np.divide(slopes[some], there, out=np.ones_like(there), where=abs(there) > _ROUNDING)
        up = (end > g).flat[cells[some]][:, None]
        bend = np.clip(bend, np.where(up, 1.0, _ROUNDING), np.where(up, np.inf, 1.0))[:, None]
        part = parts[cells[some], :, None]
        change = there[:, None] * bend * part / (1.0 + (bend - 1.0) * part)
        left = (misfit - change).astype(np.float32).reshape(-1, readings.size)
        times = np.sqrt(np.maximum(chi2(left) - before, 1.0)).reshape(some.size, _TRIED)
        least[some] = np.max(offs[some] / times, 1, where=times < _FAR, initial=0.0)
    full = curve.max_force
    any_force = np.sqrt(((full - force) ** 3 + force**3) / (3.0 * full))
    std = std.copy()
    std.flat[cells] = np.maximum(std.flat[cells], np.minimum(least, any_force.flat[cells]))
    return std
