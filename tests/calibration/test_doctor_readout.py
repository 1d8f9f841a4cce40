"""A board that is configured as another readout: the doctor names the one that fits."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, diagnose, measure_rest
from tactile_skin.bench.damage import streams
from tactile_skin.bench.damage.board import KNOTS, FaultBoard
from tactile_skin.learning import scenes
from tactile_skin.physics.circuit import forward

CURVE = PressureCurve()
KINDS = [
    ("floating", "rows"),
    ("loaded", "rows"),
    ("loaded", "columns"),
    ("grounded", "rows"),
    ("grounded", "columns"),
]


def skin(kind, shape=(8, 8)) -> Circuit:
    return Circuit(*shape, readout=kind[0], driven=kind[1])


@pytest.fixture(scope="module", params=KINDS, ids="-".join)
def recorded(request):
    """A kind, and 40 s of touches of such a board, 20 frames a second."""
    circuit, rng = skin(request.param), np.random.default_rng(17)
    board = FaultBoard(circuit, CURVE, rng)
    force = streams.everyday(circuit.populated, 40.0, rng, CURVE.max_force, hard=False).force
    steps = board.ratio(force[:: KNOTS // 20]) * 1023.0
    steps += 0.5 * rng.standard_normal(steps.shape)
    return request.param, np.clip(np.rint(steps), 0.0, 1023.0) / 1023.0


@pytest.mark.parametrize("supposed", KINDS, ids="-".join)
def test_the_readout_that_fits_is_named(recorded, supposed):
    true, frames = recorded
    found = diagnose(frames, skin(supposed), series=False)
    if true == supposed:
        assert found == []
        return
    assert [finding.kind for finding in found] == ["readout"]
    assert f"circuit.readout: {true[0]}" in found[0].remedy
    assert true[0] == "floating" or f"circuit.driven: {true[1]}" in found[0].remedy


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
@pytest.mark.parametrize("seed", [58502, 58504])
def test_fingers_are_no_noise_and_readings_upside_down_are_named(kind, seed):
    """Single cells under fingers, which lower the other readings of a grounded line."""
    circuit, rng, frames = skin(kind), np.random.default_rng(seed), []
    rest = np.exp(rng.normal(0.0, 0.2, circuit.shape)) / CURVE.rest_resistance
    for _ in range(20):
        at = rng.integers(1, 7, 2)
        force = scenes.finger(8, 8, *at, rng.uniform(2.0, 8.0), width=0.2)  # a knuckle: one cell
        pressed = CURVE.resting_at(1.0 / rest).resistance(force)
        frames += [forward(circuit, r) for r in [1.0 / rest] * 14 + [pressed] * 20]
    frames = np.array(frames) + rng.standard_normal((len(frames), 8, 8)) * 0.8 / 1023.0
    frames = np.clip(frames, 0.0, 1.0)
    assert diagnose(frames, circuit, series=False) == []
    (finding,) = diagnose(1.0 - frames, circuit, series=False)
    assert finding.kind == "polarity" and "circuit.inverted" in finding.remedy


def test_an_open_line_is_named_on_a_loaded_board():
    circuit, rng = skin(("loaded", "rows")), np.random.default_rng(18)
    board = FaultBoard(circuit, CURVE, rng)
    board.wiring.cols[3] = -1
    force = streams.everyday(circuit.populated, 40.0, rng, CURVE.max_force, hard=False).force
    ratio = board.ratio(force[:: KNOTS // 20])
    ratio += rng.standard_normal(ratio.shape) * 0.5 / 1023.0
    found = diagnose(np.clip(ratio, 0.0, 1.0), circuit, series=False)
    assert [(f.kind, f.cols) for f in found] == [("open", (3,))]


@pytest.mark.parametrize("kind", KINDS[1:], ids="-".join)
def test_the_rest_of_other_readouts(kind):
    circuit, rng = skin(kind, (8, 12)), np.random.default_rng(19)
    g = np.exp(0.1 * rng.standard_normal(circuit.shape)) / CURVE.rest_resistance
    ratio = forward(circuit, 1.0 / g)
    frames = ratio + rng.standard_normal((60, *circuit.shape)) * 0.5 / 1023.0
    rest = measure_rest(np.clip(frames, 0.0, 1.0), circuit)
    assert rest.conductance == pytest.approx(g, rel=0.03)
    curve, force = CURVE.resting_at(1.0 / rest.conductance), scenes.finger(8, 12, 3.0, 5.0, 4.0)
    pressed = forward(circuit, CURVE.resting_at(1.0 / g).resistance(force))
    found = compensate(pressed, circuit, curve, noise=0.5)
    assert found.status == "ok"
    assert found.force.sum() == pytest.approx(force.sum(), rel=0.05)
    frames[20:30] += pressed - ratio  # somebody presses for a moment
    with pytest.raises(ValueError, match="does something touch the skin"):
        measure_rest(np.clip(frames, 0.0, 1.0), circuit)
