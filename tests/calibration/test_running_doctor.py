"""The doctor of a running skin is asked while a fault stops it, and speaks when it is sure."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tactile_skin import Circuit
from tactile_skin.calibration.doctor import running
from tactile_skin.calibration.doctor.findings import Finding
from tactile_skin.calibration.doctor.running import RunningDoctor

sys.path.insert(0, str(Path(__file__).parents[1] / "yardsticks"))
from doctor import Case

CIRCUIT = Circuit(4, 4)
RATE = 100


@pytest.fixture
def asked(monkeypatch):
    """Numbers of frames that the doctor was asked about; `asked.found` is what it says."""

    class Asked(list):
        found = ()

    asked = Asked()

    def diagnose(frames, circuit, rest=None, *, series=True):
        assert frames.shape[1:] == circuit.shape and not series
        asked.append(len(frames))
        return list(asked.found)

    monkeypatch.setattr(running, "diagnose", diagnose)
    return asked


def play(doctor, seconds, start=0.0, stopped=True, rate=RATE):
    """Frames, and a look each second; the looks' findings."""
    seen = []
    for k in range(round(seconds * rate)):
        doctor.frame(start + k / rate, np.zeros(CIRCUIT.shape), stopped)
        if k % rate == rate - 1:
            doctor.look(CIRCUIT)
            seen.append(doctor.findings)
    return seen


def test_a_skin_that_is_free_is_not_looked_at(asked):
    assert set(play(RunningDoctor(), 20, stopped=False)) == {()} and not asked


def test_it_is_asked_at_growing_times_about_a_bounded_number_of_frames(asked):
    play(RunningDoctor(), 300)
    assert 5 <= len(asked) <= 12
    assert asked[0] == 300 and max(asked) <= 512


def test_a_slow_board_is_asked_once_it_has_sent_enough(asked):
    play(RunningDoctor(), 6, rate=10)
    assert asked[0] >= 50


def test_only_what_is_found_twice_in_succession_is_said(asked):
    open_row = Finding("open", "row 2", "open", "Check its lead", (2,))
    doctor, chance = RunningDoctor(), Finding("stuck", "row 1, column 1", "", "", (1,), (1,))
    asked.found = [open_row, chance]
    assert not any(play(doctor, 4))
    asked.found = [open_row]
    assert play(doctor, 6, start=4.0)[-1] == (open_row,)
    assert doctor.message == "row 2: open. Check its lead"


def test_a_stop_that_is_over_is_forgotten(asked):
    asked.found = [Finding("open", "row 2", "open", "Check its lead", (2,))]
    doctor = RunningDoctor()
    play(doctor, 10)
    assert doctor.findings
    play(doctor, 0.1, start=10.0, stopped=False)
    assert not doctor.findings and not doctor.message
    doctor.frame(10.2, np.zeros(CIRCUIT.shape), True)
    assert doctor.findings
    play(doctor, 11, start=10.3, stopped=False)
    before = len(asked)
    play(doctor, 2, start=22.0)
    assert not doctor.findings and len(asked) == before


def test_a_fault_that_stops_now_and_then_is_found_by_all_frames_since(asked):
    """But the doctor is asked while the robot stands."""
    doctor = RunningDoctor()
    for k in range(6):
        play(doctor, 1.5, start=4.0 * k)
        before = len(asked)
        play(doctor, 2.5, start=4.0 * k + 1.5, stopped=False)
        assert len(asked) == before
    assert len(asked) >= 2 and asked[0] == 500


def test_frames_that_the_doctor_refuses_are_no_finding():
    doctor = RunningDoctor()
    for k in range(400):
        doctor.frame(k / RATE, np.full(CIRCUIT.shape, 1.5), True)
    doctor.look(CIRCUIT)
    assert doctor.findings == ()


def test_a_clock_that_is_set_back_begins_anew(asked):
    doctor = RunningDoctor()
    play(doctor, 1, start=100.0)
    play(doctor, 2.5, start=0.0)
    assert not asked


def test_an_open_line_is_named_by_its_number():
    case = Case(5, ("open",), 12.0, (8, 8))
    ((_, _, rows, cols),) = case.faults
    doctor = RunningDoctor()
    for k, adc in enumerate(case.frames):
        doctor.frame(k / case.board.rate, adc, True)
        if k % 100 == 99:
            doctor.look(case.circuit)
    assert [(f.kind, set(f.rows), set(f.cols)) for f in doctor.findings] == [("open", rows, cols)]
