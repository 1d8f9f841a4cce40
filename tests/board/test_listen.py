# SPDX-License-Identifier: Apache-2.0
"""Listening at one baud rate after the other, on a clock that the line drives."""

import numpy as np
import pytest

from tactile_skin.board.recognise import listen as listening
from tactile_skin.board.recognise.listen import BAUDS, listen

LINES = [  # an untouched skin's
    b",".join(b"%d" % n for n in line) + b"\n"
    for line in np.random.default_rng(1).integers(40, 49, (100, 64))
]
STEP = 0.05  # s that a read waits


class Line:
    """A board that prints text at one rate, and bytes that are none at the others."""

    port, in_waiting = "/dev/ttyTEST", 0

    def __init__(self, baud: int, begins: float):
        self.t, self.baudrate, self._baud, self._begins = 0.0, 0, baud, begins

    def reset_input_buffer(self):
        pass

    def write(self, data):
        pass

    def read(self, n):
        self.t += STEP
        if self.t < self._begins:
            return b""
        known = self.baudrate == self._baud
        return LINES[round(self.t / STEP) % 100] if known else bytes(range(128, 192))


@pytest.fixture
def line(monkeypatch):
    def made(baud=9_600, begins=0.0):
        line = Line(baud, begins)
        monkeypatch.setattr(listening.time, "monotonic", lambda: line.t)
        return line

    return made


def test_what_is_tried_is_said_before_and_after_each_rate(line):
    said, line = [], line()
    found = listen(line, BAUDS, 4.0, lambda text: said.append((round(line.t), text)))
    assert (found.baud, found.seen.protocol, found.seen.sure) == (9_600, "text", True)
    assert [when for when, _ in said] == [0, 4, 8, 12]
    assert said[0][1] == "listening for 4 s at each of 10 baud rates, until one is sure ..."
    assert said[1][1].startswith("  115200 baud (1 of 10): ")
    assert all(text.partition(" bytes: ")[2] for _, text in said[1:])


def test_a_silent_board_takes_less_than_a_minute(line):
    """It is asked at each rate; what sends by itself would have sent bytes at the first."""
    line = line(begins=1e9)
    with pytest.raises(ValueError, match=r"no byte arrives at 115200, .* nor an answer"):
        listen(line, BAUDS, 4.0, lambda text: None)
    assert line.t < 60.0


def test_a_board_that_begins_late_is_listened_to_as_long(line):
    line = line(begins=8.5)
    found = listen(line, BAUDS, 4.0, lambda text: None)
    assert (found.baud, found.seen.sure) == (9_600, True)
    assert len(found.data) > 3.5 / STEP * len(LINES[0])
