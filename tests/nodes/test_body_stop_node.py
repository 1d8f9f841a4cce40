# SPDX-License-Identifier: Apache-2.0
"""The stops of two skins and of their body, on a clock that is driven: what lies on both, and a
body that lags.
"""

import pytest
from support.bench import Bench

from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    PointCloud2,
    Vector3,
    Wrench,
    WrenchStamped,
    cloud_columns,
    cloud_of,
)
from tactile_skin.nodes import diagnostics, now
from tactile_skin.nodes.body import Body
from tactile_skin.nodes.gesture_feature import CONTACT
from tactile_skin.nodes.observers.touch_events import PushListener
from tactile_skin.nodes.stop_on_push import STATUS, STATUS_TOPIC, StopOnPush
from tactile_skin.touch.events import Pushed, Released

NAMES = "chest", "back"
MAY_BE = 4.0 / 3.0  # times what is felt that a touch may be
FORCE = 12.0  # N, on each skin: a quarter of it on each of four cells
WAITING = 30  # frames that each skin has published before the body reads one


class TwoSkins(Bench):
    """Stops that hear contacts and diagnostics, and the body that hears the stops."""

    def __init__(self, more: float = 1.0):
        super().__init__()
        self._more = more  # times what is felt that a touch may be
        given: dict = {"skins": list(NAMES)}
        for x, name in enumerate(NAMES):
            given[f"{name}.geometry.shape"] = "plane"
            given[f"{name}.geometry.translation"] = [float(x), 0.0, 0.0]
            StopOnPush(self.node("stop_on_push", namespace=name))
        self.body = Body(self.node("body", given))
        others = self.node("others")
        self._contacts, self._wrenches = (
            [others.create_publisher(kind, f"/{name}/skin/{topic}", 10) for name in NAMES]
            for kind, topic in ((PointCloud2, "contacts"), (WrenchStamped, "wrench"))
        )
        self.reason = ""
        others.create_subscription(DiagnosticArray, STATUS_TOPIC, self._on_status, STATUS)

    def _on_status(self, message: DiagnosticArray) -> None:
        self.reason = message.status[0].message

    def publish(self, newton: float, peak: float) -> None:
        """One frame of each skin."""
        most = self._more * newton
        touch = (0.0, 0.0, 0.0, newton, 1e-3, peak, 1.0, 0.0, 0.0, 0.0, 1.0, most, peak)
        force = Wrench(Vector3(-float(newton), 0.0, 0.0))
        for contacts, wrench in zip(self._contacts, self._wrenches, strict=True):
            contacts.publish(cloud_of(CONTACT, [touch] if newton else [], self.header()))
            wrench.publish(WrenchStamped(self.header(), force))

    def lies_on_both(self, newton: float, peak: float) -> None:
        """For half a second."""
        for _ in range(50):
            self.publish(newton, peak)
            self.spin(0.01)


@pytest.mark.parametrize(("more", "reason"), [(1.0, ""), (MAY_BE, "back and chest: push")])
def test_a_push_on_two_skins_counts_as_what_it_may_be(more, reason):
    """24 N as measured; 32 N if something that nobody has excluded hides a quarter."""
    skins = TwoSkins(more)
    skins.lies_on_both(0.0, 0.0)
    assert skins.reason == ""
    skins.lies_on_both(FORCE, FORCE / 4)
    assert skins.reason == reason
    skins.lies_on_both(0.0, 0.0)
    assert skins.reason == ""


@pytest.mark.parametrize("newton", [16.0, 40.0])
def test_a_push_on_two_skins_is_one_for_the_hooks(newton):
    """It is none for the skins if each has 16 N, and one for each if each has 40 N."""
    skins, events = TwoSkins(), []
    PushListener(skins.node("hook"), events.append)
    skins.lies_on_both(0.0, 0.0)
    skins.lies_on_both(newton, 5.0)
    assert [type(event) for event in events] == [Pushed]
    assert events[0].force == pytest.approx([-2.0 * newton, 0.0, 0.0])
    skins.lies_on_both(0.0, 0.0)
    assert [type(event) for event in events] == [Pushed, Released]
    assert events[1].seconds == pytest.approx(0.5 + skins.body.stop.config.hold, abs=0.05)


def test_a_skin_whose_stop_says_no_more_than_that_it_stops_stops_the_body():
    skins = TwoSkins()
    skins.lies_on_both(0.0, 0.0)
    halt = DiagnosticStatus(diagnostics.ERROR, "stop of one's own", "halt", "", [])
    skins.body.on_status("chest", DiagnosticArray(skins.header(), [halt]))
    assert skins.body.stop.decide(now(skins.body.node)).reason == "chest: halt"


def test_a_body_that_lags_reads_the_newest_of_each_skin_and_no_older_ones():
    skins, contacts, wrenches = TwoSkins(), [], []
    skins.body.node.create_listener(PointCloud2, "/skin/contacts", contacts.append)
    skins.body.node.create_listener(WrenchStamped, "/skin/wrench", wrenches.append)
    for newton in range(1, WAITING + 1):
        skins.clock.advance(0.01)
        skins.publish(newton, newton)
    skins.spin()
    (message,) = wrenches
    assert message.wrench.force.x == -WAITING  # of the skin that comes first
    (message,) = contacts
    assert cloud_columns(message, "force")["force"].tolist() == [WAITING]
