# SPDX-License-Identifier: Apache-2.0
"""`diagnose` names the line or cell that is bad, and nothing on a sound board."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.damaged import KINDS, Case, explains
from support.lab.unknown import Unknown
from support.marks import ci, slow
from support.strangers import sim
from support.weights import known

from tactile_skin import Circuit, cli, diagnose, forward
from tactile_skin.board.frame import Counters
from tactile_skin.commands import doctor as command
from tactile_skin.guide.notes import notes
from tactile_skin.health.doctor.wiring import Wires
from tactile_skin.middleware.config import skin_of
from tactile_skin.physics.readouts import DRIVEN, PASSIVE, READOUTS

SHAPE, SECONDS = (10, 12), 20.0


@pytest.mark.parametrize("seed", [0, ci(1), ci(2)])
def test_a_sound_board_has_no_fault(seed):
    case = Case(seed, (), SECONDS, SHAPE)
    assert diagnose(case.frames, case.circuit) == []


LONG = "bits", "noisy line", "doubled", "saturation", "short at a crossing"


FLOATING = [k for k in KINDS if k not in ("resistor", "drivers")]
NAMED = [(ci if k in LONG else pytest.param)(k, "floating", 7) for k in FLOATING] + [
    (ci if readout == "loaded" else slow)(kind, readout, 192007)
    for kind in KINDS
    for readout in (PASSIVE[2:] if kind == "drivers" else PASSIVE[1:])
    if kind not in ("bits", "saturation")
]


@pytest.mark.parametrize(("kind", "readout", "seed"), NAMED)
def test_a_fault_is_named_with_its_line_or_cell(kind, readout, seed):
    case = Case(seed, (kind,), SECONDS, SHAPE, readouts=(readout,))
    found = diagnose(case.frames, case.circuit)
    if case.hidden:
        assert found == []
        return
    ((_, name, rows, cols),) = case.faults
    assert [explains(f, kind, name, rows, cols, case.cut) for f in found] == [True], found
    assert found[0].evidence and found[0].remedy
    assert str(found[0]).startswith(found[0].where)


@pytest.mark.ci
def test_a_wrong_bit_at_whose_edge_the_cells_rest_is_named_by_their_noise():
    """Samples leap across its gap, and their means fill it."""
    case = Case(171012, ("bits",), 20.0)
    (finding,) = diagnose(case.frames, case.circuit, series=False)
    assert (finding.form, finding.numbers["bit"], finding.numbers["kept"]) == ("leaps", 5, False)


@pytest.mark.parametrize(("seed", "times"), [(1, 1), (1, 3), (1, 10), (2, 10), (3, 5), (3, 10)])
def test_a_wrong_r_ref_is_named_or_the_touches_say_too_little(seed, times):
    """Where r_ref is entered too high the touches of a small board may fit any r_par."""
    circuit, rng = (
        Circuit(8, 8, r_ref=1000.0, r_par=100.0, adc_bits=12),
        np.random.default_rng(seed),
    )
    hands = {"seed": seed + 1, "rest": 6.0, "hard": (3, 45), "hold": 0.9, "gap": 0.7}
    force = sim.touches(circuit.shape, 60.0, 10, **hands)
    frames = sim.counts(circuit, sim.fabric(circuit, seed), force, rng) / circuit.full_scale
    supposed = replace(circuit, r_ref=times * circuit.r_ref)
    found = diagnose(frames, supposed)
    said = " ".join(notes(found, frames, supposed))
    assert [f.where for f in found] in ([], ["r_par, r_ref or supply"])
    assert ("a wrong r_par, r_ref or supply: these touches say too little" in said) == (
        times > 1 and not found
    )


def test_an_adc_of_another_width_may_be_another_scale():
    """What the sketch prints are millivolts of 3.3 V, configured as 16 bits."""
    circuit = Circuit(8, 8, r_ref=300.0, r_par=0.0, r_drive=25.0, readout="grounded", adc_bits=12)
    force = sim.touches(circuit.shape, 60.0, 10, seed=2, rest=6.0, hard=(3, 45), hold=0.9, gap=0.7)
    rng, supposed = np.random.default_rng(1), replace(circuit, adc_bits=16)
    sent = sim.counts(circuit, sim.fabric(circuit, 1, 0.05), force, rng, full=3300.0)
    (found,) = diagnose(sent / supposed.full_scale, supposed)
    assert "(adc_bits 12)" in found.evidence
    assert "else look circuit.adc_full_scale up" in found.remedy


def test_a_virtual_ground_asks_for_no_harder_touches():
    """Its readings show no r_par, however hard."""
    circuit = Circuit(6, 6, r_par=10.0, readout="virtual_ground")
    force, rng = sim.touches(circuit.shape, 30.0, 10), np.random.default_rng(1)
    frames = sim.counts(circuit, sim.fabric(circuit), force, rng) / circuit.full_scale
    (said, *_) = notes([], frames, circuit)
    assert "each reading is of its own cell alone" in said and "press hard" not in said


def test_readings_at_the_top_may_be_those_of_another_supply():
    """The divider's supply is half as much again as the ADC's reference."""
    circuit, rng = Circuit(8, 8, r_par=120.0, adc_bits=12), np.random.default_rng(2)
    force = sim.touches(circuit.shape, 40.0, 10, hard=(3, 45), hold=1.2, gap=0.4)
    full = 1.5 * circuit.full_scale
    frames = sim.counts(circuit, sim.fabric(circuit), force, rng, full=full) / circuit.full_scale
    (found,) = diagnose(frames, circuit)
    assert "are exactly 4095, an end of the range" in found.evidence
    assert "or the supply" in found.evidence


@pytest.mark.parametrize("shape", [ci((10, 12)), ci((8, 16)), (12, 5)])
@pytest.mark.parametrize("first", ["columns", "configured"])
def test_rows_and_columns_that_are_exchanged_are_named(shape, first):
    """Not sent row by row, or sent so and configured the other way round."""
    case = Case(5, (), SECONDS, shape)
    rows, cols = shape
    frames, circuit = case.frames, case.circuit
    if first == "columns":
        frames = frames.swapaxes(1, 2).reshape(frames.shape)
    else:
        frames, circuit = frames.reshape(-1, cols, rows), Circuit(cols, rows)
    (finding,) = diagnose(frames, circuit, series=False)
    assert finding.kind == "transposed"
    assert f"circuit.rows: {circuit.cols}" in finding.remedy


def test_two_faults_are_both_named_and_marked_in_the_picture():
    case = Case(3, ("open", "dead"), SECONDS, SHAPE)
    found = diagnose(case.frames, case.circuit)
    assert sorted(f.kind for f in found) == ["dead", "open"]
    text = command.picture(found, case.circuit)
    assert "X" in text and ("-" in text or "|" in text)
    assert len(text.splitlines()) >= SHAPE[0] + 2


@pytest.mark.parametrize("seed", [3, ci(4)])
def test_a_bad_lead_has_its_ohms(seed):
    """1 kohm, with the standard deviation that the fabric leaves."""
    case = Case(seed, ("lead",), SECONDS, SHAPE)
    (finding,) = diagnose(case.frames, case.circuit, series=False)
    size, std = map(float, re.search(r"(\d+) \+- (\d+) ohm", finding.evidence).groups())
    assert std < 100.0
    assert abs(size - 1000.0) < 3.0 * std


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("driven", DRIVEN)
def test_sound_wires_are_the_circuit(readout, driven):
    """The wiring that is searched is the solvers' network while nothing is damaged."""
    circuit = Circuit(5, 7, readout=readout, driven=driven)
    reads = circuit.two_terminal(forward(circuit, np.full((5, 7), 2e4)))
    np.testing.assert_allclose(Wires.sound(circuit, 2e4).resistance(), reads, rtol=1e-4)


@pytest.mark.parametrize("cells", ["alike", "of a fabric"])
@pytest.mark.parametrize("palms", [1, 4])
def test_a_palm_that_stands_still_is_no_fault(palms, cells):
    """All that it reads again and again is one reading."""
    shape, rng, frames = (12, 12), np.random.default_rng(2), []
    scatter = {"scatter": 0.0, "rest": 0.0, "line": 0.0} if cells == "alike" else {}
    board = Unknown(shape, seed=61, **scatter)
    row, col = np.indices(shape)
    for _ in range(palms):
        at, size = rng.uniform(2.0, 9.0, 2), rng.uniform(2.0, 3.5)
        apart = ((row - at[0]) ** 2 + (col - at[1]) ** 2) / size**2
        palm = rng.uniform(4.0, 10.0) * np.clip(1.0 - apart, 0.0, None) ** 0.3
        for share, n in ((0.0, 250), (0.1, 1), (0.4, 1), (0.8, 1), (1.0, 250), (0.3, 1)):
            ratio = board.expose(share * palm)
            frames += [board.sample(ratio) for _ in range(n)]
    assert diagnose(frames, known(board), series=False) == []


def test_a_board_that_reads_one_voltage_has_no_signal():
    frames = 0.3 + 1e-3 * np.random.default_rng(0).standard_normal((200, 8, 8))
    (finding,) = diagnose(frames, Circuit(8, 8))
    assert finding.kind == "no signal"


@pytest.mark.parametrize(
    ("frames", "match"),
    [
        (np.full((5, 4, 4), 0.2), "20 or more"),
        (np.full((50, 4, 5), 0.2), "shape"),
        (np.full((50, 4, 4), 1.2), "from 0 to 1"),
        (np.full((50, 4, 4), np.nan), "ever read"),
    ],
)
def test_frames_that_are_none_are_refused(frames, match):
    with pytest.raises(ValueError, match=match):
        diagnose(frames, Circuit(4, 4))


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Files of a sound board, and of one with an open row."""
    folder = tmp_path_factory.mktemp("doctor")
    for name, faults in (("sound", ()), ("open", ("open",))):
        case = Case(5, faults, SECONDS, (8, 9))
        np.save(folder / f"{name}.npy", case.frames)
        counts = np.rint(case.frames * case.circuit.full_scale).reshape(len(case.frames), -1)
        np.savetxt(folder / f"{name}.csv", counts, fmt="%d", delimiter=",")
    return folder


@pytest.mark.ci
def test_readings_that_are_missing_now_and_then_are_not_noise():
    """A text line with a blank now and then."""
    case = Case(2, (), 20.0)
    frames = case.frames.copy()
    lost = np.random.default_rng(4).choice(len(frames), 12, replace=False)
    frames[lost, 0, 3] = np.nan
    assert [f.kind for f in diagnose(frames, case.circuit)] == []


@pytest.mark.ci
def test_a_board_of_10_bits_that_is_configured_as_12_is_asked_about(recordings, capsys):
    """Its readings are those of another fabric: nothing else shows it."""
    size = "rows:=8", "cols:=9"
    path = str(recordings / "sound.csv")
    assert cli.main(["doctor", path, *size, "adc_bits:=12"]) == 0
    assert "check circuit.adc_bits = 12" in capsys.readouterr().out


@pytest.mark.ci
def test_the_command_tells_by_its_status(recordings, capsys):
    size = "rows:=8", "cols:=9"
    assert cli.main(["doctor", str(recordings / "sound.csv"), *size]) == 0
    out = capsys.readouterr().out
    assert "nothing found" in out and "adc_bits" not in out
    assert cli.main(["doctor", str(recordings / "open.npy"), *size]) == 1
    out = capsys.readouterr().out
    assert ("open: none of its" in out and "- - -" in out) or "|" in out
    assert cli.main(["doctor", str(recordings / "sound.npy"), "rows:=7"]) == 2
    err = capsys.readouterr().err
    assert "check rows and cols" in err and err.count("\n") == 1


def test_where_the_converter_ends_under_touches_it_is_said():
    """Nothing is broken, but more force is not felt: r_ref is too large."""
    circuit = Circuit(8, 8, r_ref=1000.0, r_par=100.0, readout="virtual_ground")
    frames = np.full((40, 8, 8), 0.03)
    assert "end of the range" not in " ".join(notes([], frames, circuit))
    frames[30:, 3, 3:5] = 1.0
    *_, said = notes([], frames, circuit)
    assert "in 10 of 40 frames readings are at the end of the range" in said
    assert "A smaller r_ref leaves room" in said


def changed(skin, given):
    return skin_of(command._board(skin, given), "").adc


def test_arguments_change_the_board_and_what_its_readout_does_not_know_is_dropped():
    given = {"rows": 8, "cols": 9, "r_line": 5.0, "adc_offset": 3.0, "diode": 0.58}
    skin = skin_of({f"circuit.{name}": value for name, value in given.items()}, "")
    adc = changed(skin, {"driven": "rows", "r_par": 70.0, "inverted": True})
    assert adc.circuit == Circuit(8, 9, r_line=5.0, r_par=70.0)
    assert (adc.offset, adc.inverted, adc.diode) == (3.0, True, 0.58)
    adc = changed(skin, {"readout": "grounded", "r_drive": 40.0, "driven": "columns"})
    grounded = Circuit(8, 9, readout="grounded", driven="columns", r_drive=40.0)
    assert adc.circuit == grounded and adc.diode == 0.0
    with pytest.raises(ValueError, match=r"circuit.r_ref .* = -5.0: must be from 1.0 to"):
        changed(skin, {"r_ref": -5.0})


def test_a_link_that_damages_or_loses_frames_is_a_finding():
    assert command._link(Counters(), 1000, 0) == []
    (finding,) = command._link(Counters(corrupt=50, lost=20), 1000, 1)
    assert finding.where == "serial link"
    assert "5.0% more came damaged and 2.0% were lost; 1 reconnections" in finding.evidence
    assert "baud rate" in finding.remedy
