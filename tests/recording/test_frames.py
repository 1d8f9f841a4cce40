# SPDX-License-Identifier: Apache-2.0
"""Frames of foreign boards: read, repaired with a word, or refused with one."""

import tracemalloc
from datetime import datetime, timedelta
from itertools import product

import numpy as np
import pytest
import recorded
from hypothesis import given
from hypothesis import strategies as st

from tactile_skin import Circuit, files
from tactile_skin.errors import FileError
from tactile_skin.physics.adc import Adc
from tactile_skin.recording.frames import read_frames

CIRCUIT = Circuit(2, 3)
ADC = Adc(CIRCUIT)
FRAMES = np.arange(24.0).reshape(4, 2, 3)


def text(tmp_path, lines, name="a.csv"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    return path


def plain(frames, separator=","):
    return [separator.join(f"{v:g}" for v in f.ravel()) for f in frames]


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", ", "  "])
@pytest.mark.parametrize("end", ["", ","])
def test_lines_of_numbers(tmp_path, separator, end):
    end = separator.strip() if end and separator.strip() else ""
    found = read_frames(text(tmp_path, [k + end for k in plain(FRAMES, separator)]), CIRCUIT)
    np.testing.assert_array_equal(found.values, FRAMES)
    assert found.times is None
    assert found.notes == []


@pytest.mark.parametrize(
    ("head", "unit"), [("time [s]", 1.0), ("t_ms", 1e-3), ("stamp (us)", 1e-6), ("ns", 1e-9)]
)
def test_a_header_names_the_unit_of_time(tmp_path, head, unit):
    lines = [f"{head},a,b,c,d,e,f"] + [f"{10 * k},{v}" for k, v in enumerate(plain(FRAMES))]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_allclose(found.times, np.arange(4) * 10 * unit)
    np.testing.assert_array_equal(found.values, FRAMES)
    assert found.notes == []


def test_times_without_a_name_are_guessed_and_said(tmp_path):
    lines = [f"{20 * k},{v}" for k, v in enumerate(plain(FRAMES))]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_allclose(found.times, np.arange(4) * 0.02)
    assert found.notes == ["the first column is taken as the time in ms"]


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%dT%H:%M:%S.%f",
        "%Y-%m-%dT%H:%M:%S.%f000+0200",
        "%Y/%m/%d_%H:%M:%SZ",
        "%d.%m.%Y %H:%M:%S UTC",
        "%m/%d/%Y %I:%M:%S %p",
        "%I:%M:%S%p",
        "%H:%M:%S.%f",
    ],
)
def test_dates_and_times_of_day(tmp_path, form):
    """Four seconds round noon of the last of May."""
    times = [datetime(2024, 5, 31, 11, 59, 58) + timedelta(seconds=k) for k in range(4)]
    lines = [
        f"{t.strftime(form)};{line}" for t, line in zip(times, plain(FRAMES, ";"), strict=True)
    ]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_array_equal(found.values, FRAMES)
    np.testing.assert_allclose(np.diff(found.times), 1.0, atol=1e-6)
    day = (times[0] - datetime(1970, 1, 1)).days * 86400.0
    assert found.times[0] == pytest.approx(43198.0 + ("%d" in form) * day)


def test_every_line_that_is_lost_is_counted(tmp_path):
    good = plain(FRAMES)
    lines = [
        "Board 1.0 ready",
        "",
        good[0],
        "1,2,3,4,5",  # cut
        good[1],
        "overrun!",
        ",,,,,",
        "1,,3,nan,5,-",
        good[2],
        "1,2,3,4,5,inf",
        good[3],
    ]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    assert len(found.values) == 5
    assert np.isnan(found.values[2]).sum() == 3
    assert found.notes == [
        "1 lines before the numbers: passed over (the first: line 1)",
        "1 lines with text among the numbers: dropped (the first: line 6)",
        "1 lines of other than 6 fields: dropped (the first: line 4)",
        "1 lines with text for a number: dropped (the first: line 10)",
        "1 lines in which no crossing was read: dropped (the first: line 7)",
        "3 fields without a number: taken as not read",
    ]


@pytest.mark.ci
def test_a_file_takes_at_most_three_times_its_size_in_memory(tmp_path):
    """Of few digits, and with a time: the numbers are the largest against their text."""

    def peak_of(frames: int) -> tuple[int, int]:
        rng = np.random.default_rng(1)
        steps = rng.integers(0, 1024, (frames, 256)) * (rng.random((frames, 256)) < 0.05)
        times = (f"{1.7e9 + k / 100:.3f}" for k in range(frames))
        lines = [f"{t},{line}" for t, line in zip(times, plain(steps), strict=True)]
        path = text(tmp_path, ["time_s," + ",".join(map(str, range(256))), *lines])
        tracemalloc.start()
        found = read_frames(path, Circuit(16, 16))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        np.testing.assert_array_equal(found.values.reshape(frames, -1), steps)
        np.testing.assert_allclose(np.diff(found.times), 0.01, atol=1e-6)
        return path.stat().st_size, peak

    (small, least), (large, most) = peak_of(1000), peak_of(5000)
    assert most - least < 3.0 * (large - small)  # blocks take the same in both


def test_lines_that_float32_does_not_hold_are_read_to_the_last_digit(tmp_path):
    """A time in front, then cells too, behind a block of integers."""
    cells = np.arange(10.0, 16.0) + np.zeros((25_000, 1))
    cells[20_000:] += 0.1
    lines = [f"{1.7e9 + k / 100:.2f},{line}" for k, line in enumerate(plain(cells))]
    found = read_frames(text(tmp_path, ["time_s,a,b,c,d,e,f", *lines]), CIRCUIT)
    np.testing.assert_array_equal(found.values.reshape(-1, 6), cells)
    np.testing.assert_array_equal(found.times, [float(line.split(",")[0]) for line in lines])


def test_a_first_line_that_is_cut_is_no_measure_of_the_others(tmp_path):
    """Of a file of more than one block, in which most lines are of another width at first."""
    good = plain(FRAMES) * 100
    found = read_frames(text(tmp_path, ["1,2,3,4"] * 210 + good), CIRCUIT)
    np.testing.assert_array_equal(found.values, np.tile(FRAMES, (100, 1, 1)))
    assert found.notes == ["210 lines of other than 6 fields: dropped (the first: line 1)"]


def test_lines_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_BLOCK", 24)
    for end, encoding in product(("\n", "\r\n", "\r"), ("utf-8", "utf-8-sig", "utf-16")):
        path = tmp_path / "a.csv"
        path.write_bytes(end.join(["µ", *plain(FRAMES)]).encode(encoding))
        np.testing.assert_array_equal(read_frames(path, CIRCUIT).values, FRAMES)
    path.write_text("1,2,3,4,5,6\n" + "1," * 30)
    with pytest.raises(FileError, match=r"a.csv: line 2: is longer than"):
        read_frames(path, CIRCUIT)


def test_decimal_commas(tmp_path):
    lines = [k.replace(".", ",") for k in plain(FRAMES + 0.5, ";")]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_array_equal(found.values, FRAMES + 0.5)


def test_gaps_and_times_that_do_not_rise_are_named(tmp_path):
    times = [0.0, 0.01, 0.02, 0.02, 0.01, 0.03, 1.04, 1.05]
    lines = ["time_s," + ",".join("abcdef")] + [f"{t},1,2,3,4,5,6" for t in times]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_allclose(found.times, [0.0, 0.01, 0.02, 0.03, 1.04, 1.05])
    assert "2 frames whose time does not rise: dropped" in found.notes
    assert "1 gaps, the longest 1.01 s, the first after 0.03 s" in found.notes


def test_times_of_a_clock_in_whole_seconds_are_spread(tmp_path):
    lines = ["time_s," + ",".join("abcdef")] + [f"{k // 10},{k},2,3,4,5,6" for k in range(60)]
    found = read_frames(text(tmp_path, lines), CIRCUIT)
    np.testing.assert_allclose(found.times, np.arange(60) / 10)
    assert "the clock is coarser than the frames: these are spread evenly" in found.notes


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], "holds no line of numbers"),
        (["|1|2|3|4|5|6|"], r"with commas, .* between: the first is '\|1\|2\|3"),
        (["1,2,3,4,5,6 # mm"] * 3, r"holds no frame: 3 lines with text for a number"),
        (["hello", "world"], "holds no line of numbers"),
        (["1,2,3,4"] * 5, "most lines hold 4 numbers, the circuit is 2 x 3 = 6"),
        (["1,2,3,4,5,6,7,8"] * 5, "most lines hold 8 numbers"),
        ([",,,,,"] * 3, "holds no frame"),
    ],
)
def test_text_that_is_no_recording_is_refused(tmp_path, lines, said):
    with pytest.raises(FileError, match=said):
        read_frames(text(tmp_path, lines), CIRCUIT)


@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "a.csv"
    path.write_bytes(data)
    try:
        found = read_frames(path, CIRCUIT)
    except FileError as error:
        assert str(path) in str(error)
    else:
        assert found.values.shape[1:] == (2, 3)


# --- NumPy ---


@pytest.mark.parametrize("shape", [(4, 2, 3), (4, 6)])
def test_arrays(tmp_path, shape):
    path = tmp_path / "a.npy"
    np.save(path, FRAMES.reshape(shape))
    np.testing.assert_array_equal(read_frames(path, CIRCUIT).values, FRAMES)


def test_arrays_with_times(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, times=np.arange(4) * 0.1, frames=FRAMES)
    found = read_frames(path, CIRCUIT)
    np.testing.assert_array_equal(found.values, FRAMES)
    np.testing.assert_allclose(found.times, np.arange(4) * 0.1)


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros((4, 3, 2)), "holds 4 x 3 x 2 numbers, the circuit is 2 x 3"),
        (np.zeros(6), "holds 6 numbers"),
        (np.zeros((4, 2, 3), complex), "must be numbers"),
        (np.zeros((0, 2, 3)), "holds no frame"),
    ],
)
def test_other_arrays_are_refused(tmp_path, array, said):
    path = tmp_path / "a.npy"
    np.save(path, array)
    with pytest.raises(FileError, match=said):
        read_frames(path, CIRCUIT)


def test_files_of_no_kind_are_refused(tmp_path):
    for name in ("a.bag", "a"):
        with pytest.raises(FileError, match=r"must be one of \.mcap"):
            read_frames(tmp_path / name, CIRCUIT)
    (tmp_path / "a.npy").write_bytes(b"no array")
    with pytest.raises(FileError, match="cannot be read"):
        read_frames(tmp_path / "a.npy", CIRCUIT)


# --- what the nodes and the solvers get ---


def test_counts_and_ratios_give_the_same(tmp_path):
    counts, ratios = tmp_path / "a.npy", tmp_path / "b.npy"
    np.save(counts, FRAMES)
    np.save(ratios, FRAMES / 1023.0)
    first, second = (read_frames(path, CIRCUIT) for path in (counts, ratios))
    np.testing.assert_allclose(first.ratio(ADC), second.ratio(ADC), atol=1e-12)
    np.testing.assert_array_equal(first.samples(ADC), second.samples(ADC))
    np.testing.assert_array_equal(first.samples(ADC), FRAMES * 64)


def test_what_was_not_read_stays_so(tmp_path):
    path = tmp_path / "a.npy"
    frames = FRAMES.copy()
    frames[1, 0, 2] = np.nan
    np.save(path, frames)
    found = read_frames(path, CIRCUIT)
    assert np.isnan(found.ratio(ADC)[1, 0, 2])
    assert found.samples(ADC)[1, 0, 2] == 65535


def test_counts_beyond_the_adc_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, FRAMES * 100.0)
    said = r"adc_bits = 10 ends at 1023: an ADC of more bits .*, millivolts .*, or resistances"
    with pytest.raises(FileError, match=said):
        read_frames(path, CIRCUIT).ratio(ADC)


def test_a_recording(tmp_path):
    pytest.importorskip("mcap")
    samples = recorded.samples(7, 2, 3)
    samples[3, 1, 1] = 65535
    path = recorded.write(tmp_path / "a.mcap", samples)
    found = read_frames(path, CIRCUIT)
    np.testing.assert_array_equal(found.samples(ADC), samples)
    np.testing.assert_allclose(found.times, np.arange(7) / 100.0, atol=1e-9)
    with pytest.raises(FileError, match="holds 7 x 2 x 3 numbers, the circuit is 3 x 2"):
        read_frames(path, Circuit(3, 2))


@pytest.mark.parametrize("named", ["scanned", "mask"])
def test_a_crossing_that_the_configuration_names_is_not_read(tmp_path, named):
    """A board that skips it prints 0, which would be a reading of nothing."""
    there = np.array([[True, True, False], [True, True, True]])
    adc = Adc(CIRCUIT, scanned=there) if named == "scanned" else Adc(Circuit(2, 3, mask=there))
    frames = np.where(there, FRAMES + 5.0, 0.0)
    found = read_frames(text(tmp_path, plain(frames)), adc.circuit).ratio(adc)
    np.testing.assert_array_equal(np.isnan(found), np.broadcast_to(~there, found.shape))
    np.testing.assert_allclose(found[:, there] * 1023.0, frames[:, there])
