# SPDX-License-Identifier: Apache-2.0
"""This process on ROS 2: one thread takes what arrives for all of its nodes."""

from __future__ import annotations

import importlib.util
import logging
import sys
import threading
import time
from collections.abc import Callable

from ...errors import RosError
from .. import bus

CLOCK = "/clock"
_LAST_WORD = 0.5  # s, for messages under way when a process ends
_logger = logging.getLogger("tactile_skin")


class Process:
    """A process on ROS 2.

    Args:
        words: of the command line, for ROS itself.

    Attributes:
        failed: rclpy itself has raised, or does not show what is there: nothing arrives.
        publishers: rclpy's, whose last messages are waited for.

    Raises:
        RosError: ROS does not understand the words, or rclpy is not installed.
    """

    def __init__(self, words: list[str]):
        if not (sys.modules.get("rclpy") or importlib.util.find_spec("rclpy")):
            raise RosError("rclpy (ROS 2) is not installed: see docs/robot.md")
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        args = ["--ros-args", *words] if words else []
        self._context = rclpy.Context()  # of its own: who composes may have the default one
        no_signals = SignalHandlerOptions.NO  # launch.Skin handles them: it publishes a final stop
        try:
            rclpy.init(args=args, context=self._context, signal_handler_options=no_signals)
        except Exception as error:  # of a type that rclpy does not export
            raise RosError(f"--ros-args {' '.join(words)}: {error}") from error
        self.failed, self._closing = False, False
        self.publishers: list = []
        self._executor = SingleThreadedExecutor(context=self._context)
        self._ended: Callable = lambda: None
        self._simulated = None  # the clock of all nodes, once one hears /clock: once is enough
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    def node(self, name: str, namespace: str, parameters: list[bus.Parameter]) -> tuple:
        """Return a node of rclpy, and its clock."""
        import rclpy
        from rclpy.parameter import Parameter

        given = [Parameter(p.name, value=p.value) for p in parameters]
        made = rclpy.create_node(
            name, context=self._context, namespace=namespace, parameter_overrides=given
        )
        self._executor.add_node(made)
        if not made.get_clock().ros_time_is_active:
            return made, made.get_clock()
        if self._simulated:  # one hears for all
            for heard in [s for s in made.subscriptions if s.topic_name == CLOCK]:
                made.destroy_subscription(heard)
        self._simulated = self._simulated or made.get_clock()
        return made, self._simulated

    @staticmethod
    def steady():
        """Return a clock for what must not stand still with a simulation's."""
        from rclpy.clock import Clock
        from rclpy.clock_type import ClockType

        return Clock(clock_type=ClockType.STEADY_TIME)

    def start(self, ended: Callable) -> None:
        """Let messages arrive; `ended` is called when none does any more."""
        self._ended = ended
        self._thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self._executor.spin()
        except ExternalShutdownException:  # `close`
            pass
        except Exception:  # Jazzy's raises one of its own if it is closed while it begins to wait
            if not self._closing:
                self.failed = True
                _logger.exception("rclpy's executor has ended")
        self._ended()

    def give_up(self, why: str) -> None:
        """End, as failed: only another start of this process helps."""
        self.failed = True
        _logger.error(why)
        self._ended()

    def close(self) -> None:
        """Leave ROS once the last messages have arrived, or nobody takes them."""
        import rclpy
        from rclpy.duration import Duration

        self._closing = True
        end = time.monotonic() + _LAST_WORD
        for publisher in self.publishers:
            publisher.wait_for_all_acked(Duration(seconds=max(0.001, end - time.monotonic())))
        # The thread must have left rclpy before Python ends: killed inside C++ code, it would abort
        # the process. Without its context it leaves by itself.
        rclpy.try_shutdown(context=self._context)
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_LAST_WORD)
        self._executor.shutdown(timeout_sec=_LAST_WORD)
