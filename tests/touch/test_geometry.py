# SPDX-License-Identifier: Apache-2.0
"""Cells sit and face where REP 103 puts them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_skin.touch.geometry import make_geometry


def test_a_plane_faces_forward_and_is_centred():
    geometry = make_geometry("plane", 3, 5, pitch=0.02)
    np.testing.assert_allclose(geometry.position.mean((0, 1)), 0.0, atol=1e-12)
    np.testing.assert_allclose(geometry.position[0, 0], [0.0, -0.04, 0.02])  # top, robot's right
    np.testing.assert_allclose(geometry.normal, np.broadcast_to([1.0, 0.0, 0.0], (3, 5, 3)))


def test_a_cylinder_keeps_pitch_and_radius():
    geometry = make_geometry("cylinder", 4, 9, pitch=0.018, radius=0.15)
    np.testing.assert_allclose(np.linalg.norm(geometry.position[..., :2], axis=-1), 0.15)
    arc = 0.15 * np.arccos(np.sum(geometry.normal[0, 0] * geometry.normal[0, 1]))
    assert arc == pytest.approx(0.018)
    np.testing.assert_allclose(np.linalg.norm(geometry.normal, axis=-1), 1.0)
    assert geometry.normal[0, -1, 1] > 0.4  # high columns face the robot's left


def test_a_sphere_keeps_the_distances_from_its_middle():
    geometry = make_geometry("sphere", 5, 9, pitch=0.018, radius=0.1)
    np.testing.assert_allclose(np.linalg.norm(geometry.position, axis=-1), 0.1)
    np.testing.assert_allclose(geometry.position, 0.1 * geometry.normal)
    np.testing.assert_allclose(geometry.normal[2, 4], [1.0, 0.0, 0.0])
    arc = 0.1 * np.arccos(geometry.normal[..., 0])
    flat = np.hypot(*np.meshgrid((np.arange(9) - 4) * 0.018, (np.arange(5) - 2) * 0.018))
    np.testing.assert_allclose(arc, flat, atol=1e-9)
    assert geometry.normal[2, -1, 1] > 0.5  # high columns face the robot's left,
    assert geometry.normal[0, 4, 2] > 0.3  # row 0 up


@pytest.mark.parametrize("shape", ["plane", "cylinder", "sphere"])
def test_every_shape_is_flat_where_its_radius_is_large(shape):
    flat = make_geometry("plane", 4, 6)
    geometry = make_geometry(shape, 4, 6, radius=1e4, translation=(0.0, 0.0, 0.0))
    moved = geometry.position - geometry.position.mean((0, 1))
    np.testing.assert_allclose(moved, flat.position, atol=1e-6)
    np.testing.assert_allclose(geometry.normal, flat.normal, atol=1e-4)


def test_a_newton_on_a_cell_has_its_lever():
    geometry = make_geometry("cylinder", 3, 5, radius=0.2, translation=(0.1, 0.0, 0.5))
    lever = geometry.lever[1 * 5 + 3]
    position, normal = geometry.position[1, 3], geometry.normal[1, 3]
    expected = [*-normal, *np.cross(position, -normal), *position, 1.0]
    np.testing.assert_allclose(lever, expected)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"shape": "torus"}, "shape 'torus'"),
        ({"shape": "plane", "pitch": 0.0}, "pitch = 0.0"),
        ({"shape": "plane", "cell_area": float("nan")}, "cell_area = nan"),
        ({"shape": "plane", "rpy": (0.0, 1.0)}, "rpy = "),
        ({"shape": "plane", "rpy": (0.0, 0.0, -180.0)}, "must be at most 6.3 rad each"),
        ({"shape": "plane", "translation": (0.0, 0.0, 500.0)}, "must be at most 100 m each"),
        ({"shape": "cylinder", "radius": 0.01}, "do not fit around"),
        ({"shape": "sphere", "radius": 0.04}, "does not fit on a sphere"),
        ({"shape": "plane", "table": "cells.csv"}, "only with shape: table"),
        ({"shape": "table"}, "needs the name of a file"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        make_geometry(rows=4, cols=16, **kwargs)


# --- a table of cells ---

TABLE = """\
# measured with a caliper, 2 x 2 cells
row,col,x,y,z,nx,ny,nz,area

0,0, 0.1, -0.01, 0.02, 2,0,0, 1e-4
0,1, 0.1, 0.01, 0.02, 1,1,0, 1e-4
1,0, 0.1, -0.01, 0.0, 1,0,-1, 1e-4
1,1, 0.1, 0.01, 0.0, 0,3,0, 2e-4
"""


@pytest.fixture
def table(tmp_path):
    """Write a table, get the geometry of 2 x 2 cells."""

    def make(text, **kwargs):
        path = tmp_path / "cells.csv"
        path.write_text(text)
        return make_geometry("table", 2, 2, table=path, **kwargs)

    return make


def test_a_table_says_where_each_cell_is(table):
    geometry = table(TABLE)
    np.testing.assert_allclose(geometry.position[1, 1], [0.1, 0.01, 0.0])
    np.testing.assert_allclose(geometry.normal[0, 0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(geometry.normal[0, 1], [0.5**0.5, 0.5**0.5, 0.0])
    np.testing.assert_allclose(geometry.cell_area, [[1e-4, 1e-4], [1e-4, 2e-4]])
    assert geometry.pitch == pytest.approx(0.02)


def test_a_table_has_a_pose_and_a_default_area(table):
    text = "\n".join(line.rsplit(",", 1)[0] for line in TABLE.splitlines())
    geometry = table(text, rpy=(0.0, 0.0, np.pi / 2), cell_area=3e-4)
    np.testing.assert_allclose(geometry.position[0, 0], [0.01, 0.1, 0.02])
    np.testing.assert_allclose(geometry.normal[0, 0], [0.0, 1.0, 0.0], atol=1e-12)
    assert (geometry.cell_area == 3e-4).all()


def test_a_table_leaves_out_cells_that_the_circuit_has_not(table):
    cells = np.array([[True, True], [True, False]])
    geometry = table("\n".join(TABLE.splitlines()[:-1]), cells=cells)
    assert not geometry.normal[1, 1].any()
    with pytest.raises(ValueError, match=r"line 7, .*: circuit\.mask has no such cell"):
        table(TABLE, cells=cells)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0,1, 0.1", "0,1, wide", r"cells.csv: line 5, .*wide.*: must be 9 numbers"),
        ("0,1, 0.1", "0,1, nan", "line 5, .*: x, y, z: must be at most 100 m"),
        ("1,1,0, 1e-4", "0,0,0, 1e-4", "line 5, .*: nx, ny, nz: must have"),
        ("0,3,0, 2e-4", "0,3,0, 0", "line 7, .*: area: must be above 0 and at most 1 m"),
        ("0,3,0, 2e-4", "0,3,0", "line 7, .*: must be 9 numbers"),
        ("1,1, 0.1", "2,1, 0.1", "line 7, .*: row, col: must be whole numbers below 2 and 2"),
        ("1,1, 0.1", "1,x, 0.1", "line 7, .*x.*: must be 9 numbers"),
        ("1,1, 0.1", "1,0, 0.1", "line 7, .*: the cell is given in line 6 already"),
        ("1,1, 0.1, 0.01, 0.0, 0,3,0, 2e-4\n", "", "row 1, col 1: no line for this cell"),
        ("nz,area", "nz,weight", "line 2: column names .*weight.: must be row,col,x"),
        ("row,col", "row,row", "line 2: column names"),
        (TABLE, "", "cells.csv: is empty"),
    ],
)
def test_a_table_that_is_wrong_is_refused_by_file_line_and_value(table, old, new, message):
    assert old in TABLE
    with pytest.raises(ValueError, match=message):
        table(TABLE.replace(old, new))


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -1.2, 2.0), (3.0, 1.0, -2.0)])
def test_roll_pitch_and_yaw_are_about_fixed_axes_in_turn(rpy):
    turned = make_geometry("sphere", 4, 5, rpy=rpy, translation=(1.0, 2.0, 3.0))
    before, rotation = make_geometry("sphere", 4, 5), Rotation.from_euler("xyz", rpy)
    for found, plain, at in (
        (turned.position, before.position, (1.0, 2.0, 3.0)),
        (turned.normal, before.normal, (0.0, 0.0, 0.0)),
    ):
        expected = rotation.apply(plain.reshape(-1, 3)) + at
        assert found.reshape(-1, 3) == pytest.approx(expected, abs=1e-15)
