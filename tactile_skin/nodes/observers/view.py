# SPDX-License-Identifier: Apache-2.0
"""view: what a skin, or each of a body, sees and says, in the browser (tactile_skin/view)."""

from __future__ import annotations

import functools
import math
import threading
import time
from dataclasses import replace

from ...errors import LaunchError
from ...fields import leaves
from ...middleware.config import adc_of, circuit_of, curve_of, declared, geometry_of
from ...middleware.plan import parameters_of
from ...middleware.written import own_sections
from ...msg import Trigger
from ...parameters.nodes import View as Parameters
from ...parameters.shared import SkinDescription
from ...view.process import DESCRIBE, PageProcess, ToPage
from ...view.snapshot import DIAGNOSTICS, OTHERS, READINGS, STOP, Collector
from .. import READING, now
from .page_recording import RECORDS, PageRecording

_QUIET = 0.1  # s after which a page is told that nothing changed
_UNHEARD = 1.0  # s without a message of the stop, which comes every 0.02 s: nobody says then
_ANSWER = 1.0  # s that a service has for its answer
_AFTER = 0.001  # s after a decision: those who stop the robot go first
# What a page may ask for, if it may -> the services that are called, in turn.
_CALLS = {
    "tare": ("compensation/tare",),
    "reset": ("compensation/reset", "stop_on_push/reset"),
    "lend": ("serial_driver/lend",),
    DESCRIBE: (),
    **dict.fromkeys(RECORDS, ()),
}
_OF_BODY: dict[str, tuple[str, ...]] = {"reset": ("body/reset",)}


def _calls(name: str, several: bool) -> dict[str, tuple[str, ...]]:
    """Return what the page of a skin, or of the body, may ask for."""
    if several and not name:
        return _OF_BODY
    space = f"{name}/" if name else ""
    return {what: tuple(f"{space}{s}" for s in services) for what, services in _CALLS.items()}


class View:
    """Serves the page from a process of its own; of a body one for each skin, and one of all.

    A page that lags, or hangs, loses snapshots and keeps nobody waiting.

    Attributes:
        skins: name -> what is shown of it; the name of one alone, and of the body, is empty.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        names = [name for name in given.skins if name]
        said = {"": given} | {name: declared(node, SkinDescription, f"{name}.") for name in names}
        for skin in said.values():
            circuit = circuit_of(skin.circuit)  # what is wrong is an error now
            adc_of(skin.circuit, circuit), curve_of(skin.curve, circuit)
            geometry_of(skin.geometry, circuit)
        parameters = {name: self._parameters(f"{name}." if name else "") for name in said}
        calls = {name: _calls(name, bool(names)) if given.controls else {} for name in said}
        clients = {name: self._clients(services) for name, services in calls.items()}
        self._closed = False
        self._page = PageProcess(given.host, given.port, given.controls, parameters)
        self.skins = {
            name: ShownSkin(node, name, to_page, clients[name], parameters[name], bool(names))
            for name, to_page in self._page.skins.items()
        }
        node.create_timer(_QUIET, self._show)
        for skin in self.skins.values():
            threading.Thread(target=self._obey, args=(skin,), daemon=True).start()
        node.get_logger().info("the skin in a browser: %s", self._page.address)

    def _parameters(self, prefix: str) -> dict:
        """Return what a skin is, name -> value."""
        get = self.node.get_parameter
        return {leaf.name: get(prefix + leaf.name).value for leaf in leaves(SkinDescription)}

    def _clients(self, calls: dict) -> dict[str, list]:
        try:
            return {
                name: [self.node.create_client(Trigger, service) for service in services]
                for name, services in calls.items()
            }
        except NotImplementedError:
            raise LaunchError(
                "view: controls = true: not on ROS: call the services ~/tare and ~/reset there"
            ) from None

    def _show(self) -> None:
        for skin in self.skins.values():
            skin.show()

    def _obey(self, skin: ShownSkin) -> None:
        """In a thread of its own: what the pages of a skin ask for."""
        skin.obey()
        if not self._closed:
            self._closed = True
            self.node.get_logger().error("the page's process has ended; the skin goes on")

    def close(self) -> None:
        self._closed = True
        for skin in self.skins.values():
            skin.recording.close()
        self._page.close()


class ShownSkin:
    """Hands the page the newest of each topic of a skin, or of the body.

    Once a reading, after the stop's decision, and nothing while no page shows it.

    Args:
        name: of the skin; empty: of one alone, or of the body.
        clients: what a page may ask for -> the services that are called, in turn.
        parameters: of the skin, name -> value.
        several: whether it is one of a body's, or the body.
    """

    def __init__(
        self, node, name: str, page: ToPage, clients: dict, parameters: dict, several: bool
    ):
        self.node, self.page, self._clients = node, page, clients
        readings, others = READINGS, OTHERS
        if several and not name:
            readings, others = {}, {topic: OTHERS[topic] for topic in (STOP, DIAGNOSTICS)}
        space = f"{name}/" if name else ""
        self.recording = PageRecording(node, space)
        self._collector = Collector()
        self._stop_at = -math.inf  # s, when its stop was heard last
        self._sent = 0.0, 0.0  # stamp of the last snapshot, and when it was sent
        self._readings = {
            topic: node.create_listener(
                kind, f"{space}{topic}", None, replace(READING, depth=count)
            )
            for topic, (kind, count) in readings.items()
        }
        for topic, (kind, qos) in others.items():
            take = functools.partial(self._take, topic)
            node.create_subscription(kind, f"{space}{topic}", take, qos)

    def _take(self, topic: str, message) -> None:
        self._collector.take(topic, message)
        if topic == STOP:
            self._stop_at = time.monotonic()
            if self.page.watched:
                time.sleep(_AFTER)
                self.show()

    def show(self) -> None:
        """Send what there is, unless it was sent just now."""
        if not self.page.watched:
            return
        for topic, listener in self._readings.items():
            for message in listener.take():
                self._collector.take(topic, message)
        snapshot, t = self._collector.snapshot(), time.monotonic()
        stamp, at = self._sent
        if snapshot.stamp == stamp and t - at < _QUIET:
            return
        self._sent = snapshot.stamp, t
        if not self._readings:  # the body's, which is of now
            snapshot = replace(snapshot, stamp=now(self.node))
        if t - self._stop_at > _UNHEARD:
            snapshot = replace(snapshot, stop=None)
        if snapshot.stamp:  # else nothing has been read yet
            snapshot = replace(snapshot, read_at=t - (now(self.node) - snapshot.stamp))
        self.page.show(snapshot)

    def obey(self) -> None:
        """Do what the pages ask for, until their process ends."""
        for name in self.page.requests():
            self.page.answer(name, *self._call(name), self.recording.take())

    def _call(self, name: str) -> tuple[bool, str]:
        if name not in self._clients:
            return False, "controls are off: launch with view_controls:=true"
        if name == DESCRIBE:
            return True, own_sections(parameters_of(self.node.context, self.recording.space))
        if name in RECORDS:
            return self.recording.ask(name)
        said = []
        for client in self._clients[name]:
            try:
                answer = client.call(Trigger.Request(), _ANSWER)
            except Exception as error:
                return False, f"{name}: {error}"
            said.append(answer.message)
            if not answer.success:
                return False, answer.message
        return True, said[-1]
