# SPDX-License-Identifier: Apache-2.0
"""Recordings come back as they were written, whole or cut off."""

import dataclasses
import inspect
import struct
import tracemalloc

import numpy as np
import pytest
import recorded

from tactile_skin import msg
from tactile_skin.errors import FileError
from tactile_skin.recording import Recording, Topic, cdr
from tactile_skin.recording.writer import Writer

pytest.importorskip("mcap")
pytest.importorskip("rosbags")
MESSAGES = [c for _, c in inspect.getmembers(msg, inspect.isclass) if dataclasses.is_dataclass(c)]


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda c: c.__name__)
def test_every_message_survives_cdr(kind):
    assert cdr.decode(kind, cdr.encode(kind())) == kind()


def test_readings_come_back_to_the_bit(tmp_path):
    frames = recorded.samples(35)
    found = Recording(recorded.write(tmp_path / "a.mcap", frames, {"notes": b"abc"}))
    np.testing.assert_array_equal(found.adc, frames)
    assert found.adc.dtype == np.uint16
    np.testing.assert_array_equal(found.stamps, [recorded.stamp(k) for k in range(35)])
    np.testing.assert_allclose(found.times, np.arange(35) / 100.0, atol=1e-9)
    assert found.topics == {"/skin/adc": Topic("sensor_msgs/msg/Image", 35)}
    assert found.attachments == {"notes": b"abc"}
    assert found.damage == ""


def test_a_second_library_reads_the_same(tmp_path):
    """MCAP's own decoder of ROS 2 messages, and the reader of rosbags."""
    frames = recorded.samples(25)
    path = recorded.write(tmp_path / "a.mcap", frames)
    decoder = pytest.importorskip("mcap_ros2.decoder")
    from mcap.reader import make_reader

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        theirs = [m for *_, m in reader.iter_decoded_messages()]
    read = [np.frombuffer(m.data, "<u2").reshape(m.height, m.width) for m in theirs]
    np.testing.assert_array_equal(read, frames)

    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as bag:
        read = [
            bag.deserialize(raw, c.msgtype).data.view("<u2").reshape(4, 5)
            for c, _, raw in bag.messages()
        ]
    np.testing.assert_array_equal(read, frames)


def test_every_cut_is_read_or_refused(tmp_path):
    """Never another exception, and never a reading that was not there."""
    frames = recorded.samples(12)
    path = recorded.write(tmp_path / "a.mcap", frames, chunk=3)
    data = path.read_bytes()
    for end in range(0, len(data), 7):
        path.write_bytes(data[:end])
        try:
            found = Recording(path)
            n = len(found.adc)
        except FileError as error:
            assert str(path) in str(error)
            continue
        np.testing.assert_array_equal(found.adc, frames[:n])
        assert 12 * end / len(data) - 4 < n
        assert "ends without an index" in found.damage or end == len(data)


def test_a_damaged_chunk_is_left_out_and_named(tmp_path):
    frames = recorded.samples(100)
    path = recorded.write(tmp_path / "a.mcap", frames)
    data = bytearray(path.read_bytes())
    from mcap.reader import make_reader

    with path.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[4]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    path.write_bytes(data)
    found = Recording(path)
    assert len(found.adc) == 90
    assert found.damage == "1 damaged chunks are left out"
    kept = [any(np.array_equal(f, g) for g in found.adc) for f in frames]
    assert sum(kept) == 90


@pytest.mark.ci
def test_an_index_that_is_damaged_is_done_without(tmp_path):
    frames = recorded.samples(100)
    path = recorded.write(tmp_path / "a.mcap", frames)
    data = path.read_bytes()
    for k in range(len(data) - 300, len(data)):
        path.write_bytes(data[:k] + bytes([data[k] ^ 0xFF]) + data[k + 1 :])
        try:
            found = Recording(path)
            np.testing.assert_array_equal(found.adc, frames)
        except FileError as error:
            assert str(path) in str(error)


def test_a_record_that_claims_more_than_the_file_takes_no_memory(tmp_path):
    """A length that lost power in the middle of it may be any: what comes before is read."""
    path = recorded.write(tmp_path / "a.mcap", recorded.samples(12), chunk=3, close=False)
    with path.open("ab") as file:
        file.write(b"\x05" + struct.pack("<Q", 2**31) + bytes(22))  # a message
    tracemalloc.start()
    found = Recording(path)
    assert len(found.adc) == 12
    assert "ends without an index: its last 31 bytes are no" in found.damage
    assert tracemalloc.get_traced_memory()[1] < 2**27  # bytes
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "is empty"),
        (b"SQLite format 3\0", "is no MCAP file"),
        (b"\x89MCAP1\r\n" + bytes(100), "version of MCAP is b'1'"),
        (b"\x89MCAP0\r\n", "holds no message: it ends without an index"),
        (
            b"\x89MCAP0\r\n\x05" + struct.pack("<Q", 2**60),
            "holds no message: it ends without an index: its",
        ),
    ],
)
def test_foreign_and_future_files_are_refused(tmp_path, data, said):
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with pytest.raises(FileError, match=said) as caught:
        _ = Recording(path).adc
    assert str(path) in str(caught.value)


def test_types_that_are_not_known_are_listed_and_passed_over(tmp_path):
    path = recorded.write(tmp_path / "a.mcap", recorded.samples(3))

    class Later:
        TYPE = "std_msgs/msg/Char"

    writer = Writer(tmp_path / "b.mcap", {}, 0)
    writer.write("/later", Later, 5, b"\0\1\0\0\1\0\0\0\0")
    message = recorded.adc_image(recorded.samples(1)[0], 7)
    writer.write("/skin/adc", msg.Image, 7, cdr.encode(message))
    writer.close()
    found = Recording(path.with_name("b.mcap"))
    assert found.topics["/later"] == Topic("std_msgs/msg/Char", 1)
    assert [topic for topic, _, _ in found.messages()] == ["/skin/adc"]


@pytest.mark.parametrize("close", [True, False], ids=["with an index", "cut off"])
def test_messages_of_a_channel_that_is_not_declared_are_left_out_and_named(tmp_path, close):
    frames = recorded.samples(20)
    path = recorded.write(tmp_path / "a.mcap", frames, close=False)
    writer = Writer(tmp_path / "b.mcap", {}, 0)
    for k, frame in enumerate(frames):
        data = cdr.encode(recorded.adc_image(frame, recorded.stamp(k)))
        writer.write("/skin/adc", msg.Image, recorded.stamp(k), data)
        if k % 4 == 0:
            writer._writer.add_message(99, k, data, k)
    writer.close() if close else writer.flush()
    found = Recording(path.with_name("b.mcap"))
    np.testing.assert_array_equal(found.adc, frames)
    said = "5 messages of channel 99, not declared, are left out"
    assert said in found.damage
    assert len(list(found.messages())) == 20


@pytest.mark.parametrize(
    ("attached", "said"),
    [
        ("/compensation: {x: 1}", "/compensation = {'x': 1}: must hold ros__parameters"),
        ("/compensation: {ros__parameters: null}", "ros__parameters': None}: must hold"),
        ("/compensation: 5", "/compensation = 5: must hold ros__parameters"),
        ("[1, 2]", r"holds \[1, 2\]: must map node names to ros__parameters"),
        ("", "holds None: must map"),
        (b"\xff\xfe\xfd", "parameters.yaml: "),
        ("/compensation: {ros__parameters: {weights: [1]}}", "weights = \\[1\\]: must be"),
    ],
)
def test_parameters_that_are_damaged_are_refused_by_name(tmp_path, attached, said):
    data = attached if isinstance(attached, bytes) else attached.encode()
    path = recorded.write(tmp_path / "a.mcap", recorded.samples(2), {"parameters.yaml": data})
    with pytest.raises(FileError, match=said) as caught:
        _ = Recording(path).parameters
    assert str(path) in str(caught.value)


def test_a_size_that_changes_is_refused(tmp_path):
    frames = [*recorded.samples(2), *recorded.samples(2, 3, 4)]
    with pytest.raises(FileError, match="size changes from 4 x 5 to 3 x 4"):
        _ = Recording(recorded.write(tmp_path / "a.mcap", frames)).adc


def test_a_file_that_is_there_is_not_overwritten(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileError, match="is there already"):
        Writer(path, {}, 0)
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("close", [True, False])
def test_a_part_is_read_from_its_chunks_alone(tmp_path, close, monkeypatch):
    frames = recorded.samples(400)
    path = recorded.write(tmp_path / "a.mcap", frames, close=close)
    found, read, library = Recording(path), [], cdr.mcap().stream_reader
    breakup = library.breakup_chunk
    monkeypatch.setattr(
        library, "breakup_chunk", lambda *a, **k: read.append(1) or breakup(*a, **k)
    )
    begin, end = recorded.stamp(205), recorded.stamp(215)
    part = [t for _, t, _ in found.messages(begin=begin, end=end)]
    assert part == [recorded.stamp(k) for k in range(205, 215)]
    assert len(read) == 2  # of 40
    assert list(found.messages(begin=recorded.stamp(500))) == []
    assert len(found.adc) == 400
