# SPDX-License-Identifier: Apache-2.0
"""When a body of several skins must stop: any of them stops it, and so does a push on several."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ..behaviours.stop import MAX_AHEAD, Cause, Decision, PushLimits, Reason, StopMessage
from .touches import OLDEST

_SILENCE = 0.15  # s without a message of a skin's stop, which publishes every 0.02 s
_AHEAD = Reason(Cause.STALE, "its clock is ahead: synchronise the clocks")
_LATE = Reason(Cause.STALE, "its 'free' is old when it arrives: late, or its clock is behind")


class BodyStop:
    """Takes what each skin's stop says, and how hard each is touched; times are of one clock [s].

    Each skin judges its own pushes. Here only a push that lies on several of them is judged: by the
    sum of their forces, with the limits of the body. With `latch` the body keeps such a push, and
    what its skins know nothing of: that one is silent, late, of another clock, or nowhere on tf.
    Before it was free for the first time only a push latches.

    Args:
        skins: their names, which the reasons begin with.
        config: the limits of the body.
        t: at which they may begin to publish.
    """

    def __init__(self, skins: Iterable[str], config: PushLimits, t: float):
        self.config = config
        words = str(Reason(Cause.WAITING, "no message from its stop yet"))
        waiting = StopMessage(True, words, causes=(Cause.WAITING,))
        self._messages = {skin: (t, waiting) for skin in skins}
        # skin -> stamp, newton; of all from the start: `close` reads it in another thread
        self._forces = dict.fromkeys(self._messages, (-math.inf, 0.0))
        self._clocks: dict[str, Reason] = {}  # of skins whose stamps do not fit the body's clock
        self._faults: dict[str, str] = {}
        self._push = ""  # the skins that a push lies on together
        self._held_until = -math.inf
        self._was_free = False
        self._latched = ""  # the reason that waits for a reset, with the names of its skins

    def hear(self, t: float, skin: str, message: StopMessage, stamp: float = -math.inf) -> None:
        """Take a message of a skin's stop.

        Args:
            stamp: of the reading that it is based on, by the clock of the skin's computer [s].
        """
        self._messages[skin] = t, message
        self._clocks.pop(skin, None)
        if stamp > t + MAX_AHEAD:
            self._clocks[skin] = _AHEAD
        elif not message.stop and t > message.until:
            self._clocks[skin] = _LATE

    def fault(self, skin: str, words: str) -> None:
        """Take why a skin's touches cannot be joined to the others'; empty: they can."""
        self._faults[skin] = words

    def touched(self, skin: str, stamp: float, force: float) -> None:
        """Take what a skin's stop counts the sum of its contact forces as [N]."""
        if (stamp, force) == self._forces[skin]:
            return  # a heartbeat: the same reading
        self._forces[skin] = stamp, force
        here = self._touched(stamp)
        total = sum(here.values())
        if len(here) > 1 and total >= self.config.threshold:
            self._push, self._held_until = " and ".join(sorted(here)), stamp + self.config.hold
            self._latch(self._push, Cause.PUSH.value)
        elif self._push and total > self.config.release:
            self._held_until = stamp + self.config.hold

    def _latch(self, who: str, words: str) -> None:
        if self.config.latch and not self._latched:
            self._latched = f"{who}: {Reason(Cause.LATCHED, words)}"

    def reset(self, t: float) -> str:
        """Free a latched stop; while a cause of one lasts it stays, and is returned."""
        if set(self.decide(t).causes) <= {Cause.LATCHED}:
            self._latched = ""
        return self.decide(t).reason

    @property
    def pushed(self) -> bool:
        """Whether a push is on, on one skin or on several, whatever else stops the body."""
        ours = bool(self._push)
        return ours or any(Cause.PUSH in message.causes for _, message in self._messages.values())

    def _pushed(self, t: float) -> bool:
        """Whether a push on several skins is on: only their readings end it, however late."""
        self._held_until = min(self._held_until, t + self.config.hold)  # the clock was set back
        pressed = sum(f for _, f in self._forces.values() if f > 0) > self.config.release
        return bool(self._push) and (t <= self._held_until or pressed)

    def _touched(self, t: float) -> dict[str, float]:
        """Return the skins that are touched -> force [N]; NaN is left to the skin's own stop."""
        return {name: f for name, (when, f) in self._forces.items() if t - when <= OLDEST and f > 0}

    def decide(self, t: float) -> Decision:
        """Return what holds at t, also when nothing comes: call it on a timer."""
        reasons: list[tuple[str, tuple[Cause, ...]]] = []
        for skin, (heard, message) in self._messages.items():
            decision = message.at(t)
            if not 0.0 <= t - heard <= _SILENCE:
                silent = Reason(Cause.STALE, "no message from its stop: has its process ended?")
                decision = Decision(True, str(silent), (Cause.STALE,))
            elif clock := self._clocks.get(skin):
                said = f"{decision.reason} + {clock}" if message.stop else str(clock)
                decision = Decision(True, said, (*message.causes, clock.cause))
            if decision.stop:
                reasons.append((f"{skin}: {decision.reason}", decision.causes or (Cause.FAULT,)))
                if self._was_free and decision.reason != message.reason:  # not its own stop
                    self._latch(skin, decision.reason)
            if words := self._faults.get(skin):
                fault = Reason(Cause.FAULT, words)
                reasons.append((f"{skin}: {fault}", (fault.cause,)))
                if self._was_free:
                    self._latch(skin, str(fault))
        if self._pushed(t):
            reasons.append((f"{self._push}: {Cause.PUSH.value}", (Cause.PUSH,)))
        else:
            self._push = ""
        self._was_free = self._was_free or not reasons
        if self._latched:
            reasons.append((self._latched, (Cause.LATCHED,)))
        causes = tuple(dict.fromkeys(cause for _, found in reasons for cause in found))
        return Decision(bool(reasons), " + ".join(words for words, _ in reasons), causes)

    def stopping(self, t: float) -> list[str]:
        """Return the names of the skins whose own stop, silence or fault stops the body at t."""
        return [
            skin
            for skin, (heard, message) in self._messages.items()
            if message.at(t).stop
            or skin in self._clocks
            or self._faults.get(skin)
            or not 0.0 <= t - heard <= _SILENCE
        ]

    @property
    def until(self) -> float:
        """When the first "free" of the skins expires [s]."""
        return min((message.until for _, message in self._messages.values()), default=-math.inf)
