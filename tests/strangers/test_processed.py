# SPDX-License-Identifier: Apache-2.0
"""Streams and files that somebody processed are named, and nothing is learnt or entered by them."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from strangers.test_advice import minus_baseline, played
from support.marks import ci, slow
from support.strangers import sim

from tactile_skin import Circuit, diagnose
from tactile_skin.cli import main
from tactile_skin.readings.processed import Done, processed
from tactile_skin.recording.frames import read_frames

DATA = Path(__file__).parents[1] / "data"
SHAPE = 7, 9
FPS = 10.0


@cache
def board(seed: int, readout="floating", bits=10, hard=(2, 25), noise=0.7):
    """Return a circuit, and (n, rows, cols) ADC steps of a minute of touches."""
    circuit = Circuit(*SHAPE, r_ref=6800.0, r_par=90.0, adc_bits=bits, readout=readout)
    force = sim.touches(SHAPE, 60.0, FPS, seed=seed, hard=hard, hold=1.2)
    rng = np.random.default_rng(seed)
    return circuit, sim.counts(circuit, sim.fabric(circuit, seed, 0.06), force, rng, noise=noise)


def zeroed(steps):
    return np.maximum(steps - np.rint(steps[:20].mean(0)).astype(int), 0)


def cut_below(steps, level):
    return np.where(steps < level, 0, steps)


def each_stretched(steps):
    low, high = steps.min((1, 2), keepdims=True), steps.max((1, 2), keepdims=True)
    return np.rint((steps - low) * 255.0 / (high - low))


DONE = {
    "an offset": (zeroed, Done.OFFSET, None),
    "an offset and a dead band": (lambda s: cut_below(zeroed(s), 30), Done.THRESHOLD, None),
    "a threshold": (lambda s: cut_below(s, np.quantile(s[0], 0.9) + 4), Done.THRESHOLD, None),
    "an offset and a ceiling": (lambda s: np.minimum(zeroed(s), 150), Done.OFFSET, 150.0),
    "a ceiling": (lambda s: np.minimum(s, 700), Done.CEILING, 700.0),
    "each frame": (each_stretched, Done.NORMALISED, None),
}


@pytest.mark.parametrize("kind", DONE)
@pytest.mark.parametrize("readout", ["floating", "loaded"])
def test_what_was_done_to_readings_is_named(kind, readout):
    make, expected, ceiling = DONE[kind]
    circuit, steps = board(31, readout)
    found = processed(make(steps), circuit.adc_bits)
    assert (found.kind, found.ceiling) == (expected, ceiling)


def test_a_threshold_is_named_with_its_level_unless_it_is_known():
    circuit, steps = board(32)
    level = int(np.quantile(steps[0], 0.9)) + 4
    found = processed(cut_below(steps, level), circuit.adc_bits)
    assert level <= found.level <= level + 2
    assert f"none lies between that and {found.level:g}" in str(found)
    assert processed(cut_below(steps, level), circuit.adc_bits, threshold=level) is None


def esp32(steps):
    return np.maximum(steps - 176, 0)


def dropped_line(steps):
    steps = steps.copy()
    steps[np.random.default_rng(3).random(len(steps)) < 0.3, 2] = 0
    return steps


def even(steps):
    """A fabric without scatter, at rest and with few readings that move."""
    return np.where(steps - steps[0] > 5, steps, 160 + (steps % 3 > 1))


SOUND = {
    "even": (even, {}),
    "even, at rest": (lambda s: even(s)[:25], {}),
    "as it is read": (lambda s: s, {}),
    "pull-ups": (lambda s: 1023 - s, {}),
    "saturated": (lambda s: np.minimum(s * 2, 1023), {"hard": (10, 60)}),
    "saturated, narrower": (lambda s: np.minimum(s * 2, 511), {"hard": (10, 60)}),
    "cells that are not there": (lambda s: np.where(np.eye(*SHAPE) > 0, 0, s), {}),
    "a loose line": (dropped_line, {}),
    "8 bits": (lambda s: s, {"bits": 8}),
    "0 at rest": (lambda s: np.maximum(s // 8 - 64, 0), {}),
    "no noise": (lambda s: s, {"noise": 0.0}),
    "a few frames": (lambda s: s[:4], {}),
}


@pytest.mark.parametrize("kind", SOUND)
@pytest.mark.parametrize("readout", ["floating", "loaded", "grounded"])
def test_what_an_adc_reads_is_not_taken_for_processed(kind, readout):
    make, given = SOUND[kind]
    circuit, steps = board(33, readout, **given)
    assert processed(make(steps), circuit.adc_bits) is None


def test_an_adc_that_reads_nothing_so_low_is_not_either():
    """An ESP32's 142 mV, where nothing rests above them."""
    circuit = Circuit(*SHAPE, r_ref=560.0, r_par=90.0, adc_bits=12, readout="loaded")
    force = sim.touches(SHAPE, 60.0, FPS, seed=34, hold=1.2)
    rng = np.random.default_rng(34)
    steps = sim.counts(circuit, sim.fabric(circuit, 34, 0.06), force, rng, noise=3.0)
    assert np.median(esp32(steps)) == 0
    assert processed(esp32(steps), 12, unresolved=176.0) is None


def test_recordings_of_others():
    garment = np.load(DATA / "garment_textile.npz")
    for name in garment.files:
        found = processed(garment[name], 12)
        assert found.kind is Done.OFFSET and "not ADC readings" in str(found)
    assert processed(garment["trousers"], 12).ceiling == 500.0
    insole = np.load(DATA / "insole_floating.npz")["counts"].astype(float)
    insole = np.where(insole < 0, np.nan, insole)
    assert 501 <= processed(insole, 12).level <= 505
    assert processed(insole, 12, threshold=500.0) is None
    for path in sorted((DATA / "cushion_loaded").glob("*.csv")):
        assert processed(np.loadtxt(path, delimiter=",").reshape(-1, 9, 9), 10) is None


# --- files, the doctor, the running skin ---


def test_a_file_says_what_was_done_to_it(tmp_path):
    np.save(tmp_path / "a.npy", np.load(DATA / "garment_textile.npz")["trousers"])
    found = read_frames(tmp_path / "a.npy", Circuit(64, 32, adc_bits=12))
    assert any("not ADC readings: a ceiling at 500" in note for note in found.notes)


@pytest.mark.parametrize(
    "kind", ["an offset", "an offset and a dead band", "an offset and a ceiling", "each frame"]
)
@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("readout", ["loaded", "floating"])
def test_the_doctor_names_no_setting_from_such_a_stream(kind, inverted, readout):
    circuit, steps = board(35, "loaded")
    frames = DONE[kind][0](steps) / circuit.full_scale
    frames = 1.0 - frames if inverted else frames
    (found,) = diagnose(frames, circuit.read_as(readout, "rows"), inverted=inverted)
    assert found.kind == "zeros" and found.change is None
    assert "not ADC readings" in str(found) and "set" not in str(found).lower().split()


def test_the_doctor_names_no_polarity_where_a_stream_is_mostly_at_its_ceiling():
    circuit, steps = board(36, "loaded", hard=(15, 60))
    off = np.minimum(zeroed(steps), 100)
    off = off[off.mean((1, 2)) > np.quantile(off.mean((1, 2)), 0.4)]
    (found,) = diagnose(off / circuit.full_scale, circuit, series=False)
    assert found.kind == "zeros"


def test_calibrate_says_it(tmp_path, capsys):
    _, steps = board(37, "loaded")
    np.save(tmp_path / "touches.npy", zeroed(steps))
    np.save(tmp_path / "rest.npy", zeroed(steps)[:30])
    config = tmp_path / "a.yaml"
    config.write_text(
        "/**:\n  ros__parameters:\n    circuit: {rows: 7, cols: 9, r_ref: 6800.0, r_par: 90.0, "
        "readout: loaded}\n"
    )
    out = tmp_path / "b.yaml"
    given = [f"{name}:={tmp_path / name}.npy" for name in ("rest", "touches")]
    assert main(["calibrate", "--config", str(config), "--out", str(out), *given]) == 2
    assert "untouched cells read 0." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("dead", "readout"),
    [
        *((0, "floating"), ci(0, "loaded"), ci(5, "loaded"), slow(400, "floating")),
        *(slow(5, "floating"), ci(400, "loaded")),
    ],
)
def test_a_running_skin_is_never_free_and_says_why(dead, readout):
    """No rest is learnt under a palm that came after the start."""
    circuit, samples, pressed = minus_baseline(dead)
    reasons, free = played(samples, circuit.read_as(readout, "rows"), pressed=pressed)
    assert free == 0.0
    assert any("not ADC readings" in reason for reason in reasons)
    assert not any("threshold: " in reason for reason in reasons)


def test_several_mats_in_a_line_are_said(tmp_path):
    _, steps = board(38)
    np.savetxt(tmp_path / "a.csv", np.hstack([steps, steps]).reshape(len(steps), -1), "%d", ",")
    with pytest.raises(ValueError, match="2 times as many: several mats on one board"):
        read_frames(tmp_path / "a.csv", Circuit(*SHAPE))
