# SPDX-License-Identifier: Apache-2.0
"""What a stop hook is told: a free is believed while the reading behind it is fresh."""

import math
import threading

import pytest
from support.patience import PATIENCE
from support.told import Told

from tactile_skin.behaviours.hooks import EventHook, StopHook, StopMessages
from tactile_skin.behaviours.stop import OUT_OF_DATE, StopMessage
from tactile_skin.middleware.bus import ManualClock

SILENT = "no message from the stop node"
PUSH = StopMessage(True, "push")


def free(until: float) -> StopMessage:
    return StopMessage(False, "", until)


# --- the words, on a driven clock ---


@pytest.fixture
def words():
    return StopMessages(["stop"], 10.0)


def test_it_is_stop_until_somebody_speaks(words):
    assert words.at(10.1) == (True, "no message from the stop node yet")


def test_a_free_runs_out_although_it_just_arrived(words):
    words.hear(10.0, "stop", free(10.12))
    assert words.at(10.0) == words.at(10.12) == (False, "")
    assert words.at(10.13) == (True, OUT_OF_DATE)
    words.hear(10.2, "stop", free(10.12))  # kept somewhere while the process was held
    assert words.at(10.2) == (True, OUT_OF_DATE)
    words.hear(10.21, "stop", free(10.3))
    assert words.at(10.21) == (False, "")


def test_a_stop_does_not_run_out(words):
    words.hear(10.0, "stop", StopMessage(True, "push", 0.0))
    assert words.at(10.2) == (True, "push")


def test_silence_is_a_stop_however_long_the_last_word_was_good_for(words):
    words.hear(10.0, "stop", free(math.inf))
    assert words.at(10.25) == (False, "")
    assert words.at(10.26) == (True, SILENT)


def test_a_clock_that_was_set_back_proves_nothing(words):
    words.hear(10.0, "stop", free(10.1))
    assert words.at(9.0) == (True, SILENT)


def test_any_of_several_stops():
    words = StopMessages(["left", "right"], 0.0)
    words.hear(0.0, "left", free(1.0))
    words.hear(0.0, "right", free(0.1))
    assert words.at(0.1) == (False, "")
    assert words.at(0.11) == (True, OUT_OF_DATE)
    words.hear(0.11, "left", PUSH)
    assert words.at(0.11) == (True, f"push + {OUT_OF_DATE}")


def test_when_the_words_change_by_themselves(words):
    words.hear(10.0, "stop", free(10.12))
    assert words.next(10.0) == 10.12
    assert words.next(10.13) == 10.25
    assert words.next(10.3) == math.inf
    words.hear(10.0, "stop", free(-math.inf))
    assert words.next(10.0) == 10.25


# --- the hook ---


@pytest.fixture
def made():
    hooks = []

    def make(hook, clock=None, **kwargs):
        clock = clock or ManualClock(10.0)
        hooks.append(StopHook(hook, ["stop"], lambda: clock.now().nanoseconds / 1e9, **kwargs))
        return hooks[-1]

    yield make
    for hook in hooks:
        hook.close()


def test_the_hook_hears_of_a_free_that_ran_out_with_nobody_speaking(made):
    told, clock = Told(), ManualClock(10.0)
    hook = made(told, clock)
    hook.hear("stop", free(10.12))
    told.wait_for((False, ""))
    clock.advance(0.13)
    told.wait_for((True, OUT_OF_DATE))


def test_a_free_is_judged_when_the_hook_is_called(made):
    """The hook was busy, or the process was held, while it ran out."""
    clock, busy, go, told = ManualClock(10.0), threading.Event(), threading.Event(), []

    def hook(stop, reason):
        told.append((stop, reason))
        if len(told) == 1:
            busy.set()
            assert go.wait(PATIENCE)

    stop_hook = made(hook, clock)
    assert busy.wait(PATIENCE)
    stop_hook.hear("stop", free(10.12))
    clock.advance(0.2)
    go.set()
    stop_hook.close(PATIENCE)
    assert all(stop for stop, _ in told)


def test_the_last_word_is_stop_whatever_comes_after_the_end(made):
    told = Told()
    hook = made(told)
    hook.hear("stop", free(math.inf))
    told.wait_for((False, ""))
    hook.end()
    hook.hear("stop", free(math.inf))
    hook.close(PATIENCE)
    assert told.calls[-1] == (True, "the skin shuts down")


@pytest.mark.parametrize("filters", [[], [lambda record: record.no_such_attribute]])
def test_the_same_stop_is_said_again_after_a_free_that_raised(made, monkeypatch, filters):
    """The hook may have let the motors go before it raised; a log may raise as well."""
    told = Told()

    def hook(stop, reason):
        told(stop, reason)
        if not stop:
            stop_hook.hear("stop", PUSH)  # before the next try
            raise RuntimeError("half done")

    stop_hook = made(hook)
    monkeypatch.setattr(stop_hook._log, "filters", filters)
    stop_hook.hear("stop", PUSH)
    told.wait_for((True, "push"))
    stop_hook.hear("stop", free(math.inf))
    told.wait_for((True, "push"), 2)


@pytest.mark.parametrize("word", [PUSH, free(math.inf)])
@pytest.mark.parametrize("heartbeat", [None, 0.1])
def test_with_a_heartbeat_the_hook_is_called_without_a_change(made, word, heartbeat):
    """Within the heartbeat of the last call; without one only at changes."""
    told, clock = Told(), ManualClock(10.0)
    hook = made(told, clock, heartbeat=heartbeat)
    hook.hear("stop", word)
    told.wait_for(word[:2])
    for times in (2, 3):
        clock.advance(0.11)
        hook.hear("stop", word)
        if heartbeat is not None:
            told.wait_for(word[:2], times)
    hook.close(PATIENCE)
    assert told.calls.count(word[:2]) == (1 if heartbeat is None else 3)


async def awaited(stop, reason):
    pass


@pytest.mark.parametrize("hook", [None, lambda: 0, lambda stop: 0, lambda a, b, c: 0, awaited])
def test_a_hook_that_cannot_be_called_is_refused_before_it_is_needed(hook):
    with pytest.raises(ValueError, match=r"hook .*must be a function of \(stop, reason\)"):
        StopHook(hook, ["stop"], lambda: 0.0)


@pytest.mark.parametrize("heartbeat", [0.0, -1.0, math.inf, math.nan, "0.1"])
def test_a_bad_heartbeat_is_refused_by_name(heartbeat):
    with pytest.raises(ValueError, match="heartbeat = "):
        StopHook(print, ["stop"], lambda: 0.0, heartbeat)


# --- hooks of events ---


def test_a_busy_event_hook_misses_the_oldest_and_says_so(caplog):
    seen, busy, go, done = [], threading.Event(), threading.Event(), threading.Event()

    def hook(k):
        seen.append(k)
        busy.set()
        assert go.wait(PATIENCE)
        if k == 99:
            done.set()

    told = EventHook(hook, ["k"])
    told.tell(0)
    assert busy.wait(PATIENCE)
    for k in range(1, 100):
        told.tell(k)
    go.set()
    assert done.wait(PATIENCE)
    told.close()
    assert seen == [0, *range(100 - (len(seen) - 1), 100)]
    assert told.dropped == 100 - len(seen) > 0
    assert f"missed {told.dropped} events" in caplog.text


def test_a_hook_that_leaves_its_work_to_a_coroutine_is_reported(caplog):
    told = EventHook(lambda k: awaited(True, k), ["k"])
    told.tell("push")
    told.close()
    assert "returned a coroutine, which nothing awaits" in caplog.text


def test_an_event_hook_that_raises_is_told_of_the_next(caplog):
    seen, done = [], threading.Event()

    def hook(k):
        seen.append(k)
        if k == 2:
            done.set()
        raise RuntimeError("hook failed")

    told = EventHook(hook, ["k"])
    for k in range(3):
        told.tell(k)
    assert done.wait(PATIENCE)
    told.close()
    assert seen == [0, 1, 2]
    assert "RuntimeError: hook failed" in caplog.text
