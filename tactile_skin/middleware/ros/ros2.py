"""Topics and services of one node by rclpy."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from .. import bus

LAST_WORD = 0.5  # s, for messages under way when a process ends
_logger = logging.getLogger("tactile_skin")


class Ros2:
    """Topics and services of one node by rclpy."""

    def __init__(self, name: str, namespace: str):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        # main handles signals: a final stop is published first
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(name, namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._publishers = []
        self.failed = False  # rclpy itself has raised: nothing arrives any more
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def ok(self) -> bool:
        return self._thread.is_alive()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self._executor.spin()
        except ExternalShutdownException:  # `close`
            pass
        except Exception:
            self.failed = True
            _logger.exception("rclpy's executor has ended")

    def advertise(self, kind: type, topic: str, qos: bus.QoSProfile) -> tuple[Callable, Callable]:
        """What sends a message, and what counts the subscribers."""
        publisher = self._node.create_publisher(kind, topic, self._qos(qos))
        self._publishers.append(publisher)
        return publisher.publish, publisher.get_subscription_count

    def subscribe(self, kind: type, topic: str, callback, qos: bus.QoSProfile) -> None:
        self._node.create_subscription(kind, topic, _isolated(topic, callback), self._qos(qos))

    def serve(self, kind: type, name: str, answer) -> None:
        self._node.create_service(kind, name, answer)

    @staticmethod
    def _qos(qos: bus.QoSProfile):
        from rclpy.qos import DurabilityPolicy, QoSProfile

        return QoSProfile(depth=qos.depth, durability=DurabilityPolicy[qos.durability.name])

    def declare(self, name: str, value, descriptor: bus.ParameterDescriptor) -> None:
        """Show a parameter to `ros2 param`; nodes read theirs once, so that none can be set."""
        from rcl_interfaces import msg as rcl

        described = rcl.ParameterDescriptor(description=descriptor.description, read_only=True)
        for bounds in descriptor.floating_point_range:
            described.floating_point_range.append(
                rcl.FloatingPointRange(from_value=bounds.from_value, to_value=bounds.to_value)
            )
        for bounds in descriptor.integer_range:
            described.integer_range.append(
                rcl.IntegerRange(from_value=bounds.from_value, to_value=bounds.to_value)
            )
        self._node.declare_parameter(name, value, described, ignore_override=True)

    def log(self, level: int, text: str) -> None:
        logger = self._node.get_logger()
        if level >= logging.ERROR:  # a line for each: rclpy wants one severity per line
            logger.error(text)
        elif level >= logging.WARNING:
            logger.warning(text)
        elif level >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)

    def close(self) -> None:
        """Leave ROS once the last messages have arrived, or nobody takes them."""
        import rclpy
        from rclpy.duration import Duration

        end = time.monotonic() + LAST_WORD
        for publisher in self._publishers:
            left = max(0.001, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))
        # The thread must have left rclpy before Python ends: killed inside C++ code, it would abort
        # the process. Without its context it leaves by itself.
        rclpy.try_shutdown()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(LAST_WORD)
        self._executor.shutdown(timeout_sec=LAST_WORD)


def _isolated(topic: str, callback: Callable) -> Callable:
    """A subscriber's callback whose exceptions are logged: one would end rclpy's executor."""

    def call(message) -> None:
        try:
            callback(message)
        except Exception:
            _logger.exception("a message on %s was not taken", topic)

    return call
