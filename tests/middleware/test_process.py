# SPDX-License-Identifier: Apache-2.0
"""An object in a process of its own answers as if it were here, and says when it cannot."""

import os
import signal

import numpy as np
import pytest
from support.patience import until

from tactile_skin.middleware.process import OwnProcess, ProcessEnded

pytestmark = pytest.mark.live


class Counter:
    def __init__(self, count: int):
        if count < 0:
            raise ValueError("count must not be negative")
        self.count = count

    def add(self, more: int, *, twice: bool = False) -> np.ndarray:
        if more < 0:
            raise ValueError(f"more = {more}: must not be negative")
        self.count += (1 + twice) * more
        return np.full(2, self.count)

    @property
    def half(self) -> float:
        return 0.5 * self.count

    def where(self) -> int:
        return os.getpid()

    def die(self) -> None:
        os._exit(3)


@pytest.fixture
def counter():
    made = OwnProcess(Counter, (4,), Counter(4), ("count",))
    yield made
    made.end()


def test_calls_attributes_and_errors_are_the_objects(counter):
    assert counter.count == 4  # before it answers
    with pytest.raises(ProcessEnded, match="its process starts"):
        counter.add(1)
    until(lambda: counter.ready)
    assert counter.add(1, twice=True).tolist() == [6, 6]
    assert (counter.count, counter.half) == (6, 3.0)
    assert counter.where() == counter._process.pid != os.getpid()
    with pytest.raises(ValueError, match="more = -1: must not be negative"):
        counter.add(-1)
    assert counter.add(0).tolist() == [6, 6]


def test_what_ends_is_started_again_until_it_is_over(counter):
    until(lambda: counter.ready)
    counter.add(1)
    with pytest.raises(ProcessEnded, match=r"its process ended \(3\) and is started again"):
        counter.die()
    counter.arguments = (7,)
    until(lambda: counter.ready)
    assert counter.count == 7 and counter.add(1)[0] == 8
    counter.end()
    assert not counter.ready


def test_what_cannot_be_made_never_answers():
    made = OwnProcess(Counter, (-1,), Counter(1), ("count",))
    with pytest.raises(ValueError, match="count must not be negative"):
        until(lambda: made.ready)
    assert not made.ready and made.why == "count must not be negative" and made.count == 1
    made.end()


def test_one_that_hangs_is_killed_and_one_may_end_before_it_answers(counter):
    counter._process.kill()
    counter._process.wait()
    assert not counter.ready and "ended (-9)" in counter.why
    until(lambda: counter.ready)
    os.kill(counter._process.pid, signal.SIGSTOP)
    with pytest.raises(ProcessEnded, match=r"ended \(-9\)"):
        counter.where()
    until(lambda: counter.ready)
    assert counter.add(1)[0] == 5
