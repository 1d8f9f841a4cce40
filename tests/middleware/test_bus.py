# SPDX-License-Identifier: Apache-2.0
"""The bus behaves as rclpy does, and never lets one callback harm another."""

import dataclasses
import inspect
import logging
import threading

import pytest
from support.bench import Bench
from support.patience import PATIENCE, Hang

from tactile_skin.errors import ParameterError
from tactile_skin.fields import About
from tactile_skin.middleware.bus import (
    Context,
    DurabilityPolicy,
    MultiThreadedExecutor,
    Node,
    Parameter,
    QoSProfile,
    Time,
)
from tactile_skin.msg import Bool, Float32, Trigger

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def threads():
    """An executor with a thread per node, ended after the test."""
    executor = MultiThreadedExecutor()
    yield executor
    assert executor.shutdown(PATIENCE)


def values(messages) -> list:
    return [m.data for m in messages]


# --- signatures ---

RCLPY = {  # positional parameters by name, as rclpy documents them for Humble
    "create_publisher": ["msg_type", "topic", "qos_profile"],
    "create_subscription": ["msg_type", "topic", "callback", "qos_profile"],
    "create_timer": ["timer_period_sec", "callback"],
    "create_service": ["srv_type", "srv_name", "callback"],
    "create_client": ["srv_type", "srv_name"],
    "declare_parameter": ["name", "value", "descriptor"],
    "get_parameter": ["name"],
    "get_name": [],
    "get_namespace": [],
    "get_fully_qualified_name": [],
    "resolve_topic_name": ["topic"],
    "get_logger": [],
    "get_clock": [],
    "destroy_node": [],
}


@pytest.mark.parametrize("method", RCLPY)
def test_signature_is_rclpys(method):
    parameters = list(inspect.signature(getattr(Node, method)).parameters)
    assert parameters == ["self", *RCLPY[method]]


# --- topics ---


def test_a_message_reaches_every_subscriber_once(bench):
    first, second = [], []
    bench.node("a").create_subscription(Float32, "t", first.append, 10)
    bench.node("b").create_subscription(Float32, "t", second.append, 10)
    publisher = bench.node("c").create_publisher(Float32, "t", 10)
    assert publisher.get_subscription_count() == 2
    message = Float32(1.0)
    publisher.publish(message)
    bench.spin()
    assert first == second == [message]
    bench.spin()
    assert len(first) == 1


def test_spin_some_runs_what_callbacks_bring_about(bench):
    """A chain of nodes is through after one call, whatever their order."""
    seen = []
    last, first = bench.node("last"), bench.node("first")
    last.create_subscription(Float32, "b", seen.append, 10)
    forward = first.create_publisher(Float32, "b", 10)
    first.create_subscription(Float32, "a", forward.publish, 10)
    last.create_publisher(Float32, "a", 10).publish(Float32(3.0))
    bench.spin()
    assert values(seen) == [3.0]


def test_contexts_do_not_see_each_other():
    seen, here, there = [], Bench(), Bench()
    here.node().create_subscription(Float32, "t", seen.append, 10)
    there.node().create_publisher(Float32, "t", 10).publish(Float32())
    here.spin()
    assert seen == []


def test_two_types_on_one_topic_are_refused(bench):
    node = bench.node()
    node.create_publisher(Float32, "t", 10)
    with pytest.raises(TypeError, match=r"topic /t carries std_msgs/msg/Float32, not .*Bool"):
        node.create_subscription(Bool, "t", print, 10)
    with pytest.raises(TypeError, match="/t"):
        node.create_publisher(Bool, "t", 10)


def test_a_message_of_another_type_is_refused(bench):
    publisher = bench.node().create_publisher(Float32, "t", 10)
    for wrong in (Bool(True), 1.0, Float32):
        with pytest.raises(TypeError, match="topic /t carries std_msgs/msg/Float32"):
            publisher.publish(wrong)


@pytest.mark.parametrize("name", ["", "t/", "two words"])
def test_what_is_no_topic_name_is_refused(bench, name):
    with pytest.raises(ValueError, match="is not a topic or service name"):
        bench.node().create_publisher(Float32, name, 10)


def test_a_full_queue_drops_the_oldest_and_counts(bench):
    seen, node = [], bench.node()
    subscription = node.create_subscription(Float32, "t", seen.append, QoSProfile(depth=3))
    publisher = node.create_publisher(Float32, "t", 10)
    for k in range(8):
        publisher.publish(Float32(k))
    bench.spin()
    assert values(seen) == [5, 6, 7]
    assert subscription.dropped == 5


def test_a_full_queue_keeps_its_turn(bench):
    """A topic that is published faster than it is read would else never come before others."""
    seen, node = [], bench.node()
    for name, depth in (("a", 2), ("b", 10)):
        node.create_subscription(Float32, name, lambda m, n=name: seen.append((n, m.data)), depth)
    publishers = {name: node.create_publisher(Float32, name, 10) for name in "ab"}
    for k, name in enumerate("abaab"):
        publishers[name].publish(Float32(k))
    bench.spin()
    assert seen == [("a", 2), ("b", 1), ("a", 3), ("b", 4)]


def test_a_queue_without_room_is_refused():
    with pytest.raises(ValueError, match="depth = 0"):
        QoSProfile(depth=0)


# --- latched topics ---


def test_a_late_subscriber_gets_what_was_kept(bench):
    """The last `depth` messages, and after them the new ones."""
    kept = dataclasses.replace(LATCHED, depth=2)
    seen, publisher = [], bench.node("a").create_publisher(Float32, "t", kept)
    for k in range(4):
        publisher.publish(Float32(k))
    late = bench.node("late")
    late.create_subscription(Float32, "t", seen.append, dataclasses.replace(LATCHED, depth=10))
    publisher.publish(Float32(4))
    bench.spin()
    assert values(seen) == [2, 3, 4]


@pytest.mark.parametrize(("offered", "asked"), [(LATCHED, 1), (1, LATCHED)])
def test_nothing_is_kept_unless_both_sides_ask(bench, offered, asked):
    seen, publisher = [], bench.node("a").create_publisher(Float32, "t", offered)
    publisher.publish(Float32(1.0))
    bench.node("late").create_subscription(Float32, "t", seen.append, asked)
    bench.spin()
    assert seen == []


# --- names ---


@pytest.mark.parametrize(
    ("namespace", "topic", "full"),
    [
        ("", "skin/adc", "/skin/adc"),
        ("left", "skin/adc", "/left/skin/adc"),
        ("/left/", "skin/adc", "/left/skin/adc"),
        ("/left/arm", "skin/adc", "/left/arm/skin/adc"),
        ("left", "/skin/adc", "/skin/adc"),
        ("", "~/adc", "/driver/adc"),
        ("left", "~/adc", "/left/driver/adc"),
    ],
)
def test_names_are_resolved_as_in_ros(bench, namespace, topic, full):
    node = bench.node("driver", namespace=namespace)
    assert node.resolve_topic_name(topic) == full
    assert node.create_publisher(Float32, topic, 1).topic_name == full


def test_remapping(bench):
    """Of relative, absolute and private names, of topics and services; the first rule counts."""
    node = bench.node(
        "driver",
        namespace="left",
        remappings=[("adc", "raw"), ("~/x", "/y"), ("/a", "b"), ("/a", "not")],
    )
    assert node.resolve_topic_name("adc") == "/left/raw"
    assert node.resolve_topic_name("/left/adc") == "/left/raw"
    assert node.resolve_topic_name("~/x") == "/y"
    assert node.resolve_topic_name("/a") == "/left/b"
    assert node.resolve_topic_name("other") == "/left/other"
    assert node.create_service(Trigger, "adc", print).srv_name == "/left/raw"


# --- timers ---


def test_a_timer_keeps_its_beat(bench):
    """Its calls do not drift, however late each came."""
    times, start = [], bench.clock.now().nanoseconds
    bench.node().create_timer(0.1, lambda: times.append(bench.clock.now().nanoseconds - start))
    for _ in range(400):
        bench.spin(0.007)  # 2.8 s
    assert len(times) == 28
    lateness = [t - 100_000_000 * (k + 1) for k, t in enumerate(times)]
    assert min(lateness) >= 0
    assert max(lateness) < 7_000_000


def test_missed_ticks_are_skipped(bench):
    calls = []
    bench.node().create_timer(0.1, lambda: calls.append(bench.clock.now().nanoseconds))
    bench.spin(1.05)
    assert len(calls) == 1
    bench.spin(0.04)
    assert len(calls) == 1
    bench.spin(0.02)  # the beat of 0.1 s is kept: the next is due at 1.1 s
    assert len(calls) == 2


def test_a_cancelled_timer_is_silent_until_reset(bench):
    calls = []
    timer = bench.node().create_timer(0.1, lambda: calls.append(1))
    timer.cancel()
    bench.spin(1.0)
    assert calls == []
    timer.reset()
    bench.spin(0.09)
    assert calls == []
    bench.spin(0.01)
    assert calls == [1]


@pytest.mark.parametrize("period", [0, -1.0, float("nan")])
def test_a_period_must_be_above_zero(bench, period):
    with pytest.raises(ValueError, match="timer_period_sec"):
        bench.node().create_timer(period, print)


def slow_timer(bench, node, calls, until=100):
    """A timer of 10 ms whose callback takes 15 ms, so that it is always due; it ends itself."""

    def slow():
        calls.append("timer")
        bench.clock.advance(0.015)
        if calls.count("timer") == until:
            timer.cancel()

    timer = node.create_timer(0.01, slow)
    bench.clock.advance(0.01)


@pytest.mark.parametrize("stages", [1, 2])
def test_a_slow_timer_and_messages_take_turns(bench, stages):
    """In one node, and in two that share a thread, the later one's timer first."""
    calls, done, executor = [], threading.Event(), MultiThreadedExecutor()
    first = Node("first", context=bench.context)
    later = Node("later", context=bench.context) if stages == 2 else first
    publisher = first.create_publisher(Float32, "t", 10)

    def on_message(message):
        calls.append("message")
        if message.data == 99:
            done.set()

    first.create_subscription(Float32, "t", on_message, 100)
    slow_timer(bench, later, calls, until=1000)
    for k in range(100):
        publisher.publish(Float32(k))
    executor.add_node(*([first] if stages == 1 else [first, later]))
    try:
        assert done.wait(PATIENCE)
    finally:
        assert executor.shutdown(PATIENCE)
    assert calls[:200] == ["timer", "message"] * 100


def test_slow_timers_take_turns_among_themselves(bench):
    """Which has waited longest comes first, also of nodes that share a thread."""
    calls, done, executor = [], threading.Event(), MultiThreadedExecutor()
    nodes = [Node(name, context=bench.context) for name in ("first", "later")]

    def slow(name):
        calls.append(name)
        bench.clock.advance(0.025)
        if len(calls) == 100:
            done.set()

    for k in range(4):
        nodes[k % 2].create_timer(0.01, lambda k=k: slow(k))
    executor.add_node(*nodes)
    bench.clock.advance(0.01)
    nodes[0]._wake.set()
    try:
        assert done.wait(PATIENCE)
    finally:
        assert executor.shutdown(PATIENCE)
    assert all(len(set(calls[k : k + 4])) == 4 for k in range(0, 100, 4))


# --- services ---


def answer(request, response):
    response.success, response.message = True, "done"
    return response


def counting():
    """What was asked, and a service that notes it."""
    asked = []
    return asked, lambda request, response: asked.append(1) or response


def test_a_service_answers(bench):
    bench.node("server").create_service(Trigger, "reset", answer)
    client = bench.node("client").create_client(Trigger, "reset")
    future = client.call_async(Trigger.Request())
    assert not future.done()
    bench.spin()
    assert future.result(0) == Trigger.Response(True, "done")


def test_the_asker_gets_the_servers_exception(bench):
    def fail(request, response):
        raise RuntimeError("no such luck")

    server = bench.node("server")
    server.create_service(Trigger, "reset", fail)
    future = bench.node("client").create_client(Trigger, "reset").call_async(Trigger.Request())
    bench.spin()
    with pytest.raises(RuntimeError, match="no such luck"):
        future.result(0)
    assert server.callback_errors == 1


def test_a_service_that_nobody_offers_is_an_error(bench):
    client = bench.node().create_client(Trigger, "reset")
    with pytest.raises(RuntimeError, match="service /reset is not offered"):
        client.call_async(Trigger.Request())


def test_a_service_is_offered_once(bench):
    bench.node("a").create_service(Trigger, "reset", answer)
    with pytest.raises(ValueError, match="service /reset is offered already"):
        bench.node("b").create_service(Trigger, "reset", answer)


def test_the_asker_hears_that_the_server_went(bench):
    server = bench.node("server")
    server.create_service(Trigger, "reset", answer)
    client = bench.node("client").create_client(Trigger, "reset")
    future, given_up = (client.call_async(Trigger.Request()) for _ in range(2))
    given_up.cancel()
    for _ in range(2):
        server.destroy_node()
    with pytest.raises(RuntimeError, match="its node is gone"):
        future.result(0)
    with pytest.raises(RuntimeError, match="its node is gone"):
        server.ask(print)


def test_a_server_that_hangs_collects_no_requests(bench):
    """What is refused is said at once; those in the queue are carried out, once each."""
    asked, count = counting()
    bench.node("server").create_service(Trigger, "reset", count)
    client = bench.node("client").create_client(Trigger, "reset")
    futures = [client.call_async(Trigger.Request()) for _ in range(10)]
    for _ in range(5):
        with pytest.raises(RuntimeError, match="service /reset: 10 requests wait"):
            client.call_async(Trigger.Request())
    bench.spin()
    assert len(asked) == 10 and all(future.done() for future in futures)


def test_requests_that_were_withdrawn_take_no_place(bench):
    """Nor does any of them, later, keep the others or messages from being heard."""
    (asked, count), seen, server = counting(), [], bench.node("server")
    server.create_service(Trigger, "reset", count)
    server.create_subscription(Float32, "t", seen.append, 10)
    client = bench.node("client").create_client(Trigger, "reset")
    server.create_publisher(Float32, "t", 10).publish(Float32(1.0))
    kept = client.call_async(Trigger.Request())
    for _ in range(50):
        client.call_async(Trigger.Request()).cancel()
    last = client.call_async(Trigger.Request())
    server.create_publisher(Float32, "t", 10).publish(Float32(2.0))
    bench.spin()
    assert kept.done() and last.done()
    assert (len(asked), values(seen)) == (2, [1.0, 2.0])
    assert server._idle()


# --- parameters ---


def declared(value, default, **about):
    node = Node("driver", context=Context(), parameter_overrides=[Parameter("p", value)])
    return node.declare_parameter("p", default, About("", "", **about)).value


@pytest.mark.parametrize(
    ("value", "default"),
    [(True, False), (3, 1), ("x", ""), ([1.0], []), (["a"], ["b"]), (3, 1.0), ([1, 2.5], [0.0])],
)
def test_a_value_of_the_defaults_type_is_taken(value, default):
    """In YAML, 3 is an integer: a float where floats are wanted."""
    taken = declared(value, default)
    assert taken == value
    first, wanted = (v[0] if isinstance(v, list) and v else v for v in (taken, default))
    assert wanted == [] or type(first) is type(wanted)


@pytest.mark.parametrize(
    ("value", "default"),
    [(1.5, 1), (True, 1), (1, True), ("1", 1), (None, ""), (1.0, [1.0]), (["a"], [1.0])],
)
def test_a_value_of_another_type_is_refused_by_name(value, default):
    with pytest.raises(ParameterError, match=r"parameter p of node driver = .*: must be"):
        declared(value, default)


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), float("inf"), [0.5, 2.0]])
def test_values_outside_the_range_are_refused(value):
    default = [0.5] if isinstance(value, list) else 0.5
    assert declared([0.0, 1.0], [0.5], low=0.0, high=1.0) == [0.0, 1.0]
    with pytest.raises(
        ParameterError, match=r"p of node driver = .*: must be (finite|from 0\.0 to 1\.0)"
    ):
        declared(value, default, low=0.0, high=1.0)


def test_undeclared_parameters_are_errors_and_listed():
    overrides = [Parameter("treshold", 1.0), Parameter("release", 1.0)]
    node = Node("driver", context=Context(), parameter_overrides=overrides)
    node.declare_parameter("threshold", 5.0)
    node.declare_parameter("release", 2.0)
    assert node.undeclared() == ["treshold"]
    assert node.parameter_names() == ["release", "threshold"]
    with pytest.raises(ParameterError, match="treshold of node driver is not declared"):
        node.get_parameter("treshold")
    with pytest.raises(ParameterError, match="release of node driver is declared twice"):
        node.declare_parameter("release", 2.0)


# --- exceptions ---


class Unhashable:
    """A callback that is an object, of a kind that no dict takes as key."""

    __hash__ = None

    def __call__(self, message):
        raise ValueError("bad")


def raising(message):
    raise ValueError("bad")


@pytest.mark.parametrize("callback", [raising, Unhashable(), lambda: None])
def test_a_raising_callback_harms_no_other(bench, callback):
    """Wrong number of arguments included; its own next message is delivered again."""
    seen, node = [], bench.node()
    node.create_subscription(Float32, "t", callback, 10)
    node.create_subscription(Float32, "t", seen.append, 10)
    publisher = node.create_publisher(Float32, "t", 10)
    for k in range(3):
        publisher.publish(Float32(k))
    bench.spin()
    assert values(seen) == [0, 1, 2]
    assert node.callback_errors == 3


def test_a_raising_callback_is_logged_once(bench, caplog):
    """In full at first; then one line in 5 s, with the count."""
    caplog.set_level(logging.ERROR, "tactile_skin.driver")
    node = bench.node("driver")
    node.create_subscription(Float32, "t", raising, 10)
    publisher = node.create_publisher(Float32, "t", 10)
    for _ in range(4):
        publisher.publish(Float32())
        bench.spin(1.0)
    (record,) = caplog.records
    assert "raising raised" in record.getMessage()
    assert record.exc_info[0] is ValueError
    for _ in range(2):
        publisher.publish(Float32())
        bench.spin(1.5)
    assert [r.getMessage() for r in caplog.records[1:]] == [
        "callback raising raised 6 times: ValueError('bad')"
    ]


# --- clocks ---


def test_time_to_message_and_back():
    time = Time(12 * 10**9 + 34)
    assert (time.to_msg().sec, time.to_msg().nanosec) == (12, 34)
    assert Time.from_msg(time.to_msg()) == time


# --- executors and shutdown ---


def test_a_hanging_subscriber_delays_nobody(threads):
    """Its own queue drops; another node gets every message while it hangs."""
    context, hang, all_seen, done = Context(), Hang(), [], threading.Event()

    def see(message):
        all_seen.append(message.data)
        if message.data == 99:
            done.set()

    slow, quick = Node("slow", context=context), Node("quick", context=context)
    subscription = slow.create_subscription(Float32, "t", hang, 5)
    quick.create_subscription(Float32, "t", see, 200)
    publisher = Node("source", context=context).create_publisher(Float32, "t", 10)
    threads.add_node(slow)
    threads.add_node(quick)
    publisher.publish(Float32(-1))
    hang.has_begun()
    for k in range(100):
        publisher.publish(Float32(k))
    assert done.wait(PATIENCE)
    assert all_seen == [-1, *range(100)]
    assert subscription.dropped == 95
    hang.release()


def test_callbacks_of_one_node_never_overlap(threads):
    context, node_threads, done = Context(), set(), threading.Event()
    node = Node("n", context=context)
    inside = []

    def callback(message):
        inside.append("in")
        node_threads.add(threading.current_thread().name)
        assert inside == ["in"]
        inside.clear()
        if message.data == 49:
            done.set()

    node.create_subscription(Float32, "a", callback, 100)
    node.create_subscription(Float32, "b", callback, 100)
    threads.add_node(node)
    publishers = [node.create_publisher(Float32, t, 10) for t in "ab"]
    for k in range(50):
        for publisher in publishers:
            publisher.publish(Float32(k))
    assert done.wait(PATIENCE)
    threads.drain(PATIENCE)
    assert node.callback_errors == 0
    assert node_threads == {"node n"}


def test_timers_run_in_threads_too(threads):
    called = threading.Event()
    node = Node("n", context=Context())
    threads.add_node(node)
    node.create_timer(0.001, called.set)  # after the thread began to wait
    assert called.wait(PATIENCE)


def test_shutdown_says_when_a_callback_hangs():
    hang, node, executor = Hang(), Node("n", context=Context()), MultiThreadedExecutor()
    node.create_subscription(Float32, "t", hang, 10)
    executor.add_node(node)
    node.create_publisher(Float32, "t", 10).publish(Float32())
    hang.has_begun()
    assert executor.shutdown(0.01) is False
    hang.release()
    assert executor.shutdown(PATIENCE) is True


def test_a_destroyed_node_is_gone(bench):
    """No callback, no kept message, no service of it is left; its queue is not run any more."""
    seen, node, other = [], bench.node("gone"), bench.node("other")
    node.create_subscription(Float32, "t", seen.append, 10)
    node.create_timer(0.1, lambda: seen.append("timer"))
    node.create_service(Trigger, "reset", answer)
    node.create_publisher(Float32, "kept", LATCHED).publish(Float32())
    publisher = other.create_publisher(Float32, "t", 10)
    publisher.publish(Float32())
    node.destroy_node()
    assert publisher.get_subscription_count() == 0
    other.create_subscription(Float32, "kept", seen.append, LATCHED)
    publisher.publish(Float32())
    bench.spin(1.0)
    assert seen == []
    other.create_service(Trigger, "reset", answer)  # the name is free again
    node.destroy_node()  # twice does no harm


def test_nodes_share_a_context_unless_given_one():
    """As in rclpy, where nodes of one process see each other."""
    a, b = Node("a"), Node("b")
    assert a.context is b.context


# --- what watches ---


def test_topics_are_listed_with_their_types(bench):
    node = bench.node(namespace="left")
    node.create_publisher(Bool, "a", 1)
    node.create_subscription(Float32, "/b", print, 1)
    assert sorted(node.get_topic_names_and_types()) == [
        ("/b", ["std_msgs/msg/Float32"]),
        ("/left/a", ["std_msgs/msg/Bool"]),
    ]


def test_a_listener_hears_at_once_and_what_was_latched(bench):
    """In the publisher's thread: nothing spins here."""
    publisher, heard = bench.node("a").create_publisher(Bool, "topic", LATCHED), []
    publisher.publish(Bool(True))
    watcher = bench.node("b")
    watcher.create_listener(Bool, "topic", heard.append)
    publisher.publish(Bool(False))
    assert values(heard) == [True, False]
    watcher.destroy_node()
    publisher.publish(Bool(True))
    assert len(heard) == 2


def test_a_listener_without_a_callback_keeps_the_newest_until_they_are_taken(bench):
    """And wakes nobody: nothing spins here."""
    publisher = bench.node("a").create_publisher(Bool, "topic", 10)
    listener = bench.node("b").create_listener(Bool, "topic", None, 2)
    for value in (True, True, False):
        publisher.publish(Bool(value))
    assert values(listener.take()) == [True, False]
    assert listener.take() == []


def test_a_listener_that_raises_is_counted_and_does_not_reach_the_publisher(bench, caplog):
    publisher, heard = bench.node("a").create_publisher(Bool, "topic", 1), []

    def broken(message):
        raise RuntimeError("broken")

    watcher = bench.node("b")
    watcher.create_listener(Bool, "topic", broken)
    bench.node("c").create_subscription(Bool, "topic", heard.append, 10)
    for _ in range(3):
        publisher.publish(Bool(True))
    bench.spin()
    assert len(heard) == watcher.callback_errors == 3
    assert "broken raised" in caplog.text
