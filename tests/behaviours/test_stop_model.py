# SPDX-License-Identifier: Apache-2.0
"""The stop against a small literal model of docs/behaviours.md, in whatever order things come."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_skin.behaviours.stop import MAX_AHEAD, StopConfig, StopPolicy

STALE_AFTER = 0.1  # s
STAGES = "driver", "compensation"

newtons = st.sampled_from([0.0, 0.0, 0.0, 19.9, 20.1, 29.0, 30.0])
on_one_cell = st.sampled_from([0.0, 0.0, 8.9, 9.0])  # N
sound = st.tuples(st.just("reading"), newtons, on_one_cell, st.just(0.0))
odd = st.tuples(
    st.just("reading"),
    st.sampled_from([0.0, 80.0, math.nan, -1.0]),
    on_one_cell,
    st.sampled_from([0.0, -0.005, -0.2, 0.019, 0.021, 9.0]),  # s, its stamp beside the clock
)
others = st.one_of(
    st.tuples(st.just("fault"), st.sampled_from(STAGES), st.sampled_from(["", "", "bad"])),
    st.tuples(st.just("set back"), st.sampled_from([0.01, 0.3, 3600.0])),
    st.tuples(st.just("reset")),
    st.tuples(st.just("time")),
)
steps = st.one_of(
    *[st.tuples(st.just(0.01), sound)] * 8,
    st.tuples(st.just(0.01), odd),
    st.tuples(st.sampled_from([0.01, 0.03, 0.15, 1.0]), others),
)


class Model:
    """What is known of the skin, by the words of the page.

    A push is over `hold` after the last reading above `release`, in time that went by: a clock that
    is set back shortens nothing.
    """

    def __init__(self, hold: float):
        self._hold = hold
        self._newest = -math.inf  # stamp
        self._invalid = self._pushed = False
        self._above = -math.inf  # s that had gone by
        self.faults: dict[str, str] = {}

    def reading(self, t: float, gone: float, force: float, peak: float, stamp: float) -> None:
        if self._newest > t + MAX_AHEAD:
            self._newest = -math.inf
        if not 0.0 <= force < math.inf:
            self._invalid = True
        elif self._newest < stamp <= t + MAX_AHEAD:
            self._newest, self._invalid = stamp, False
            push = force >= 30.0 or peak >= 9.0
            self._pushed = self._pushed or push
            if push or force > 20.0:
                self._above = gone
            elif gone - self._above >= self._hold - 0.21:  # stamps may lie 0.2 s beside the clock
                self._pushed = False

    def may_be_free(self, t: float) -> bool:
        fresh = -MAX_AHEAD <= t - self._newest <= STALE_AFTER
        return fresh and not (self._invalid or self._pushed or any(self.faults.values()))


@settings(max_examples=300)
@given(st.lists(steps, min_size=20, max_size=60), st.sampled_from([0.0, 0.5]), st.booleans())
def test_it_is_free_only_on_a_fresh_sound_reading_without_a_push(events, hold, latch):
    """And with `latch` only until the first stop, or after a reset that was granted."""
    config = StopConfig(hold=hold, latch=latch, lead=0.0, stale_after=STALE_AFTER)
    policy, model = StopPolicy(config), Model(hold)
    gone, ahead = 0.0, 1e4  # s that went by; what the clock shows more
    free_once = latched = False
    for dt, (kind, *what) in [(0.01, ("reading", 0.0, 0.0, 0.0))] * 5 + events:
        gone += dt
        ahead -= what[0] if kind == "set back" else 0.0
        t = gone + ahead
        if kind == "reading":
            force, peak, beside = what
            model.reading(t, gone, force, peak, t + beside)
            policy.reading(t, force, peak, t + beside)
        elif kind == "fault":
            model.faults[what[0]] = what[1]
            policy.fault(*what)
        elif kind == "reset" and policy.reset(t) == "":
            assert model.may_be_free(t)
            latched = False
        stopped = policy.decide(t).stop
        assert stopped or (model.may_be_free(t) and not latched), (t, kind, what)
        free_once = free_once or not stopped
        latched = latched or (latch and free_once and stopped)
