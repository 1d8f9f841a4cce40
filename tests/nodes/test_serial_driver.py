# SPDX-License-Identifier: Apache-2.0
"""The driver on a driven clock: which frames it publishes, with what stamp, and what it reports."""

from __future__ import annotations

import numpy as np
import pytest
from support.bench import Bench

from tactile_skin.board import protocol
from tactile_skin.board.liveness import JITTER
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Image, image_array
from tactile_skin.nodes.serial_driver import SerialDriver

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
SHAPE, BITS, FRACTION = (4, 5), 10, 6
PERIOD = 0.01  # s
SETTLED = 25  # frames after which frames come at the board's own pace


class Driven(Bench):
    """A serial_driver whose reader never starts: its bytes are a board's that is drawn at random.

    Attributes:
        stamps: of skin/adc [ns].
        device, number: clock [s] and number of the board's next frame.
    """

    def __init__(self, text=False, **parameters):
        super().__init__()
        self.text = text
        given = {"circuit.rows": SHAPE[0], "circuit.cols": SHAPE[1], "port": "loop://"}
        given |= {"protocol": "text" if text else "binary"} | parameters
        node, observer = self.node("serial_driver", given), self.node("observer")
        self.driver = SerialDriver(node)
        for timer in node._timers:  # neither the reader starts, nor do seconds end by themselves
            timer.cancel()
        self.stamps, self.arrivals, self.reports, self.pictures = [], [], [], []
        observer.create_subscription(Image, "skin/adc", self._on_adc, 100)
        observer.create_subscription(
            DiagnosticArray, "skin/diagnostics", lambda m: self.reports.append(m.status[0]), 100
        )
        self.rng = np.random.default_rng(1)
        self.device, self.number = 3.0, 7
        self.connect()

    def _on_adc(self, message) -> None:
        stamp = message.header.stamp
        self.stamps.append(stamp.sec * 10**9 + stamp.nanosec)
        self.arrivals.append(self.clock.now().nanoseconds)
        self.pictures.append(image_array(message))

    def connect(self) -> None:
        """As the reader does when a frame has come: with a parser of its own."""
        reader = self.driver._reader
        counters, reader.parser = reader.parser.counters, reader._make_parser()
        reader.parser.counters = counters
        reader._found("loop://")
        self.executor.spin_some()

    def disconnect(self) -> None:
        self.driver._reader._lost("the plug is out", "loop://")
        self.executor.spin_some()

    def samples(self) -> np.ndarray:
        """(rows, cols), in ADC steps * 64."""
        steps = self.rng.integers(40, 60, SHAPE)
        return steps if self.text else steps * 64 + self.rng.integers(0, 64, SHAPE)

    def frame(self, samples=None) -> bytes:
        """The board's next bytes."""
        samples = self.samples() if samples is None else samples
        self.device, self.number = self.device + PERIOD, self.number + 1
        if self.text:
            return (",".join(map(str, samples.ravel())) + "\n").encode()
        return protocol.encode(self.number, round(self.device * 1e6), samples, BITS, FRACTION)

    def arrive(self, data: bytes, after=PERIOD) -> None:
        self.clock.advance(after)
        for frame in self.driver._reader.parser.feed(data):
            self.driver.on_frame(frame)
        self.executor.spin_some()

    def run(self, frames: int, samples=None) -> None:
        for _ in range(frames):
            self.arrive(self.frame(samples))

    def second(self) -> DiagnosticStatus:
        """What it reports at the end of a second."""
        self.driver.on_timer()
        self.executor.spin_some()
        return self.reports[-1]

    def value(self, key: str) -> str:
        return {pair.key: pair.value for pair in self.second().values}[key]


@pytest.fixture(params=["binary", "text"])
def driven(request):
    """Frames have come for a while, and are published."""
    driven = Driven(text=request.param == "text")
    driven.run(100)
    assert driven.stamps
    return driven


@pytest.fixture
def binary():
    driven = Driven()
    driven.run(100)
    return driven


def test_frames_of_a_living_board_are_published_as_they_come(driven):
    driven.stamps.clear(), driven.arrivals.clear()
    driven.run(50)
    assert len(driven.stamps) == 50
    assert driven.stamps == driven.arrivals
    report = driven.second()
    assert (report.level, report.message) == (OK, "frames from loop://")


@pytest.mark.parametrize("text", [False, True])
def test_no_frame_is_published_before_they_come_at_the_boards_pace(text):
    driven = Driven(text=text)
    driven.run(SETTLED - 10)
    assert driven.stamps == []
    assert driven.second().level == WARN
    assert "do not arrive at the board's own rate yet" in driven.reports[-1].message
    driven.run(20)
    assert driven.stamps


def test_a_frozen_scan_is_no_reading_and_an_error_at_once(driven):
    """Not only at the next second; its end is told at once, too."""
    frozen = driven.samples()
    driven.run(25, frozen)
    assert driven.reports[-1].level == ERROR
    assert "the scan is frozen" in driven.reports[-1].message
    driven.stamps.clear()
    driven.run(50, frozen)
    assert driven.stamps == []
    driven.run(1)
    assert driven.reports[-1].level == OK
    assert len(driven.stamps) == 1


@pytest.mark.parametrize("text", [False, True])
def test_a_board_that_says_so_may_repeat_itself(text):
    driven = Driven(text=text, frozen_after=0.0)
    driven.run(100)
    driven.stamps.clear()
    driven.run(300, driven.samples())
    assert len(driven.stamps) == 300
    assert driven.second().level == OK


def test_what_was_held_back_is_as_old_as_it_is(driven):
    """A link that stalls for 0.5 s, and delivers all of it within 5 ms."""
    held = [driven.frame() for _ in range(50)]
    driven.clock.advance(49 * PERIOD)
    driven.stamps.clear(), driven.arrivals.clear()
    for data in held:
        driven.arrive(data, 1e-4)
    ages = (np.array(driven.arrivals) - driven.stamps) * 1e-9
    assert ages[:20] == pytest.approx(0.49 - PERIOD * np.arange(20), abs=2 * JITTER)
    driven.run(50)
    assert driven.second().level == OK


def test_frames_that_stay_late_are_a_warning(binary):
    """A link that delivers each frame, 0.3 s after it was sent."""
    held = []
    for _ in range(130):
        held.append(binary.frame())
        binary.arrive(held.pop(0) if len(held) > 30 else b"")
    assert "late: is the link too slow?" in binary.second().message
    assert binary.reports[-1].level == WARN


def test_stamps_rise_and_never_lie_ahead_of_the_clock(driven):
    """Whatever the link does: jitter, a stall, a burst."""
    driven.stamps.clear(), driven.arrivals.clear()
    for _ in range(20):
        for pause in driven.rng.uniform(1e-4, 2 * PERIOD, 20):
            driven.arrive(driven.frame(), pause)
        held = [driven.frame() for _ in range(driven.rng.integers(2, 40))]
        driven.clock.advance(len(held) * PERIOD)
        for data in held:
            driven.arrive(data, 1e-4)
    stamps, arrivals = np.array(driven.stamps), np.array(driven.arrivals)
    assert len(stamps) > 400
    assert (np.diff(stamps) > 0).all()
    assert (stamps <= arrivals).all()


def test_the_time_of_day_may_be_set_while_frames_come(driven):
    """On ROS stamps are the time of day: a second that is put in is no lag of the link."""
    for seconds in (1.0, -1.0, 3600.0, -7200.0):
        driven.clock.set(seconds)
        driven.stamps.clear(), driven.arrivals.clear()
        driven.run(50)
        assert len(driven.stamps) == 50
        assert driven.stamps == driven.arrivals
    assert driven.second().level == OK


def test_a_number_that_jumps_is_a_restart_although_the_boards_clock_goes_on(binary):
    for restart in (1, 2, 3):
        binary.number = 20_000 * restart
        binary.stamps.clear()
        binary.run(SETTLED - 10)
        assert binary.stamps == []
        binary.run(40)
        assert bool(binary.stamps) is (restart < 3)
        assert binary.value("restarts") == str(restart)
    assert binary.reports[-1].level == ERROR
    assert "the board restarted 3 times" in binary.reports[-1].message


@pytest.mark.parametrize("how", ["damaged", "lost"])
@pytest.mark.parametrize(("share", "level"), [(0.02, OK), (0.06, WARN), (0.4, WARN), (0.55, ERROR)])
def test_a_link_that_damages_or_loses_frames(driven, how, share, level):
    if driven.text and how == "lost":
        pytest.skip("lines have no numbers")
    driven.second()
    for k in range(100):
        data = driven.frame()
        bad = int((k + 1) * share) > int(k * share)
        if bad and how == "damaged":
            data = data.replace(b",", b"x", 1) if driven.text else data[:-1] + bytes([data[-1] ^ 1])
        driven.arrive(b"" if bad and how == "lost" else data)
    report = driven.second()
    assert report.level == level
    assert ("damaged or lost" in report.message) is (level != OK)
    driven.run(100)
    assert driven.second().level == OK


def test_what_was_lost_before_hides_no_damage(binary):
    """They are counted for themselves: a second of the one follows many of the other."""
    for k in range(300):
        data = binary.frame()
        binary.arrive(data if k % 2 else b"")
    assert binary.second().level == WARN
    for _ in range(50):  # each twice: the second counts as damaged, and is not lost
        data = binary.frame()
        binary.arrive(data)
        binary.arrive(data, 1e-3)
    assert binary.second().level == ERROR


def test_samples_beyond_what_the_header_says_name_adc_bits():
    """A board that says 10 bits and 5 of a fraction, and sends a fraction of 6."""
    driven = Driven()

    def frame(samples):
        driven.device, driven.number = driven.device + PERIOD, driven.number + 1
        return protocol.encode(driven.number, round(driven.device * 1e6), samples, 10, 5)

    for k in range(200):
        pressed = k % 2 * np.full(SHAPE, 700 * 64)
        driven.arrive(frame(np.maximum(driven.samples() // 2, pressed)))
    report = driven.second()
    assert report.level == ERROR
    assert "check the board's adc_bits" in report.message
    assert driven.value("out_of_range") == "100"


def test_a_reconnect_begins_anew(driven):
    """Neither the trouble nor the pace of the connection before is of this one."""
    driven.run(40, driven.samples())
    assert "frozen" in driven.second().message
    driven.disconnect()
    assert (driven.reports[-1].level, driven.reports[-1].message) == (ERROR, "the plug is out")
    driven.clock.advance(1.0)
    driven.device, driven.number = 0.0, 0
    driven.connect()
    assert "frozen" not in driven.reports[-1].message
    driven.stamps.clear(), driven.arrivals.clear()
    if driven.text:
        driven.arrive(b"\n", 0.0)  # what comes before the first line's end counts for nothing
    driven.run(SETTLED - 10)
    assert driven.stamps == []
    driven.run(40)
    assert driven.second().level == OK
    assert driven.stamps == driven.arrivals
    assert driven.value("restarts") == "0"


def test_reconnects_are_no_restarts(binary):
    """A loose plug is told by itself; three of them do not name the board's supply."""
    for _ in range(5):
        binary.disconnect()
        binary.device, binary.number = 0.0, 0
        binary.connect()
        binary.run(60)
    assert binary.second().level == OK
    assert binary.value("reconnects") == "5"


@pytest.mark.parametrize(
    ("shape", "bits", "advice"),
    [((4, 6), 10, "circuit.cols: 6"), ((4, 5), 12, "circuit.adc_bits: 12")],
)
def test_a_frame_of_another_board_is_an_error_and_no_reading(binary, shape, bits, advice):
    sent = protocol.encode(1, 1, np.ones(shape, int), bits, 16 - bits)
    (wrong,) = protocol.BinaryParser().feed(sent)
    binary.stamps.clear()
    binary.driver.on_frame(wrong)
    binary.executor.spin_some()
    assert binary.stamps == []
    assert binary.reports[-1].level == ERROR
    assert binary.reports[-1].message == (
        f"the board sends 4 x {shape[1]} at {bits} bits, the configuration says 4 x 5 at 10 bits: "
        f"set {advice}"
    )


# --- crossings that are not read ---


def dashed(steps, *cells) -> bytes:
    """A line in which these crossings were not read."""
    words = [str(v) for v in np.ravel(steps)]
    for row, col in cells:
        words[row * SHAPE[1] + col] = "-"
    return (",".join(words) + "\n").encode()


def sent(driven, samples=None, cells=()):
    """The next frame with a few crossings that the board prints as a dash."""
    driven.arrive(dashed(driven.samples() if samples is None else samples, *cells))


def test_a_crossing_that_was_not_read_is_marked_on_the_topic_and_named():
    driven = Driven(text=True)
    driven.run(50)
    for _ in range(5):
        sent(driven, cells=[(1, 2)])
    last = driven.pictures[-1]
    assert np.argwhere(last == 65535).tolist() == [[1, 2]]
    report = driven.second()
    assert report.level == WARN
    assert report.message == (
        "no reading at row 1, column 2: repair it, or exclude it in circuit.scanned (in "
        "circuit.mask, if no cell is there)"
    )


@pytest.mark.parametrize("name", ["circuit.scanned", "circuit.mask"])
@pytest.mark.parametrize("dash", [False, True])
def test_a_crossing_that_is_named_is_marked_however_the_board_prints_it(name, dash):
    driven = Driven(text=True, **{name: "11111 11011 11111 11111"})
    for _ in range(100):
        samples = driven.samples()
        samples[1, 2] = 0
        sent(driven, samples, [(1, 2)] if dash else [])
    assert driven.second().level == OK
    assert np.argwhere(driven.pictures[-1] == 65535).tolist() == [[1, 2]]


def test_a_crossing_that_is_printed_as_0_and_not_named_is_named():
    driven = Driven(text=True)
    for _ in range(100):
        samples = driven.samples()
        samples[3, 4] = 0
        sent(driven, samples)
    assert driven.second().message.startswith(
        "no reading at row 3, column 4: is it connected, or below a threshold of the board's?"
    )


def test_a_fabric_that_reads_0_at_rest_is_no_board_that_skips_crossings():
    """A coarse ADC: most cells read 0 until they are touched."""
    driven = Driven(text=True)
    for _ in range(100):
        samples = driven.samples() * (driven.rng.random(SHAPE) < 0.2)
        samples[:2] = 0
        samples[3, 3] = 40 + driven.number % 5
        driven.number += 1
        sent(driven, samples)
    assert "no reading" not in driven.second().message


@pytest.mark.parametrize(("axis", "said"), [(0, "row 2"), (1, "column 2")])
def test_a_line_without_a_reading_stops(axis, said):
    """Nothing would be felt there. A few crossings are read through their neighbours."""
    driven = Driven(text=True)
    driven.run(50)
    cells = [(2, j) for j in range(5)] if axis == 0 else [(i, 2) for i in range(4)]
    for _ in range(5):
        sent(driven, cells=cells)
    assert driven.reports[-1].level == ERROR
    assert driven.reports[-1].message == f"{said}: the board reads none of its crossings"
    driven.run(5)
    assert driven.second().level == OK


@pytest.mark.parametrize("inverted", [False, True])
def test_a_board_whose_readings_fall_with_pressure_is_as_alive_as_another(inverted):
    """Near either end of the ADC's range; and with an offset, which shifts them by some steps."""
    driven = Driven(text=True, **{"circuit.inverted": inverted, "circuit.adc_offset": 12.0})
    for k in range(200):
        steps = driven.rng.integers(5, 20, SHAPE) + (k > 100) * driven.rng.integers(0, 500, SHAPE)
        sent(driven, 1023 - steps if inverted else steps)
    assert driven.second().level == OK
    frozen = driven.samples()
    for _ in range(30):
        sent(driven, frozen)
    assert "the scan is frozen" in driven.second().message


def test_many_crossings_without_a_reading_stop():
    driven = Driven(text=True)
    driven.run(50)
    for _ in range(5):
        sent(driven, cells=[(k, (k + d) % 5) for k in range(4) for d in (0, 1)])
    assert driven.reports[-1].level == ERROR
    assert driven.reports[-1].message == "more than 25% of the crossings are not read"
