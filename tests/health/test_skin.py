# SPDX-License-Identifier: Apache-2.0
"""One running skin without topics: readings in, force and reasons out."""

import datetime

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.findings.finding import Kind
from tactile_skin.health import skin as skin_module
from tactile_skin.health.doctor import played
from tactile_skin.health.skin import Follower
from tactile_skin.physics.adc import Adc
from tactile_skin.physics.creep import Creep
from tactile_skin.physics.proof import Proof
from tactile_skin.simulation import scenes

CIRCUIT, CURVE = Circuit(8, 8), PressureCurve()
FRAME = 0.01  # s
PUSH = scenes.finger(8, 8, 3.3, 4.1, 20.0, 1.2)  # N


GIVEN = {
    "proof": Proof(),
    "today": datetime.date(2026, 11, 28),
    "r_par_std": None,
    "follows": True,
    "noise": None,
    "threshold": 0.0,
    "time_limit": 60.0,
}


class Board:
    """One whose cells rest 3 % apart, and a skin that reads it."""

    def __init__(self, method="auto", curve=CURVE, **given):
        self.curve = curve
        self.rng, self.t, self.warnings = np.random.default_rng(40), 0.0, []
        self.rest = np.exp(0.03 * self.rng.standard_normal(CIRCUIT.shape))
        given = GIVEN | given
        self.skin = Follower(
            Adc(CIRCUIT), curve, Creep(), weights=None, warn=self.warnings.append, **given
        )
        self.skin.use(method)

    def feel(self, force, frames=1, *, late=False, broken=None):
        """The force [N] that is found in the last frame."""
        for _ in range(frames):
            ratio = forward(CIRCUIT, self.curve.resistance(force) * self.rest)
            steps = ratio * CIRCUIT.full_scale + 0.5 * self.rng.standard_normal(CIRCUIT.shape)
            if broken is not None:
                steps[broken] = 0.0  # a row that is open
            samples = np.rint(64.0 * np.clip(steps, 0.0, None)).astype(np.uint16)
            found = self.skin.frame(self.t, samples, late=late)
            self.t += FRAME
        return found


NOTHING = np.zeros(CIRCUIT.shape)


def test_it_measures_its_rest_and_finds_the_force():
    board = Board()
    assert board.skin.waits and board.skin.rest_resistance is None
    board.feel(NOTHING, 150)
    assert not board.skin.waits
    assert board.skin.rest_resistance == pytest.approx(board.rest * 40000.0, rel=0.02)
    assert board.feel(PUSH, 5).sum() == pytest.approx(PUSH.sum(), rel=0.05)
    assert not board.skin.fault and board.skin.findings() == [] and not board.warnings


@pytest.mark.parametrize("off", [0.0, 0.3])
def test_one_voltage_from_the_start_is_a_fault_at_once_and_for_as_long_as_it_lasts(off):
    """Though it is what an untouched skin reads: cells that are as alike are not read."""
    board = Board()
    sound = board.rest
    board.rest = np.full(CIRCUIT.shape, np.exp(off))
    for k in range(400):
        board.feel(NOTHING)
        assert board.skin.fault, k
    assert "Is the matrix connected?" in str(board.skin.findings()[0])
    board.rest = sound  # it is plugged in
    board.feel(NOTHING, 400)
    assert not board.skin.fault


def test_a_sound_skin_waits_until_its_rest_is_measured_and_not_again():
    """Free, stopped and free again would make a robot jerk at every start.

    The frame that ends the measurement is no fault: it was fitted without what it tells.
    """
    board, faults = Board(), []
    for _ in range(300):
        board.feel(NOTHING)
        faults.append(board.skin.fault)
        assert board.skin.waits or not board.skin.fault, board.skin.findings()
    assert all(faults[:100]) and not any(faults[120:])
    assert np.count_nonzero(np.diff(np.array(faults, int))) == 1


def test_a_late_frame_is_taken_by_the_fast_method_if_the_user_asked_for_none():
    for method, fast in (("auto", True), ("map", False)):
        board = Board(method)
        board.feel(PUSH, late=True)
        assert board.skin.fitted != fast
        assert board.skin.taken["fixed_point"] == fast


def test_a_late_frame_of_an_untouched_skin_is_known_as_that():
    """It takes less than the fast method would, and judges the skin in full."""
    board = Board()
    board.feel(NOTHING, 150)
    before = board.skin.taken["rest"]
    board.feel(NOTHING, 20, late=True)
    assert board.skin.taken["rest"] == before + 20 and board.skin.fitted


def test_a_touch_that_begins_is_seen_by_the_fast_method_and_then_fitted():
    """The stop waits for no fit of frames that a board's low-pass has mixed."""
    board = Board()
    board.feel(NOTHING, 150)
    assert board.feel(PUSH, 2).sum() == pytest.approx(PUSH.sum(), rel=0.1)
    assert board.skin.taken["fixed_point"] == 2 and not board.skin.fitted
    board.feel(PUSH, 10)
    assert board.skin.taken["fixed_point"] == 2 and board.skin.fitted


def test_a_frame_of_a_slow_board_mixes_nothing_and_is_fitted_at_once():
    board = Board()
    board.feel(NOTHING, 150)
    board.t += 0.08
    board.feel(PUSH)
    assert board.skin.fitted and board.skin.taken["fixed_point"] == 0


@pytest.fixture
def limit_after(monkeypatch):
    """Return (intervals) -> the time limit [s] of the frame that follows them."""
    limits = []

    def compensate(*arguments, time_limit, **given):
        limits.append(time_limit)
        return idle

    board = Board(time_limit=0.0)
    board.feel(NOTHING)
    idle = skin_module.compensate(np.full(CIRCUIT.shape, 0.05), CIRCUIT, CURVE)
    monkeypatch.setattr(skin_module, "compensate", compensate)

    def after(intervals):
        for interval in intervals:
            board.t += interval - FRAME
            board.feel(NOTHING)
        return limits[-1]

    return after


@pytest.mark.parametrize(
    ("interval", "limit"), [(0.002, 0.05), (0.01, 0.05), (0.1, 0.2), (0.2, 0.4), (1.0, 0.5)]
)
def test_a_frame_may_take_two_of_the_board_within_what_a_push_may_wait(
    limit_after, interval, limit
):
    assert limit_after([interval] * 100) == pytest.approx(limit, rel=0.01)


def test_frames_that_come_at_once_may_take_as_long_as_those_before(limit_after):
    """A computer that was busy takes them together; one gap makes no slow board, either."""
    assert limit_after([*[0.1] * 100, 0.001]) == pytest.approx(0.18, abs=0.01)
    assert limit_after([*[0.1] * 100, 1.0]) == pytest.approx(0.38, abs=0.03)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("shape", [(4, 4), (8, 9), (64,), (0, 8), (1, 8, 8)])
def test_a_frame_of_which_nothing_can_be_made_fails_and_the_next_does_not(shape, late):
    board = Board()
    assert board.skin.frame(0.0, np.full(shape, 640, np.uint16), late=late) is None
    assert board.skin.status == "failed" and f"shape {shape}" in str(board.skin.findings()[0])
    assert board.feel(PUSH) is not None
    assert board.skin.status == "ok"


@pytest.mark.parametrize("reading", [np.nan, -1.0, 640.0])
def test_a_frame_of_floats_is_refused(reading):
    board = Board()
    assert board.skin.frame(0.0, np.full(CIRCUIT.shape, reading, np.float32)) is None
    assert [str(f) for f in board.skin.findings()] == ["reading is of float32: must be uint16"]


def test_an_open_row_is_a_fault_until_a_reset_finds_it_gone():
    board = Board()
    board.feel(NOTHING, 150)
    board.feel(PUSH, 20, broken=3)
    assert board.skin.fault and "row 3 is open" in str(board.skin.findings()[0])
    board.skin.reset()
    assert board.skin.fault, "it is there still"
    board.feel(PUSH, 20)
    assert board.skin.fault and "kept until" in str(board.skin.findings()[0])
    board.skin.reset()
    assert not board.skin.fault and board.skin.findings(past=False) == []


def test_the_rest_is_measured_anew_on_request_unless_something_presses():
    board = Board()
    board.feel(NOTHING, 150)
    board.feel(PUSH)
    assert "something presses" in board.skin.tare() and not board.skin.waits
    board.feel(NOTHING)
    assert board.skin.tare() == "" and board.skin.waits
    assert "the tare is off" in Board(follows=False).skin.tare()


def test_an_unknown_method_is_refused():
    board = Board()
    with pytest.raises(ValueError, match="method = 'magic': must be one of naive"):
        board.skin.use("magic")
    board.feel(PUSH)
    assert "magic" not in board.skin.taken


def test_a_sound_fabric_whose_cells_read_alike_does_not_wait_for_ever():
    """A megohm a cell: 3 % of it are 0.05 ADC steps, less than what channels differ by."""
    curve = PressureCurve((0.0, 1.0, 10.0), (1e6, 5e4, 5e3))
    board = Board(curve=curve)
    board.feel(NOTHING, 150)
    assert "Is the matrix connected?" in str(board.skin.findings()[0]) and not board.skin.fault
    assert board.feel(PUSH, 5).sum() == pytest.approx(PUSH.sum(), rel=0.1)


@pytest.mark.parametrize(("r_ref", "warns"), [(1780.0, False), (200e3, True)])
def test_it_warns_of_readings_that_read_like_a_short_circuit_under_any_force(r_ref, warns):
    circuit = Circuit(8, 8, r_ref=r_ref, adc_bits=8)
    skin = Follower(Adc(circuit), CURVE, Creep(), weights=None, warn=print, **GIVEN)
    skin.use("auto")
    force = scenes.finger(8, 8, 4.0, 3.0, 9.0)
    adc = forward(circuit, CURVE.resistance(force))
    skin.frame(0.0, np.rint(255 * adc).astype(np.uint16) << 8)
    assert any(found.form == "range" for found in skin.findings()) == warns


# --- lines that come and go ---

ROW, OTHER = 3, 5


@pytest.fixture
def board():
    """One that has rested; it is a skin that knows its rest."""
    board = Board()
    board.feel(NOTHING, 200)
    return board


def opens(board, row=ROW, frames=6, force=NOTHING):
    """Feel a row without a lead for too few frames to be a fault, and then one that is sound."""
    board.feel(force, frames, broken=row)
    assert board.skin.findings() and not board.skin.fault
    board.feel(force, 100)


def test_the_third_time_is_a_fault_until_it_has_not_come_back_for_10_s(board):
    opens(board)
    opens(board)
    board.feel(NOTHING, 6, broken=ROW)
    board.feel(NOTHING, 100)
    assert board.skin.fault
    (found,) = (str(f) for f in board.skin.findings() if f.stops)
    assert found.startswith(f"row {ROW}: opened 3 times within 10 s. Press the connector on")
    board.feel(PUSH, 100)
    assert board.skin.fault
    board.feel(NOTHING, 900)
    assert not board.skin.fault


def test_a_person_who_checked_it_ends_it(board):
    for _ in range(3):
        board.feel(NOTHING, 6, broken=ROW)
        board.feel(NOTHING, 50)
    assert board.skin.fault
    board.skin.reset()
    assert not board.skin.fault


def test_once_each_of_three_lines_is_no_loose_lead(board):
    for row in (1, ROW, OTHER):
        opens(board, row)
    assert not board.skin.fault


@pytest.mark.parametrize(("closed", "counts"), [(1, False), (8, False), (11, True)])
def test_a_tenth_of_a_second_apart_they_are_two_times(board, closed, counts):
    """Closed for 80 ms between two times it only chatters; for 110 ms it has come back."""
    for _ in range(4):
        board.feel(NOTHING, 1, broken=ROW)
        board.feel(NOTHING, closed)
    assert board.skin.fault == counts


def recorded(broken=None) -> list[np.ndarray]:
    """Frames of two seconds of rest, and of a touch during which a row may be open for 0.4 s."""
    board, frames = Board(), []
    for k in range(320):
        touched = 200 <= k < 300
        ratio = forward(CIRCUIT, CURVE.resistance(PUSH * touched) * board.rest)
        noise = 0.5 * board.rng.standard_normal(CIRCUIT.shape) / CIRCUIT.full_scale
        frames.append(np.clip(ratio + noise, 0.0, 1.0))
        if broken is not None and 230 <= k < 270:
            frames[-1][broken] = 0.0
    return frames


def test_frames_are_played_through_a_skin_and_what_stops_it_is_named():
    """A stop that came in use is found again on its recording."""
    adc, t = Adc(CIRCUIT), 50.0 + FRAME * np.arange(320)
    assert played.stopped_by(Board().skin, adc, recorded(), t) is None
    reason, since = played.stopped_by(Board().skin, adc, recorded(broken=2), t)
    assert reason.kind is Kind.OPEN and reason.rows == (2,)
    assert since == pytest.approx(2.3, abs=0.15)


def test_a_reading_that_is_set_aside_says_nothing_of_its_own_cell():
    """The stop counts that cell as one that was not read: a converter that lost a bit reads so."""
    board, cell = Board(), (3, 4)
    board.feel(NOTHING, 150)
    board.feel(PUSH, 20)
    most = board.skin.bound[cell][0]
    steps = forward(CIRCUIT, CURVE.resistance(PUSH) * board.rest) * CIRCUIT.full_scale
    steps[cell] *= 0.3
    board.skin.frame(board.t, np.rint(64.0 * steps).astype(np.uint16))
    assert board.skin.status == "ok" and board.skin.bound[cell][0] > 1.2 * most


def test_what_rests_lower_after_a_release_is_no_fault_under_the_next_push():
    """Nor where that raises the readings of all cells, those of the lower ones too."""
    board = Board()
    board.feel(NOTHING, 150)
    sound, beside = board.rest, np.roll(PUSH, 2, axis=1)
    board.feel(PUSH, 100)
    found = []
    for k in range(140):
        share = 0.35 * np.exp(-k * FRAME / 3.0)  # of its conductance, as Velostat under a robot
        board.rest = sound / (1.0 - share * (PUSH > 0.02))
        board.feel(NOTHING if k < 40 else 2.0 * beside)
        found += board.skin.findings()
    assert not [str(f) for f in found if f.stops]


@pytest.mark.parametrize("lifts", [True, False])
def test_a_cover_that_shakes_in_step_with_the_frames_lies_heavier_elsewhere(lifts):
    """What is lost lies lower, and nothing higher."""
    board = Board()
    board.feel(NOTHING, 150)
    wave = np.sin(np.arange(8) * 0.9) * np.ones((8, 1))
    wave = wave if lifts else np.minimum(wave, 0.0)
    sound = board.rest
    for k in range(150):
        board.rest = sound / (1.0 + 0.2 * wave * min(1.0, k / 10))
        board.feel(NOTHING)
    assert board.skin.fault is not lifts
