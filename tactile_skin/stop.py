"""When the robot must stop: one page, no clock and no bus of its own.

Whatever is not known to be safe stops: a push, readings that stay away, and whatever a stage of
the skin reports as wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Decision(NamedTuple):
    stop: bool
    reason: str  # "push", "stale: ...", "fault: ...", joined by " + "; empty while free to move


@dataclass(frozen=True)
class StopConfig:
    """Attributes:
    threshold: contact force that is a push [N].
    release: contact force below which a push is over [N]; at most the threshold.
    debounce: how long the force must stay above the threshold [s]; 0: one reading is enough.
    hold: how long a push is held after the force fell below `release` [s].
    stale_after: how old the last reading may be [s].
    """

    threshold: float = 15.0
    release: float = 10.0
    debounce: float = 0.01
    hold: float = 0.3
    stale_after: float = 0.1

    def __post_init__(self):
        for name in ("threshold", "release", "stale_after"):
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
        self._last_reading: float | None = None
        self._above_since: float | None = None
        self._held_until: float | None = None  # a push is on while this is set
        self._faults: dict[str, str] = {}

    def reading(self, t: float, force: float) -> Decision:
        """A valid reading arrived at t with this total contact force [N]."""
        config = self.config
        if self._last_reading is not None and t - self._last_reading > config.stale_after:
            self._above_since = None  # nobody knows what the force did meanwhile
        self._last_reading = t
        if force >= config.threshold:
            self._above_since = t if self._above_since is None else self._above_since
            if t - self._above_since >= config.debounce:
                self._held_until = t + config.hold
        else:
            self._above_since = None
        if self._held_until is not None:
            if force > config.release:
                self._held_until = t + config.hold
            elif t >= self._held_until:
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
        if self._last_reading is None:
            reasons.append("stale: no reading yet")
        elif t - self._last_reading > self.config.stale_after:
            reasons.append("stale: readings stay away")
        return Decision(bool(reasons), " + ".join(reasons))
