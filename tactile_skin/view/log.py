# SPDX-License-Identifier: Apache-2.0
"""What happened: stops, findings, and the force of the last ten minutes. Time is an argument."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from .snapshot import CONTACT, Snapshot, lines_of

ENTRIES = 50  # that are kept
_STEP = 0.1  # s of each point of the history
_HISTORY = 600.0  # s that it goes back
_RING = 60.0  # s of snapshots that are kept, one for each point of the history
_RISE = 0.5  # N by which a force exceeds the largest one before it is noted
Push = dict  # of Pictures.push_of: row, column, direction


@dataclass
class Entry:
    """A stop, or something that a node found."""

    kind: str  # "stop" or "finding"
    # begin, end: its times [s]; end None: it lasts
    begin: float
    end: float | None
    stamp: float  # of the reading that shows it [s]: the hardest of a push, else the first
    # reason, causes: of the stop; of a finding its message, and the node's name
    reason: str
    causes: tuple[str, ...] = ()
    # felt, force, limit: largest force, the most that it may be, and the one that is a push [N]
    felt: float = 0.0
    force: float = 0.0
    limit: float | None = None
    # peak, cell_limit: the same of one cell
    peak: float = 0.0
    cell_limit: float | None = None
    push: Push | None = None  # where the hardest push came from; None: nothing pushed
    # rows, cols: that something was found on
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()


class _Kept(NamedTuple):
    number: int
    snapshot: Snapshot


class _Point(NamedTuple):
    t: float
    force: float
    stop: bool


class Log:
    """Watches the snapshots of one skin; `version` rises with each change of the entries.

    Args:
        push_of: a snapshot -> its push.
        keep: whether moments are kept, so that `moment` finds them.
    """

    def __init__(self, push_of: Callable[[Snapshot], Push | None], keep: bool = True):
        self._push_of, self._keep = push_of, keep
        self.version = 0
        self._entries: deque[Entry] = deque(maxlen=ENTRIES)
        self._open: dict[tuple, Entry] = {}  # those that last, by what they are
        self._moments: dict[float, _Kept] = {}  # stamp -> the snapshot of an entry
        self._ring: deque[_Kept] = deque()
        self._points: deque[_Point] = deque()

    def take(self, t: float, number: int, snapshot: Snapshot) -> None:
        """Take the snapshot that is the newest at t [s]."""
        self._note(t, number, snapshot)
        force = float(snapshot.contacts[:, 3].sum())
        stop = bool(snapshot.stop)
        if self._points and 0.0 <= t - self._points[-1].t < _STEP:
            last = self._points[-1]
            self._points[-1] = _Point(last.t, max(last.force, force), last.stop or stop)
        else:
            if self._points and t < self._points[-1].t:  # the clock was set back
                self._points.clear()
            self._points.append(_Point(t, force, stop))
            if self._keep and snapshot.adc is not None:
                self._ring.append(_Kept(number, snapshot))
        while self._points[0].t < t - _HISTORY:
            self._points.popleft()
        while self._ring and not 0.0 <= snapshot.stamp - self._ring[0].snapshot.stamp <= _RING:
            self._ring.popleft()

    def _note(self, t: float, number: int, snapshot: Snapshot) -> None:
        found: dict[tuple, tuple[str, str]] = {}
        for name, status in snapshot.nodes.items():
            if status.level and status.values.get("waiting") != "true":
                places = lines_of(status, "rows"), lines_of(status, "cols")
                found[("finding", name, *places)] = name, status.message
        if snapshot.stop:
            found[("stop",)] = "", snapshot.reason
        for key in self._open.keys() - found.keys():
            self._open.pop(key).end = t
            self.version += 1
        for key, (name, text) in found.items():
            entry = self._open.get(key)
            if entry is None:
                entry = Entry(key[0], t, None, snapshot.stamp, text, (name,) if name else ())
                if not name:
                    entry.causes = snapshot.causes
                else:
                    entry.rows, entry.cols = key[2:]
                self._open[key] = entry
                self._entries.append(entry)
                self._show(entry, number, snapshot)
            if not name:
                self._harder(entry, number, snapshot)

    def _harder(self, entry: Entry, number: int, snapshot: Snapshot) -> None:
        """Note the largest force of a stop, and where it pushed."""
        pushes = "push" in snapshot.causes
        first = pushes and entry.push is None
        if not pushes or not (first or snapshot.force > entry.force + _RISE):
            return
        entry.felt = float(snapshot.contacts[:, CONTACT.index("force")].sum())
        entry.force, entry.limit = snapshot.force, snapshot.limit
        entry.peak = float(snapshot.contacts[:, CONTACT.index("peak")].max(initial=0.0))
        entry.cell_limit = snapshot.cell_limit
        entry.reason, entry.causes = snapshot.reason, snapshot.causes
        entry.push = self._push_of(snapshot)
        self._show(entry, number, snapshot)

    def _show(self, entry: Entry, number: int, snapshot: Snapshot) -> None:
        """Have a snapshot as the entry's moment."""
        entry.stamp = snapshot.stamp
        self.version += 1
        if self._keep and snapshot.adc is not None:
            self._moments[snapshot.stamp] = _Kept(number, snapshot)
            used = {e.stamp for e in self._entries}
            self._moments = {s: kept for s, kept in self._moments.items() if s in used}

    def moment(self, stamp: float) -> tuple[int, Snapshot] | None:
        """Return the kept snapshot that is nearest to a stamp, and its number."""
        if (kept := self._moments.get(stamp)) is None:
            near = sorted(self._ring, key=lambda k: abs(k.snapshot.stamp - stamp))
            if not near:
                return None
            kept = near[0]
        return kept.number, kept.snapshot

    def entries(self) -> list[dict]:
        """Return the entries, the newest first, as JSON's own types."""
        return [vars(entry) | {"causes": list(entry.causes)} for entry in reversed(self._entries)]

    def history(self) -> dict[str, list]:
        """Return times [s], largest force [N] and stop of each tenth of a second."""
        return {
            "times": [round(point.t, 2) for point in self._points],
            "force": [round(point.force, 2) for point in self._points],
            "stop": [point.stop for point in self._points],
        }
