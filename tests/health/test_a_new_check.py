# SPDX-License-Identifier: Apache-2.0
"""A check is added in some lines, and said by the live skin, the page and the doctor."""

import numpy as np
import pytest
from support.damaged import Case

from tactile_skin import diagnose
from tactile_skin.findings.finding import WORDS, Finding, Kind, Words, at
from tactile_skin.health import monitor
from tactile_skin.health.doctor import readings
from tactile_skin.middleware.bus import Context, ManualClock, Node
from tactile_skin.msg import Header, Time, image
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.view.pictures import findings
from tactile_skin.view.snapshot import NodeStatus, Snapshot


class Corner:
    """Doubts row 1, column 2 of any frame."""

    def __init__(self, adc, threshold): ...

    def frame(self, seen): ...

    def findings(self):
        return [Finding(Kind.CONTACT, "new", **at((1, 2)))]

    def forget(self): ...


@pytest.fixture
def added(monkeypatch):
    monkeypatch.setattr(monitor, "CHECKS", [*monitor.CHECKS, Corner])
    new = [*readings.CHECKS, lambda seen, skip: Corner(None, 0).findings()]
    monkeypatch.setattr(readings, "CHECKS", new)
    monkeypatch.setitem(WORDS, ("contact", "new"), Words("{at}", "is new", "Look there"))


SAID = "row 1, column 2: is new. Look there"


def test_it_is_said_everywhere(added):
    node = Node("compensation", context=Context(clock=ManualClock()))
    skin = Compensation(node)
    samples = np.full((16, 16), 2624, np.uint16)
    skin.on_adc(image(samples, "16UC1", Header(Time(0, 1))))
    assert any(str(f) == f"{SAID}." for f in skin.skin.findings())
    status = NodeStatus(1, SAID, diagnostics.places((1,), (2,)))
    (marked,) = findings(Snapshot(nodes={"compensation": status}))
    assert (marked["rows"], marked["cols"]) == ([1], [2])
    case = Case(7, (), 40.0, shape=(8, 8))
    assert [str(f) for f in diagnose(case.frames, case.circuit, series=False)] == [f"{SAID}."]
