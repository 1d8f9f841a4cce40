# SPDX-License-Identifier: Apache-2.0
"""Every node reports what it dropped and what its callbacks raised."""

import pytest
from support.bench import Bench
from support.patience import spin_until

from tactile_skin.launch import launch
from tactile_skin.msg import Bool, DiagnosticArray
from tactile_skin.nodes import diagnostics


@pytest.fixture
def reports():
    """A bench, and what arrives on diagnostics as name -> status."""
    bench, found = Bench(), {}
    bench.node("listener", namespace="left").create_subscription(
        DiagnosticArray,
        "skin/diagnostics",
        lambda m: found.update({s.name: s for s in m.status}),
        10,
    )
    return bench, found


def values(status) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


def test_dropped_messages_and_callback_errors_are_among_the_values(reports):
    bench, found = reports
    node = bench.node("busy", namespace="left")

    def fail(message):
        raise RuntimeError("no such luck")

    node.create_subscription(Bool, "/news", fail, 2)
    diagnostics.ensure_reported(node)
    publisher = bench.node("source").create_publisher(Bool, "/news", 10)
    for _ in range(5):
        publisher.publish(Bool(True))
    bench.spin(1.0)
    assert values(found["left/busy"])["dropped"] == "3"
    bench.spin(1.0)
    assert values(found["left/busy"]) == {"dropped": "3", "callback_errors": "2"}
    assert found["left/busy"].level == diagnostics.OK


def test_a_node_that_reports_itself_reports_once(reports):
    node = reports[0].node("own", namespace="left")
    node.create_publisher(DiagnosticArray, "skin/diagnostics", 10)
    diagnostics.ensure_reported(node)
    assert len(node.publishers) == 1


@pytest.mark.live
def test_every_node_of_a_launch_reports_them():
    found = {}
    with launch(method="auto") as skin:
        skin.node.create_subscription(
            DiagnosticArray,
            "skin/diagnostics",
            lambda m: found.update({s.name: s for s in m.status}),
            100,
        )
        names = {"serial_driver", "compensation", "gesture_feature", "stop_on_push", "monitor"}
        spin_until(skin, lambda: set(found) >= names | {"user"}, lambda: found)
    for status in found.values():
        assert {"dropped", "callback_errors"} <= set(values(status))
