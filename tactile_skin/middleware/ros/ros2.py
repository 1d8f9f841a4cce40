"""Topics, services and parameters of a process's nodes by rclpy."""

from __future__ import annotations

import importlib.util
import logging
import sys
import threading
import time
from collections.abc import Callable

from ...errors import RosError
from .. import bus

LAST_WORD = 0.5  # s, for messages under way when a process ends
_COMPARE = 2.0  # s, between two looks at what others publish and subscribe to
_logger = logging.getLogger("tactile_skin")


def check_installed() -> None:
    """Raise RosError where rclpy is not installed."""
    if not (sys.modules.get("rclpy") or importlib.util.find_spec("rclpy")):
        raise RosError("rclpy (ROS 2) is not installed: see docs/robot.md")


class Ros2:
    """A process on ROS 2: its nodes share one thread for what arrives.

    Attributes:
        failed: rclpy itself has raised: nothing arrives any more.
    """

    def __init__(self, name: str, namespace: str, words: list[str]):
        """
        Args:
            words: of the command line, for ROS itself.

        Raises:
            RosError: ROS does not understand them, or rclpy is not installed.
        """
        check_installed()
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        args = ["--ros-args", *words] if words else []
        try:  # launch.Skin handles signals: a final stop is published first
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # of a type that rclpy does not export
            raise RosError(f"--ros-args {' '.join(words)}: {error}") from error
        self._executor = SingleThreadedExecutor()
        self._nodes: list[Ros2Node] = []
        self.failed = False
        self._ended: Callable = lambda: None
        self._simulated: Ros2Node | None = None  # whose clock is that of all
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)

    def node(self, name: str, namespace: str, parameters: list[bus.Parameter]) -> Ros2Node:
        made = Ros2Node(name, namespace, parameters, self._simulated)
        if self._simulated is None and made.simulated:
            self._simulated = made
        self._executor.add_node(made.node)
        self._nodes.append(made)
        return made

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
        except Exception:
            self.failed = True
            _logger.exception("rclpy's executor has ended")
        self._ended()

    def close(self) -> None:
        """Leave ROS once the last messages have arrived, or nobody takes them."""
        import rclpy

        end = time.monotonic() + LAST_WORD
        for node in self._nodes:
            node.wait_until_heard(end)
        # The thread must have left rclpy before Python ends: killed inside C++ code, it would abort
        # the process. Without its context it leaves by itself.
        rclpy.try_shutdown()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(LAST_WORD)
        self._executor.shutdown(timeout_sec=LAST_WORD)


class Ros2Node:
    """Topics, services and parameters of one node by rclpy.

    Args:
        simulated: another node of the process that hears /clock: once is enough.
    """

    def __init__(
        self,
        name: str,
        namespace: str,
        parameters: list[bus.Parameter],
        simulated: Ros2Node | None = None,
    ):
        import rclpy
        from rclpy.parameter import Parameter

        if simulated:
            parameters = [p for p in parameters if p.name != "use_sim_time"]
        given = [Parameter(p.name, value=p.value) for p in parameters]
        self.node = rclpy.create_node(name, namespace=namespace, parameter_overrides=given)
        self._clock = (simulated or self).node.get_clock()
        self._publishers: list = []
        self._kinds: dict[str, type] = {}  # topic -> what this node takes it to be
        self._told: set[tuple[str, str]] = set()
        self.node.create_timer(_COMPARE, _isolated("the graph", self.compare_types))

    @property
    def simulated(self) -> bool:
        """Whether /clock tells the time."""
        return self._clock.ros_time_is_active

    def now(self) -> int:
        """Time of day, or what /clock says [ns]."""
        return self._clock.now().nanoseconds

    def advertise(self, kind: type, topic: str, qos: bus.QoSProfile) -> tuple[Callable, Callable]:
        """What sends a message, and what counts the subscribers."""
        from rclpy.qos_overriding_options import QoSOverridingOptions

        publisher = self.node.create_publisher(
            kind,
            topic,
            self._qos(qos),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._publishers.append(publisher)
        self._kinds[topic] = kind
        return publisher.publish, publisher.get_subscription_count

    def subscribe(self, kind: type, topic: str, callback, qos: bus.QoSProfile) -> None:
        taken = _isolated(f"a message on {topic}", callback)
        self.node.create_subscription(kind, topic, taken, self._qos(qos))
        self._kinds[topic] = kind

    def serve(self, kind: type, name: str, answer) -> None:
        self.node.create_service(kind, name, answer)

    @staticmethod
    def _qos(qos: bus.QoSProfile):
        from rclpy.qos import DurabilityPolicy, QoSProfile

        return QoSProfile(depth=qos.depth, durability=DurabilityPolicy[qos.durability.name])

    def declare(self, name: str, value, descriptor: bus.ParameterDescriptor) -> None:
        """Show a parameter to `ros2 param`."""
        from rcl_interfaces import msg as rcl

        described = rcl.ParameterDescriptor(
            description=descriptor.description,
            read_only=descriptor.read_only,
            dynamic_typing=descriptor.dynamic_typing,
        )
        for bounds in descriptor.floating_point_range:
            described.floating_point_range.append(
                rcl.FloatingPointRange(from_value=bounds.from_value, to_value=bounds.to_value)
            )
        for whole in descriptor.integer_range:
            described.integer_range.append(
                rcl.IntegerRange(from_value=whole.from_value, to_value=whole.to_value)
            )
        self.node.declare_parameter(name, value, described, ignore_override=True)

    def on_set(self, take: Callable[[list[bus.Parameter]], str]) -> None:
        """Let `ros2 param set` change parameters; `take` returns why not, or nothing."""
        from rcl_interfaces import msg as rcl

        def taken(parameters):
            reason = take([bus.Parameter(p.name, p.value) for p in parameters])
            return rcl.SetParametersResult(successful=not reason, reason=reason)

        self.node.add_on_set_parameters_callback(taken)

    def compare_types(self) -> None:
        """Warn of others who use a topic of this node for another type: DDS connects them not."""
        for topic, kind in self._kinds.items():
            ours = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            for end in (
                *self.node.get_publishers_info_by_topic(topic),
                *self.node.get_subscriptions_info_by_topic(topic),
            ):
                other = topic, end.node_name
                if end.topic_type not in ("", ours) and other not in self._told:
                    self._told.add(other)
                    self.log(
                        logging.WARNING,
                        f"{topic}: {end.node_name} has {end.topic_type}, this node {ours}: "
                        f"they do not hear each other{_remedy(ours, end.topic_type)}",
                    )

    def log(self, level: int, text: str) -> None:
        logger = self.node.get_logger()
        if level >= logging.ERROR:  # a line for each: rclpy wants one severity per line
            logger.error(text)
        elif level >= logging.WARNING:
            logger.warning(text)
        elif level >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)

    def wait_until_heard(self, end: float) -> None:
        """Until the last messages have arrived, or a monotonic time [s]."""
        from rclpy.duration import Duration

        for publisher in self._publishers:
            left = max(0.001, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=left))


def _remedy(ours: str, theirs: str) -> str:
    if {ours, theirs} == {"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"}:
        return f": set stamped to {str(theirs.endswith('Stamped')).lower()}"
    return ""


def _isolated(what: str, callback: Callable) -> Callable:
    """A callback whose exceptions are logged: one would end rclpy's executor."""

    def call(*arguments) -> None:
        try:
            callback(*arguments)
        except Exception:
            _logger.exception("%s was not taken", what)

    return call
