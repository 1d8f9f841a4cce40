# SPDX-License-Identifier: Apache-2.0
"""Listening at one baud rate after the other, on a clock that the line drives."""

import numpy as np
import pytest

from tactile_skin.board.recognise import listen as listening
from tactile_skin.board.recognise.listen import BAUDS, listen

LINES = [  # an untouched skin's
    b",".join(b"%d" % n for n in line) + b"\n"
    for line in np.random.default_rng(1).integers(45, 54, (100, 64))
]
STEP = 0.05  # s that a read waits


class Line:
    """A board that prints text at one rate, and bytes that are none at the others.

    It begins so many seconds after the opening, with `banner` every so often until then.
    """

    port, in_waiting = "/dev/ttyTEST", 0

    def __init__(self, baud: int, begins: float, banner=b"", every=1.0, asked=False):
        self.t, self.baudrate, self._baud, self._begins = 0.0, 0, baud, begins
        self._banner, self._every, self._asked, self._answers = banner, every, asked, 0

    def reset_input_buffer(self):
        pass

    def write(self, data):
        self._answers += self._asked and data == b"A" and self.baudrate == self._baud

    def read(self, n):
        known = self.baudrate == self._baud
        self.t += STEP
        if self.t <= self._begins:
            self._answers = 0
            data = self._banner if (self.t - STEP) % self._every < STEP else b""
        elif self._asked and not self._answers:
            return b""
        else:
            self._answers -= self._asked
            data = LINES[round(self.t / STEP) % 100]
        return data if known else bytes(b * 7 % 128 + 128 for b in data[::2])


@pytest.fixture
def line(monkeypatch):
    def made(baud=9_600, begins=0.0, **kind):
        line = Line(baud, begins, **kind)
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


BANNERS = [  # and how often they are printed [s]
    (b"", 1.0),
    (b"Calibrating, do not touch ...\r\n", 1.0),
    (b"offsets\r\n" + b"0,0,0,0,0,0,0,0\r\n" * 8, 30.0),
    (b"1 of 100\n", 1.0),
]


@pytest.mark.parametrize("bauds", [BAUDS, BAUDS[:1]])
@pytest.mark.parametrize(("banner", "every"), BANNERS)
@pytest.mark.parametrize("boot", [2, 5, 9, 25])
def test_a_board_that_needs_time_after_the_opening_is_found(boot, banner, every, bauds, line):
    """Not silent, not asked, and no banner is taken for its readings."""
    line = line(115_200, begins=boot, banner=banner, every=every)
    found = listen(line, bauds, 4.0, lambda text: None)
    assert (found.baud, found.request, found.seen.cells) == (115_200, "", 64)
    assert found.seen.sure or banner
    assert found.rate == pytest.approx(1.0 / STEP, rel=0.5)
    assert line.t < 50.0


@pytest.mark.parametrize("boot", [0, 5, 9, 25])
def test_a_board_that_is_asked_late_is_asked_again(boot, line):
    found = listen(line(115_200, begins=boot, asked=True), BAUDS, 4.0, lambda text: None)
    assert (found.baud, found.request, found.seen.cells) == (115_200, "A", 64)


def test_what_has_ended_is_never_sure(line):
    """A banner, and nothing behind it."""
    line = line(115_200, begins=1e9, banner=LINES[0] * 9)
    line.read = lambda n, read=line.read: read(n) if line.t < 2.5 else (read(n), b"")[1]
    found = listen(line, BAUDS, 4.0, lambda text: None)
    assert not found.seen.sure and line.t < 120.0
