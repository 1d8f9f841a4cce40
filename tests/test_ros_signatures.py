# SPDX-License-Identifier: Apache-2.0
"""Every call of rclpy fits the signatures that ROS 2 Humble, the oldest that is meant, documents.

CI runs the same calls on Kilted (tests/test_ros.py). Source: docs.ros.org/en/humble/p/rclpy and
rclpy's changelog: signal_handler_options and wait_for_all_acked came with 3.1; Humble has 3.3.
"""

import ast
import inspect
from pathlib import Path

import pytest

from tactile_skin.middleware.ros import node

# fmt: off
DOCUMENTED = {
    # rclpy
    "Context": lambda: 0,
    "init": lambda *, args=None, context=None, domain_id=None, signal_handler_options=None: 0,
    "create_node": lambda node_name, *, context=None, cli_args=None, namespace=None,
        use_global_arguments=True, enable_rosout=True, start_parameter_services=True,
        parameter_overrides=None, allow_undeclared_parameters=False,
        automatically_declare_parameters_from_overrides=False: 0,
    "try_shutdown": lambda *, context=None, uninstall_handlers=None: 0,
    # rclpy.node.Node
    "create_publisher": lambda msg_type, topic, qos_profile, *, callback_group=None,
        event_callbacks=None, qos_overriding_options=None, publisher_class=None: 0,
    "create_subscription": lambda msg_type, topic, callback, qos_profile, *, callback_group=None,
        event_callbacks=None, qos_overriding_options=None, raw=False: 0,
    "create_service": lambda srv_type, srv_name, callback, *, qos_profile=None,
        callback_group=None: 0,
    "declare_parameter": lambda name, value=None, descriptor=None, ignore_override=False: 0,
    "get_clock": lambda: 0,
    "create_timer": lambda timer_period_sec, callback, callback_group=None, clock=None: 0,
    "add_on_set_parameters_callback": lambda callback: 0,
    "count_publishers": lambda topic_name: 0,
    "get_node_names_and_namespaces": lambda: 0,
    "destroy_subscription": lambda subscription: 0,
    "get_publishers_info_by_topic": lambda topic_name, no_mangle=False: 0,
    "get_subscriptions_info_by_topic": lambda topic_name, no_mangle=False: 0,
    # rclpy.parameter, rclpy.qos_overriding_options, rclpy.clock
    "Parameter": lambda name, type_=None, value=None: 0,
    "Clock": lambda *, clock_type=None: 0,
    "with_default_policies": lambda *, callback=None, entity_id=None: 0,
    "now": lambda: 0,
    # rclpy.publisher.Publisher, rclpy.executors.SingleThreadedExecutor
    "wait_for_all_acked": lambda timeout=None: 0,
    "publish": lambda msg: 0,
    "get_subscription_count": lambda: 0,
    "SingleThreadedExecutor": lambda *, context=None: 0,
    "add_node": lambda node: 0,
    "get_nodes": lambda: 0,
    "spin": lambda: 0,
    "shutdown": lambda timeout_sec=None: 0,
    # rclpy.logging, rclpy.context, rclpy.callback_groups
    "get_logger": lambda name=None: 0,
    "log": lambda message, severity, name=None, **kwargs: 0,
    "ok": lambda: 0,
    "MutuallyExclusiveCallbackGroup": lambda: 0,
    "beginning_execution": lambda entity: 0,
    # rclpy.qos, rclpy.duration
    "QoSProfile": lambda *, history=None, depth=None, reliability=None, durability=None,
        lifespan=None, deadline=None, liveliness=None, liveliness_lease_duration=None,
        avoid_ros_namespace_conventions=None: 0,
    "Duration": lambda *, seconds=0, nanoseconds=0: 0,
    # rcl_interfaces.msg: a field each
    "ParameterDescriptor": lambda *, name="", type=0, description="", additional_constraints="",
        read_only=False, dynamic_typing=False, floating_point_range=(), integer_range=(): 0,
    "FloatingPointRange": lambda *, from_value=0.0, to_value=0.0, step=0.0: 0,
    "SetParametersResult": lambda *, successful=False, reason="": 0,
    "IntegerRange": lambda *, from_value=0, to_value=0, step=0: 0,
}
# fmt: on
# of what is called: rclpy's modules and objects, as the code names them
THEIRS = {"rclpy", "rcl", "self.ros", "self.context", "self._executor", "self._theirs"}
THEIRS |= {"publisher", "group", "node", "clock"}


def calls() -> list[ast.Call]:
    """What the package calls of rclpy."""
    found = []
    for call in ast.walk(ast.parse(Path(node.__file__).read_text())):
        if isinstance(call, ast.Call):
            owner = ast.unparse(call.func).rpartition(".")[0]
            if owner in THEIRS or owner.startswith("rclpy."):
                found.append(call)
    return found


def name_of(call: ast.Call) -> str:
    return ast.unparse(call.func).rpartition(".")[2]


def test_the_calls_are_found():
    assert len({name_of(call) for call in calls()}) >= 25


@pytest.mark.parametrize("call", calls(), ids=lambda c: f"{name_of(c)}_{c.lineno}")
def test_a_call_fits_what_is_documented(call):
    named = {k.arg: None for k in call.keywords if k.arg}
    documented = inspect.signature(DOCUMENTED[name_of(call)])
    complete = len(named) == len(call.keywords)  # there is no ** among them
    (documented.bind if complete else documented.bind_partial)(*call.args, **named)
