"""serial_driver: bytes of the board -> skin/adc."""

from __future__ import annotations

from ..config import circuit_of, describe
from ..msg import DiagnosticArray, Header, Image, image
from ..protocol import Frame, make_parser
from ..serial_port import SerialReader, check_port
from . import diagnostics


class SerialDriver:
    """Publishes skin/adc (16UC1: ADC steps * 2**(16 - adc_bits)), stamped with the arrival of the
    frame's last byte, and diagnostics once a second.
    """

    def __init__(self, node):
        self.node = node
        self.circuit = circuit_of(node)

        def value(name, default, *bounds):
            return node.declare_parameter(name, default, describe(*bounds)).value

        port = value("port", "auto", "serial device, or auto: the first that sends frames")
        baud = value("baud", 1_000_000, "bits per second", 300, 20_000_000)
        protocol = value("protocol", "binary", "binary or text")
        wait = value("wait_for_port", 0.0, "how long the port may take to appear [s]", 0.0, 3600.0)
        watchdog = value("watchdog", 3.0, "silence after which the port is reopened [s]", 0.1, 60.0)
        self.frame_id = value("frame_id", "base_link", "frame of the skin's messages")
        size = (self.circuit.rows, self.circuit.cols, self.circuit.adc_bits)
        make_parser(protocol, *size)  # a wrong name is an error now, not in the reader's thread
        self._mismatch = ""
        self._mark, self._rate = (self._now(), 0), 0.0
        self._adc = node.create_publisher(Image, "skin/adc", 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)
        if wait == 0.0:
            check_port(port)
        self._reader = SerialReader(
            port,
            baud,
            lambda: make_parser(protocol, *size),
            self.on_frame,
            self._on_link,
            watchdog,
            wait,
        )
        node.create_timer(1.0, self.on_timer)
        # Read only once the node spins: whoever subscribes is there by then.
        self._starter = node.create_timer(0.001, self._start)

    def _start(self) -> None:
        self._starter.cancel()
        self._reader.start()

    def on_frame(self, frame: Frame) -> None:
        """In the reader's thread: publish at once."""
        stamp = self.node.get_clock().now().to_msg()
        sent, wanted = (
            (frame.samples.shape, frame.adc_bits),
            (self.circuit.shape, self.circuit.adc_bits),
        )
        if sent != wanted:
            self._mismatch = (
                f"the board sends {sent[0]} at {sent[1]} bits, "
                f"the configuration says {wanted[0]} at {wanted[1]} bits"
            )
            return
        self._mismatch = ""
        self._adc.publish(image(frame.samples, "16UC1", Header(stamp, self.frame_id)))

    def on_timer(self) -> None:
        """Once a second: measure the rate, and report."""
        now, frames = self._now(), self._reader.parser.counters.frames
        since, before = self._mark
        self._mark = now, frames
        self._rate = (frames - before) * 1e9 / max(now - since, 1)
        self._report()

    def _on_link(self, text: str) -> None:
        """In the reader's thread: the connection came or went."""
        self.node.get_logger().info(text)
        self._report()

    def _report(self) -> None:
        reader, counters = self._reader, self._reader.parser.counters
        level, message = diagnostics.OK, f"frames from {reader.connected_to}"
        if self._mismatch:
            level, message = diagnostics.ERROR, self._mismatch
        elif reader.connected_to is None:
            level, message = diagnostics.ERROR, reader.trouble
        values = {
            "port": reader.connected_to or reader.port,
            "rate": f"{self._rate:.2f}",
            "frames": counters.frames,
            "crc_errors": counters.corrupt,
            "lost": counters.lost,
            "skipped_bytes": counters.skipped_bytes,
            "restarts": counters.restarts,
            "reconnects": max(0, reader.reconnects),
        }
        self._diagnostics.publish(diagnostics.report(self.node, level, message, values))

    def _now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def close(self) -> None:
        self._reader.close()
        self._report()  # the last word: the final counts
