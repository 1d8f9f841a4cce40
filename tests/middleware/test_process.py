# SPDX-License-Identifier: Apache-2.0
"""Nodes in a process of their own do what they would do here, and it is said when they cannot."""

import os
import signal
import time

import pytest
from support.patience import PATIENCE, until
from support.skins import skin_of

from tactile_skin.middleware.bus import Node, Parameter, result_of
from tactile_skin.middleware.process import SkinProcess
from tactile_skin.msg import DiagnosticArray, Float32, Header, Trigger
from tactile_skin.nodes.gesture_feature import contact_cloud
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC

pytestmark = pytest.mark.live


@pytest.fixture
def stop():
    """A stop node, run by a process; .process, .absent (what it was called with), .heard."""
    skin = skin_of(("stop_on_push", {"threshold": 25.0, "latch": True}))
    with skin:
        (action,), (handle,) = skin._plan.nodes, skin._handles
        skin.absent, skin.heard, skin.handle = [], [], handle
        skin.process = SkinProcess([action], [handle], lambda *why: skin.absent.append(why))
        take = skin.heard.append
        skin.node.create_subscription(DiagnosticArray, STATUS_TOPIC, take, 100)
        yield skin
        skin.process.end(time.monotonic() + PATIENCE)


def said(stop) -> str:
    return stop.heard[-1].status[0].message if stop.heard else ""


def values(stop) -> dict[str, str]:
    return {pair.key: pair.value for pair in stop.heard[-1].status[0].values} if stop.heard else {}


def change(stop, threshold: float):
    given = [Parameter("threshold", threshold)]
    return result_of(stop.handle.ask(stop.handle.set_parameters_atomically, given), PATIENCE)


def test_topics_services_and_parameters_are_the_processes(stop, caplog):
    assert stop.absent[0] == ("starts", True)
    stop.process.wait(PATIENCE)
    until(lambda: said(stop) == "stale: no reading yet", "a first decision")
    contacts = stop.node.create_publisher(
        type(empty := contact_cloud([], Header())), "skin/contacts", 1
    )
    contacts.publish(empty)  # heard by the process alone
    until(lambda: "old when they arrive" in said(stop), "a reading of long ago")
    assert values(stop)["threshold"] == "25"
    assert change(stop, 300.0).successful
    until(lambda: values(stop)["threshold"] == "300", "another limit")
    until(lambda: "no push will stop the robot" in caplog.text.replace("\n", " "), "its warning")
    refused = change(stop, -1.0)
    assert not refused.successful and "= -1.0: must be from" in refused.reason
    refused = change(stop, 5.0)  # by the node: below `release`
    assert not refused.successful and "release" in refused.reason
    assert stop.handle.get_parameter("threshold").value == 300.0
    reset = stop.node.create_client(Trigger, "/stop_on_push/reset")
    assert not reset.call(Trigger.Request(), PATIENCE).success  # it is stale
    assert stop.process.why == ""


def test_only_what_is_heard_is_sent(stop):
    stop.process.wait(PATIENCE)
    until(lambda: STATUS_TOPIC in {t.strip("/") for t in stop.process._hears}, "somebody hears")
    assert "/skin/stop" not in stop.process._hears
    node = Node("late", context=stop._context)
    node.create_listener(stop.process._publishers["/skin/stop"].msg_type, "skin/stop")
    until(lambda: "/skin/stop" in stop.process._hears, "one that came later")
    node.destroy_node()
    until(lambda: "/skin/stop" not in stop.process._hears, "it has gone")
    node.create_publisher(Float32, "skin/other", 1).publish(Float32(1.0))  # is nobody's


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_one_that_ends_or_hangs_is_said_and_started_again(stop, how):
    stop.process.wait(PATIENCE)
    until(lambda: said(stop), "a decision")
    assert change(stop, 33.0).successful
    stop.absent.clear()
    os.kill(stop.process._process.pid, how)
    why = "ended (-9) and is started again"
    until(lambda: (why, False) in stop.absent, "it is said")
    answer = stop.node.create_client(Trigger, "/stop_on_push/reset").call(Trigger.Request(), 1.0)
    assert not answer.success and answer.message == f"its process {why}"
    assert "its process ended" in change(stop, 40.0).reason
    until(lambda: not stop.process.why, "it runs again")
    stop.heard.clear()
    until(lambda: values(stop).get("threshold") == "33", "what was changed")
    assert "latched: " in said(stop) and "ended (-9)" in said(stop)


def test_the_last_words_are_heard(stop):
    stop.process.wait(PATIENCE)
    until(lambda: said(stop), "a decision")
    stop.process.end(time.monotonic() + PATIENCE)
    until(lambda: "the skin shuts down" in said(stop), "its last decision")
    assert stop.process._process.poll() is not None and not stop.process._thread.is_alive()


def test_one_that_hangs_stops_before_it_is_killed_and_ends_no_later(stop):
    stop.process.wait(PATIENCE)
    until(lambda: said(stop), "a decision")
    os.kill(stop.process._process.pid, signal.SIGSTOP)
    until(lambda: ("does not answer", False) in stop.absent, "it is said")
    stop.process.end(time.monotonic())
    assert stop.process._process.poll() is not None and not stop.process._thread.is_alive()


def test_what_is_latched_here_is_forgotten_with_the_last_who_hears_it(stop):
    stop.process.wait(PATIENCE)
    publisher = stop.process._publishers["/skin/stop"]
    node = Node("late", context=stop._context)
    node.create_listener(publisher.msg_type, "skin/stop")
    until(lambda: "/skin/stop" in stop.process._hears, "somebody hears")
    node.destroy_node()
    until(lambda: not publisher._kept, "nobody hears it")


def test_an_error_of_who_hears_it_does_not_end_the_line(stop, monkeypatch):
    stop.process.wait(PATIENCE)

    def raises(message):
        raise ValueError("as a filter of a log may")

    monkeypatch.setattr(stop.process._publishers["/skin/stop_status"], "publish", raises)
    until(lambda: "/skin/stop_status" in stop.process._hears, "somebody hears")
    time.sleep(0.1)
    monkeypatch.undo()
    stop.heard.clear()
    until(lambda: said(stop), "a decision")
