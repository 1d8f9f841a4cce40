# SPDX-License-Identifier: Apache-2.0
"""serial_driver: bytes of the board -> skin/adc."""

from __future__ import annotations

import dataclasses
import time

from ..board.admission import Admission
from ..board.formats import make_format, make_parser
from ..board.frame import Counters, Frame
from ..board.liveness import JITTER
from ..board.recognise import explain
from ..board.serial_port import LONGEST_BOOT, SerialReader, check_port
from ..errors import concerning
from ..middleware.bus import Time
from ..middleware.config import adc_of, circuit_of, declared, part_of
from ..msg import Header, Image, Trigger, image
from ..parameters.nodes import SerialDriver as Parameters
from . import diagnostics

_DOUBTFUL = 0.05  # of a second's frames damaged or lost: a warning
_BAD = 0.5  # the same: a stop
_TICK = 1000  # ns that stamps are apart at least
_SLOW = 0.1  # s on their way from which on frames are worth a warning


class SerialDriver:
    """Publishes the frames of the board, and what is wrong with them.

    Publishes skin/adc (16UC1: ADC steps * 2**(16 - adc_bits); 65535: not read), stamped with the
    arrival of the frame's last byte, less the time that it was held back on its way; and
    diagnostics once a second. Frames that no living board sends (liveness.py) are not published,
    and are an ERROR, which stops the robot; so is a link that damages or loses half of the frames.
    """

    longest_start = LONGEST_BOOT  # s until the first frame of a board that its opening resets

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        self.circuit = circuit_of(given.circuit)
        self._admission = Admission(adc_of(given.circuit, self.circuit), given.frozen_after)
        self._connection = -1  # that it knows
        self.frame_id = given.frame_id
        self._part = part_of(given.circuit)
        size = (*self._part.shape, self.circuit.adc_bits)
        with concerning("format", "protocol"):  # what is wrong is an error now
            fmt = make_format(given.protocol, dataclasses.asdict(given.format))
        self._stamp = 0  # ns, of the last frame
        # on ROS stamps are the time of day, which may be set, or a simulation's
        self._monotonic = getattr(node.get_clock(), "monotonic", time.monotonic)
        self._mark, self._rate = (self._now(), 0, 0, 0, 0), 0.0
        self._bad, self._beyond = 0.0, ("", 0.0)  # why numbers are out of range; the largest
        self._adc = node.create_publisher(Image, "skin/adc", 10)
        self._diagnostics = diagnostics.Reporter(node)
        absent = given.wait_for_port == 0.0 and not node.waits
        looked_for = given.port == "auto" and given.serial_number
        with concerning("port", *(["serial_number"] if looked_for else [])):
            check_port(given.port, given.serial_number, absent)
        self._reader = SerialReader(
            given.port,
            given.baud,
            lambda: make_parser(given.protocol, *size, fmt),
            self.on_frame,
            self._on_link,
            given.watchdog,
            given.wait_for_port,
            lambda frame: self._admission.refuse(frame.only(self._part.of)),
            given.serial_number,
        )
        node.create_service(Trigger, "~/lend", self.on_lend)
        node.create_timer(1.0, self.on_timer)
        # Read only once the node spins: whoever subscribes is there by then.
        self._starter = node.create_timer(0.001, self._start)

    def _start(self) -> None:
        self._starter.cancel()
        self._reader.start()

    def on_lend(self, _, response):
        """Let another program have the port for a while; without frames the robot stands."""
        self._reader.lend()
        response.success, response.message = True, f"{self._reader.port} is lent"
        return response

    def on_frame(self, frame: Frame) -> None:
        """In the reader's thread: publish at once."""
        now, before, reader = self._now(), self._admission.trouble, self._reader
        restarts = reader.parser.counters.restarts
        if reader.reconnects != self._connection:
            self._connection = reader.reconnects
            self._admission.connect(restarts)
        frame = frame.only(self._part.of)
        samples = self._admission.frame(self._monotonic(), frame, restarts)
        if before != self._admission.trouble:
            self._report()  # a stop need not wait for the next second
        if samples is None:
            return
        lag = self._admission.verdict.lag
        taken = now - round(lag * 1e9) if lag > JITTER else now
        self._stamp = min(max(taken, self._stamp + _TICK), now)  # they rise as the frames do
        header = Header(Time(self._stamp).to_msg(), self.frame_id)
        self._adc.publish(image(samples, "16UC1", header))

    def on_timer(self) -> None:
        """Once a second: measure the rate and the losses, and report."""
        counters = self.counters
        counts = counters.frames, counters.corrupt, counters.lost, counters.out_of_range
        since, *before = self._mark
        self._mark = self._now(), *counts
        frames, corrupt, lost, beyond = (n - b for n, b in zip(counts, before, strict=True))
        self._rate = frames * 1e9 / max(self._mark[0] - since, 1)
        bad = max(corrupt, lost)  # a frame that is damaged is also missing where they have numbers
        self._bad = bad / max(frames + bad, 1)
        if 2 * beyond < corrupt or not corrupt:
            self._beyond = "", 0.0
        elif not self._beyond[0] or counters.largest > self._beyond[1]:
            self._beyond = explain(self._reader.parser), counters.largest
        self._report()

    @property
    def counters(self) -> Counters:
        """What was seen of the frames."""
        return self._reader.parser.counters

    @property
    def reconnects(self) -> int:
        """How often the port was opened again."""
        return max(0, self._reader.reconnects)

    @property
    def trouble(self) -> str:
        """Why frames are not published; empty if they are."""
        return self._admission.trouble or self._reader.trouble

    def _on_link(self, text: str) -> None:
        """In the reader's thread: the connection came or went."""
        self._admission.forget()
        self._report()  # first: a log handler may raise
        self.node.get_logger().info(text)

    def _report(self) -> None:
        reader, counters = self._reader, self.counters
        level, message, kind = diagnostics.OK, f"frames from {reader.connected_to}", ""
        seen = self._admission
        lag = seen.verdict.lag
        if seen.trouble:
            level, message = diagnostics.ERROR, seen.trouble
        elif reader.connected_to is None:
            level, message = diagnostics.ERROR, reader.trouble
        elif self._bad >= _DOUBTFUL:
            level = diagnostics.ERROR if self._bad >= _BAD else diagnostics.WARN
            kind = "damaged"
            # the share is among the values: each other text would be another reason to stop
            share = "half or more" if self._bad >= _BAD else "some"
            message = f"{share} of the last second's frames were damaged or lost"
            if why := self._beyond[0]:
                message += f": {why}"
        elif not seen.verdict.settled:
            level, kind = diagnostics.WARN, "unsettled"
            message = "frames do not arrive at the board's own rate yet"
        elif lag > _SLOW:
            level, kind = diagnostics.WARN, "late"
            message = f"frames arrive {lag:.2f} s late: is the link too slow?"
        elif seen.unread.text:
            level, message, kind = diagnostics.WARN, seen.unread.text, "unread"
        values = {
            "port": reader.connected_to or reader.port,
            diagnostics.SIMULATED: str(reader.simulated).lower(),
            "rate": f"{self._rate:.2f}",
            "frames": counters.frames,
            "crc_errors": counters.corrupt,
            "out_of_range": counters.out_of_range,
            "passed_over": counters.passed,
            "lost": counters.lost,
            "bad": f"{self._bad:.3f}",
            "lag": f"{lag:.3f}",
            "skipped_bytes": counters.skipped_bytes,
            "restarts": counters.restarts,
            "reconnects": self.reconnects,
        }
        if kind:
            values[diagnostics.KIND] = kind
        if where := next((w for w in (seen.verdict, seen.unread) if w.rows or w.cols), None):
            values |= diagnostics.places(where.rows, where.cols)
        self._diagnostics.publish(diagnostics.report(self.node, level, message, values))

    def _now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def close(self) -> None:
        self._reader.close()
        self._report()  # the final counts
