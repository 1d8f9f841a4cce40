"""When the robot must stop: one page, no clock and no bus of its own.

Whatever is not known to be safe stops: a push, readings that are old, stay away or make no sense,
and whatever a stage of the skin reports as wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

_STEADY = 3  # readings in a row, none late, that end "stale"
_FUTURE = 0.02  # s that a reading's stamp may lie ahead


class Decision(NamedTuple):
    stop: bool
    reason: str  # "push", "stale: ...", "fault: ...", joined by " + "; empty while free to move


@dataclass(frozen=True)
class StopConfig:
    """Attributes:
    threshold: contact force that is a push [N].
    release: contact force below which a push is over [N]; at most the threshold.
    peak: force on one cell that is a push [N]: a hard edge, whose cells end before they reach
        the threshold together.
    debounce: how long the force must stay above the threshold [s]; 0: one reading is enough.
    hold: how long a push is held after the force fell below `release` [s].
    stale_after: how old the last reading may be [s].
    """

    threshold: float = 15.0
    release: float = 10.0
    peak: float = 9.0
    debounce: float = 0.01
    hold: float = 0.3
    stale_after: float = 0.1

    def __post_init__(self):
        for name in ("threshold", "release", "peak", "stale_after"):
            if not getattr(self, name) > 0:
                raise ValueError(f"stop: {name} = {getattr(self, name)!r}: must be above 0")
        for name in ("debounce", "hold"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"stop: {name} = {getattr(self, name)!r}: must be 0 or more")
        if self.release > self.threshold:
            raise ValueError(
                f"stop: release = {self.release} N: must be at most threshold = {self.threshold} N"
            )


class StopPolicy:
    """Hysteresis, debounce and the fail-safe; all times are of one monotonic clock [s]."""

    def __init__(self, config: StopConfig):
        self.config = config
        self._newest = -math.inf  # stamp of the newest reading
        self._in_time = 0  # readings in a row of which none was late
        self._above_since: float | None = None
        self._held_until: float | None = None  # a push is on while this is set
        self._faults: dict[str, str] = {}

    def reading(
        self, t: float, force: float, peak: float = 0.0, stamp: float | None = None
    ) -> Decision:
        """A reading arrived at t.

        Args:
            force: total contact force [N].
            peak: largest force on one cell [N].
            stamp: when it was taken, t by default. One that is no newer than the last, or lies
                ahead of t, proves nothing, and so does not keep the robot moving.
        """
        stamp = t if stamp is None else stamp
        if self._newest > t + _FUTURE:  # the clock was set back: begin anew, stopped
            self._newest, self._above_since, self._held_until = -math.inf, None, None
        if not (math.isfinite(force) and math.isfinite(peak) and force >= 0.0):
            self.fault("reading", f"a force of {force} N, {peak} N on one cell")
            return self.decide(t)
        self.fault("reading", "")
        if stamp <= self._newest or stamp > t + _FUTURE:
            return self.decide(t)
        config = self.config
        late = stamp - self._newest > config.stale_after or t - stamp > config.stale_after
        self._in_time = 0 if late else self._in_time + 1
        self._newest = stamp
        if force >= config.threshold or peak >= config.peak:
            self._above_since = stamp if self._above_since is None else self._above_since
            # After a gap nobody knows how long it has lasted: it counts at once.
            if late or stamp - self._above_since >= config.debounce:
                self._held_until = stamp + config.hold
        else:
            self._above_since = None
        if self._held_until is not None:
            if force > config.release:
                self._held_until = stamp + config.hold
            elif stamp >= self._held_until:
                self._held_until = None
        return self.decide(t)

    def fault(self, source: str, message: str) -> None:
        """A stage reports itself as wrong, or as sound again with an empty message."""
        if message:
            self._faults[source] = message
        else:
            self._faults.pop(source, None)

    def decide(self, t: float) -> Decision:
        """What holds at t, also when no reading comes: call it on a timer."""
        reasons = ["push"] if self._held_until is not None else []
        reasons += [f"fault: {source}: {text}" for source, text in sorted(self._faults.items())]
        if self._newest == -math.inf:
            reasons.append("stale: no reading yet")
        elif not -_FUTURE <= t - self._newest <= self.config.stale_after:
            reasons.append("stale: readings stay away")
        elif self._in_time < _STEADY:
            reasons.append("stale: readings only just came back")
        return Decision(bool(reasons), " + ".join(reasons))
