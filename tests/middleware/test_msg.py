# SPDX-License-Identifier: Apache-2.0
"""The messages are ROS's own, and arrays go in and out of them unchanged."""

import dataclasses
import inspect
import typing

import numpy as np
import pytest

from tactile_skin import msg

HEADER = msg.Header(msg.Time(12, 34), "base_link")
MESSAGES = [c for _, c in inspect.getmembers(msg, inspect.isclass) if dataclasses.is_dataclass(c)]


# --- images ---


@pytest.mark.parametrize(("encoding", "dtype"), [("16UC1", np.uint16), ("32FC1", np.float32)])
def test_image_round_trip(encoding, dtype):
    array = np.arange(12).reshape(3, 4).astype(dtype)
    made = msg.image(array, encoding, HEADER)
    assert (made.height, made.width, made.encoding) == (3, 4, encoding)
    assert made.step == 4 * array.itemsize
    assert made.is_bigendian == 0
    assert made.header is HEADER
    np.testing.assert_array_equal(msg.image_array(made), array)


def test_image_rows_stand_one_after_the_other():
    """Also those of an array that lies differently in memory."""
    array = np.arange(6, dtype=np.uint16).reshape(2, 3)
    assert msg.image(array, "16UC1", HEADER).data == bytes([0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0])
    np.testing.assert_array_equal(msg.image_array(msg.image(array.T, "16UC1", HEADER)), array.T)


def test_big_endian_images_are_read():
    """As a bag of another machine may hold them."""
    array = np.array([[1, 2], [300, 65_535]], dtype=np.uint16)
    made = msg.image(array, "16UC1", HEADER)
    made.is_bigendian, made.data = 1, array.astype(">u2").tobytes()
    np.testing.assert_array_equal(msg.image_array(made), array)


def test_an_image_read_is_read_only():
    """Its data is shared by all subscribers."""
    array = msg.image_array(msg.image(np.zeros((2, 2)), "32FC1", HEADER))
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0


@pytest.mark.parametrize("encoding", ["mono8", "", "16uc1", "64FC1"])
def test_unknown_encodings_are_refused(encoding):
    with pytest.raises(ValueError, match=f"{encoding!r}: must be one of 16UC1, 32FC1"):
        msg.image_array(msg.Image(HEADER, 1, 1, encoding, 0, 2, b"ab"))


@pytest.mark.parametrize("size", [0, 11, 13, 24])
def test_data_of_another_size_is_refused(size):
    made = msg.Image(HEADER, 2, 3, "16UC1", 0, 6, bytes(size))
    with pytest.raises(ValueError, match=f"2 x 3 16UC1 holds {size} bytes"):
        msg.image_array(made)


# --- point clouds ---


@pytest.mark.parametrize("n", [0, 1, 5])
def test_cloud_round_trip(n):
    columns = {
        name: np.arange(n, dtype=np.float32) + k for k, name in enumerate(["x", "y", "z", "force"])
    }
    made = msg.cloud(columns, HEADER)
    assert (made.height, made.width, made.point_step, made.row_step) == (1, n, 16, 16 * n)
    assert made.is_dense
    read = msg.cloud_columns(made)
    assert list(read) == list(columns)
    for name, column in columns.items():
        np.testing.assert_array_equal(read[name], column)
    assert list(msg.cloud_columns(made, "force", "y")) == ["y", "force"]


def test_cloud_fields_say_where_each_value_is():
    """A reader that knows only PointCloud2 finds every value by its field's offset."""
    made = msg.cloud({"x": np.array([1.0, 2.0]), "force": np.array([3.0, 4.0])}, HEADER)
    assert [(f.name, f.offset, f.datatype, f.count) for f in made.fields] == [
        ("x", 0, msg.PointField.FLOAT32, 1),
        ("force", 4, msg.PointField.FLOAT32, 1),
    ]
    second_force = made.data[made.point_step + 4 : made.point_step + 8]
    assert np.frombuffer(second_force, "<f4") == 4.0


def test_columns_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        msg.cloud({"x": np.zeros(2), "y": np.zeros(3)}, HEADER)


# --- definitions ---


def test_each_message_has_its_own_default_parts():
    """Two messages do not share the header that both start with."""
    first, second = msg.WrenchStamped(), msg.WrenchStamped()
    first.header.frame_id = "base_link"
    first.wrench.force.x = 1.0
    assert second.header.frame_id == ""
    assert second.wrench.force.x == 0.0


@pytest.fixture(scope="module")
def humble():
    """ROS 2 Humble's message definitions: {name: (constants, fields)}."""
    typesys = pytest.importorskip("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).fielddefs


def python_type(definition):
    """What a field of ROS's definition is in Python, as msg.py spells it."""
    from rosbags.interfaces import Nodetype

    kind, detail = definition
    if kind == Nodetype.BASE:
        name = detail[0]
        if name == "string":
            return str
        return {"bool": bool, "float32": float, "float64": float}.get(name, int)
    if kind == Nodetype.NAME:
        return detail
    inner = detail[0]
    if inner[0] == Nodetype.BASE and inner[1][0] in ("uint8", "byte", "octet"):
        return bytes
    return [python_type(inner)]


def python_type_here(annotation):
    if hasattr(annotation, "TYPE"):
        return annotation.TYPE
    if typing.get_origin(annotation) is list:
        return [python_type_here(typing.get_args(annotation)[0])]
    return annotation


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_fields_are_those_of_ros(message, humble):
    """Names, order and types; byte and uint8 are int here."""
    _, fields = humble[message.TYPE]
    hints = typing.get_type_hints(message)
    ours = [(f.name, python_type_here(hints[f.name])) for f in dataclasses.fields(message)]
    assert ours == [(name, python_type(definition)) for name, definition in fields]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_constants_are_those_of_ros(message, humble):
    constants, _ = humble[message.TYPE]
    ours = {k: v for k, v in vars(message).items() if k.isupper() and k != "TYPE"}
    theirs = {name: value for name, _, value in constants}
    assert {k: theirs.get(k) for k in ours} == ours


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.__name__)
def test_defaults_have_the_type_of_their_field(message):
    hints = typing.get_type_hints(message)
    made = message()
    for f in dataclasses.fields(message):
        expected = typing.get_origin(hints[f.name]) or hints[f.name]
        assert type(getattr(made, f.name)) is expected


def test_the_service_is_ross_own():
    """std_srvs/srv/Trigger, whose definition is an empty request and these two lines."""
    typesys = pytest.importorskip("rosbags.typesys")
    (fields,) = typesys.get_types_from_msg(
        "bool success # indicate successful run of triggered service\n"
        "string message # informational, e.g. for error messages\n",
        "std_srvs/msg/Trigger",
    ).values()
    hints = typing.get_type_hints(msg.Trigger.Response)
    ours = [(f.name, hints[f.name]) for f in dataclasses.fields(msg.Trigger.Response)]
    assert ours == [(name, python_type(definition)) for name, definition in fields[1]]
    assert not dataclasses.fields(msg.Trigger.Request)
    assert msg.Trigger.TYPE == "std_srvs/srv/Trigger"
