"""The snapshots of a recording: one for each of its readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import FileError
from ..recording.reader import ADC, Recording
from .server import Wanted
from .snapshot import DIAGNOSTICS, TOPICS, Collector, Snapshot

_POINTS = 2000  # of the force over the whole recording


class Recorded:
    """
    Args:
        recording: that is shown.
        track: wraps the messages while they are read, for a progress bar: (iterable, total).

    Attributes:
        shape: (rows, cols) of its readings.

    Raises:
        FileError: it holds no reading.
    """

    def __init__(self, recording: Recording, track: Callable = lambda items, total: items):
        here = recording.adc_topic.removesuffix(ADC)
        topics = {f"{here}{topic}": topic for topic in TOPICS}
        topics[recording.diagnostics_topic] = DIAGNOSTICS
        total = sum(t.count for name, t in recording.topics.items() if name in topics)
        collector = Collector()
        self._snapshots: list[Snapshot] = []
        for name, _, message in track(recording.messages(*topics), total):
            if topics[name] == ADC:  # all that followed the reading before has been said
                self._snapshots.append(collector.snapshot())
            try:
                collector.take(topics[name], message)
            except ValueError as error:
                raise FileError(f"{recording.path}: {name}: {error}") from error
        self._snapshots = [*self._snapshots[1:], collector.snapshot()]
        if self._snapshots[0].adc is None:
            raise FileError(f"{recording.path}: holds no reading")
        self.shape = self._snapshots[0].adc.shape
        stamps = np.array([s.stamp for s in self._snapshots])
        self._times = np.maximum.accumulate(stamps - stamps[0])
        self._path, self._damage = recording.path, recording.damage

    def hello(self) -> dict:
        n = len(self._snapshots)
        steps = np.diff(self._times)
        force = np.array([s.contacts[:, 3].sum() for s in self._snapshots])
        stop = np.array([bool(s.stop) for s in self._snapshots])
        begins = np.arange(0, n, -(-n // _POINTS))
        return {
            "title": self._path.name + (f" ({self._damage})" if self._damage else ""),
            "recording": {
                "duration": float(self._times[-1]),
                "interval": float(np.median(steps)) if n > 1 else 0.0,
                "times": self._times[begins].round(4).tolist(),
                "force": np.maximum.reduceat(force, begins).round(2).tolist(),
                "stop": np.logical_or.reduceat(stop, begins).tolist(),
            },
        }

    async def snapshot(self, wanted: Wanted) -> tuple[int, Snapshot]:
        """The reading at a time, or the last before it."""
        k = max(0, int(np.searchsorted(self._times, wanted.at + 1e-6, side="right")) - 1)
        return k + 1, self._snapshots[k]

    def watched(self, pages: int) -> None:
        pass
