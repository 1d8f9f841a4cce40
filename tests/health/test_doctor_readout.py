# SPDX-License-Identifier: Apache-2.0
"""A board that is configured as another readout: the doctor names the one that fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.damaged import Case
from support.lab.board import KNOTS, FaultBoard
from support.lab.touches import everyday
from support.marks import ci, slow
from support.strangers import sim as stranger

from tactile_skin import Circuit, PressureCurve, compensate, diagnose, measure_rest
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.guide.notes import notes
from tactile_skin.health.doctor.wiring import Damage, Wires, search
from tactile_skin.physics.adc import Adc
from tactile_skin.physics.circuit import forward
from tactile_skin.physics.readouts import PASSIVE
from tactile_skin.simulation import scenes, simulator

CURVE = PressureCurve()
KINDS = [
    ("floating", "rows"),
    ("loaded", "rows"),
    ("loaded", "columns"),
    ("grounded", "rows"),
    ("grounded", "columns"),
]

CUSHIONS = Path(__file__).parents[1] / "data" / "cushion_loaded"
CUSHION = Circuit(9, 9, r_ref=35e3, r_par=25.0, readout="loaded")


def skin(kind, shape=(8, 8)) -> Circuit:
    return Circuit(*shape, readout=kind[0], driven=kind[1])


def touched(circuit, seed, ties=()):
    """Return 40 s of everyday touches of a board, 20 frames a second."""
    rng = np.random.default_rng(seed)
    board = FaultBoard(circuit, CURVE, rng)
    board.matrix.wiring.ties.extend(ties)
    force = everyday(circuit.populated, 40.0, rng, CURVE.max_force, hard=False).force
    steps = board.ratio(force[:: KNOTS // 20]) * 1023.0
    steps += 0.5 * rng.standard_normal(steps.shape)
    return np.clip(np.rint(steps), 0.0, 1023.0) / 1023.0


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_a_virtual_ground_raises_no_reading_beside_a_touch(kind):
    """Though it fits any readings, each by its own cell."""
    circuit = skin(kind)
    frames = touched(circuit, 23)
    (finding,) = diagnose(frames, replace(circuit, readout="virtual_ground"), series=False)
    assert finding.change.circuit.readout_class is circuit.readout_class
    assert finding.change.circuit.driven == circuit.driven
    assert "as configured" in str(finding)


def test_light_touches_of_a_virtual_ground_that_others_fit_as_well_accuse_nobody():
    rng = np.random.default_rng(7)
    circuit = Circuit(12, 10, r_ref=100.0, r_par=25.0, readout="virtual_ground")
    force = stranger.touches(circuit.shape, 60.0, 10, seed=7, rest=6.0, hard=(2, 10))
    steps = stranger.counts(circuit, stranger.fabric(circuit), force, rng, noise=1.0)
    assert not diagnose(steps / circuit.full_scale, circuit, series=False)


@pytest.fixture(scope="module")
def recorded(request):
    """A kind, and touches of such a board."""
    return request.param, touched(skin(request.param), 17)


def test_a_line_that_comes_and_goes_is_no_virtual_ground():
    """Open in most touches it reads nothing in them, which no network explains."""
    circuit, rng = Circuit(8, 10, r_ref=1e4, r_par=25.0, readout="loaded"), np.random.default_rng(0)
    cells = np.exp(0.15 * rng.standard_normal(circuit.shape)) / 15e3  # S
    frames = [forward(circuit, 1.0 / cells)] * 200
    for _ in range(20):
        (row, col), pressed = rng.integers(0, (6, 8)), cells.copy()
        pressed[row : row + 3, col : col + 3] = 1.0 / rng.uniform(300.0, 900.0, (3, 3))
        frames += [forward(circuit, 1.0 / pressed)] * 10 + frames[:10]
    frames = np.array(frames) + 5e-4 * rng.standard_normal((len(frames), *circuit.shape))
    frames[np.arange(len(frames)) % 20 < 15, 6] = 0.0
    (finding,) = diagnose(np.clip(frames, 0.0, 1.0), circuit, series=False)
    assert finding.kind == "contact" and finding.rows == (6,)


def test_stripes_that_touch_read_alike_under_touches():
    """At rest too few cells differ by too little for that to be sure."""
    frames = touched(skin(KINDS[0]), 17, ties=[(0, 2, 0, 3, 1.0)])
    (finding,) = diagnose(frames, skin(KINDS[0]), series=False)
    assert finding.kind == "short" and finding.rows == (2, 3)


@pytest.mark.parametrize("seed", [0, ci(2)])
def test_what_seems_to_lie_there_by_a_wrong_readout_is_none(seed):
    """Its owner was asked to take it off, whatever he did."""
    circuit = Circuit(7, 16, r_ref=1e4, r_par=0.0, adc_bits=12, readout="grounded", r_drive=25.0)
    circuit = replace(circuit, driven="columns")
    curve, rng = stranger.fabric(circuit, seed=seed, scatter=0.12), np.random.default_rng(seed)
    force = stranger.touches(circuit.shape, 60.0, 10.0, seed=seed, rest=5.0, hard=(3, 30))
    steps = np.array([stranger.counts(circuit, curve, f, rng, noise=1.2) for f in force])
    floating = circuit.read_as("floating", "rows")
    (finding,) = diagnose(steps / circuit.full_scale, floating, series=False)
    assert "Set circuit.readout: grounded, circuit.driven: columns" in str(finding)


@pytest.mark.parametrize("seed", [2, ci(5), ci(7), ci(9)])
def test_sound_lines_that_a_touch_joins_are_not_shorted(seed):
    """Behind pull-ups of 35 kohm a finger joins the lines below it: they read alike."""
    circuit = Circuit(8, 8, r_ref=35e3, r_par=25.0, readout="loaded")
    curve, rng = stranger.fabric(circuit, seed=seed, scatter=0.08), np.random.default_rng(seed)
    force = stranger.touches((8, 8), 60.0, 20.0, seed=seed, rest=5.0, hard=(5, 40))
    steps = np.array([stranger.counts(circuit, curve, f, rng, noise=1.2) for f in force])
    kinds = {finding.kind for finding in diagnose(steps / 1023.0, circuit, series=False)}
    assert not kinds & {"short", "doubled"}


def test_stripes_that_touch_are_no_load():
    """They conduct as one, which cells of sound stripes explain by a load on both."""
    rng = np.random.default_rng(1)
    cells = np.exp(0.15 * rng.standard_normal((8, 8))) / 15e3  # S
    one = np.vstack([cells[:2], cells[2:4].sum(0, keepdims=True), cells[4:]])
    read = forward(Circuit(7, 8), 1.0 / one)[[0, 1, 2, 2, 3, 4, 5, 6]]
    frames = read + 5e-4 * rng.standard_normal((200, 8, 8))
    (finding,) = diagnose(frames, Circuit(8, 8), series=False)
    assert finding.kind == "short" and finding.rows == (2, 3)


@pytest.mark.parametrize(
    ("recorded", "supposed"),
    [
        (true, other) if k in (0, 1) else ci(true, other)
        for n, true in enumerate(KINDS)
        for k, other in enumerate(KINDS[n:] + KINDS[:n])
    ],
    indirect=["recorded"],
)
def test_the_readout_that_fits_is_named(recorded, supposed):
    true, frames = recorded
    found = diagnose(frames, skin(supposed), series=False)
    if true == supposed:
        assert found == []
        return
    assert [finding.kind for finding in found] == ["readout"]
    assert f"circuit.readout: {true[0]}" in found[0].remedy
    assert true[0] == "floating" or f"circuit.driven: {true[1]}" in found[0].remedy


@pytest.mark.parametrize("kind", [*KINDS[:2], *map(ci, KINDS[2:])])
@pytest.mark.parametrize("seed", [58502, slow(58504)])
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


@pytest.mark.parametrize("seed", [41, slow(42), slow(44)])
@pytest.mark.parametrize("readout", [ci("floating"), "loaded", ci("grounded")])
def test_readings_upside_down_are_named_whatever_a_skin_rests_at(readout, seed):
    """Pull-ups of 35 kohm: cells rest about the middle of the range, and a palm takes all of it."""
    given = {"r_ref": 35e3, "r_par": 25.0} if readout != "floating" else {}
    case = Case(seed, (), 40.0, (9, 9), readouts=(readout,), **given)
    found = diagnose(1.0 - case.frames, case.circuit, series=False)
    assert [finding.kind for finding in found] == ["polarity"]
    other = Circuit(9, 9, r_ref=case.circuit.r_ref, r_par=case.circuit.r_par)
    found = diagnose(1.0 - case.frames, other, series=False)
    assert found[0].kind == "polarity"
    assert [finding.kind for finding in found[1:]] == ["readout"] * (readout != "floating")


@pytest.mark.ci
@pytest.mark.parametrize("part", [slice(110, 1500, 3), slow(slice(110, 2500, 5))])
@pytest.mark.parametrize("kind", [("loaded", (9, 9), 35e3), ("floating", (16, 16), 1780.0)])
def test_a_skin_that_is_hardly_left_alone_is_upside_down_rather_than_broken(kind, part):
    """The demo, of which a running skin keeps what it stopped for: else lines were shorted."""
    readout, shape, r_ref = kind
    circuit = Circuit(*shape, r_ref=r_ref, readout=readout)
    adc = Adc(circuit, inverted=True)
    board, parser, frames = (
        simulator.Board(circuit, CURVE, scenes.script("demo", *shape), adc=adc),
        BinaryParser(),
        [],
    )
    while len(frames) < part.stop:
        frames += parser.feed(board.scan())
    forgotten = np.array([frame.samples for frame in frames[part]]) / 64.0 / circuit.full_scale
    (finding,) = diagnose(forgotten, circuit, series=False)
    assert finding.kind == "polarity"


def test_a_skin_that_is_never_left_alone_is_neither_upside_down_nor_damaged():
    """Somebody sits on it from the first frame to the last: there are no touches to judge by."""
    paths = (CUSHIONS / name for name in ("hj_1_1.csv", "hj_6_1.csv"))
    counts = np.concatenate([np.loadtxt(path, delimiter=",").reshape(-1, 9, 9) for path in paths])
    frames = 1.0 - counts / 1023.0
    (finding,) = found = diagnose(frames, CUSHION)
    assert finding.kind == "too little seen" and "in all frames" in finding.evidence
    assert "0 touches were seen" in notes(found, frames, CUSHION)[0]


def test_feet_that_stand_in_turn_leave_no_rest():
    """Each foot loads columns from end to end, as a bad line would, and most cells are loaded."""
    rng, circuit = np.random.default_rng(3), Circuit(8, 12, readout="loaded", driven="columns")
    rest = np.exp(0.05 * rng.standard_normal((8, 12))) / 15e3  # S
    cols = np.arange(12) - [[5.5], [9.5]]
    feet = (
        np.exp(-0.5 * np.square(cols / 2.0))[:, None]
        * np.exp(0.3 * rng.standard_normal(8))[:, None]
    )
    feet /= 1e3
    sway = 1.0 + 0.2 * np.sin(np.arange(400) / 7.0)
    frames = forward(circuit, 1.0 / (rest + [s * feet[k // 25 % 2] for k, s in enumerate(sway)]))
    frames += 5e-4 * rng.standard_normal(frames.shape)
    (finding,) = diagnose(frames, circuit, series=False)
    assert finding.kind == "too little seen" and "never left alone" in finding.evidence


@pytest.mark.ci
def test_readings_that_other_touches_lower_lack_no_bit():
    """A grounded board that is taken for a floating one: 0.06 % of its readings exceed 512."""
    case = Case(99101, (), 20.0, readouts=("grounded",), r_ref=1e4, r_par=0.0)
    (finding,) = diagnose(case.frames, Circuit(*case.circuit.shape))
    assert finding.where == "wiring of the board"


@pytest.mark.parametrize("readout", PASSIVE[1:])
def test_a_resistor_of_another_value_is_named_with_its_ohms(readout):
    circuit, rng = Circuit(8, 12, readout=readout), np.random.default_rng(192100)
    sound = Wires.sound(circuit, 4e4)
    damaged = sound.with_one(Damage("resistor", 1, 5, -1, 3300.0, 0.0)).resistance()
    rho = damaged * np.exp(0.01 * rng.standard_normal(circuit.shape))
    (damage,), _ = search(circuit, rho, np.ones(circuit.shape, bool), sound)
    assert (damage.kind, damage.axis, damage.line) == ("resistor", 1, 5)
    assert damage.size == pytest.approx(3300.0, rel=0.05)


PULL_UP = Circuit(9, 9, readout="loaded", r_ref=35000.0, r_par=25.0)
DIRECT = Circuit(12, 10, readout="grounded", r_ref=4700.0, r_par=0.0)


@pytest.mark.parametrize("seed", [78201, slow(78202)])
@pytest.mark.parametrize(
    "true, supposed",
    [
        ci(PULL_UP, replace(PULL_UP, r_par=326.0)),
        (PULL_UP, Circuit(9, 9)),  # the defaults, none of which is the board's
        ci(PULL_UP, Circuit(9, 9, readout="grounded", r_ref=35000.0)),
        ci(DIRECT, Circuit(12, 10, readout="grounded")),
    ],
    ids=["r_par", "defaults", "readout and r_par", "r_ref and r_par"],
)
def test_where_no_readout_explains_the_touches_that_is_said(true, supposed, seed):
    frames = touched(true, seed)
    assert diagnose(frames, true) == []
    (finding,) = diagnose(frames, supposed)
    assert finding.kind == "circuit"
    assert "circuit.r_par" in finding.remedy or "what is left is r_par" in finding.remedy


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
