"""view: what the skin sees and says, on a page in the browser (tactile_skin/view)."""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections import deque
from dataclasses import replace

from ...errors import LaunchError
from ...middleware.config import adc_of, circuit_of, curve_of, declared, geometry_of
from ...msg import Trigger
from ...parameters.nodes import View as Parameters
from ...view.process import PageProcess
from ...view.snapshot import OTHERS, READINGS, STOP, Collector
from .. import READING
from .page_recording import RECORDS, PageRecording

_QUIET = 0.1  # s after which a page is told that nothing changed
_AFTER = 0.001  # s after a decision: those who stop the robot go first
# What a page may ask for, if it may -> the services that are called, in turn.
_CALLS = {
    "tare": ("compensation/tare",),
    "reset": ("compensation/reset", "stop_on_push/reset"),
    **dict.fromkeys(RECORDS, ()),
}


class View:
    """Serves the page from a process of its own.

    It hands it the newest of each topic, once a reading, after the stop's decision, and nothing
    while no page is open. A page that lags, or hangs, loses snapshots and keeps nobody waiting.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        circuit = circuit_of(given.circuit)  # what is wrong is an error now
        adc_of(given.circuit, circuit), curve_of(given.curve, circuit)
        geometry_of(given.geometry, circuit)
        calls = _CALLS if given.controls else {}
        try:
            self._clients = {
                name: [node.create_client(Trigger, service) for service in services]
                for name, services in calls.items()
            }
        except NotImplementedError:
            raise LaunchError(
                "view: controls = true: not on ROS: call the services ~/tare and ~/reset there"
            ) from None
        parameters = {name: node.get_parameter(name).value for name in node.parameter_names()}
        self._recording = PageRecording(node, parameters)
        self._page = PageProcess(parameters)
        self._collector = Collector()
        self._closed = False
        self._sent = 0.0, 0.0  # stamp of the last snapshot, and when it was sent
        self._newest: dict[str, deque] = {}  # topic -> messages that were not taken yet
        for topic, (kind, count) in READINGS.items():  # nobody is woken for each of them
            self._newest[topic] = deque(maxlen=count)
            node.create_tap(kind, topic, self._newest[topic].append, READING)
        for topic, (kind, qos) in OTHERS.items():
            node.create_subscription(kind, topic, self._taker(topic), qos)
        node.create_timer(_QUIET, self._show)
        threading.Thread(target=self._obey, name="view controls", daemon=True).start()
        node.get_logger().info("the skin in a browser: %s", self._page.address)

    def _taker(self, topic: str):
        def take(message) -> None:
            self._collector.take(topic, message)
            if topic == STOP and self._page.watched:
                time.sleep(_AFTER)
                self._show()

        return take

    def _show(self) -> None:
        """Send what there is, unless it was sent just now."""
        if not self._page.watched:
            return
        for topic, messages in self._newest.items():
            while messages:
                self._collector.take(topic, messages.popleft())
        snapshot, now = self._collector.snapshot(), time.monotonic()
        stamp, at = self._sent
        if snapshot.stamp == stamp and now - at < _QUIET:
            return
        self._sent = snapshot.stamp, now
        age = self.node.get_clock().now().nanoseconds / 1e9 - snapshot.stamp
        self._page.show(replace(snapshot, read_at=now - age))

    def _obey(self) -> None:
        """In a thread of its own: what the pages ask for."""
        for name in self._page.requests():
            self._page.answer(name, *self._call(name), self._recording.take())
        if not self._closed:
            self.node.get_logger().error("the page's process has ended; the skin goes on")

    def _call(self, name: str) -> tuple[bool, str]:
        if name not in self._clients:
            return False, "controls are off: launch with view_controls:=true"
        if name in RECORDS:
            return self._recording.ask(name)
        said = []
        for client in self._clients[name]:
            future = client.call_async(Trigger.Request())
            try:
                answer = future.result(1.0)
            except (TimeoutError, concurrent.futures.TimeoutError):
                # a reset that was given up must not free the robot later
                given_up = future.cancel()
                return False, f"{name}: {'no answer' if given_up else 'is at work on it'}"
            except Exception as error:
                return False, f"{name}: {error}"
            said.append(answer.message)
            if not answer.success:
                return False, answer.message
        return True, said[-1]

    def close(self) -> None:
        self._closed = True
        self._recording.close()
        self._page.close()
