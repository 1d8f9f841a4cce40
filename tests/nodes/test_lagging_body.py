# SPDX-License-Identifier: Apache-2.0
"""A body that lags, on a clock that is driven: it reads the newest of each skin."""

import pytest

from tactile_skin.middleware.bus import (
    Context,
    ManualClock,
    Node,
    Parameter,
    SingleThreadedExecutor,
)
from tactile_skin.msg import (
    Header,
    PointCloud2,
    Vector3,
    Wrench,
    WrenchStamped,
    cloud_columns,
    cloud_of,
)
from tactile_skin.nodes.body import Body
from tactile_skin.nodes.gesture_feature import CONTACT

NAMES = "chest", "back"
WAITING = 30  # frames that each skin has published before the body reads one


@pytest.fixture
def lagging():
    """Context and executor of a body of two skins, and what it publishes."""
    context, heard = Context(ManualClock()), []
    given: dict = {"skins": list(NAMES)}
    for x, name in enumerate(NAMES):
        given[f"{name}.geometry.shape"] = "plane"
        given[f"{name}.geometry.translation"] = [float(x), 0.0, 0.0]
    overrides = [Parameter(name, value) for name, value in given.items()]
    node = Node("body", context=context, parameter_overrides=overrides)
    body = Body(node)
    for kind, topic in ((PointCloud2, "/skin/contacts"), (WrenchStamped, "/skin/wrench")):
        node.create_tap(kind, topic, heard.append)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    yield context, executor, heard
    body.close()


def test_it_reads_the_newest_of_each_skin_and_no_older_ones(lagging):
    context, executor, heard = lagging
    skins = Node("skins", context=context)
    publishers = {
        name: (
            skins.create_publisher(PointCloud2, f"/{name}/skin/contacts", 10),
            skins.create_publisher(WrenchStamped, f"/{name}/skin/wrench", 10),
        )
        for name in NAMES
    }
    for newton in range(1, WAITING + 1):
        context.clock.advance(0.01)
        header = Header(context.clock.now().to_msg(), "base_link")
        touch = (0.0, 0.0, 0.0, newton, 1e-3, newton, 1.0, 0.0, 0.0, 0.0, 1.0)
        for contacts, wrench in publishers.values():
            contacts.publish(cloud_of(CONTACT, [touch], header))
            force = Wrench(Vector3(float(newton), 0.0, 0.0), Vector3())
            wrench.publish(WrenchStamped(header, force))
    executor.spin_some()
    (wrench,) = [message for message in heard if isinstance(message, WrenchStamped)]
    assert wrench.wrench.force.x == WAITING  # of the skin that comes first
    (contacts,) = [message for message in heard if isinstance(message, PointCloud2)]
    assert cloud_columns(contacts, "force")["force"].tolist() == [WAITING]
