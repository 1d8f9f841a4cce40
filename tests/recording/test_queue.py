# SPDX-License-Identifier: Apache-2.0
"""The recorder drops, counts and ends; it never blocks, and what is written stays readable."""

import errno
import gc
import time

import numpy as np
import pytest
import recorded
from support.patience import PATIENCE, Hang

pytest.importorskip("mcap")

from tactile_skin.errors import FileError
from tactile_skin.recording import Recording, writer
from tactile_skin.recording import recorder as module
from tactile_skin.recording.recorder import Limits, Recorder


class Clock:
    def __init__(self):
        self.t = recorded.START

    def __call__(self):
        return self.t


@pytest.fixture
def clock():
    return Clock()


def make(path, clock, **limits):
    """A recorder whose thread is not started: `turn` is called by the test."""
    return Recorder(path, Limits(**limits), {"notes": b"abc"}, clock)


def feed(recorder, clock, frames, rate=100.0, every=10):
    """Put the frames in their time, with a turn after each `every` of them."""
    for k, frame in enumerate(frames):
        recorder.put("/skin/adc", clock.t, recorded.adc_image(frame, clock.t))
        clock.t += round(1e9 / rate)
        if k % every == every - 1:
            recorder.turn()


def test_everything_is_recorded(tmp_path, clock):
    frames, path = recorded.samples(250), tmp_path / "a.mcap"
    recorder = make(path, clock)
    feed(recorder, clock, frames)
    recorder.turn(closing=True)
    found = Recording(path)
    np.testing.assert_array_equal(found.adc, frames)
    assert found.attachments == {"notes": b"abc"}
    assert (recorder.store.written, recorder.dropped, recorder.trouble) == (250, 0, "")
    assert recorder.store.files == [path]


def test_a_kill_loses_less_than_a_second(tmp_path, clock):
    """What the file holds before it is closed, at any time."""
    frames, path = recorded.samples(300), tmp_path / "a.mcap"
    recorder = make(path, clock)
    for k in range(0, 300, 10):
        feed(recorder, clock, frames[k : k + 10])
        found = Recording(path)
        n = len(found.adc) if found.topics else 0
        assert n > k + 10 - 70
        assert found.damage
    recorder.turn(closing=True)


def test_a_folder_gets_files_named_after_their_time(tmp_path, clock):
    recorder = make(f"{tmp_path}/made/", clock)
    feed(recorder, clock, recorded.samples(20))
    recorder.turn(closing=True)
    (path,) = (tmp_path / "made").iterdir()
    assert path.name.startswith("skin_2023-11-")
    assert len(Recording(path).adc) == 20


def test_a_name_without_a_suffix_is_a_file(tmp_path, clock):
    recorder = make(tmp_path / "touches", clock)
    feed(recorder, clock, recorded.samples(20))
    recorder.turn(closing=True)
    assert len(Recording(tmp_path / "touches.mcap").adc) == 20


@pytest.mark.parametrize(
    ("limits", "said"),
    [({"duration": 1.0}, "max_duration = 1 s"), ({"size": 20e3}, "max_size = 0.02 MB")],
)
def test_a_limit_ends_it_with_a_word(tmp_path, clock, limits, said):
    path = tmp_path / "a.mcap"
    recorder = make(path, clock, **limits)
    feed(recorder, clock, recorded.samples(1000))
    assert said in recorder.trouble
    found = Recording(path)
    assert found.damage == ""
    assert 50 < len(found.adc) < 400
    written = recorder.store.written
    feed(recorder, clock, recorded.samples(10))
    assert recorder.store.written == written


@pytest.mark.parametrize("after", [0, 1, 2000, 30_000])
def test_a_full_disk_ends_it_with_a_word(tmp_path, clock, monkeypatch, after):
    """All that was flushed before is readable, and nothing is raised."""
    frames, path = recorded.samples(500), tmp_path / "a.mcap"
    recorder = make(path, clock)
    before = path.stat().st_size

    class Full:
        """The file of a disk with room for so many bytes more."""

        def __init__(self, file):
            self.file, self.left = file, after

        def write(self, data):
            data = bytes(data)
            self.file.write(data[: self.left])
            self.left -= len(data)
            if self.left < 0:
                self.left = 0
                raise OSError(errno.ENOSPC, "No space left on device")
            return len(data)

        def __getattr__(self, name):
            return getattr(self.file, name)

    inner = recorder.store._writer
    inner._file = full = Full(inner._file)
    inner._writer._Writer__stream = full
    feed(recorder, clock, frames)
    assert recorder.trouble == "recording has ended: No space left on device"
    recorder.turn(closing=True)
    found = Recording(path)
    assert found.damage or not after
    assert path.stat().st_size <= before + after
    if after == 30_000:
        assert len(found.adc) > 100
        np.testing.assert_array_equal(found.adc, frames[: len(found.adc)])


def test_a_slow_disk_drops_and_counts(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(module, "_WAITING", 30)
    path = tmp_path / "a.mcap"
    recorder = make(path, clock)
    feed(recorder, clock, recorded.samples(100), every=1000)
    assert recorder.dropped == 70
    recorder.turn(closing=True)
    assert len(Recording(path).adc) == 30


@pytest.mark.live
def test_a_disk_that_hangs_blocks_nobody(tmp_path, clock, monkeypatch):
    recorder, hang = make(tmp_path / "a.mcap", clock), Hang()
    monkeypatch.setattr(recorder.store, "write", hang)
    recorder.start()
    feed(recorder, clock, recorded.samples(5), every=1000)
    hang.has_begun()
    feed(recorder, clock, recorded.samples(50), every=1000)  # returns
    recorder.close(timeout=0.01)  # so does this
    recorder.finish(stalled=0.01)  # and this
    hang.release()
    recorder.close(PATIENCE)


@pytest.mark.live
def test_what_led_to_a_stop_is_written_before_the_end_however_long_it_takes(
    tmp_path, clock, monkeypatch
):
    """The process ends after `finish`, and its threads with it."""
    recorder = make(tmp_path, clock, last=60.0)
    feed(recorder, clock, recorded.samples(200), every=1000)
    recorder.stop(clock.t)
    write = writer.Writer.write

    def slowly(*args):
        time.sleep(0.002)
        write(*args)

    monkeypatch.setattr(writer.Writer, "write", slowly)
    recorder.start()
    recorder.close(timeout=0.01)
    recorder.finish(stalled=5.0)
    (path,) = tmp_path.iterdir()
    found = Recording(path)
    assert found.damage == "" and len(found.adc) == 200


def test_a_file_that_cannot_be_made_is_said_at_once(tmp_path, clock):
    (tmp_path / "a.mcap").write_bytes(b"")
    with pytest.raises(FileError, match="is there already"):
        make(tmp_path / "a.mcap", clock)
    for limits in ({}, {"last": 10.0}):
        with pytest.raises(FileError, match="there is no folder"):
            make(tmp_path / "no" / "a.mcap", clock, **limits)
        with pytest.raises(FileError, match=r"must be a \.mcap file, or a folder"):
            make(tmp_path / "a.csv", clock, **limits)


# --- what led to a stop ---


def test_a_folder_that_takes_no_file_is_said_before_the_first_stop(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(module.os, "access", lambda *_: False)  # root may write anywhere
    for path in (tmp_path, tmp_path / "a.mcap"):
        with pytest.raises(FileError, match=f"{tmp_path}: no file can be made"):
            make(path, clock, last=10.0)


def test_what_led_to_a_stop_is_kept(tmp_path, clock):
    frames = recorded.samples(2000)
    recorder = make(tmp_path / "stops.mcap", clock, last=5.0)
    feed(recorder, clock, frames[:1000])
    assert list(tmp_path.iterdir()) == []
    stopped = clock.t
    recorder.stop(stopped)
    feed(recorder, clock, frames[1000:])
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("stops_2023-")
    found = Recording(path)
    assert found.damage == ""
    assert found.stamps[0] == pytest.approx(stopped - 5e9, abs=2e7)
    assert found.stamps[-1] == pytest.approx(stopped + 2e9, abs=2e8)
    np.testing.assert_array_equal(found.adc, frames[500 : 500 + len(found.adc)])
    assert found.attachments == {"notes": b"abc"}


def test_what_is_kept_does_not_hold_the_garbage_collector_up(tmp_path, clock):
    recorder = make(tmp_path, clock, last=5.0)
    feed(recorder, clock, recorded.samples(300))
    gc.collect()
    assert not any(gc.is_tracked(entry) for entry in recorder.store._kept)


def test_a_second_stop_has_a_file_of_its_own(tmp_path, clock):
    recorder = make(tmp_path, clock, last=5.0)
    for _ in range(2):
        feed(recorder, clock, recorded.samples(1000))
        recorder.stop(clock.t)
        recorder.stop(clock.t)
        feed(recorder, clock, recorded.samples(500))
    assert len(list(tmp_path.iterdir())) == len(recorder.store.files) == 2


def test_a_stop_just_before_the_end_is_kept(tmp_path, clock):
    recorder = make(tmp_path, clock, last=60.0)
    feed(recorder, clock, recorded.samples(300))
    recorder.stop(clock.t)
    recorder.turn(closing=True)
    (path,) = tmp_path.iterdir()
    assert len(Recording(path).adc) == 300


def test_a_stop_while_the_last_one_is_written_is_kept_at_the_end(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(module, "_SLICE", 10)
    recorder = make(tmp_path, clock, last=5.0)
    feed(recorder, clock, recorded.samples(300))
    recorder.stop(clock.t)
    feed(recorder, clock, recorded.samples(250))  # the first is being written
    recorder.stop(clock.t)
    recorder.turn(closing=True)
    found = [Recording(path) for path in sorted(tmp_path.iterdir())]
    assert len(found) == 2 and not any(one.damage for one in found)


def test_without_a_stop_nothing_is_written(tmp_path, clock):
    recorder = make(tmp_path, clock, last=5.0)
    feed(recorder, clock, recorded.samples(300))
    recorder.turn(closing=True)
    assert list(tmp_path.iterdir()) == []


def test_stops_fill_no_disk(tmp_path, clock):
    recorder = make(tmp_path, clock, last=5.0, size=100e3)
    for _ in range(10):
        feed(recorder, clock, recorded.samples(300))
        recorder.stop(clock.t)
        feed(recorder, clock, recorded.samples(300))
    assert "max_size = 0.1 MB" in recorder.trouble
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) < 200e3


def test_libraries_that_are_missing_are_named(tmp_path, clock, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mcap.writer", None)
    module.cdr.mcap.cache_clear()
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'tactile_skin\[record\]'"):
        make(tmp_path / "a.mcap", clock)
    assert not (tmp_path / "a.mcap").exists()
    assert writer
