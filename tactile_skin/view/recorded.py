# SPDX-License-Identifier: Apache-2.0
"""The snapshots of a recording: one for each of its readings."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import dropwhile

import numpy as np

from ..errors import FileError
from ..recording.reader import ADC, Recording
from .log import Log
from .server import Wanted
from .snapshot import DIAGNOSTICS, TOPICS, Collector, Snapshot

_POINTS = 2000  # of the force over the whole recording
_BLOCK = 300  # readings that are read from the file together
_BLOCKS = 8  # that are kept
_AROUND = 1_000_000_000  # ns by which a message may be out of order in the file


class Recorded:
    """Keeps times and forces of all readings; snapshots are read when they are asked for.

    Args:
        recording: that is shown.
        push_of: of Pictures, for the log.
        track: wraps the messages while they are read, for a progress bar: (iterable, total).

    Attributes:
        shape: (rows, cols) of its readings.

    Raises:
        FileError: it holds no reading.
    """

    def __init__(
        self,
        recording: Recording,
        push_of: Callable = lambda snapshot: None,
        track: Callable = lambda items, total: items,
    ):
        here = recording.adc_topic.removesuffix(ADC)
        self._recording = recording
        self._topics = {f"{here}{topic}": topic for topic in TOPICS}
        self._topics[recording.diagnostics_topic] = DIAGNOSTICS
        total = sum(t.count for name, t in recording.topics.items() if name in self._topics)
        stamps, force, stop = array("d"), array("d"), array("b")
        # where each block begins: time of recording [ns], and what was known before
        self._blocks: list[tuple[int, Collector]] = []
        self._block = lru_cache(_BLOCKS)(self._read)
        self.shape = 0, 0
        self.log, self.work = Log(push_of, keep=False), None
        collector, messages = Collector(), recording.messages(*self._topics)
        for reading, snapshot in self._readings(collector, track(messages, total)):
            if snapshot is not None and snapshot.adc is not None:
                if not stamps:
                    self.shape = snapshot.adc.shape
                stamps.append(snapshot.stamp)
                force.append(snapshot.contacts[:, 3].sum())
                stop.append(bool(snapshot.stop))
                self.log.take(snapshot.stamp - stamps[0], len(stamps), snapshot)
            if reading is not None and len(stamps) % _BLOCK == 0:
                self._blocks.append((reading, collector.copy()))
        if not stamps:
            raise FileError(f"{recording.path}: holds no reading")
        self._start = stamps[0]
        self._times = np.maximum.accumulate(np.array(stamps) - stamps[0])
        self._force, self._stop = np.array(force), np.array(stop, bool)
        self._damage = recording.damage

    def _readings(self, collector: Collector, messages) -> Iterator:
        """Yield the time of a reading that comes [ns], and the snapshot of the one before it."""
        # all that follows a reading has been said when the next one comes
        before = False
        for name, t, message in messages:
            if self._topics[name] == ADC:
                yield t, collector.snapshot() if before else None
                before = True
            try:
                collector.take(self._topics[name], message)
            except ValueError as error:
                raise FileError(f"{self._recording.path}: {name}: {error}") from error
        if before:
            yield None, collector.snapshot()

    def _read(self, block: int) -> list[Snapshot]:
        """Return the snapshots of a block, from the file."""
        begin, collector = self._blocks[block]
        messages = self._recording.messages(*self._topics, begin=begin - _AROUND)
        entries = dropwhile(lambda m: (self._topics[m[0]], m[1]) != (ADC, begin), messages)
        found = []
        for _, snapshot in self._readings(collector.copy(), entries):
            if snapshot is not None:
                found.append(snapshot)
            if len(found) == _BLOCK:
                break
        return found

    def hello(self) -> dict:
        n = len(self._times)
        steps = np.diff(self._times)
        begins = np.arange(0, n, -(-n // _POINTS))
        return {
            "title": self._recording.path.name + (f" ({self._damage})" if self._damage else ""),
            "recording": {
                "start": self._start,
                "duration": float(self._times[-1]),
                "interval": float(np.median(steps)) if n > 1 else 0.0,
            },
            "history": {
                "times": self._times[begins].round(4).tolist(),
                "force": np.maximum.reduceat(self._force, begins).round(2).tolist(),
                "stop": np.logical_or.reduceat(self._stop, begins).tolist(),
            },
        }

    async def snapshot(self, wanted: Wanted) -> tuple[int, Snapshot]:
        """Return the reading at a time, or the last before it."""
        k = max(0, int(np.searchsorted(self._times, wanted.at + 1e-6, side="right")) - 1)
        return k + 1, self._block(k // _BLOCK)[k % _BLOCK]

    def watched(self, pages: int) -> None:
        pass

    async def ask(self, name: str) -> dict:
        return {"answer": name, "success": False, "message": "a recording"}
