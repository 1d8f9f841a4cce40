# SPDX-License-Identifier: Apache-2.0
"""The live server of the Foxglove app, by a client that speaks its protocol."""

import contextlib
import itertools
import json
import struct
import sys
import threading

import pytest

pytest.importorskip("foxglove", reason="serves")
pytest.importorskip("websockets", reason="is the client")
from support.bench import Bench
from websockets.sync.client import connect

from tactile_skin.errors import LaunchError
from tactile_skin.middleware.launch_file import read_plan
from tactile_skin.middleware.package import FOXGLOVE, find
from tactile_skin.msg import (
    Bool,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    PointCloud2,
    Time,
    Vector3Stamped,
    cloud,
    image,
)
from tactile_skin.nodes.observers.foxglove import Foxglove
from tactile_skin.recording import cdr

pytestmark = pytest.mark.live

PATIENCE = 10.0  # s
TOPICS = {
    "/skin/adc": Image,
    "/skin/contacts": PointCloud2,
    "/skin/stop": Bool,
    "/diagnostics": DiagnosticArray,
}
MESSAGE = struct.Struct("<BIQ")  # opcode 1, number of the subscription, log time [ns]


class Skin(Bench):
    """The node, and a publisher for each of TOPICS."""

    def __init__(self, **given):
        super().__init__()
        self.talker = self.node("talker")
        self.publish = {
            topic: self.talker.create_publisher(kind, topic, 10).publish
            for topic, kind in TOPICS.items()
        }
        self.foxglove = Foxglove(self.node("foxglove", {"port": 0} | given))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.foxglove.close()


class App:
    """A client, as the app is one."""

    def __init__(self, address: str):
        self._open = contextlib.ExitStack()
        self._socket = self._open.enter_context(connect(address, subprotocols=["foxglove.sdk.v1"]))
        self.info = self._said("serverInfo")
        self.channels = {c["topic"]: c for c in self._said("advertise")["channels"]}
        self._topics: dict[int, str] = {}

    def _said(self, op: str) -> dict:
        while True:
            said = json.loads(self._socket.recv(PATIENCE))
            if said["op"] == op:
                return said

    def new_channels(self) -> dict:
        return {c["topic"]: c for c in self._said("advertise")["channels"]}

    def subscribe(self, *topics: str) -> None:
        self._topics |= dict(zip(itertools.count(len(self._topics)), topics))
        wanted = [{"id": n, "channelId": self.channels[t]["id"]} for n, t in self._topics.items()]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def message(self, patience: float = PATIENCE) -> tuple[str, int, bytes]:
        """Topic, log time [ns] and CDR."""
        data = self._socket.recv(patience)
        opcode, number, t = MESSAGE.unpack_from(data)
        assert opcode == 1
        return self._topics[number], t, data[MESSAGE.size :]

    def rest(self, patience: float) -> set[str]:
        """Topics of all messages until there is none for so long [s]."""
        topics = set()
        with contextlib.suppress(TimeoutError):
            while True:
                topics.add(self.message(patience)[0])
        return topics

    def close(self):
        self._open.close()


@pytest.fixture
def skin():
    with Skin() as skin:
        yield skin


@pytest.fixture
def app(skin):
    app = App(skin.foxglove.address)
    yield app
    app.close()


def subscribed(skin, app, *topics):
    """Subscribe, and wait until the server knows: it then passes messages on."""
    skin.foxglove._closing.set()  # the thread ends; what waits is sent by hand
    skin.foxglove._thread.join()
    app.subscribe(*topics)

    left = set(topics)
    while left:  # what comes before the server has noted all of it reaches nobody
        for topic in topics:
            skin.publish[topic](TOPICS[topic]())
        skin.foxglove._send()
        left -= app.rest(0.2)
    assert not app.rest(0.2)


def test_every_topic_is_a_channel_with_the_schema_of_a_recording(app):
    assert app.info["name"] == "tactile_skin"
    assert app.info["capabilities"] == []  # nobody publishes or calls by it
    assert set(app.channels) == set(TOPICS)
    for topic, kind in TOPICS.items():
        channel = app.channels[topic]
        assert (channel["schemaName"], channel["encoding"]) == (kind.TYPE, "cdr")
        assert channel["schemaEncoding"] == "ros2msg"
        assert channel["schema"] == cdr.definition(kind)


def test_frames_arrive_as_they_were_published(skin, app):
    subscribed(skin, app, "/skin/adc", "/skin/contacts")
    before = 0
    for k in range(20):
        header = Header(Time(k, 7), "base_link")
        sent = {
            "/skin/adc": image([[k, 2], [3, 65535]], "16UC1", header),
            "/skin/contacts": cloud({"x": [0.1 * k], "force": [2.0]}, header),
            "/skin/stop": Bool(True),  # not subscribed to
        }
        for topic, message in sent.items():
            skin.publish[topic](message)
        skin.foxglove._send()
        for _ in range(2):
            topic, t, data = app.message()
            assert cdr.decode(TOPICS[topic], data) == sent.pop(topic)
            assert t >= before
            before = t


def test_a_topic_that_appears_later_is_advertised(skin, app):
    skin.talker.create_publisher(Vector3Stamped, "/skin/stroke", 10)
    skin.foxglove._listen()
    assert set(app.new_channels()) == {"/skin/stroke"}


def test_nothing_is_kept_for_nobody(skin):
    skin.publish["/skin/stop"](Bool(True))
    assert not skin.foxglove._newest["/skin/stop"]


def test_the_newest_is_sent_and_all_of_diagnostics(skin, app):
    subscribed(skin, app, "/skin/stop", "/diagnostics")
    for k in range(12):
        skin.publish["/skin/stop"](Bool(k == 11))
        status = DiagnosticStatus(name=f"node_{k}")
        skin.publish["/diagnostics"](DiagnosticArray(status=[status]))
    skin.foxglove._send()
    got = [app.message() for _ in range(13)]
    assert [cdr.decode(Bool, data) for topic, _, data in got if topic == "/skin/stop"] == [
        Bool(True)
    ]
    said = [cdr.decode(DiagnosticArray, data) for t, _, data in got if t == "/diagnostics"]
    assert [array.status[0].name for array in said] == [f"node_{k}" for k in range(12)]


def test_a_message_that_cannot_be_sent_hides_no_others(skin, app, caplog):
    subscribed(skin, app, "/skin/stop", "/skin/contacts")
    for _ in range(3):
        skin.publish["/skin/contacts"](PointCloud2(width="wide"))
        skin.publish["/skin/stop"](Bool(True))
        skin.foxglove._send()
        assert app.message()[0] == "/skin/stop"
    assert caplog.text.count("/skin/contacts is not shown") == 1


def test_the_thread_sends_by_itself(skin, app):
    app.subscribe("/skin/stop")
    ended = threading.Event()

    def publish():
        while not ended.wait(0.01):
            skin.publish["/skin/stop"](Bool(True))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert cdr.decode(Bool, app.message()[2]) == Bool(True)
    finally:
        ended.set()
        thread.join()


def test_a_port_that_is_taken_is_said_in_a_line(skin):
    port = int(skin.foxglove.address.rpartition(":")[2])
    with pytest.raises(LaunchError, match=f"port {port}: .*in use.*: set host and port"):
        Skin(port=port)


def test_without_its_library_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(LaunchError, match=r"pip install 'tactile_skin\[foxglove\]'"):
        Skin()


def test_any_launch_file_may_have_it():
    def kinds(**given):
        plan = read_plan(find("skin.launch.yaml"), {"port": "loop://"} | given)
        return [action.kind for action in plan.nodes]

    assert FOXGLOVE not in kinds() + kinds(foxglove="false")
    assert FOXGLOVE in kinds(foxglove="true") and kinds(foxglove="true", record="x")[-2] == FOXGLOVE
    with pytest.raises(LaunchError, match="foxglove = 'x': must be true or false"):
        kinds(foxglove="x")
