# SPDX-License-Identifier: Apache-2.0
"""The node gesture_feature: its clouds, as any subscriber reads them."""

from collections import defaultdict

import numpy as np
import pytest
from support.bench import Bench

from tactile_skin.behaviours.stop import Decision
from tactile_skin.msg import (
    Float32,
    Image,
    PointCloud2,
    Vector3Stamped,
    WrenchStamped,
    cloud_columns,
    image,
)
from tactile_skin.nodes.gesture_feature import CONTACT, GestureFeature
from tactile_skin.nodes.observers.latest import Latest
from tactile_skin.nodes.stop_on_push import Decisions
from tactile_skin.nodes.touch import xyz
from tactile_skin.simulation.scenes import finger

CELL_AREA = 1.44e-4  # m^2


class Skin(Bench):
    """The node alone, fed with forces a hundred times a second."""

    def __init__(self, **parameters):
        super().__init__()
        self.seen = defaultdict(list)
        given = {f"geometry.{key}": value for key, value in parameters.items()}
        self.handle, observer = self.node("gesture_feature", given), self.node("observer")
        for kind, topic in (
            (PointCloud2, "skin/contacts"),
            (Vector3Stamped, "skin/stroke"),
            (Float32, "skin/stroke_confidence"),
        ):
            observer.create_subscription(kind, topic, self.seen[topic].append, 10)
        GestureFeature(self.handle)
        self.pressure = observer.create_publisher(Image, "skin/pressure", 10)

    def feel(self, force) -> None:
        self.clock.advance(0.01)
        self.pressure.publish(image(force / CELL_AREA, "32FC1", self.header()))
        self.executor.spin_some()
        assert self.handle.callback_errors == 0

    def contacts(self):
        return cloud_columns(self.seen["skin/contacts"][-1])


NOTHING = np.zeros((16, 16))


def test_without_a_shape_a_push_has_a_force_and_no_vector():
    """NaN, also of none: 0 would say that it is known, and that nothing pushes."""
    skin = Skin(shape="unknown")
    heard = defaultdict(list)
    hear = skin.node("hear").create_subscription
    hear(WrenchStamped, "skin/wrench", heard["wrench"].append, 10)
    hear(Vector3Stamped, "skin/push_direction", heard["direction"].append, 10)
    for force in (NOTHING, finger(16, 16, 7.5, 3.0, 5.0)):
        skin.feel(force)
        wrench, way = heard["wrench"][-1].wrench, heard["direction"][-1].vector
        assert np.isnan([xyz(wrench.force), xyz(wrench.torque), xyz(way)]).all()
    assert skin.contacts()["force"] == pytest.approx(5.0, rel=0.03)


def test_the_latest_snapshot_is_of_one_reading_and_has_the_stop_of_now():
    skin = Skin(shape="unknown")
    latest = Latest(skin.node("latest"), ["/skin/stop_status"])
    decisions = Decisions(skin.node("stop_on_push"))
    std = skin.node("compensation").create_publisher(Image, "skin/pressure_std", 10)
    force = finger(16, 16, 7.5, 3.0, 5.0)
    skin.feel(force)
    assert latest.snapshot() is None  # its std is on its way
    std.publish(image(NOTHING + 2.0, "32FC1", skin.header()))
    skin.feel(2.0 * force)
    skin.executor.spin_some()
    found = latest.snapshot()
    assert found.stop and found.reason == "waiting: no message from the stop yet"
    np.testing.assert_allclose(found.pressure, force / CELL_AREA, rtol=1e-6)
    assert (found.std == 2.0).all() and found.force == pytest.approx(5.0, rel=0.03)
    assert found.bound >= found.force and found.contacts["force"].sum() == found.force
    assert np.isnan(found.wrench).all()
    with pytest.raises(AttributeError):
        found.force = 0.0
    with pytest.raises(ValueError, match="read-only"):
        found.wrench[0] = 0.0
    decisions.publish(Decision(False, "", ()), {"good_for": "0.1"}, skin.header(), final=False)
    skin.executor.spin_some()
    assert not latest.snapshot().stop
    skin.clock.advance(1.0)  # "free" is over
    assert latest.snapshot().stop and latest.snapshot().stamp == found.stamp


def test_a_contact_has_its_place_force_id_velocity_and_state():
    skin = Skin()
    skin.feel(NOTHING)
    skin.feel(finger(16, 16, 7.5, 3.0, 5.0))
    first = skin.contacts()
    assert list(first) == list(CONTACT)
    assert first["state"] == 0
    for k in range(20):
        skin.feel(finger(16, 16, 7.5, 3.0 + 0.2 * k, 5.0))
    now = skin.contacts()
    assert now["id"] == first["id"] == 1
    assert now["state"] == 1
    assert now["force"] == pytest.approx(5.0, rel=0.03)
    assert now["y"] == pytest.approx((3.0 + 0.2 * 19 - 7.5) * 0.018, abs=5e-4)
    assert now["vy"] == pytest.approx(0.2 * 0.018 / 0.01, rel=0.03)
    assert now["vx"] == pytest.approx(0.0, abs=1e-3)
    assert now["vz"] == pytest.approx(0.0, abs=1e-3)
    stroke = skin.seen["skin/stroke"][-1].vector
    assert stroke.y == pytest.approx(float(now["vy"][0]), abs=1e-6)
    assert skin.seen["skin/stroke_confidence"][-1].data > 0.9


def test_a_released_touch_is_no_point():
    """What takes points for obstacles must not see one where nothing is."""
    skin = Skin()
    for _ in range(11):
        skin.feel(finger(16, 16, 5.0, 5.0, 5.0))
    assert skin.contacts()["state"] == 1
    for _ in range(10):
        skin.feel(NOTHING)
        assert skin.seen["skin/contacts"][-1].width == 0


def test_a_table_of_cells_is_a_geometry(tmp_path):
    """A cover measured cell by cell: here a plane that faces left."""
    lines = ["row,col,x,y,z,nx,ny,nz"]
    lines += [f"{r},{c},{-0.02 * c},0.3,{-0.02 * r},0,1,0" for r in range(16) for c in range(16)]
    table = tmp_path / "cover.csv"
    table.write_text("\n".join(lines))
    skin = Skin(shape="table", table=str(table))
    skin.feel(finger(16, 16, 5.0, 8.0, 5.0))
    found = skin.contacts()
    place = [float(found[name][0]) for name in "xyz"]
    np.testing.assert_allclose(place, [-0.16, 0.3, -0.1], atol=1e-3)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_a_pressure_that_is_none_gives_no_contacts(bad):
    """And so, as nothing is said, a stop."""
    skin = Skin()
    skin.feel(NOTHING)
    with pytest.raises(AssertionError):
        skin.feel(np.full((16, 16), bad))
    assert skin.handle.callback_errors == 1
    assert len(skin.seen["skin/contacts"]) == 1
