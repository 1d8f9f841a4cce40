# SPDX-License-Identifier: Apache-2.0
"""The table of what must not get worse: what a line counts, and that each can be played."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.lab.board import KNOTS, FaultBoard, Sent
from support.marks import ci, slow

from benchmarks import harness
from benchmarks.accept import __main__ as accept
from benchmarks.accept import boards, presses, rests, without
from benchmarks.accept.lines import LINES, Asked, Figure
from benchmarks.faults.reliability import Record
from tactile_skin import Circuit, PressureCurve
from tactile_skin.calibration import at_rest, tare
from tactile_skin.health import monitor


def test_a_figure_is_met_by_its_share_and_by_its_direction():
    assert Figure("silent", 8, 1000, 0.009).met and not Figure("silent", 10, 1000, 0.009).met
    assert Figure("named", 40, 40, 1.0, True).met and not Figure("named", 39, 40, 1.0, True).met
    assert Figure("felt", 12.0, None, 8.0, True).met and Figure("failing", 1, 10).met is None


def test_results_are_added_up_and_what_no_task_tells_is_left_out():
    results = [{"free": 1, "palms": 6}, {"free": 0, "palms": 6}, {"ms": [1.0, 5.0]}, {"ms": [3.0]}]
    assert Asked("free", "free", "palms").figure(results)[1:3] == (1, 12)
    assert Asked("p50", "ms", take=np.median).figure(results).value == 3.0
    assert Asked("insole", "insole s").figure(results) is None


@pytest.mark.parametrize(
    ("today", "word"), [(0, "better"), (14, "worse"), (5, ""), (6, "")], ids=str
)
def test_what_other_seeds_make_is_neither_worse_nor_better(today, word):
    before = {"value": 5, "of": 200}
    assert accept.next_to(Figure("missed", today, 200, 0.0), before) == ("5 of 200", word)


def counted(stopped) -> dict:
    """A palm from 1 to 3 s, on a robot that is stopped at these times [s]."""
    t = np.arange(4 * KNOTS) / KNOTS
    force = np.zeros((len(t), 2, 2))
    force[KNOTS : 3 * KNOTS] = presses.PALM / 4
    stop = np.any([(t >= a) & (t < b) for a, b in stopped] or [t < 0], 0)
    record = Record(force, force, stop, stop & False, stop & False, [])
    return presses.held(record, SimpleNamespace(spans=[(KNOTS, 3 * KNOTS)]))


def test_a_palm_is_held_or_let_go_or_missed():
    assert counted([(1.2, 3.5)]) == {"palms": 1, "free": 0, "missed": 0, "early": 0}
    assert counted([(1.2, 2.0)]) == {"palms": 1, "free": 1, "missed": 0, "early": 1}
    assert counted([(1.8, 3.5)]) == {"palms": 1, "free": 1, "missed": 0, "early": 0}
    assert counted([]) == {"palms": 1, "free": 1, "missed": 1, "early": 0}


@pytest.mark.parametrize("law", boards.LAWS)
def test_a_zero_that_moves_prints_a_palm_that_fades_in_its_time(law):
    circuit = Circuit(2, 2)
    board = FaultBoard(circuit, PressureCurve(), np.random.default_rng(1))
    zero = boards.MovingZero(board, law, 2.0, 100.0)
    printed = []
    for t in np.arange(0.0, 9.0, 0.05):
        steps = 50 if t < 1.0 else 250  # ADC steps
        samples = np.full(circuit.shape, steps * 2**board.fraction_bits)
        sent = zero(Sent(t, samples, 0, 0))
        printed.append(sent.samples[0, 0] / 2**board.fraction_bits)
    assert printed[10] == 100.0 and 290.0 < printed[20] <= 300.0
    assert printed[-1] == pytest.approx(100.0, abs=5.0)


def test_a_load_that_creeps_conducts_as_the_curve_says_after_a_second():
    found = boards.crept(np.ones(3 * KNOTS), 0.2)
    assert found[KNOTS] == pytest.approx(1.0) and 0.7 < found[0] < 0.85 and found[-1] > 1.05


def test_the_lines_are_listed(capsys):
    accept.main(["--list"])
    said = capsys.readouterr().out
    assert len(said.splitlines()) == len(LINES) > 12
    assert all(line.tasks(1, 0.01, accept.Path("nowhere")) for line in LINES[:2])


@pytest.mark.parametrize(
    "name",
    [
        "entries",
        *(
            pytest.param(n, marks=pytest.mark.ci)
            for n in ("faults", "moving", "proved", "bits", "weighed")
        ),
        pytest.param("obey", marks=pytest.mark.slow),
    ],
)
def test_the_smallest_version_of_a_line_runs(name, capsys, monkeypatch):
    monkeypatch.setattr(presses, "PALMS", 1)
    monkeypatch.setattr(presses, "PUSHES", 1)
    found = accept.main(["--share", "0.001", "--only", name, "--jobs", "1"])
    asked = next(line for line in LINES if line.name == name).asked
    said = capsys.readouterr().out
    assert found[name] and set(found[name]) <= {each.name for each in asked}
    assert all(f"| {name} | {figure} |" in said for figure in found[name])


@pytest.mark.parametrize(
    ("kind", "wired"),
    [
        ci("open at rest", "grounded"),
        ("below a step", "floating"),
        ci("signed", "virtual_ground"),
        ("uneven", "floating"),
        ci("shaking cover", "loaded"),
    ],
)
def test_a_sound_skin_unlike_an_even_fabric_is_free_and_feels_what_presses(kind, wired):
    found = rests.run(kind, wired, 0, 7)
    # under a touch what a cover loses is not told from what a short takes: that stops the robot
    most = 0.15 if kind == "shaking cover" else 0.02
    assert found["at once"] and found["fault"] <= most * found["idle"], found["said"]
    assert found["free"] == found["missed"] == 0
    assert found["ratios"] == pytest.approx([1.0, 1.0], abs=0.07)


@pytest.mark.parametrize(
    "k", [slow(6), ci(7)]
)  # a palm comes before it is free; it is open by its curve
def test_an_uneven_grounded_skin_is_free_at_once(k):
    found = rests.run("uneven", "grounded", k, harness.seed_of(9, "uneven", "grounded", k))
    assert found["at once"] and not found["fault"], found["said"]
    assert found["free"] == found["missed"] == 0


def test_a_mechanism_is_left_out_by_its_name(monkeypatch, capsys):
    monkeypatch.setattr(monitor, "CHECKS", list(monitor.CHECKS))
    monkeypatch.setattr(tare, "one_voltage", at_rest.one_voltage)  # both are set back
    monkeypatch.setattr(at_rest, "one_voltage", at_rest.one_voltage)
    without.leave_out("health.bits.Bits")
    assert len(monitor.CHECKS) == 9 and monitor.Bits not in monitor.CHECKS
    without.leave_out("calibration.at_rest.one_voltage")
    assert at_rest.one_voltage(1, 2) is tare.one_voltage() is None
    for name in "health.bits.Bit", "health.nothing.At", "solvers.map.map_estimate":
        with pytest.raises(SystemExit):
            accept.main(["--list", "--without", name])
        assert name in capsys.readouterr().err
