# SPDX-License-Identifier: Apache-2.0
"""Crossings without a reading: which ones, and whether the configuration names them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_FRAMES = 30  # in which a crossing has read nothing but 0, since the first one
_FEW = 0.25  # of the crossings: if more of them read 0, the ADC is too coarse for the fabric
_MANY = 0.25  # of the crossings without a reading: the rest does not tell the picture
_SAY = 4  # crossings that are named


class Unread(NamedTuple):
    """Crossings without a reading that the configuration does not name."""

    text: str = ""  # what to say; empty if there are none
    blind: bool = False  # whether the picture cannot be trusted without them
    # rows, cols: a line, or crossings one by one
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()


class Absent:
    """Looks for crossings that the board does not read, and the configuration does not name.

    A matrix of fabric reads no exact 0 at one crossing while the others of its row and its column
    read something: current flows to it through its neighbours. A board prints 0 for what it skips.

    Args:
        named: (rows, cols) bool, crossings that the configuration says are not read.
        populated: (rows, cols) bool, crossings that carry a cell.
    """

    def __init__(self, named: np.ndarray, populated: np.ndarray):
        self._named, self._populated = named, populated
        self._zero = populated & ~named  # always, so far
        self._reads = populated.copy()  # bool, crossings that never read 0
        self._looking = True  # whether any of these is left
        self._frames = 0

    def frame(self, samples: np.ndarray, unread: np.ndarray | None) -> Unread:
        """Return what is not read after this frame; `unread`: what the board itself says of it."""
        if unread is None and not self._looking:
            return Unread()
        unnamed = np.zeros(self._named.shape, bool) if unread is None else unread & ~self._named
        self._frames += 1
        self._zero &= (samples == 0) & ~unnamed
        self._reads &= samples != 0
        self._looking = bool(self._zero.any())
        if unnamed.any():
            for name, axis in (("row", 1), ("column", 0)):
                cells = self._populated & ~self._named
                blind = cells.any(axis) & ~(cells & ~unnamed).any(axis)
                if blind.any():
                    line = int(blind.argmax())
                    where = {"rows" if axis else "cols": (line,)}
                    text = f"{name} {line}: the board reads none of its crossings"
                    return Unread(text, True, **where)
            if unnamed[self._populated].mean() > _MANY:
                return Unread(f"more than {_MANY:.0%} of the crossings are not read", True)
        if self._frames < _FRAMES:
            silent = unnamed
        else:
            zero, reads = self._zero, self._reads
            beside = np.outer(reads.any(1), reads.any(0))
            alone = beside & (zero.mean() < _FEW)
            silent = unnamed | (zero & alone)
        silent &= self._populated
        if not silent.any():
            return Unread()
        names = [f"row {i}, column {j}" for i, j in np.argwhere(silent).tolist()]
        more = f" and {len(names) - _SAY} more" if len(names) > _SAY else ""
        ask = "" if unnamed.any() else "is it connected, or below a threshold of the board's? "
        text = (
            f"no reading at {'; '.join(names[:_SAY])}{more}: {ask}repair it, or exclude it "
            "in circuit.scanned (in circuit.mask, if no cell is there)"
        )
        rows, cols = (tuple(k.tolist()) for k in np.nonzero(silent))
        return Unread(text, False, rows, cols)
