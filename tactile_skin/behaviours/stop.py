# SPDX-License-Identifier: Apache-2.0
"""When the robot must stop: one page, no clock and no bus of its own.

Whatever is not known to be safe stops: a push, readings that are old, stay away or make no sense,
and whatever a stage of the skin reports as wrong. With `latch` a stop also outlives its cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

from ..fields import Checked, parameter
from .let_go import Pressing
from .pace import RESUMED, Pace

_STEADY = 3  # readings in a row, none late, that end "stale",
_STEADY_FOR = 0.02  # s that they take: what was kept in a buffer meanwhile comes in one burst
_ROUNDING = 1e-6  # s, of the difference of two stamps
MAX_AHEAD = 0.02  # s that a reading's stamp may lie ahead of the clock
TRANSPORT = 0.02  # s that a message of the stop may take to its subscribers: threads, a network
_FADED = "it faded, and was not let go: touch the skin there and let go, or reset the stop"
_FADES = 5.0  # s below `release` after which a push that was not let go is said to have faded
OUT_OF_DATE = "stale: the stop's last 'free' is based on an old reading"


class Cause(str, Enum):
    """What stops the robot."""

    PUSH = "push"
    STALE = "stale"  # readings are old, stay away, or came back just now
    WAITING = "waiting"  # a stage is not ready yet
    FAULT = "fault"  # a stage reports itself as wrong
    LATCHED = "latched"  # one of these did, and was not reset


class Reason(NamedTuple):
    """Why the robot must stop, as one source says it."""

    causes: tuple[Cause, ...]
    words: str  # for a person, the cause first
    who: str = ""  # the source, where there are several
    latches: bool = True  # False: what it is of has a latch of its own

    def __str__(self) -> str:
        return f"{self.who}: {self.words}" if self.who else self.words


def because(cause: Cause, words: str = "", who: str = "") -> Reason:
    """Return the reason of one cause."""
    return Reason((cause,), f"{cause.value}: {words}" if words else cause.value, who)


class Decision(NamedTuple):
    """Whether the robot must stop."""

    stop: bool
    reason: str  # for a person, the reasons joined by " + "; empty while free to move
    causes: tuple[Cause, ...] = ()  # of these reasons

    @property
    def for_push_alone(self) -> bool:
        """Whether only a push stops it: it may then move away from what pushes."""
        return self.stop and self.causes == (Cause.PUSH,)


class StopMessage(NamedTuple):
    """A decision as a subscriber received it."""

    stop: bool
    reason: str
    until: float = math.inf  # when a "free" expires [s]; a stop never does
    causes: tuple[Cause, ...] = ()

    def at(self, t: float) -> Decision:
        """Return the decision at t: a "free" that has expired is a stop."""
        if self.stop or t <= self.until:
            return Decision(self.stop, self.reason, self.causes)
        return Decision(True, OUT_OF_DATE, (Cause.STALE,))


@dataclass(frozen=True)
class PushLimits(Checked):
    """What a push is, and how long it stops the robot."""

    threshold: float = parameter(30.0, "N", "contact force that is a push", 0.1, 500.0, live=True)
    release: float = parameter(
        20.0, "N", "contact force below which a push is over", 0.1, 500.0, live=True
    )
    hold: float = parameter(0.3, "s", "time a stop is kept after the release", 0.0, 60.0, live=True)
    latch: bool = parameter(False, "", "keep a stop until a reset, also after its cause has gone")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.release > self.threshold:
            raise ValueError(
                f"stop: release = {self.release} N: must be at most threshold = {self.threshold} N"
            )


@dataclass(frozen=True)
class StopConfig(PushLimits):
    """When to stop, and when to be free again.

    `peak` is for a hard edge, whose cells end before they reach the threshold together. `lead`: a
    rising force counts with what it gained since the last reading, times lead over their distance
    in time, at most once; it makes up for the board's low-pass and the wait for the next frame.
    """

    peak: float = parameter(
        9.0,
        "N",
        "force on one cell that is a push; at most 95 % of the end of the curve",
        0.01,
        500.0,
        live=True,
    )
    debounce: float = parameter(
        0.0,
        "s",
        "time above the threshold before it is a push; text lines: 0.01",
        0.0,
        0.2,
        live=True,
    )
    lead: float = parameter(
        0.01,
        "s",
        "time by which a rising force is extrapolated; text lines: 0",
        0.0,
        0.05,
        live=True,
    )
    stale_after: float = parameter(
        0.0,
        "s",
        "maximum age of a reading; 0: 2.5 measured intervals, 0.1 to 0.5 s",
        0.0,
        1.0,
        live=True,
    )


class Source(Protocol):
    """What may stop the robot."""

    def reasons(self, t: float) -> Iterable[Reason]:
        """Return why the robot must stop at t; nothing: as far as this knows it may move."""


class Stop:
    """Decides by its sources, with a latch and its reset; all times are of one clock [s].

    What latches: every stop of a robot that was free before, whatever its cause. A cable that comes
    loose and makes contact again must not send the robot off by itself, and a push least of all.
    Before it was free for the first time only a push latches, and what is only waited for never
    does: stops at start-up do not.
    """

    def __init__(self, config: PushLimits, sources: Iterable[Source]):
        self.config = config
        self._sources = tuple(sources)
        self._was_free = False
        self._latched: Reason | None = None  # of the stop that waits for a reset

    def decide(self, t: float) -> Decision:
        """Return what holds at t, also when nothing comes: call it on a timer."""
        reasons = self._reasons(t)
        self._was_free = self._was_free or not reasons
        for reason in reasons:
            self._latch(reason)
        if held := self._latched:
            reasons.append(because(Cause.LATCHED, held.words, held.who))
        causes = dict.fromkeys(cause for reason in reasons for cause in reason.causes)
        return Decision(bool(reasons), _joined(reasons), tuple(causes))

    def reset(self, t: float) -> str:
        """Free a latched stop; while a cause of one lasts it stays, and the causes are returned."""
        reasons = self._reasons(t)
        if not reasons:
            self._latched = None
        return _joined(reasons)

    def _reasons(self, t: float) -> list[Reason]:
        return [reason for source in self._sources for reason in source.reasons(t)]

    def _latch(self, reason: Reason) -> None:
        pushed, waits = ((cause,) == reason.causes for cause in (Cause.PUSH, Cause.WAITING))
        counts = reason.latches and (pushed or (self._was_free and not waits))
        if self.config.latch and not self._latched and counts:
            self._latched = reason


class StopPolicy(Stop):
    """The stop of one skin, whose readings are its source: hysteresis, debounce and the fail-safe.

    All times are of one monotonic clock [s].
    """

    config: StopConfig

    def __init__(self, config: StopConfig):
        super().__init__(config, [self])
        self._pace = Pace(config.stale_after)
        self._lates = 0  # readings that were late since they were last steady, and
        self._olds = 0  # those of them that were old when they came
        self._newest = -math.inf  # stamp of the newest reading
        self._old_at = -math.inf  # when the last one came that was too old, or no news
        self._force = self._peak = 0.0  # of the newest reading
        self._felt = 0.0, 0.0  # force and peak, as they are felt
        self._in_time = 0  # readings in a row of which none was late
        self._late = -math.inf  # stamp of the last one that was
        self._above_since: float | None = None
        self._held_until: float | None = None  # a push is on while this is set
        self.unknown = ""  # why a force may be more than is felt, in words
        self._words = ""  # of the push that is on
        self._above = -math.inf  # s, when it was above `release` last
        self._pressing, self._pressing_peak = Pressing(), Pressing()
        self._faults: dict[str, Reason] = {}
        self.stands = ""  # what a touch that stands without moving may be

    def configure(self, config: StopConfig) -> None:
        """Go on with other limits; a push that is on, a fault and what is latched stay.

        What the last reading had may be a push by the new ones.
        """
        if config.stale_after != self.config.stale_after:
            self._pace.configure(config.stale_after)
        self.config = config
        if self._force >= config.threshold or self._peak >= config.peak:
            self._hold(self._newest)

    def reading(
        self,
        t: float,
        force: float,
        peak: float = 0.0,
        stamp: float | None = None,
        felt: float | None = None,
        felt_peak: float | None = None,
    ) -> Decision:
        """Take a reading that arrived at t.

        Args:
            force: total contact force, the most that it may be [N].
            peak: largest force on one cell, the most that it may be [N].
            felt: total contact force as it is felt [N]; None: `force`. felt_peak: of `peak`.
            stamp: when it was taken, t by default. One that is no newer than the last, or lies
                ahead of t, proves nothing, and so does not keep the robot moving.
        """
        stamp = t if stamp is None else stamp
        if stamp <= self._newest or t - stamp > self.stale_after:
            self._old_at = t
        if self._newest > t + MAX_AHEAD:  # the clock was set back: begin anew, stopped
            self._newest, self._above_since = -math.inf, None
            if self.pushed:  # only readings end a push: the hold begins anew
                self._held_until = t + self.config.hold
            self._lates = self._olds = 0
            self._pace.forget()
            self._pressing.begin()
            self._pressing_peak.begin()
        if not (0.0 <= force < math.inf and 0.0 <= peak < math.inf):
            self.fault("reading", f"invalid force: {force} N in all, {peak} N on one cell")
            return self.decide(t)
        if stamp <= self._newest or stamp > t + MAX_AHEAD:
            return self.decide(t)
        self.fault("reading", "")
        config = self.config
        gap = stamp - self._newest
        if math.isfinite(gap):
            self._pace.gap(gap)
        old = t - stamp > self.stale_after
        late = old or gap > self.stale_after
        self._in_time, self._late = (0, stamp) if late else (self._in_time + 1, self._late)
        self._lates, self._olds = self._lates + late, self._olds + old
        # After a gap nobody knows how fast it rose; frames that arrive in a burst rise too fast.
        share = 0.0 if late else min(1.0, config.lead / gap)
        ahead = force + share * max(0.0, force - self._force)
        self._newest, self._force, self._peak = stamp, force, peak
        self._felt = force if felt is None else felt, peak if felt_peak is None else felt_peak
        self._pressing.take(stamp, force)
        self._pressing_peak.take(stamp, peak)
        if self._steady:
            self._lates = self._olds = 0
        if ahead >= config.threshold or peak >= config.peak:
            self._above_since = stamp if self._above_since is None else self._above_since
            # Nor how long it has lasted: then it counts at once.
            if late or stamp - self._above_since >= config.debounce - _ROUNDING:
                self._hold(stamp)
        else:
            self._above_since = None
        if self._held_until is not None:
            if force > config.release:
                self._held_until, self._above = stamp + config.hold, stamp
            elif self._above_since is None and not self._let_go:
                self._held_until = max(self._held_until, stamp + _ROUNDING)
                self._words = self._words if stamp - self._above < _FADES else _FADED
            elif stamp >= self._held_until and self._above_since is None:
                self._held_until = None
        return self.decide(t)

    @property
    def _let_go(self) -> bool:
        """Whether what pressed was let go, and did not only fade."""
        limits = self.config
        peak = limits.peak * limits.release / limits.threshold
        return self._pressing.force <= limits.release and self._pressing_peak.force <= peak

    def _hold(self, stamp: float) -> None:
        """Begin a push, or go on with it: a reading of this time is above a limit."""
        if self._held_until is None or self._words == _FADED:
            felt, most, limit, where = self._felt[0], self._force, self.config.threshold, ""
            if most < limit and self._peak >= self.config.peak:
                felt, most, limit = self._felt[1], self._peak, self.config.peak
                where = " on one cell"
            more = may_be(felt, most, self.unknown)
            self._words = f"{felt:.0f} N{where}{more}, limit {limit:g} N"
        self._held_until, self._above = stamp + self.config.hold, stamp

    def fault(self, source: str, message: str, waiting: bool = False) -> None:
        """Take a stage's report that it is wrong, or valid again with an empty message.

        Args:
            waiting: it is not wrong, but not ready yet.
        """
        if message:
            cause = Cause.WAITING if waiting else Cause.FAULT
            self._faults[source] = because(cause, f"{source}: {message}")
            self._latch(self._faults[source])  # it may be gone before the next decision
        else:
            self._faults.pop(source, None)

    def resume(self, source: str, message: str) -> None:
        """Begin after a fault that is over, and that came when the robot may have been free."""
        self._was_free = True
        self.fault(source, message)
        self.fault(source, "")

    @property
    def stale_after(self) -> float:
        """How old the last reading may be, in force now [s]."""
        return self._pace.stale_after

    @property
    def interval(self) -> float | None:
        """Usual between readings [s]; None: too few have come."""
        return self._pace.interval

    @property
    def _steady(self) -> bool:
        return self._in_time >= _STEADY and self._newest - self._late >= _STEADY_FOR

    @property
    def pushed(self) -> bool:
        """Whether a push is on, whatever else stops the robot."""
        return self._held_until is not None

    def reset(self, t: float) -> str:
        """Free a latched stop, as every stop does, and a push that only faded."""
        over = self._newest - self._above >= self.config.hold and self._above_since is None
        if self.pushed and over and not self._let_go:
            self._pressing.begin()  # somebody has checked what only faded
            self._pressing_peak.begin()
            self._held_until = None
        return super().reset(t)

    def reasons(self, t: float) -> list[Reason]:
        """Return a push that is on, faults of stages, and that readings are old."""
        words = "; ".join(filter(None, [self._words, self.stands]))
        reasons = [because(Cause.PUSH, words)] if self.pushed else []
        reasons += [reason for _, reason in sorted(self._faults.items())]
        fresh = -MAX_AHEAD <= t - self._newest <= self.stale_after
        if not (fresh and self._steady):
            reasons.append(because(Cause.STALE, self._stale(t, fresh)))
        return reasons

    def _stale(self, t: float, fresh: bool) -> str:
        """Why readings do not count; the same words for as long as the cause is the same."""
        if self._newest == -math.inf:
            return "no reading yet"
        if self._lates >= 2 and 0.0 <= t - self._newest <= self._pace.patience:
            if 2 * self._olds >= self._lates:
                return "readings are already old when they arrive"
            return self._pace.slow()
        if fresh:
            return RESUMED
        here = 0.0 <= t - self._old_at <= self.stale_after
        return f"readings {'are already old when they arrive' if here else 'no longer arrive'}"


def may_be(felt: float, most: float, why: str = "") -> str:
    """Return that a force may be more than is felt [N], in words; empty: it is not."""
    said = f" (may be {most:.0f} N{': ' * bool(why)}{why})"
    return said if most >= 1.05 * felt + 0.5 else ""


def _joined(reasons: list[Reason]) -> str:
    return " + ".join(map(str, reasons))
