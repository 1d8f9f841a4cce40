# SPDX-License-Identifier: Apache-2.0
"""Files as strangers have them: other columns, blocks, other scales, processed numbers."""

import numpy as np
import pytest
from support.strangers import sim

from tactile_skin import Circuit
from tactile_skin.cli import main
from tactile_skin.errors import FileError
from tactile_skin.readings.scale import Numbers, scale_of
from tactile_skin.recording.frames import read_frames

CIRCUIT = Circuit(8, 8, r_ref=10e3, r_par=140.0)
N = 300


@pytest.fixture(scope="module")
def steps():
    """(n, 8, 8) whole ADC steps of a skin that is touched."""
    rng = np.random.default_rng(11)
    force = sim.touches((8, 8), N / 20.0, 20.0)
    return sim.counts(CIRCUIT, sim.fabric(CIRCUIT), force, rng)


def text(path, lines) -> str:
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def line(frame, separator=",") -> str:
    return separator.join(map(str, frame.ravel().tolist()))


CLOCK = np.datetime64("2024-05-01T09:30:00.000")
AROUND = {  # line, its number -> as it is printed; and the interval that its times show [s]
    "an index in front": (lambda words, k: f"{k},{words}", None),
    "a word behind": (lambda words, k: f"{words},{['sit', 'stand'][k // 60 % 2]}", None),
    "ms in front": (lambda words, k: f"{120_000 + 50 * k},{words}", 0.05),
    "the clock of a serial monitor": (
        lambda words, k: f"{str(CLOCK + np.timedelta64(50 * k, 'ms'))[11:]} -> {words}",
        0.05,
    ),
    "the clock of another monitor": (
        lambda words, k: f"{str(CLOCK + np.timedelta64(50 * k, 'ms')).replace('T', ' ')}\t{words}",
        0.05,
    ),
    "an object": (lambda words, k: f'{{"t_ms": {50 * k}, "data": [{words}]}}', 0.05),
    "an object with a date": (
        lambda words, k: f'{{"at": "{CLOCK + np.timedelta64(50 * k, "ms")}Z", "v": [{words}]}}',
        0.05,
    ),
    "names": (
        lambda words, k: " ".join(f"S{i}:{v}" for i, v in enumerate(words.split(","))),
        None,
    ),
    "names and commas": (
        lambda words, k: ",".join(f"S{i}: {v}" for i, v in enumerate(words.split(","))),
        None,
    ),
    "us behind": (lambda words, k: f"{words},{1_700_000_000_000_000 + 50_000 * k}", 0.05),
    "ns behind": (lambda words, k: f"{words},{1_700_000_000_000_000_000 + 50_000_000 * k}", 0.05),
    "a date in front": (lambda words, k: f"{CLOCK + np.timedelta64(50 * k, 'ms')},{words}", 0.05),
    "a counter and a time behind": (
        lambda words, k: f"{words},{k},{1_700_000_000_000_000 + 50_000 * k}",
        0.05,
    ),
}


@pytest.mark.parametrize("kind", AROUND)
def test_a_column_that_is_no_cell_is_known_by_what_it_does(kind, tmp_path, steps):
    write, interval = AROUND[kind]
    path = text(tmp_path / "a.csv", [write(line(frame), k) for k, frame in enumerate(steps)])
    found = read_frames(path, CIRCUIT)
    np.testing.assert_array_equal(found.values, steps)
    if interval is None:
        assert found.times is None and (found.notes or "names" in kind)
    else:
        assert np.diff(found.times) == pytest.approx(np.full(N - 1, interval), rel=1e-3)


def test_classes_are_numbers_that_a_header_names(tmp_path, steps):
    """Few small numbers may be a cell's: what they are is asked."""
    lines = [f"{k},{line(frame)},{k // 50 % 4}" for k, frame in enumerate(steps)]
    with pytest.raises(ValueError, match="name them in a header"):
        read_frames(text(tmp_path / "a.csv", lines), CIRCUIT)
    header = ",".join(["", *[f"s{k}" for k in range(64)], "posture"])
    found = read_frames(text(tmp_path / "a.csv", [header, *lines]), CIRCUIT)
    np.testing.assert_array_equal(found.values, steps)
    assert {*found.labels["posture"]} == {"0", "1", "2", "3"}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_says_the_encoding(encoding, tmp_path, steps):
    lines = "\r\n".join(map(line, steps))
    (tmp_path / "a.log").write_bytes(lines.encode(encoding))
    np.testing.assert_array_equal(read_frames(tmp_path / "a.log", CIRCUIT).values, steps)


def test_a_row_less_costs_one_frame_where_each_has_a_heading(tmp_path, steps):
    frames = [[f"frame: {k}, time: {50 * k}", *map(line, a)] for k, a in enumerate(steps)]
    del frames[7][4]
    lines = [each for frame in frames for each in frame]
    found = read_frames(text(tmp_path / "a.csv", lines), CIRCUIT)
    np.testing.assert_array_equal(found.values, np.delete(steps, 7, 0))
    assert found.times == pytest.approx(0.05 * np.delete(np.arange(N), 7))


def test_null_is_not_read(tmp_path, steps):
    lines = [f'{{"v": [null, {line(a).partition(",")[2]}]}}' for a in steps]
    values = read_frames(text(tmp_path / "a.jsonl", lines), CIRCUIT).values
    assert np.isnan(values[:, 0, 0]).all() and np.isnan(values).sum() == N


def test_rows_as_objects_are_a_row_a_line(tmp_path, steps):
    rows = [f'{{"row": {r}, "v": {row.tolist()}}}' for a in steps for r, row in enumerate(a)]
    np.testing.assert_array_equal(
        read_frames(text(tmp_path / "a.jsonl", rows), CIRCUIT).values, steps
    )


@pytest.mark.parametrize("head", [[], ["time,row,col,value"]])
@pytest.mark.parametrize("first", [0, 1])
def test_a_cell_a_line_is_no_row_of_four(first, head, tmp_path):
    cells = [(k, at) for k in range(9) for at in np.ndindex(4, 4)]
    lines = [f"{50 * k},{r + first},{c + first},{300 + 7 * r + k}" for k, (r, c) in cells]
    with pytest.raises(FileError, match="names the row and column of one reading: must be a frame"):
        read_frames(text(tmp_path / "a.csv", head + lines), Circuit(4, 4))


def test_decimals_are_taken_as_means_and_that_is_said(tmp_path, steps):
    path = text(tmp_path / "a.csv", [line(frame / 90.0 + 0.25) for frame in steps])
    notes = read_frames(path, CIRCUIT).notes
    assert any("taken as means of ADC steps" in note for note in notes)


SHAPES = {
    "stacked": lambda steps: steps.reshape(-1, 8),
    "the frames last": lambda steps: np.moveaxis(steps, 0, -1),
    "with a channel": lambda steps: steps[:, None],
}


@pytest.mark.parametrize("kind", SHAPES)
def test_an_array_of_another_shape(kind, tmp_path, steps):
    np.save(tmp_path / "a.npy", SHAPES[kind](steps))
    np.testing.assert_array_equal(read_frames(tmp_path / "a.npy", CIRCUIT).values, steps)


@pytest.mark.parametrize("head", ["Time: {}.{:03} s", "time (ms) = {}{:03}", "# t={}{:03}"])
def test_blocks_of_rows_with_a_heading_each(head, tmp_path, steps):
    """Their times are those of the frames below; what does not rise is none."""
    blocks = [
        "\n".join([f"Frame: {k}", head.format(*divmod(50 * k, 1000)), *map(line, frame), ""])
        for k, frame in enumerate(steps)
    ]
    found = read_frames(text(tmp_path / "a.csv", blocks), CIRCUIT)
    np.testing.assert_array_equal(found.values, steps)
    assert found.times == pytest.approx(0.05 * np.arange(N))
    path = text(tmp_path / "a.csv", blocks[1:] + blocks[:1])
    assert read_frames(path, CIRCUIT).times is None


def test_zeros_at_the_end_were_never_written(tmp_path, steps):
    padded = np.concatenate([steps, np.zeros((40, 8, 8), int)])
    path = text(tmp_path / "a.csv", [line(frame) for frame in padded])
    assert len(read_frames(path, CIRCUIT).values) == N


def test_a_file_of_which_most_would_be_dropped_is_refused(tmp_path, steps, capsys):
    lines = [line(frame) if k % 5 == 0 else line(frame)[:-9] for k, frame in enumerate(steps)]
    lines = [f"{50 * (k % 3)},{words}" for k, words in enumerate(lines)]
    assert main(["replay", text(tmp_path / "a.csv", lines)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_pickle_is_refused_in_a_sentence(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{1: 2}], object), allow_pickle=True)
    with pytest.raises(FileError, match="is a pickle, which may run any program"):
        read_frames(tmp_path / "a.npy", CIRCUIT)


def test_the_rate_counts_where_the_file_has_no_times(tmp_path, steps):
    bare = text(tmp_path / "a.csv", [f"{k},{line(frame)}" for k, frame in enumerate(steps)])
    assert np.diff(read_frames(bare, CIRCUIT, rate=20.0).times) == pytest.approx(0.05)
    timed = text(tmp_path / "b.csv", [f"{50 * k},{line(f)}" for k, f in enumerate(steps)])
    assert "rate:=40 is not used: the file has times" in read_frames(timed, CIRCUIT, rate=40).notes


# --- scale and processing ---


def normalised(steps, axis):
    low, high = steps.min(axis, keepdims=True), steps.max(axis, keepdims=True)
    return (steps - low) / (high - low)


PROCESSED = {
    "volts": (lambda steps: np.round(steps * 3.3 / 1023, 3), Numbers.VOLTS),
    "volts below 1": (lambda steps: np.round(steps / 1023 * 0.9, 3), Numbers.RATIOS_OR_VOLTS),
    "ratios of three decimals": (lambda s: np.round(s / 1023, 3), Numbers.RATIOS_OR_VOLTS),
    "normalised, each frame": (lambda steps: normalised(steps, (1, 2)), Numbers.NORMALISED),
    "normalised together": (lambda steps: normalised(steps, (0, 1, 2)), Numbers.NORMALISED),
    "a baseline subtracted": (lambda steps: steps - steps[:20].mean(0), Numbers.NEGATIVE),
}


@pytest.mark.parametrize("kind", PROCESSED)
def test_what_an_adc_does_not_read_is_refused_by_what_was_seen(kind, tmp_path, steps):
    make, expected = PROCESSED[kind]
    values = make(steps.astype(float))
    assert scale_of(values).kind is expected
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(FileError, match=r"numbers from|each frame|the file") as error:
        read_frames(tmp_path / "a.npy", CIRCUIT)
    assert "set " not in str(error.value)


SOUND = {
    "ADC steps": lambda steps: steps,
    "steps as floats": lambda steps: steps.astype(float),
    "means of scans": lambda steps: steps + 0.25,
    "ratios": lambda steps: steps / 1023,
    "ratios of six decimals": lambda steps: np.round(steps / 1023, 6),
    "8 bits, at rest 0": lambda steps: np.maximum(steps // 4 - 60, 0),
    "ratios of means": lambda steps: (steps + 0.3) / 1023.7,
}


@pytest.mark.parametrize("kind", SOUND)
def test_what_an_adc_reads_is_taken(kind, tmp_path, steps):
    np.save(tmp_path / "a.npy", SOUND[kind](steps))
    found = read_frames(tmp_path / "a.npy", CIRCUIT)
    assert found.are_ratios == ("ratios" in kind)
    assert any("taken as ratios" in note for note in found.notes) == found.are_ratios


@pytest.mark.parametrize("full_scale", [3.3, 5.0])
def test_volts_are_read_once_their_scale_is_given(full_scale, tmp_path, steps):
    np.save(tmp_path / "a.npy", np.round(steps * full_scale / 1023, 4))
    found = read_frames(tmp_path / "a.npy", CIRCUIT, full_scale=full_scale)
    np.testing.assert_allclose(found.values, steps, atol=0.05)


def test_minus_one_is_no_value(tmp_path, steps):
    values = steps.copy()
    values[:, 3, 4] = -1
    np.save(tmp_path / "a.npy", values)
    found = read_frames(tmp_path / "a.npy", CIRCUIT)
    assert np.isnan(found.values[:, 3, 4]).all() and np.isnan(found.values).sum() == N
    assert f"{N} numbers of -1: taken as not read" in found.notes


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("form", ["{:,}", "{:.3f}"])
def test_a_comma_in_a_number_marks_thousands_only_where_smaller_ones_have_none(
    form, separator, tmp_path
):
    """1,234 among numbers such as 512 are 1234 steps, not 1.234; with 0,512 they are decimals."""
    right = np.random.default_rng(1).integers(90, 4000, (N, 8, 8))
    right = right if form == "{:,}" else right / 1000.0
    words = [[form.format(v).replace(".", ",") for v in f.ravel().tolist()] for f in right]
    quoted = [[f'"{word}"' for word in frame] for frame in words]
    path = text(tmp_path / "a.csv", [separator.join(frame) for frame in quoted])
    circuit = Circuit(8, 8, r_ref=10e3, r_par=140.0, adc_bits=12)
    scale = {} if form == "{:,}" else {"full_scale": 4.095}
    np.testing.assert_allclose(
        read_frames(path, circuit, **scale).values, right * (1 if form == "{:,}" else 1000)
    )
