# SPDX-License-Identifier: Apache-2.0
"""When a body of several skins must stop: any of them stops it, and so does a push on several."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ..behaviours.stop import MAX_AHEAD, Cause, PushLimits, Reason, Stop, StopMessage, because
from .touches import OLDEST

_SILENCE = 0.15  # s without a message of a skin's stop, which publishes every 0.02 s
_SILENT = because(Cause.STALE, "no message from its stop: has its process ended?")
_AHEAD = because(Cause.STALE, "its clock is ahead: synchronise the clocks")
_LATE = because(Cause.STALE, "its 'free' is old when it arrives: late, or its clock is behind")
_UNHEARD = because(Cause.WAITING, "no message from its stop yet")


class SkinStop:
    """What the stop of one skin says, from a time on at which it may begin [s].

    Attributes:
        fault: why its touches cannot be joined to the others'; empty: they can.
    """

    def __init__(self, name: str, t: float):
        self.name, self.fault = name, ""
        self._heard, self._clock = t, ""  # when, and why its stamps do not fit the body's clock
        self.message = StopMessage(True, _UNHEARD.words, causes=_UNHEARD.causes)

    def hear(self, t: float, message: StopMessage, stamp: float = -math.inf) -> None:
        """Take a message of its stop.

        Args:
            stamp: of the reading that it is based on, by the clock of the skin's computer [s].
        """
        self._heard, self.message = t, message
        late = _LATE.words if not message.stop and t > message.until else ""
        self._clock = _AHEAD.words if stamp > t + MAX_AHEAD else late

    def reasons(self, t: float) -> list[Reason]:
        """Return its own stop, which has a latch of its own, or what the body alone knows."""
        found, now = [], self.message.at(t)
        if not 0.0 <= t - self._heard <= _SILENCE:
            found.append(_SILENT._replace(who=self.name))
        elif self._clock:
            words = f"{now.reason} + {self._clock}" if self.message.stop else self._clock
            found.append(Reason((*self.message.causes, Cause.STALE), words, self.name))
        elif now.stop:
            own = now.reason == self.message.reason
            found.append(Reason(now.causes or (Cause.FAULT,), now.reason, self.name, not own))
        return [*found, because(Cause.FAULT, self.fault, self.name)] if self.fault else found


class BodyStop(Stop):
    """The stop of several skins, each a source; times are of one clock [s].

    Each skin judges its own pushes. Here only a push that lies on several of them is judged: by the
    sum of their forces, with the limits of the body. With `latch` the body keeps such a push, and
    what its skins know nothing of: that one is silent, late, of another clock, or nowhere on tf.

    Args:
        skins: their names, which the reasons begin with.
        config: the limits of the body.
        t: at which they may begin to publish.

    Attributes:
        skins: by their names.
    """

    def __init__(self, skins: Iterable[str], config: PushLimits, t: float):
        self.skins = {name: SkinStop(name, t) for name in skins}
        super().__init__(config, [*self.skins.values(), self])
        # skin -> stamp, newton; of all from the start: `close` reads it in another thread
        self._forces = dict.fromkeys(self.skins, (-math.inf, 0.0))
        self._push = ""  # the skins that a push lies on together
        self._held_until = -math.inf

    def touched(self, skin: str, stamp: float, force: float) -> None:
        """Take what a skin's stop counts the sum of its contact forces as [N]."""
        if (stamp, force) == self._forces[skin]:
            return  # a heartbeat: the same reading
        self._forces[skin] = stamp, force
        here = self._touched(stamp)
        total = sum(here.values())
        if len(here) > 1 and total >= self.config.threshold:
            self._push, self._held_until = " and ".join(sorted(here)), stamp + self.config.hold
            self._latch(because(Cause.PUSH, who=self._push))
        elif self._push and total > self.config.release:
            self._held_until = stamp + self.config.hold

    @property
    def pushed(self) -> bool:
        """Whether a push is on, on one skin or on several, whatever else stops the body."""
        messages = [skin.message for skin in self.skins.values()]
        return bool(self._push) or any(Cause.PUSH in message.causes for message in messages)

    def _touched(self, t: float) -> dict[str, float]:
        """Return the skins that are touched -> force [N]; NaN is left to the skin's own stop."""
        return {name: f for name, (when, f) in self._forces.items() if t - when <= OLDEST and f > 0}

    def reasons(self, t: float) -> list[Reason]:
        """Return a push on several skins, while it is on: only their readings end it."""
        self._held_until = min(self._held_until, t + self.config.hold)  # the clock was set back
        pressed = sum(f for _, f in self._forces.values() if f > 0) > self.config.release
        if not (t <= self._held_until or pressed):
            self._push = ""
        return [because(Cause.PUSH, who=self._push)] if self._push else []

    def stopping(self, t: float) -> list[str]:
        """Return the names of the skins whose own stop, silence or fault stops the body at t."""
        return [name for name, skin in self.skins.items() if skin.reasons(t)]

    @property
    def until(self) -> float:
        """When the first "free" of the skins expires [s]."""
        return min((skin.message.until for skin in self.skins.values()), default=-math.inf)
