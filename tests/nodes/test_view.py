# SPDX-License-Identifier: Apache-2.0
"""The node `view`: snapshots to the page's process, requests from there, and its end."""

import asyncio
import json
import os
import signal
import urllib.request
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("websockets", reason="serves the page")

from support.page import unpack
from support.patience import PATIENCE, until
from websockets.asyncio.client import connect

from tactile_skin.behaviours.stop import StopConfig
from tactile_skin.errors import LaunchError
from tactile_skin.launch import Skin, read_plan
from tactile_skin.middleware.bus import (
    Context,
    ManualClock,
    MultiThreadedExecutor,
    Node,
    Parameter,
)
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    Time,
    Trigger,
    image,
)
from tactile_skin.nodes.observers import view
from tactile_skin.nodes.observers.view import View
from tactile_skin.recording.reader import Recording
from tactile_skin.view.process import PageProcess, listen
from tactile_skin.view.snapshot import LATCHED, STOP

pytestmark = pytest.mark.live


class Viewed:
    """The node on a bus, and what a page of it gets."""

    def __init__(self, controls=False):
        self.clock = ManualClock()
        self.context, self.executor = Context(self.clock), MultiThreadedExecutor()
        given = [Parameter("port", 0), Parameter("controls", controls)]
        self.asked = []
        self.node = Node("view", context=self.context, parameter_overrides=given)
        self.other = Node("other", context=self.context)
        for name in ("compensation/tare", "compensation/reset", "stop_on_push/reset"):
            self.other.create_service(Trigger, f"/{name}", self._service(name))
        self.adc = self.other.create_publisher(Image, "skin/adc", 10)
        self.stop = self.other.create_publisher(DiagnosticArray, STOP, LATCHED)
        self.view = View(self.node)
        self.address = self.view._page.address
        self.executor.add_node(self.node)
        self.executor.add_node(self.other)

    def _service(self, name):
        def serve(_, response):
            self.asked.append(name)
            response.success, response.message = name != "stop_on_push/reset", f"{name} said"
            return response

        return serve

    def publish(self, k, stop=False):
        stamp = Header(Time(k, 0))
        self.adc.publish(image(np.full((16, 16), 64 * (k % 1000), np.uint16), "16UC1", stamp))
        status = DiagnosticStatus(2 * stop, "stop_on_push", "push" if stop else "")
        self.stop.publish(DiagnosticArray(stamp, [status]))

    def close(self):
        self.view.close()
        self.executor.shutdown(PATIENCE)


@pytest.fixture(scope="module")
def viewed(request):
    """One for all tests that ask for the same controls."""
    made = Viewed(getattr(request, "param", False))
    yield made
    made.close()


@pytest.fixture
def fresh():
    """One that the test may harm."""
    made = Viewed()
    yield made
    made.close()


def talk(viewed, scenario):
    """Run `scenario(page)` with a page of it."""

    async def run():
        url = viewed.address.replace("http", "ws") + "/snapshots"
        async with connect(url, origin=viewed.address, max_size=None) as page:
            await page.recv()
            await scenario(page)

    asyncio.run(asyncio.wait_for(run(), PATIENCE))


async def shown(page, happens, before=lambda: None):
    number = 0
    while True:
        before()
        await page.send(json.dumps({"after": number}))
        head, arrays = unpack(await page.recv())
        number = head["number"]
        if happens(head):
            return arrays


def test_the_page_has_a_low_priority_within_its_session_and_among_sessions(viewed):
    pid = viewed.view._page._process.pid
    low = min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)

    def says_low() -> bool:
        group = Path(f"/proc/{pid}/autogroup")
        among = group.read_text() if group.exists() else "nice 10"
        return os.getpriority(os.PRIO_PROCESS, pid) == low and "nice 10" in among

    until(says_low)


def test_a_page_sees_what_is_published_and_the_stop(viewed):
    async def scenario(page):
        arrays = await shown(page, lambda h: h["stamp"] == 200.0, lambda: viewed.publish(200))
        assert (arrays["reading"] == 200.0).all()
        stopped = lambda h: h["stop"] and h["reason"] == "push"  # noqa: E731
        await shown(page, stopped, lambda: viewed.publish(201, stop=True))

    talk(viewed, scenario)


def test_a_stop_that_is_heard_no_more_is_unknown(viewed, monkeypatch):
    """Its process may have been killed: its last word was "free"."""
    monkeypatch.setattr(view, "_UNHEARD", 0.3)

    async def scenario(page):
        await shown(page, lambda h: h["stop"] is False, lambda: viewed.publish(500))
        unknown = lambda h: h["stop"] is None and h["stamp"] == 500.0  # noqa: E731
        await shown(page, unknown, viewed.view._show)

    talk(viewed, scenario)


def test_nothing_is_sent_while_no_page_is_open(fresh):
    sent = []
    fresh.view.skins[""].page.show = sent.append
    fresh.publish(3)
    until(fresh.node._idle)
    assert not sent and not fresh.view.skins[""].page.watched


@pytest.mark.parametrize("viewed", [True], indirect=True)
def test_a_page_that_may_tares_and_resets(viewed):
    async def scenario(page):
        await page.send(json.dumps({"ask": "tare"}))
        said = json.loads(await page.recv())["said"]
        assert (said["success"], said["message"]) == (True, "compensation/tare said")
        await page.send(json.dumps({"ask": "reset"}))
        said = json.loads(await page.recv())["said"]
        assert (said["success"], said["message"]) == (False, "stop_on_push/reset said")

    talk(viewed, scenario)
    assert viewed.asked == ["compensation/tare", "compensation/reset", "stop_on_push/reset"]


@pytest.mark.parametrize(
    ("host", "controls", "guarded"),
    [("127.0.0.1", True, False), ("0.0.0.0", False, False), ("0.0.0.0", True, True)],
)
def test_the_printed_address_has_a_token_where_others_may_steer(host, controls, guarded):
    pages = [PageProcess(host, 0, controls, {}) for _ in range(2)]
    tokens = [page.address.partition("/#")[2] for page in pages]
    for page in pages:
        page.close()
    assert all(len(token) == 12 for token in tokens) if guarded else tokens == ["", ""]
    assert len(set(tokens)) == 1 + guarded


@pytest.mark.parametrize("viewed", [True], indirect=True)
def test_a_page_that_may_records_all_that_is_published(viewed, tmp_path):
    pytest.importorskip("mcap", reason="makes recordings")
    given = [Parameter("format", "{:d},")]
    driver = Node("serial_driver", context=viewed.node.context, parameter_overrides=given)

    async def scenario(page):
        async def ask(name):
            await page.send(json.dumps({"ask": name}))
            return json.loads(await page.recv())["said"]

        assert (await ask("finish"))["message"] == "nothing is recorded"
        assert driver.declare_parameter("format", "").value == "{:d},"
        assert (await ask("record"))["success"]
        assert (await ask("record"))["message"] == "a recording is on already"
        for k in range(300, 325):
            viewed.publish(k)
        said = await ask("finish")
        assert said["success"] and "file" not in said

    talk(viewed, scenario)
    with urllib.request.urlopen(f"{viewed.address}/recording.mcap", timeout=PATIENCE) as answer:
        (tmp_path / "r.mcap").write_bytes(answer.read())
    recording = Recording(tmp_path / "r.mcap")
    times = [message.header.stamp.sec for _, _, message in recording.messages("/skin/adc")]
    assert recording.node_parameters("serial_driver") == {"format": "{:d},"}
    assert times == list(range(300, 325)) and recording.skin.circuit.shape == (16, 16)


@pytest.mark.parametrize("viewed", [True], indirect=True)
def test_a_page_is_given_what_the_nodes_were_launched_with(viewed, tmp_path):
    """What `detect` wrote for a board: its calibration must not lose it."""
    given = {
        "serial_driver": {"protocol": "text", "format.full_scale": 3300.0, "circuit.rows": 8},
        "stop_on_push": {"debounce": 0.01, "threshold": StopConfig.threshold},
        "monitor": {"rate": 5.0},
    }
    nodes = []  # held as long as the page may ask
    for name, values in given.items():
        node = Node(name, context=viewed.node.context)
        for key, value in values.items():
            node.declare_parameter(key, value)
        nodes.append(node)
    answered, text = viewed.view.skins[""]._call("describe")
    assert answered
    (tmp_path / "a.yaml").write_text("/**: {ros__parameters: {circuit: {rows: 8}}}\n" + text)
    found = {s.node: s.values for s in ParameterFile(tmp_path / "a.yaml").sections}
    assert found["serial_driver"] == {"protocol": "text", "format.full_scale": 3300.0}
    assert found["stop_on_push"] == {"debounce": 0.01}
    assert set(found) == {"", "serial_driver", "stop_on_push"}


def test_a_page_that_may_not_is_refused_by_the_skin_too(viewed):
    """Whatever the page's process is made to ask for."""
    assert viewed.view.skins[""]._call("reset")[0] is False and viewed.asked == []


def test_before_the_first_reading_nothing_has_an_age(fresh, monkeypatch):
    """It was the seconds since 1970."""
    skin, shown = fresh.view.skins[""], []
    monkeypatch.setattr(skin.page, "show", shown.append)
    skin.page.watched = True
    skin.show()
    assert shown[0].stamp == 0.0 and shown[0].read_at is None
    body = view.ShownSkin(fresh.node, "", skin.page, {}, {}, True)
    body.show()  # it has no readings of its own, and its log has times all the same
    assert shown[1].stamp == view.now(fresh.node) and shown[1].read_at is not None


def test_the_skin_goes_on_when_the_pages_process_dies(fresh, caplog):
    os.kill(fresh.view._page._process.pid, signal.SIGKILL)
    until(lambda: "has ended" in caplog.text)
    assert "the skin goes on" in caplog.text
    fresh.view.skins[""].page.watched = True
    for k in range(2000):  # more than any buffer holds
        fresh.publish(k)
    fresh.view._show()
    assert not fresh.view.skins[""].page.watched and fresh.node.callback_errors == 0


def test_a_page_process_that_hangs_costs_snapshots_only(fresh):
    """Frozen, it takes nothing: the buffer is full, and what is new is dropped."""
    os.kill(fresh.view._page._process.pid, signal.SIGSTOP)
    try:
        fresh.view.skins[""].page.watched = True
        for k in range(2000):
            fresh.publish(k)
            fresh.view._show()
            if fresh.view.skins[""].page.dropped:
                break
        assert fresh.view.skins[""].page.dropped
    finally:
        os.kill(fresh.view._page._process.pid, signal.SIGCONT)


def test_it_ends_with_the_skin():
    viewed = Viewed()
    process = viewed.view._page._process
    viewed.close()
    process.wait(PATIENCE)
    assert process.returncode is not None


def test_an_address_that_is_taken_is_named(tmp_path):
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        plan = read_plan("launch/skin.launch.yaml", {"view": "true", "view_port": str(port)})
        plan.nodes = [action for action in plan.nodes if action.executable == "view"]
        with pytest.raises(LaunchError, match=rf"port {port}: .*in use"):
            Skin(plan).build()
    with pytest.raises(LaunchError, match=r"192\.0\.2\.1"):
        listen("192.0.2.1", 0)
    with pytest.raises(LaunchError, match=r"no\.such"):
        listen("no.such.host.invalid", 0)
