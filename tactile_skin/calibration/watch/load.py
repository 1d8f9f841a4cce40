"""A load on half of the skin: since the start, so that its rest is unknown; or for long."""

from __future__ import annotations

import numpy as np

from ...physics.curve import GRAM

IDLE = 15.0 * GRAM  # N on a cell: below it nothing touches; lines shorted at rest read as 13 g
_LASTS = 2.0  # s for which half of the cells may be loaded without a word


class Load:
    """Follows one skin; all times are of one clock [s].

    Attributes:
        since_start: where it is loaded, from the first frame on; empty: it has been let go.
        message: what half of the skin being loaded for long means; empty if it is not.
    """

    def __init__(self, rest_known: bool, cells: int):
        """Args:
        rest_known: whether the rest need not be measured.
        cells: number of those that exist.
        """
        self._let_go, self._cells = rest_known, cells
        self._full_since = np.inf  # s, since when half of the cells or more have been loaded
        self.since_start = self.message = ""

    def frame(self, t: float, force: np.ndarray) -> None:
        """Take a frame.

        Args:
            t: when it was read.
            force: (rows, cols) [N].
        """
        half = 2 * np.count_nonzero(force >= IDLE) > self._cells
        self._full_since = min(self._full_since, t) if half else np.inf
        self.message = ""
        if not self._let_go:
            self._let_go = bool(force.max() < IDLE)
            self.since_start = _where(force) if half else ""
        elif t - self._full_since > _LASTS:
            self.message = (
                "half of the skin is loaded: too few cells are at rest to check the circuit"
            )


def _where(force: np.ndarray) -> str:
    row, col = np.unravel_index(force.argmax(), force.shape)
    return (
        f"the skin has been loaded since the start, most at row {row}, column {col}: unload it, so "
        "that its rest can be measured"
    )
