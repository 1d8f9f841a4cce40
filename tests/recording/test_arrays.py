# SPDX-License-Identifier: Apache-2.0
"""Arrays as loggers write them: which of them are readings, and in what unit their times are."""

import numpy as np
import pytest
from support.strangers import sim

from tactile_skin import Circuit
from tactile_skin.cli import main
from tactile_skin.errors import FileError
from tactile_skin.recording.frames import read_frames

CIRCUIT = Circuit(6, 5, r_ref=10e3, r_par=140.0, adc_bits=12)
N, STEP = 200, 0.05  # frames; s between two
SINCE = 1_760_000_000  # s since 1970


@pytest.fixture(scope="module")
def steps():
    """(n, 6, 5) uint16 of a skin that is touched."""
    force = sim.touches(CIRCUIT.shape, N * STEP, 1.0 / STEP)
    found = sim.counts(CIRCUIT, sim.fabric(CIRCUIT), force, np.random.default_rng(3))
    return found.astype(np.uint16)


def saved(path, **arrays) -> str:
    np.savez(path, **arrays)
    return str(path)


def stamps(unit: str, since: int = 0) -> np.ndarray:
    each = {"s": 1, "ms": 1000, "us": 10**6, "ns": 10**9}[unit]
    ticks = since * each + np.arange(N) * STEP * each
    return ticks if unit == "s" else ticks.astype(np.int64)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("since", [0, SINCE])
@pytest.mark.parametrize("name", ["times", "t_{}", "stamp [{}]"])
def test_times_are_read_in_their_unit(unit, since, name, tmp_path, steps):
    times = {name.format(unit): stamps(unit, since)}
    found = read_frames(saved(tmp_path / "a.npz", frames=steps, **times), CIRCUIT)
    np.testing.assert_allclose(np.diff(found.times), STEP, atol=1e-6)
    assert any(f"times is taken as the time in {unit}" in n for n in found.notes) == (
        name == "times"
    )


@pytest.mark.parametrize("form", ["M8[ns]", "U26"])
def test_dates_in_arrays_are_times(form, tmp_path, steps):
    dates = (np.datetime64("2025-10-09") + stamps("us").astype("m8[us]")).astype(form)
    found = read_frames(saved(tmp_path / "a.npz", frames=steps, stamp=dates), CIRCUIT)
    np.testing.assert_allclose(np.diff(found.times), STEP, atol=1e-6)


@pytest.mark.parametrize("step", [1.0, 2.0, 3e3, 3e6, 1e-5])
def test_times_that_may_be_of_two_units_are_refused(step, tmp_path, steps):
    """Of a frame every 2 s, or every 2 ms: only its name says it."""
    path = saved(tmp_path / "a.npz", frames=steps, time=np.arange(N) * step)
    with pytest.raises(FileError, match="name its unit: time_s, time_ms"):
        read_frames(path, CIRCUIT)
    named = saved(tmp_path / "b.npz", frames=steps, time_ms=np.arange(N) * step)
    assert np.diff(read_frames(named, CIRCUIT).times) == pytest.approx(step / 1000)


def test_a_board_that_runs_for_a_month_counts_no_seconds_since_1970(tmp_path, steps):
    path = saved(tmp_path / "a.npz", frames=steps, time=1_400_000_000 + np.arange(N) * 50)
    with pytest.raises(FileError, match="rises by 50 a frame: name its unit"):
        read_frames(path, CIRCUIT)


def gray(steps):
    low = steps.min((1, 2), keepdims=True)
    return (255.0 * (steps - low) / np.ptp(steps, (1, 2))[:, None, None]).astype(np.uint8)


@pytest.mark.parametrize("first", ["raw", "picture"])
def test_the_array_of_the_readings_is_taken(first, tmp_path, steps):
    arrays = {"raw": steps, "picture": gray(steps)}
    others = {"frame_id": np.arange(N, dtype="i4"), "label": np.full(N, "palm"), "fps": 20}
    given = {first: arrays.pop(first), **others, **arrays, "t_ns": stamps("ns", SINCE)}
    found = read_frames(saved(tmp_path / "a.npz", **given), CIRCUIT)
    np.testing.assert_array_equal(found.values, steps)
    np.testing.assert_allclose(np.diff(found.times), STEP, atol=1e-6)
    assert "raw is taken" in found.notes[0]


def test_an_array_of_objects_next_to_the_readings_is_not_run(tmp_path, steps):
    about = np.array([{"by": "anna"}], object)
    found = read_frames(saved(tmp_path / "a.npz", about=about, frames=steps), CIRCUIT)
    np.testing.assert_array_equal(found.values, steps)


def test_two_arrays_of_readings_are_refused_by_their_names(tmp_path, steps):
    path = saved(tmp_path / "a.npz", left=steps, right=steps, t_ns=stamps("ns"))
    said = r"holds left \(200, 6, 5\), right .*, t_ns .*: which are the readings.* named frames"
    with pytest.raises(FileError, match=said):
        read_frames(path, CIRCUIT)
    path = saved(tmp_path / "b.npz", t=stamps("ns"), x=steps[:, :4])
    with pytest.raises(FileError, match=r"holds t \(200,\), x \(200, 4, 5\): which"):
        read_frames(path, CIRCUIT)


def test_a_clock_that_is_set_is_a_sentence(tmp_path, capsys):
    times = np.where(np.arange(N) < 20, 0.0, 6e8) + stamps("s")
    frames = np.full((N, 16, 16), 500)
    assert main(["replay", saved(tmp_path / "a.npz", frames=frames, time_s=times)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "times from 0 to 6e+08 s: their unit is another one, or the clock was set" in line


@pytest.mark.parametrize(
    "times",
    [
        np.full(N, np.nan),
        np.where(np.arange(N) > 50, np.inf, np.arange(N) * STEP),
        np.arange(N) * 1e300,
        -np.arange(N),
    ],
)
def test_times_that_say_nothing_are_a_sentence(times, tmp_path, steps):
    with pytest.raises(FileError, match=r"does not rise|holds no frame|name its unit|dropped"):
        read_frames(saved(tmp_path / "a.npz", frames=steps, times=times), CIRCUIT)


@pytest.mark.parametrize("word", [np.datetime64("NaT"), "noon"])
def test_words_that_are_no_dates_are_passed_over_aloud(word, tmp_path, steps):
    path = saved(tmp_path / "a.npz", frames=steps, times=np.full(N, word))
    found = read_frames(path, CIRCUIT)
    assert found.times is None
    assert found.notes == ["times says no time that is known: passed over"]
