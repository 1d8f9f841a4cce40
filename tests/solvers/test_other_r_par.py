# SPDX-License-Identifier: Apache-2.0
"""An r_par that is not the circuit's: found where it is, and not where it is not."""

import dataclasses
import zlib

import numpy as np
import pytest
from support.lab import touches
from support.lab.board import FaultBoard
from support.marks import ci

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.calibration.rest import resting_conductance
from tactile_skin.physics.curve import GRAM
from tactile_skin.physics.readouts import PASSIVE
from tactile_skin.simulation import scenes
from tactile_skin.simulation.textile import Textile, read
from tactile_skin.solvers.reading import SCAN_NOISE, check_reading
from tactile_skin.solvers.rivals import other_r_par

CIRCUIT, CURVE = Circuit(), PressureCurve()
_SKIN = "16x16-loaded-rows", "text", "single", 1.0, True
PALM = [67003, *(zlib.crc32(str(word).encode()) for word in _SKIN)]  # its seed in the benchmark


def block(force=250.0, circuit=CIRCUIT):
    """(rows, cols) [N]: one touch of 20 cells of so many grams."""
    found = np.zeros(circuit.shape)
    found[4:9, 5:9] = force * GRAM
    return found * circuit.populated


def read_by(circuit, force, rng, readout="scan"):
    g = circuit.populated / CURVE.resistance(force)
    with np.errstate(divide="ignore"):
        return scenes.read_out(circuit, forward(circuit, 1.0 / g), readout, rng)


def rested(board, rng, scatter=0.03, supposed=CIRCUIT):
    """A fabric whose cells scatter at rest, as it is, and as it is measured by another circuit."""
    cells = CURVE.rest_resistance * np.exp(scatter * rng.standard_normal(board.shape))
    g = resting_conductance(forward(board, cells), supposed, 0.1)
    return CURVE.resting_at(cells), CURVE.resting_at(1.0 / np.where(g > 0.0, g, 1e-5))


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_r_par_is_found_by_one_frame(share):
    board, rng = dataclasses.replace(CIRCUIT, r_par=share * CIRCUIT.r_par), np.random.default_rng(0)
    fabric, curve = rested(board, rng)
    adc = scenes.read_out(board, forward(board, fabric.resistance(block())), "scan", rng)
    reading = check_reading(adc, CIRCUIT, curve, noise=SCAN_NOISE)
    found = other_r_par.other_r_par(reading, 1.0 / curve.resistance(block()))
    assert found.r_par == pytest.approx(board.r_par, abs=3.0 * found.std)
    assert found.std < 20.0


@pytest.mark.parametrize("readout", PASSIVE)
def test_the_std_covers_noise_and_lightly_touched_cells(readout):
    """Held at rest, cells that are touched lightly would tell of another r_par."""
    circuit, rng, off = Circuit(readout=readout), np.random.default_rng(7), []
    for _ in range(40):
        force = block()
        lightly = rng.integers(10, 16, 20), rng.integers(0, 16, 20)
        force[lightly] = rng.uniform(3.0, 7.0, 20) * GRAM
        fabric, curve = rested(circuit, rng, supposed=circuit)
        reading = check_reading(
            scenes.read_out(circuit, forward(circuit, fabric.resistance(force)), "scan", rng),
            circuit, curve, noise=SCAN_NOISE,
        ).above_cut_off()  # fmt: skip
        g = 1.0 / curve.resistance(force)
        assert other_r_par.other_r_par(reading, g) is None
        adc = np.where(reading.known, reading.adc, np.nan)
        evidence = other_r_par._supposed(circuit, curve).evidence(adc, SCAN_NOISE, g)
        off.append(evidence.score[0] / evidence.information[0, 0] ** 0.5)
    assert abs(np.mean(off)) < 0.5
    assert 0.5 < np.std(off) < 1.4


def test_of_a_rest_that_was_not_measured_little_is_told():
    """Cells that scatter read as another r_par would."""
    rng = np.random.default_rng(8)
    found = []
    for _ in range(20):
        fabric, _ = rested(CIRCUIT, rng, 0.05)
        adc = scenes.read_out(CIRCUIT, forward(CIRCUIT, fabric.resistance(block())), "scan", rng)
        reading = check_reading(adc, CIRCUIT, CURVE, noise=SCAN_NOISE)
        found.append(other_r_par.other_r_par(reading, 1.0 / CURVE.resistance(block())))
    assert sum(f is not None for f in found) <= 1


def test_where_everything_is_touched_r_par_is_not_determined():
    rng = np.random.default_rng(2)
    force = scenes.sample("random", 1, 16, 16, rng)[0] + 20 * GRAM
    board = dataclasses.replace(CIRCUIT, r_par=1.1 * CIRCUIT.r_par)
    reading = check_reading(read_by(board, force, rng), CIRCUIT, CURVE)
    assert other_r_par.other_r_par(reading, 1.0 / CURVE.resistance(force)) is None


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_wrong_r_par_is_told_and_the_force_is_that_of_the_right_one(share):
    board, rng = dataclasses.replace(CIRCUIT, r_par=share * CIRCUIT.r_par), np.random.default_rng(8)
    errors, trusting, found = [], [], []
    for force in np.minimum(scenes.sample("rects", 30, 16, 16, rng), CURVE.max_force):
        fabric, curve = rested(board, rng)
        adc = scenes.read_out(board, forward(board, fabric.resistance(force)), "scan", rng)
        estimate = compensate(adc, CIRCUIT, curve, "map", noise=SCAN_NOISE)
        if estimate.r_par is not None:
            assert estimate.status == "suspect" and f"{estimate.r_par:.0f}" in estimate.message
            found.append(estimate.r_par)
            errors.append(np.abs(estimate.force - force).mean())
            exact = compensate(adc, CIRCUIT, curve, "newton").force
            trusting.append(np.abs(exact - force).mean())
    assert len(found) >= 8
    assert np.median(np.abs(np.subtract(found, board.r_par))) < 8.0  # ohm
    assert np.mean(errors) < 0.5 * np.mean(trusting)


def test_a_stream_goes_on_with_the_r_par_that_was_found():
    """And lets go of it where the circuit's own explains the reading."""
    board, rng, last = dataclasses.replace(CIRCUIT, r_par=250.0), np.random.default_rng(9), None
    fabric, curve = rested(board, rng)
    for k in range(5):
        force = (1.0 + 0.02 * k) * block()
        adc = scenes.read_out(board, forward(board, fabric.resistance(force)), "scan", rng)
        last = compensate(adc, CIRCUIT, curve, "auto", start=last)
        assert last.r_par == pytest.approx(board.r_par, abs=40.0)
    adc = scenes.read_out(CIRCUIT, forward(CIRCUIT, curve.resistance(block())), "scan", rng)
    sound = compensate(adc, CIRCUIT, curve, "auto", start=last)
    assert (sound.status, sound.r_par) == ("ok", None)


def test_readings_next_to_the_cut_off_err_to_neither_side():
    """Those just above it are the ones that noise raised."""
    rng, circuit = np.random.default_rng(8), Circuit(100, 200, readout="grounded")
    true = rng.uniform(0.0, 4.0, circuit.shape) / circuit.full_scale
    adc = scenes.read_out(circuit, true, "scan", rng)
    reading = check_reading(adc, circuit, CURVE, noise=SCAN_NOISE).above_cut_off()
    assert abs(reading.misfit(true).mean()) < 0.05 * SCAN_NOISE


@pytest.mark.parametrize("share", [0.8, 1.25])
def test_a_skin_with_gaps_and_lost_readings_finds_it_too(share):
    mask = np.ones((16, 16), bool)
    mask[::5, 1::4] = False
    circuit, rng = Circuit(mask=mask), np.random.default_rng(3)
    other = dataclasses.replace(circuit, r_par=share * circuit.r_par)
    _, curve = rested(other, rng, 0.0, circuit)
    adc = np.where(rng.random((16, 16)) < 0.05, np.nan, read_by(other, block(circuit=other), rng))
    found = compensate(adc, circuit, curve, "map", missing=True, noise=0.52)
    assert found.r_par == pytest.approx(other.r_par, abs=40.0)
    assert (found.status, found.force[~mask].max()) == ("suspect", 0.0)


def soft_hand(rng):
    """A hand laid on most of the skin, of a few grams, and a finger that presses."""
    picture = scenes.sample("blobs", 1, 16, 16, rng)[0]
    soft = rng.uniform(2.0, 30.0) * GRAM * np.exp(0.3 * rng.standard_normal((16, 16)))
    where = np.zeros((16, 16), bool)
    i, j = rng.integers(0, 6, 2)
    where[i : i + 11, j : j + 9] = True
    return np.minimum(np.maximum(picture, where * soft), CURVE.max_force)


@pytest.mark.parametrize("kind", ["blobs", "rects", "soft hand"])
@pytest.mark.parametrize("readout", ["scan", "adc10"])
def test_a_valid_skin_gets_no_other_r_par(kind, readout):
    rng = np.random.default_rng(4)
    others = 0
    for _ in range(60):
        one = soft_hand(rng) if kind == "soft hand" else scenes.sample(kind, 1, 16, 16, rng)[0]
        adc = read_by(CIRCUIT, np.minimum(one, CURVE.max_force), rng, readout)
        others += compensate(adc, CIRCUIT, CURVE, "map").r_par is not None
    assert others <= 1


@pytest.mark.parametrize(
    "fault", [{"open": 1}, {"moving": 2.0}, {"ceiling": 0.5}, {"full_scale": 1}, {"broken": 1}]
)
def test_another_fault_is_not_taken_for_it(fault):
    rng = np.random.default_rng(5)
    for force in scenes.sample("rects", 15, 16, 16, rng):
        adc = read(Textile(noise=1.0, **fault), CIRCUIT, CURVE, np.minimum(force, 9.8), rng)
        assert compensate(adc, CIRCUIT, CURVE, "map", noise=SCAN_NOISE).r_par is None


def test_the_scatter_of_an_unknown_rest_is_seldom_worth_a_second_fit(monkeypatch):
    """It shifts the r_par that a frame seems to ask for by more than its noise."""
    rng, fits = np.random.default_rng(1), []
    rest = CURVE.points[0][1] * np.exp(0.05 * rng.standard_normal(CIRCUIT.shape))
    force = scenes.sample("blobs", 40, 16, 16, rng)
    adc = forward(CIRCUIT, CURVE.resting_at(rest).resistance(force))
    once = other_r_par.Supposed.evidence
    monkeypatch.setattr(other_r_par.Supposed, "evidence", lambda *a: fits.append(a) or once(*a))
    found = compensate(scenes.read_out(CIRCUIT, adc, "scan", rng), CIRCUIT, CURVE, "map", noise=0.5)
    assert np.count_nonzero(found.status == "ok") == 40
    assert len(fits) <= 16


def palm(rng):
    """(16, 16) [N]: a broad load, softer and softer towards its rim."""
    row, col = np.mgrid[:16, :16]
    (y, x), (high, wide), power = rng.uniform(2, 14, 2), rng.uniform(3, 6, 2), rng.choice([2, 3, 4])
    force = np.exp(-(np.abs((row - y) / high) ** power) - np.abs((col - x) / wide) ** power)
    return force * rng.uniform(0.5, 4.0) * np.exp(0.1 * rng.standard_normal(force.shape))


@pytest.mark.parametrize("noise", [None, ci(SCAN_NOISE)])
@pytest.mark.parametrize("readout", PASSIVE)
def test_a_palm_is_no_fault(readout, noise):
    """Its rim would be of another r_par, if its cells were at rest."""
    circuit, rng = Circuit(readout=readout), np.random.default_rng(3)
    frames = np.array([read_by(circuit, palm(rng), rng) for _ in range(60)])
    found = compensate(frames, circuit, CURVE, "map", noise=noise)
    assert np.count_nonzero(found.status != "ok") <= 3


def even(rng, scatter):
    """(16, 16) [N]: a load on all cells, whose touch scatters."""
    force = np.exp(rng.uniform(np.log(0.3), np.log(9.0)) + scatter * rng.standard_normal((16, 16)))
    return np.minimum(force, CURVE.max_force)


@pytest.mark.parametrize("scatter", [0.05, 0.2])
@pytest.mark.parametrize("readout", PASSIVE)
def test_an_even_load_on_all_cells_is_no_fault(readout, scatter):
    """The cells of its fit differ by noise, not by a load that would be too even."""
    circuit, rng = Circuit(readout=readout), np.random.default_rng(6)
    frames = [read_by(circuit, even(rng, scatter), rng) for _ in range(40)]
    found = compensate(np.array(frames), circuit, CURVE, "map", noise=SCAN_NOISE)
    assert np.count_nonzero(found.status != "ok") <= 2


def test_a_palm_with_a_soft_rim_is_no_other_r_par():
    """Its rim leaves lightly touched cells; an r_par without them must explain as much.

    A push of `benchmarks.faults` on sound boards, taken for one in 10 of 57 frames.
    """
    circuit, rng = Circuit(16, 16, readout="loaded"), np.random.default_rng(PALM)
    board = FaultBoard(circuit, CURVE, rng, 1.0, "text", "single")
    scene = touches.everyday(circuit.populated, 24.0, rng, CURVE.max_force, False)
    rest = resting_conductance(board.ratio(np.zeros((1, 16, 16)))[0], circuit, 0.2)
    curve, noise = CURVE.resting_at(1.0 / rest), np.random.default_rng(1)
    force = scene.force[185:1000:5]
    force = force[force.sum((1, 2)) > 20.0]
    steps = 1023.0 * board.ratio(force) + noise.standard_normal(force.shape)
    adc = np.clip(np.rint(steps), 0.0, 1023.0) / 1023.0
    found = compensate(adc, circuit, curve, "map", noise=1.1)
    assert len(force) > 50
    assert (found.status == "ok").all()
