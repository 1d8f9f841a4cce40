# SPDX-License-Identifier: Apache-2.0
"""When frames in doubt are a fault, and when that fault is over.

A touch that comes or goes causes a few suspect frames; half of the last ones are a fault, and so is
one that misses by much what stands. One at rest persists under a touch, which may hide it; one
under a touch may not show at rest, and is not over when the hand is gone.
"""

from __future__ import annotations

import math
from collections import deque

# Chosen so that valid streams do not stop the robot and faults do within 0.2 s; scored by bench
# faults, in docs/reliability.md.
_WINDOW = 20  # frames: 0.2 s at 100 a second
_FAULT = _WINDOW // 2  # suspect frames among them that make a fault,
_OVER = _FAULT // 2  # and that end it
# Times its noise by which a frame misses what stands, that is a fault at once. A frame is explained
# at least as well as by the picture before it, which it misses by what its readings have changed
# since: so far a touch that moves while rows are read may miss. Chosen on 20 sound streams (rows
# read in 10 to 80 ms, seed 7): of 12800 frames 150 missed by more, the most by 39 times the noise,
# and none of them by more than 0.46 of its change.
LARGE = 5.0
_REST_SECONDS = 1.0  # s of rest without a suspect frame after which a fault under one touch is over
_VALID_SECONDS = 0.5  # s of touch without a suspect frame after which any fault is
_REPEATED = 2  # touches with a fault in succession from which on rest is no evidence


class Doubt:
    """Follows the doubt of one skin's frames; all times are of one clock [s].

    Attributes:
        kept: why a fault holds although the present frames are not in doubt; empty if it does not.
        held: whether a fault that was seen under a touch is not over.
        present: whether the last frames are in doubt, whatever was before.
    """

    def __init__(self):
        # at first as many count as in doubt as make a fault: a skin that is wrong from the start is
        # never free
        self._recent = deque([True] * _FAULT + [False] * (_WINDOW - _FAULT), maxlen=_WINDOW)
        self.present = False
        self.reset()

    def reset(self) -> None:
        """Forget the past: who asks for it has checked the skin.

        What the last frames are goes on to count: a reset is no cure.
        """
        self.kept = ""
        self._at_rest, self._lasting = 0, False  # frames in doubt with nothing touching
        self._touches = 0  # with a fault since the last one without doubt
        self._counted = False  # the present touch is among them
        self.held = False  # the last one's fault is not over
        self._began = self._last = -math.inf
        self._touched = False

    def frame(self, t: float, suspect: bool, touched: bool, large: bool = False) -> bool:
        """Take a frame; whether there is a fault.

        Args:
            t: when it was read.
            suspect: whether it is in doubt.
            touched: whether anything was found to touch.
            large: whether it misses by more than `LARGE`, and than a touch that moves: alone it
                counts as many as make a fault.
        """
        self._recent.extend([True] * _FAULT if large else [suspect])
        doubts = sum(self._recent)
        self.present = doubts >= (_OVER if self.present else _FAULT)
        if suspect or touched != self._touched or t < self._last:
            self._began = t  # of a stretch without doubt, all touch or all rest
        self._last, self._touched = t, touched
        clear = t - self._began
        if touched:
            if self.present and not self._counted:
                self._touches, self._counted, self.held = self._touches + 1, True, True
            if clear >= _VALID_SECONDS:
                self._touches, self._counted, self.held = 0, False, False
        else:
            # a fault that a touch hides for a while is still there
            self._at_rest = min(max(self._at_rest + (1 if suspect else -1), 0), _FAULT)
            if self._at_rest in (0, _FAULT):
                self._lasting = self._at_rest > 0
            if clear >= _REST_SECONDS:
                self._counted, self.held = False, self.held and self._touches >= _REPEATED
        self.kept = ""
        if self.held and not self.present:
            self.kept = (
                "seen under each touch: kept until a valid touch or a reset"
                if self._touches >= _REPEATED
                else f"seen under the last touch: kept until {_REST_SECONDS:g} s of rest"
            )
        return self.fault

    @property
    def fault(self) -> bool:
        """Whether so many frames are in doubt, or were under a touch, that it is a fault."""
        return self.present or self._lasting or self.held
