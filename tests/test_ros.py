# SPDX-License-Identifier: Apache-2.0
"""The nodes on real ROS 2, each a process.

Tests of the mark `ros` skip where there is none; `--require-ros` makes that a failure.
"""

import dataclasses
import itertools
import logging
import os
import pkgutil
import queue
import random
import signal
import subprocess
import sys
import threading
import time
import types
import typing
from collections import defaultdict

import numpy as np
import pytest
from support.ros_graph import Graph, Player, endless, plan_of, record

import tactile_skin
from tactile_skin import __main__, msg, ros
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.middleware import bus
from tactile_skin.middleware.bus import (
    Context,
    ManualClock,
    Node,
    Parameter,
    SingleThreadedExecutor,
)
from tactile_skin.middleware.package import COMPOSED, NODES
from tactile_skin.middleware.plan import NodeAction, make_node
from tactile_skin.middleware.ros import messages
from tactile_skin.middleware.ros import node as ros_node
from tactile_skin.msg import (
    DiagnosticArray,
    Header,
    Image,
    PointCloud2,
    Vector3Stamped,
    WrenchStamped,
    image,
)
from tactile_skin.nodes import frames
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.touch.frames import IDENTITY

pytestmark = pytest.mark.live

MESSAGES = [c for c in vars(msg).values() if dataclasses.is_dataclass(c) and hasattr(c, "TYPE")]
IDLE, DEMO, PUSH = "idle", "demo", "push_left"
SEEDS = itertools.count(90)  # one each time something is played: frames that repeat are a fault
REST = PressureCurve()  # without a tare each cell has to rest as the curve says

# --- without ROS ---


def test_a_machine_without_ros_or_extras_imports_and_runs_everything_else(tmp_path):
    """Also where they are installed: here their modules cannot be imported."""
    pytest.importorskip("websockets")
    modules = [
        m.name
        for m in pkgutil.walk_packages(tactile_skin.__path__, "tactile_skin.")
        if "listen_" not in m.name and not m.name.rpartition(".")[2].startswith("_loops")
    ]
    assert "tactile_skin.ros" in modules
    code = f"""
import importlib, sys
for name in ("rclpy", "std_msgs", "sensor_msgs"):
    sys.modules[name] = None
class Missing:
    def find_spec(name, path=None, target=None):
        if name in ("torch", "threadpoolctl", "tqdm", "matplotlib"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing)
for name in {modules!r}:
    if name.split(".")[-1] not in ("training", "soap", "export", "chart"):
        importlib.import_module(name)
from tactile_skin.launch import launch
with launch(duration=0.3) as skin:
    skin.spin(60.0)
sys.exit(skin.failed)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "summary" in done.stdout


def test_a_node_without_ros_says_so(capsys, monkeypatch):
    monkeypatch.setattr(ros_node, "rclpy", None)
    assert ros.run("serial_driver", []) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("serial_driver: error: ")
    assert "rclpy (ROS 2) is not installed" in err


@pytest.mark.parametrize("name", [*NODES, COMPOSED])
def test_each_node_has_an_entry_point(name, capsys):
    with pytest.raises(SystemExit) as end:
        getattr(__main__, name)(["--help"])
    assert end.value.code == 0
    assert f"{name}: " in capsys.readouterr().out.replace("All nodes", "skin: All nodes")


def test_ros_arguments_are_split_from_the_programs_own():
    own, args = ros.split_arguments(
        ["--ros", "1", "--ros-args", "-r", "__node:=left", "-r", "__ns:=/arm", "--", "-h"]
    )
    assert own == ["--ros", "1", "-h"]
    assert (args.name_of("monitor"), args.namespace_of("monitor")) == ("left", "/arm")
    own, args = ros.split_arguments(["--ros-args", "-p", "a:=1", "--ros-args", "-p", "b:=2"])
    assert own == []
    assert args.parameters_of(None, "x") == [Parameter("a", 1), Parameter("b", 2)]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["-r", "from"], "'from'"),
        (["-r"], "-r"),
        (["-p", "=1"], "'=1'"),
        (["-p", ":a:=1"], "':a:=1'"),
        (["-p", "a:=[1"], "not valid YAML"),
        (["--params-file", "none.yaml"], "none.yaml"),
    ],
)
def test_a_ros_argument_that_is_not_understood_is_refused_by_name(words, named, capsys):
    assert ros.run("monitor", ["--ros-args", *words]) == 2
    assert named in capsys.readouterr().err


@pytest.fixture
def signals_stay():
    kept = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


# --- what a callback raises, on a stand-in for rclpy ---


class StandIn:
    """As much of rclpy as the package uses; what its executor calls is put into `work`."""

    def __init__(self, monkeypatch):
        self.work, self.subscriptions, self.services = queue.Queue(), {}, {}
        part = types.SimpleNamespace
        nothing = lambda *_, **__: None  # noqa: E731
        rclpy = part(
            Context=lambda: part(ok=lambda: True),
            init=nothing,
            create_node=lambda *_, **__: self,
            try_shutdown=lambda context: self.work.put(None),  # its executor ends
            executors=part(SingleThreadedExecutor=lambda context: self),
            callback_groups=part(MutuallyExclusiveCallbackGroup=nothing),
            signals=part(SignalHandlerOptions=part(NO=0)),
            clock=part(Clock=nothing),
            clock_type=part(ClockType=part(STEADY_TIME=0)),
            logging=part(get_logger=lambda name: logging.getLogger("rclpy")),
            qos=part(QoSProfile=nothing),
            qos_overriding_options=part(QoSOverridingOptions=part(with_default_policies=nothing)),
        )
        monkeypatch.setattr(ros_node, "rclpy", rclpy)
        for module in (messages, ros_node):
            monkeypatch.setattr(module, "ros_class", lambda kind: kind)

    def add_node(self, node):
        pass

    def create_subscription(self, kind, topic, callback, **_):
        self.subscriptions[topic] = callback

    def get_clock(self):
        return types.SimpleNamespace(ros_time_is_active=False)

    def create_timer(self, period, callback, clock):
        pass

    def add_on_set_parameters_callback(self, callback):
        pass

    def create_publisher(self, kind, topic, **_):
        return types.SimpleNamespace(publish=lambda m: None, get_subscription_count=lambda: 0)

    def get_nodes(self):
        return []

    def create_service(self, kind, name, callback):
        self.services[name] = callback

    def get_logger(self):
        return types.SimpleNamespace(name="n")

    def spin(self):
        """Until a callback raises, as rclpy's, or shutdown."""
        while (call := self.work.get()) is not None:
            call()

    def shutdown(self, timeout_sec):
        self.work.put(None)

    def ask(self, name):
        """The response of a service, called by the executor."""
        found = queue.Queue()
        response = msg.Trigger.Response()
        self.work.put(lambda: found.put(self.services[name](msg.Trigger.Request(), response)))
        return found.get(timeout=20.0)


@pytest.fixture
def stand_in(monkeypatch):
    return StandIn(monkeypatch)


@pytest.fixture
def on_stand_in(stand_in):
    """A node on it, which is run."""
    theirs = ros_node.Process([])
    node = ros_node.RosNode(theirs, "n", context=Context())
    executor = bus.MultiThreadedExecutor()
    node.connect("skin/diagnostics")
    executor.add_node(node)
    theirs.start(lambda: None)
    yield node, theirs
    theirs.close()
    executor.shutdown()


def trigger(_, response):
    response.success = True
    return response


def failing(_, response):
    raise RuntimeError("no such luck")


def test_a_service_that_raises_answers_that_it_failed(on_stand_in, stand_in):
    """And rclpy's executor, which would end by the exception, goes on."""
    node, theirs = on_stand_in
    node.create_service(msg.Trigger, "bad", failing)
    node.create_service(msg.Trigger, "good", trigger)
    for _ in range(2):
        assert stand_in.ask("/bad") == msg.Trigger.Response(False, "no such luck")
    assert stand_in.ask("/good").success
    assert theirs._thread.is_alive() and not theirs.failed


def test_a_service_that_hangs_answers_that_it_does(on_stand_in, stand_in, monkeypatch):
    """What waits in its queue then does not happen later; what has begun is told to have."""
    node, theirs = on_stand_in
    monkeypatch.setattr(ros_node, "_SERVICE_WITHIN", 0.01)
    hangs, release, asked = threading.Event(), threading.Event(), []

    def hang(_, response):
        asked.append(1)
        hangs.set()
        release.wait(20.0)
        return response

    node.create_service(msg.Trigger, "slow", hang)
    first = stand_in.ask("/slow")
    assert hangs.wait(20.0)
    others = [stand_in.ask("/slow") for _ in range(20)]  # more than its queue holds
    assert not first.success and "did not answer within 0.01 s" in first.message
    assert {(r.success, r.message) for r in others} == {
        (False, "the node did not answer within 0.01 s")
    }
    release.set()
    monkeypatch.setattr(ros_node, "_SERVICE_WITHIN", 20.0)
    stand_in.ask("/slow")
    assert len(asked) == 2
    assert theirs._thread.is_alive()


def test_what_a_part_says_on_tf_does_not_hide_what_the_robot_says(stand_in):
    """Else the gate knows no fixed joint of the robot, and stands while anybody pushes."""
    theirs, context = ros_node.Process([]), Context()
    features, gate = (ros_node.RosNode(theirs, n, context=context) for n in ("features", "gate"))
    frames.publish_static(features, "forearm", "skin", IDENTITY)
    found = frames.hear(gate)
    for node in (features, gate):
        node.connect("skin/diagnostics", *frames.TOPICS)
    header, at = msg.Header(frame_id="base"), msg.Vector3(1.0, 2.0, 3.0)
    fixed = msg.TransformStamped(header, "forearm", msg.Transform(at, msg.Quaternion(w=1.0)))
    stand_in.subscriptions["/tf_static"](frames.TFMessage([fixed]))
    executor = bus.SingleThreadedExecutor()
    executor.add_node(gate)
    executor.spin_some()
    assert found.lookup("base", "skin", 0.0).translation.tolist() == [1.0, 2.0, 3.0]


def test_a_message_that_cannot_be_taken_is_logged_and_counted(on_stand_in, stand_in, caplog):
    node, theirs = on_stand_in
    seen = queue.Queue()
    node.create_subscription(msg.Float32, "t", seen.put, 10)
    for message in (None, msg.Float32(2.0)):
        stand_in.work.put(lambda m=message: stand_in.subscriptions["/t"](m))
    assert seen.get(timeout=20.0) == msg.Float32(2.0)
    assert theirs._thread.is_alive()
    assert "callback of a message on /t raised" in caplog.text
    assert node.callback_errors == 1


@pytest.mark.usefixtures("signals_stay")
@pytest.mark.parametrize("status", [1, 0])
def test_a_process_whose_executor_ends_by_an_exception_fails(stand_in, monkeypatch, status):
    """One that is asked to end does not."""
    logger = logging.getLogger("tactile_skin")
    for name in ("level", "propagate", "handlers"):
        monkeypatch.setattr(logger, name, getattr(logger, name))
    monkeypatch.setattr(ros, "_about", lambda name: "")

    def work():
        if status:
            raise RuntimeError("a type support that is missing")
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(NodeAction, "made_by", property(lambda _: lambda node: None))
    stand_in.work.put(work)
    assert ros.run("monitor", []) == status


def test_what_ros_cannot_log_harms_nobody(capsys):
    """A ROS that is gone raises."""

    class Gone:
        def get_logger(self):
            raise RuntimeError("rcl is not initialised")

    logger = logging.Logger("n")
    logger.addHandler(ros_node.ToRos())
    logger.handlers[0].nodes["n"] = Gone()
    logger.error("a word")
    assert "rcl is not initialised" in capsys.readouterr().err


def test_what_a_node_of_one_skin_logs_is_logged_by_that(stand_in, monkeypatch):
    said = []

    class Node:
        def __init__(self, name):
            self.name = name

        def get_logger(self):
            return self

        def log(self, text, severity):
            said.append((self.name, severity))

    monkeypatch.setattr(ros_node.rclpy.logging, "get_logger", Node)

    handler = ros_node.ToRos()
    handler.nodes = {f"n.{name}.driver": Node(name) for name in ("chest", "back")}
    handler.handle(logging.makeLogRecord({"name": "n.back.driver", "levelno": logging.ERROR}))
    assert said == [("back", logging.ERROR)]


# --- with ROS ---


# messages


def filled(kind, dice):
    """A message with a value of its own in each field."""
    values = []
    for name, hint in messages._fields(kind):
        if dataclasses.is_dataclass(hint):
            values.append(filled(hint, dice))
        elif typing.get_origin(hint) is list:
            values.append([filled(typing.get_args(hint)[0], dice) for _ in range(2)])
        elif hint is int:
            values.append(dice.randrange(1, 2) if name == "is_bigendian" else dice.randrange(4))
        else:
            values.append(
                {
                    float: dice.choice([0.5, -1.25, 3.0]),
                    str: dice.choice(["map", "ä", ""]),
                    bool: True,
                    bytes: dice.randbytes(12),
                }[hint]
            )
    return kind(*values)


@pytest.mark.ros
@pytest.mark.parametrize("kind", MESSAGES, ids=lambda m: m.__name__)
def test_a_message_comes_back_from_ros_as_it_was(kind, rclpy):
    """Every field has its like in the installed definition, and keeps its value on the wire."""
    message = filled(kind, random.Random(5))
    theirs = messages.to_ros(message)
    assert type(theirs).__module__.split(".")[0] == kind.TYPE.split("/")[0]
    assert messages.from_ros(kind, through_the_wire(theirs)) == message
    assert messages.from_ros(kind, messages.ros_class(kind)()) == kind()  # the same defaults


def through_the_wire(message):
    from rclpy.serialization import deserialize_message, serialize_message

    return deserialize_message(serialize_message(message), type(message))


# the graph


@pytest.fixture(scope="module")
def skin(rclpy):
    """Every node of skin.launch.yaml a process, a recorded board on a pty: graph, player, plan."""
    # Equal bytes give equal values if none is lost, given up or late: on a busy machine, too, where
    # `auto` would take a faster method.
    player = Player(rate=50.0)
    plan = plan_of(
        player.port,
        serial_driver={"watchdog": 60.0},
        # a tare remembers what came before, and so does a noise that is measured
        compensation={"method": "map", "time_limit": 10.0, "tare": False, "noise": 0.5},
        gesture_feature={"geometry.shape": "plane"},
        stop_on_push={"stale_after": 0.5},
    )
    with Graph() as graph:
        for action in plan.values():
            graph.start_node(action)
        name = graph.listen()
        with player.playing(endless(IDLE, next(SEEDS), REST)):
            graph.wait_until_heard(name)
        graph.heard(name)
        yield graph, player, plan
    player.close()


def by_topic(heard) -> dict[str, list[tuple]]:
    found = defaultdict(list)
    for topic, *rest in heard:
        found[topic].append(tuple(rest))
    return found


RESET = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("plain_client")
client = node.create_client(Trigger, "/compensation/reset")
assert client.wait_for_service(20.0)
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
print(future.result().success, future.result().message)
"""


def reset(graph) -> str:
    """Call the service by ROS alone."""
    words = [sys.executable, "-c", RESET]
    done = subprocess.run(words, env=graph.env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


class InProcess:
    """The same nodes in this process, fed with frames and the stamps that they had on ROS."""

    def __init__(self, plan):
        self.clock, self.executor = ManualClock(0.0), SingleThreadedExecutor()
        self.context = Context(self.clock)
        self.seen = defaultdict(dict)  # topic -> stamp [ns] -> message, the first of each stamp
        observer = Node("observer", context=self.context)
        for kind, topic in (
            (Image, "skin/pressure"),
            (PointCloud2, "skin/contacts"),
            (WrenchStamped, "skin/wrench"),
            (Vector3Stamped, "skin/push_direction"),
            (DiagnosticArray, STATUS_TOPIC),
        ):
            observer.create_subscription(kind, topic, self._noter(topic), 100)
        self._adc = observer.create_publisher(Image, "skin/adc", 10)
        self.executor.add_node(observer)
        for name in ("compensation", "gesture_feature", "stop_on_push"):
            handle = make_node(plan[name], self.context)
            plan[name].made_by(handle)
            self.executor.add_node(handle)

    def _noter(self, topic):
        def note(m):
            stamp = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            self.seen[topic].setdefault(stamp, m)

        return note

    def feed(self, frame: bytes, stamp: int) -> Image:
        (found,) = BinaryParser().feed(frame)
        self.clock.advance((stamp - self.clock.now().nanoseconds) / 1e9)
        self.clock._now = stamp
        message = image(found.samples, "16UC1", Header(self.clock.now().to_msg(), "base_link"))
        self._adc.publish(message)
        self.executor.spin_some()
        return message


@pytest.mark.ros
def test_the_values_are_those_in_process_for_the_same_bytes(skin, monkeypatch):
    """Pictures, contacts, wrench, direction, stop and its reason: each to the last bit. At half
    the rate, which is another test's: a frame that a busy machine drops changes what follows."""
    graph, player, plan = skin
    frames = [
        frame
        for count, scene in ((150, DEMO), (60, PUSH), (60, IDLE))
        for frame in record(count, scene, next(SEEDS), REST)
    ]
    name = graph.listen()
    with player.playing(endless(IDLE, next(SEEDS), REST)):
        graph.wait_until_heard(name)
    time.sleep(0.5)
    assert reset(graph).startswith("True ")
    before = time.time_ns()
    monkeypatch.setattr(player, "rate", 50.0)
    player.play(frames)
    time.sleep(1.0)
    heard = by_topic(graph.heard(name))
    adc = [(stamp, values) for _, stamp, values in heard["skin/adc"] if stamp > before]
    assert len(adc) == len(frames)
    # A busy machine may give a frame up, and the next one then starts from another picture.
    taken = {stamp for _, stamp, _ in heard["skin/pressure"] if stamp > before}
    assert len(taken) >= 0.98 * len(frames)
    here = InProcess(plan)
    for frame, (stamp, values) in zip(frames, adc, strict=True):
        if stamp not in taken:
            continue
        m = here.feed(frame, stamp)
        assert values == ("base_link", m.height, m.width, "16UC1", 0, m.step, m.data)
    counted = 0
    for _, stamp, values in heard["skin/pressure"]:
        if stamp > before:
            m = here.seen["skin/pressure"][stamp]
            assert values == ("base_link", 16, 16, "32FC1", 0, 64, m.data)
            counted += 1
    earlier = None  # contacts that ROS saw before: ids count from the start of the node
    for _, stamp, (*layout, data) in heard["skin/contacts"]:
        if stamp > before:
            m = here.seen["skin/contacts"][stamp]
            fields = [(f.name, f.offset, f.datatype, f.count) for f in m.fields]
            assert layout == [m.height, m.width, fields, m.point_step, m.row_step, m.is_dense]
            shape = m.width, m.point_step // 4
            theirs, ours = (np.frombuffer(d, "<f4").reshape(shape) for d in (data, m.data))
            number = [f.name for f in m.fields].index("id")
            if earlier is None and m.width:
                earlier = theirs[0, number] - ours[0, number]
            ids = ours[:, number] + (earlier or 0)
            np.testing.assert_array_equal(theirs[:, number], ids)
            np.testing.assert_array_equal(*(np.delete(a, number, 1) for a in (theirs, ours)))
            counted += 1
    for _, stamp, values in heard["skin/wrench"]:
        if stamp > before:
            w = here.seen["skin/wrench"][stamp].wrench
            assert values == tuple(getattr(v, a) for v in (w.force, w.torque) for a in "xyz")
            counted += 1
    for _, stamp, values in heard["skin/push_direction"]:
        if stamp > before:
            v = here.seen["skin/push_direction"][stamp].vector
            assert values == (v.x, v.y, v.z)
            counted += 1
    assert counted == 4 * len(taken)

    def what(reason):
        """Without the text of `stale`: it tells of frames before these, which only ROS has seen."""
        return "stale" if reason.startswith("stale: ") else reason

    decided, reasons = set(), set()
    for _, stamp, ((_, level, reason, _, _),) in heard["skin/stop_status"]:
        if stamp in taken and stamp not in decided and stamp != adc[-1][0]:
            decided.add(stamp)
            status = here.seen[STATUS_TOPIC][stamp].status[0]
            assert (level, what(reason)) == (status.level, what(status.message))
            reasons.add(reason)
    assert len(decided) >= 0.98 * len(frames)  # the first that hears of a stamp is its decision
    assert "" in reasons and any(reason.startswith("push: ") for reason in reasons)
