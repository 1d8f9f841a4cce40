# SPDX-License-Identifier: Apache-2.0
"""Readings leave as NumPy and CSV, and come back as they were."""

import re

import numpy as np
import pytest
import recorded

from tactile_skin import msg
from tactile_skin.errors import FileError
from tactile_skin.launch import read_skin
from tactile_skin.recording import Recording, cdr
from tactile_skin.recording.convert import export, to_recording
from tactile_skin.recording.frames import Frames, read_frames
from tactile_skin.recording.writer import Writer

pytest.importorskip("mcap")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("/**: {ros__parameters: {circuit: {rows: 4, cols: 5, r_par: 300.0}}}\n")
    return path


@pytest.mark.parametrize("kind", [".npy", ".npz", ".csv"])
def test_there_and_back(tmp_path, config, kind):
    samples = recorded.samples(30) // 64 * 64
    samples[3, 1, 2] = 65535
    path, out = recorded.write(tmp_path / "a.mcap", samples), tmp_path / f"a{kind}"
    skin = read_skin(config)
    frames = read_frames(path, skin.circuit)
    export(Recording(path), frames, out)
    again = read_frames(out, skin.circuit)
    np.testing.assert_array_equal(again.samples(skin.adc), samples)
    if kind != ".npy":
        np.testing.assert_allclose(again.times, np.arange(30) / 100.0, atol=1e-9)
    back = tmp_path / "b.mcap"
    to_recording(again, back, skin, config, 100.0, recorded.START)
    found = Recording(back)
    np.testing.assert_array_equal(found.adc, samples)
    np.testing.assert_allclose(found.stamps, Recording(path).stamps, atol=1)
    assert found.skin.circuit.r_par == 300.0
    with pytest.raises(FileError, match="is there already"):
        export(Recording(path), frames, out)


def test_pressure_is_exported_where_it_was_recorded(tmp_path, config):
    path, frames = tmp_path / "a.mcap", recorded.samples(5)
    writer = Writer(path, {}, recorded.START)
    for k, frame in enumerate(frames):
        t = recorded.stamp(k)
        adc = recorded.adc_image(frame, t)
        pressure = msg.image(frame * 2.0, "32FC1", adc.header)
        for topic, message in (("/skin/adc", adc), ("/skin/pressure", pressure)):
            writer.write(topic, msg.Image, t, cdr.encode(message))
    writer.close()
    export(Recording(path), read_frames(path, read_skin(config).circuit), tmp_path / "a.npz")
    arrays = np.load(tmp_path / "a.npz")
    np.testing.assert_allclose(arrays["pressure"], frames * 2.0)
    np.testing.assert_allclose(arrays["pressure_times"], arrays["times"], atol=1e-9)


def test_frames_without_times_take_a_rate(tmp_path, config):
    skin, path = read_skin(config), tmp_path / "a.mcap"
    to_recording(Frames(np.zeros((4, 4, 5)), path="a"), path, skin, None, 50.0, recorded.START)
    np.testing.assert_allclose(Recording(path).times, np.arange(4) / 50.0, atol=1e-9)
    with pytest.raises(ValueError, match=r"rate = 0\.0: must be above 0"):
        to_recording(Frames(np.zeros((4, 4, 5)), path="a"), path, skin, None, 0.0, 0)


# --- the commands ---


def rest(tmp_path, n=200):
    """A .csv of a skin at rest, with a cut line and a word of the board."""
    rng = np.random.default_rng(2)
    frames = 150.0 + rng.normal(0.0, 1.0, (n, 20)) + 3.0 * rng.standard_normal(20)
    lines = ["ready"] + [",".join(f"{v:.0f}" for v in frame) for frame in frames]
    lines[50] = lines[50][:20]
    path = tmp_path / "rest.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.ci
@pytest.mark.usefixtures("joblib_keeps_no_process")
def test_a_foreign_file_is_replayed_recorded_and_exported(tmp_path, config, call):
    path, made, out = rest(tmp_path), tmp_path / "made.mcap", tmp_path / "out.npy"
    status, said, err = call("replay", path, f"config:={config}", "rate:=50", "--out", made)
    assert status == 0
    assert "readings  199 of 4.0 s" in said
    assert "1 lines before the numbers: passed over (the first: line 1)" in err
    assert "1 lines of other than 20 fields: dropped (the first: line 51)" in err
    assert Recording(made).topics["/skin/stop"].count > 199
    status, said, _ = call("replay", made, "--export", out)
    assert status == 0 and np.load(out).shape == (199, 4, 5)
    status, said, _ = call("replay", made, "--jobs", "2")
    assert status == 0 and "readings  199" in said


def test_of_several_skins_that_of_the_namespace_is_taken(tmp_path, call):
    path, out = tmp_path / "a.mcap", tmp_path / "a.npy"
    left, right = recorded.samples(3, 16, 16), recorded.samples(3, 16, 16, seed=1)
    writer = Writer(path, {}, recorded.START)
    for k in range(3):
        for side, frames in (("left", left), ("right", right)):
            message = recorded.adc_image(frames[k], recorded.stamp(k))
            data = cdr.encode(message)
            writer.write(f"/{side}/skin/adc", msg.Image, recorded.stamp(k), data)
    writer.close()
    status, _, error = call("replay", path, "--export", out)
    assert status == 2 and "there are: /left/skin/adc, /right/skin/adc" in error
    status, said, error = call("replay", path, "namespace:=right", "--export", out)
    assert (status, error) == (0, "") and "3 frames" in said
    np.testing.assert_array_equal(np.load(out), right / 64)
    status, _, error = call("replay", path, "namespace:=up", "--export", out)
    assert status == 2 and "no topic /up/skin/adc" in error
    status, _, error = call("doctor", path)
    assert status == 2 and "there are: /left/skin/adc, /right/skin/adc" in error
    _, _, error = call("doctor", path, "namespace:=right")
    assert "3 frames: give 20 or more" in error  # it has found them


def test_an_export_takes_rate_and_full_scale(tmp_path, config, call):
    """Of a file that says neither, as a replay does."""
    path, out = tmp_path / "volts.csv", tmp_path / "out.npz"
    volts = np.random.default_rng(4).uniform(0.9, 3.0, (30, 20))
    np.savetxt(path, volts, "%.3f", ",")
    words = f"config:={config}", "rate:=50", "full_scale:=5.0"
    assert call("replay", path, *words, "--export", out)[0] == 0
    steps = read_skin(config).circuit.full_scale / 5.0 * volts.reshape(30, 4, 5)
    np.testing.assert_allclose(np.load(out)["frames"], steps, atol=0.2)
    np.testing.assert_allclose(np.load(out)["times"], np.arange(30) / 50.0)


def test_the_reason_of_a_stop_from_the_first_reading_on_is_said(tmp_path, config, call):
    calm, pressed = rest(tmp_path), tmp_path / "pressed.npy"
    np.save(pressed, np.random.default_rng(3).integers(200, 900, (60, 4, 5)).astype(np.uint16))
    length = {calm: r"for \d\.\d\d s", pressed: "until the end"}
    for path, words in length.items():
        _, said, _ = call("replay", path, f"config:={config}")
        assert re.search(rf'not free {words}, most of it: ".*measuring rest: hands off', said)
        assert "stops     0, " in said


def test_methods_are_compared(tmp_path, config, call):
    words = f"config:={config}", "--compare", "map", "naive"
    status, said, _ = call("replay", rest(tmp_path, 60), *words)
    assert status == 0
    lines = said.partition("\n\n")[2].splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["method", "map", "naive"]
