"""A reading that is set aside again and again, since the others do not allow it: a bad contact."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

# Times that a reading is set aside in one second and in another. Of a sound board's each is once a
# minute; a touch that comes or goes sets one aside up to 6 times in a row (8 x 8, seed 33201).
_OFTEN = 3
_WINDOW, _MOSTLY = 20, 10  # frames, and of them those that tell without a second look: as doubt.py


class Contacts:
    """Counts of one skin, by the second and over the last frames.

    Attributes:
        message: which contact may be bad; empty if none.
        summary: what the last second set aside; empty if nothing.
    """

    def __init__(self):
        self.message = self.summary = ""
        self._times: Counter[tuple[int, int]] = Counter()  # in this second
        self._bad: tuple[int, int] | None = None  # most often in an earlier one
        self._recent: deque[list[tuple[int, int]]] = deque(maxlen=_WINDOW)

    def frame(self, aside: np.ndarray | None) -> None:
        """Take what an estimate set aside: (rows, cols) bool, or None."""
        cells = [] if aside is None else list(map(tuple, np.argwhere(aside).tolist()))
        self._recent.append(cells)
        self._times.update(cells)
        if cells:
            cell, times = Counter(c for frame in self._recent for c in frame).most_common(1)[0]
            if times >= _MOSTLY:
                self._tell(cell)

    def end_second(self) -> None:
        """Judge the second; call it once a second."""
        most, total = self._times.most_common(1), self._times.total()
        self._times.clear()
        self.message = self.summary = ""
        if not most:
            return
        cell, times = most[0]
        row, col = cell
        self.summary = f"{total} readings, most often row {row}, column {col}: {times} times"
        if times >= _OFTEN:
            again, self._bad = cell == self._bad, cell
            if again:  # twice is no chance
                self._tell(cell)

    def _tell(self, cell: tuple[int, int]) -> None:
        self._bad = cell
        self.message = (
            f"row {cell[0]}, column {cell[1]}: reads less than the others allow: a bad contact?"
        )
