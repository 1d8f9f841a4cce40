"""A reading that is set aside again and again, since the others do not allow it: a bad contact."""

from __future__ import annotations

from collections import Counter

import numpy as np

_OFTEN = 3  # times in a second that a reading is set aside: a sound board's is once a minute


class Contacts:
    """Counts of one skin, by the second.

    Attributes:
        message: which contact may be bad; empty if none.
        summary: what the last second set aside; empty if nothing.
    """

    def __init__(self):
        self.message = self.summary = ""
        self._times: Counter[tuple[int, int]] = Counter()  # in this second
        self._bad: tuple[int, int] | None = None  # most often in an earlier one

    def frame(self, aside: np.ndarray | None) -> None:
        """Take what an estimate set aside: (rows, cols) bool, or None."""
        if aside is not None:
            self._times.update(map(tuple, np.argwhere(aside)))

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
                self.message = (
                    f"row {row}, column {col}: reads less than the others allow: a bad contact?"
                )
