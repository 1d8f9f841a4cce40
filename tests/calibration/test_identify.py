# SPDX-License-Identifier: Apache-2.0
"""Boards with r_par, stripes, fabric and noise of their own; the literal network reads them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.esp32 import SUPPLY, UnknownEsp32
from support.lab.unknown import Unknown, UnknownDriven
from support.marks import ci, slow
from support.weights import bodies

from tactile_skin import Circuit, PressureCurve, forward, identify, measure_rest
from tactile_skin.calibration.identify import how_to_press
from tactile_skin.calibration.rest import resting_conductance, supposing
from tactile_skin.calibration.tare import Tare
from tactile_skin.calibration.tracker import CircuitTracker
from tactile_skin.solvers.evidence import HARD, Supposed

SHAPE = 12, 12


@pytest.fixture(scope="module")
def board():
    board = Unknown(SHAPE, seed=7, r_par=1.15, line=9.0)
    board.touched = board.frames(bodies(16, SHAPE, np.random.default_rng(7)))
    board.idle = board.at_rest()
    return board


def test_both_are_found(board):
    """Within three of the standard deviations that are named, and those are small."""
    found = identify(board.touched, board.supposed, measure_rest(board.idle, board.supposed))
    assert found.told == {"r_par": True, "r_line": True}
    assert found.std["r_par"] < 6.0
    assert found.std["r_line"] < 4.0
    assert abs(found.circuit.r_par - board.r_par) < 3.0 * found.std["r_par"]
    assert abs(found.circuit.r_line - board.r_line) < 3.0 * found.std["r_line"]
    assert "r_par = " in found.message


def test_noise_alone_makes_no_resistance():
    """Cells that noise raises are not taken for touched, which would leave those that it lowers.

    On the true circuit, with noise of 2 steps; a limit of twice the rest finds r_par 6 ohm too
    small.
    """
    off = []
    for seed in range(300, 308):
        board = Unknown(SHAPE, seed, noise=2.0, lateral=0.0)
        rest = measure_rest(board.at_rest(), board.supposed)
        true = replace(board.supposed, r_par=board.r_par, r_line=board.r_line)
        supposed = Supposed(true, supposing(rest, true).conductance, HARD)
        touched = board.frames(bodies(16, SHAPE, np.random.default_rng(seed)))
        found = [e for e in (supposed.evidence(adc, rest.noise) for adc in touched) if e]
        information = sum(e.information for e in found)
        off.append(np.linalg.solve(information, sum(e.score for e in found)))
    assert abs(np.mean(off, axis=0)[0]) < 3.0


@pytest.mark.ci
def test_the_right_circuit_is_left_as_it_is(board):
    """From the truth as well as from what is supposed, the answer is the same.

    But for the weight of what is supposed, which the second time is the first answer.
    """
    rest = measure_rest(board.idle, board.supposed)
    found = identify(board.touched, board.supposed, rest)
    first, std = found.circuit, found.std
    again = identify(board.touched, first, rest).circuit
    assert again.r_par == pytest.approx(first.r_par, abs=0.4 * std["r_par"])
    assert again.r_line == pytest.approx(first.r_line, abs=0.4 * std["r_line"])


@pytest.mark.parametrize("touched", [False, True])
def test_frames_that_do_not_tell_change_nothing(board, touched):
    """Idle ones, or a few grams on a cell."""
    force = np.zeros((10, *SHAPE))
    if touched:
        force[:, 5, 6] = 0.03
    rest = measure_rest(board.idle, board.supposed)
    found = identify(board.frames(force), board.supposed, rest)
    assert found.circuit == board.supposed
    assert found.told == {"r_par": False, "r_line": False}
    assert "do not tell" in found.message


def test_crossings_that_are_not_read_are_done_without(board):
    """NaN in a tenth of the readings: a little less is known."""
    frames = board.touched.copy()
    frames[np.random.default_rng(0).random(frames.shape) < 0.1] = np.nan
    rest = measure_rest(board.idle, board.supposed)
    found = identify(frames, board.supposed, rest)
    assert abs(found.circuit.r_par - board.r_par) < 4.0 * found.std["r_par"]


@pytest.mark.parametrize(
    ("frames", "named"),
    [(np.zeros((3, 4, 4)), "shape"), (np.full((3, *SHAPE), 1.5), "frame 0, row 0, column 0")],
)
def test_what_is_no_frame_is_refused(board, frames, named):
    rest = measure_rest(board.idle, board.supposed)
    with pytest.raises(ValueError, match=named):
        identify(frames, board.supposed, rest)


def test_rest_is_the_exact_inverse(board):
    """Of a circuit with stripes and missing cells; the curve has no part in it."""
    mask = np.ones(SHAPE, bool)
    mask[3, 4] = mask[0, 0] = False
    circuit = Circuit(*SHAPE, mask=mask, r_line=7.0)
    rng = np.random.default_rng(3)
    g = np.where(mask, np.exp(0.1 * rng.standard_normal(SHAPE)) / 20000.0, 0.0)
    with np.errstate(divide="ignore"):
        adc = forward(circuit, 1.0 / g)
    np.testing.assert_allclose(resting_conductance(adc, circuit), g, rtol=2e-3)


DRIVEN = "loaded-rows", "loaded-columns", "grounded-rows", "grounded-columns"


@pytest.mark.parametrize("readout", [*map(ci, DRIVEN[:2]), DRIVEN[2], ci(DRIVEN[3])])
@pytest.mark.parametrize("off", [0.8, slow(1.0), slow(1.2)])
def test_r_par_of_driven_lines_is_found(readout, off):
    """Grounded, it is what is left of the sum with r_ref, and told with r_drive."""
    board = UnknownDriven(SHAPE, 44000, readout, r_par=off)
    rest = measure_rest(board.at_rest(), board.supposed)
    touched = board.frames(bodies(28, SHAPE, np.random.default_rng(44000)))
    found = identify(touched, board.supposed, rest)
    assert not found.missing
    assert found.circuit.r_par == pytest.approx(board.r_par, abs=3.0 * found.std["r_par"])
    if readout.startswith("loaded"):
        assert found.told == {"r_par": True, "r_line": False}
        assert found.std["r_par"] < 1.0
        assert "r_line is taken as 0" in found.message
    else:
        assert found.told == {"r_par": True, "r_drive": True}
        assert found.std["r_par"] < 8.0 and found.std["r_drive"] < 2.0
        assert board.r_drive > 10.0  # 0 is supposed
        close = 3.0 * found.std["r_drive"]
        assert found.circuit.r_drive == pytest.approx(board.r_drive, abs=close)


@pytest.fixture(scope="module", params=["loaded-rows", "loaded-columns"])
def pulled_up(request):
    """A board with pull-ups of a microcontroller and nothing in series but its pins.

    Its owner left the r_par of the paper: no cell conducts enough behind that for a hard touch.
    """
    board = UnknownDriven((8, 8), 44003, request.param, r_ref=35e3, r_par=25.0 / 326.0)
    board.idle = board.at_rest()
    return board


def test_an_r_par_that_is_far_too_large_is_found(pulled_up):
    force = bodies(16, (8, 8), np.random.default_rng(44003))
    rest = measure_rest(pulled_up.idle, pulled_up.supposed)
    found = identify(pulled_up.frames(force), pulled_up.supposed, rest)
    assert found.told["r_par"]
    assert found.circuit.r_par == pytest.approx(25.0, abs=15.0)


def test_a_running_skin_learns_that_r_par_is_far_too_large(pulled_up):
    """It is used: less than a small r_ref would make likely is no sign of another fault."""
    tracker = follow(pulled_up, pulled_up.supposed, standing(pulled_up, 8, (8, 8)))
    assert tracker.circuit.r_par == pytest.approx(25.0, abs=20.0)
    assert "r_par is" in said(tracker)
    assert not any(finding.stops for finding in tracker.findings())


@pytest.mark.parametrize("readout", DRIVEN)
def test_idle_frames_of_driven_lines_do_not_tell(readout):
    board = UnknownDriven(SHAPE, 44001, readout, r_par=1.2)
    rest = measure_rest(board.at_rest(), board.supposed)
    found = identify(board.frames(np.zeros((8, *SHAPE))), board.supposed, rest)
    assert found.circuit == board.supposed
    assert found.missing == (("r_par",) if board.r_drive == 0.0 else ("r_par", "r_drive"))


def said(tracker):
    return "; ".join(str(f) for f in tracker.findings() if f.form != "likely")


def suggested(tracker):
    return "; ".join(str(f) for f in tracker.findings() if f.form == "likely")


def follow(board, circuit, touches, noise=0.6, r_par_std=None):
    """A tracker beside the tare of a skin that rests, then is touched: frames of each touch."""
    tracker = CircuitTracker(circuit, r_par_std)
    tare, t = Tare(circuit, PressureCurve()), 0.0
    for k in range(130):
        tare.update(t, board.idle[k % len(board.idle)], np.zeros(circuit.shape))
        t += 0.01
    assert tare.measured
    for frames in touches:
        for adc in frames:
            t += 0.01
            tracker.offer(t, adc, noise)
        if tracker.ask(tare.curve, noise):
            tare.suppose(tracker.circuit)
    return tracker


def standing(board, n: int, shape=SHAPE, seed: int = 7) -> list[np.ndarray]:
    """Sixteen touches, n frames of each, alike but for their noise."""
    force = bodies(16, shape, np.random.default_rng(seed))
    return [[board.sample(ratio) for _ in range(n)] for ratio in map(board.expose, force)]


def test_a_running_skin_learns_its_circuit(board):
    """What it knows, and what to write, is said."""
    tracker = follow(board, board.supposed, standing(board, 12))
    assert tracker.circuit.r_par == pytest.approx(board.r_par, abs=12.0)
    assert tracker.circuit.r_line == pytest.approx(board.r_line, abs=6.0)
    assert "r_par is" in said(tracker)
    assert not any(finding.stops for finding in tracker.findings())
    assert set(tracker.values()) == {"r_par", "r_par_std", "r_line", "r_line_std"}


@pytest.mark.parametrize("off", [-10, 10])
def test_an_r_ref_that_is_off_is_named_beside_r_par(board, off):
    """Readings tell multiples of r_ref: a value that nobody soldered is a wrong r_ref."""
    supposed = replace(
        board.supposed, r_par=board.r_par, r_ref=board.supposed.r_ref / (1.0 + off / 100)
    )
    message = said(follow(board, supposed, standing(board, 12)))
    named = re.search(r"an r_ref that is ([+-]\d+) % off", message)
    assert named and int(named[1]) == pytest.approx(off, abs=3)
    assert not re.search(r"r_par[^;]*write", message)


def test_two_touches_that_tell_are_a_hint(board):
    """It is said at once, and used once more tell the same."""
    touches = standing(board, 12)
    first = follow(board, board.supposed, touches[:3])
    assert "suggest that r_par is" in suggested(first) and not said(first)
    assert first.circuit == board.supposed
    assert not suggested(follow(board, board.supposed, touches)), "it is used by then"


def test_a_right_circuit_is_not_touched(board):
    """No word, no hint, no change, however many touches."""
    true = replace(board.supposed, r_par=board.r_par, r_line=board.r_line)
    touches = standing(board, 12)
    for n in range(1, 17, 3):
        tracker = follow(board, true, touches[:n])
        assert tracker.circuit is true and not tracker.findings()


@pytest.mark.parametrize("readout", DRIVEN)
def test_a_running_skin_of_driven_lines_learns_its_r_par(readout):
    """Loaded, an r_par that is 20 % too low makes hard touches feel like three times as much."""
    board = UnknownDriven(SHAPE, 44002, readout, r_par=1.2)
    board.idle = board.at_rest()
    tracker = follow(board, board.supposed, standing(board, 8))
    assert tracker.circuit.r_par == pytest.approx(board.r_par, abs=12.0)
    assert tracker.circuit.r_drive == pytest.approx(board.r_drive, abs=4.0)
    assert "r_par is" in said(tracker)
    assert ("r_drive is" in said(tracker)) == (board.r_drive > 0.0)
    assert "r_line" not in said(tracker)


def test_one_touch_that_tells_r_drive_is_a_hint():
    """Until it is used, a stop counts with what it hides."""
    board = UnknownDriven(SHAPE, 44007, "grounded-rows", r_ref=470.0, r_par=1.0)
    board.idle = board.at_rest()
    fresh, early, late = (follow(board, board.supposed, standing(board, 8)[:n]) for n in (0, 3, 16))
    assert fresh.unknown() > 25.0 and not suggested(fresh)  # of any driver
    assert "r_drive is" in suggested(early) and early.circuit == board.supposed
    assert early.unknown() > 0.8 * board.r_drive
    assert late.circuit.r_drive == pytest.approx(board.r_drive, abs=3.0)
    assert late.unknown() < 10.0 and not suggested(late)


@pytest.mark.parametrize(("off", "std", "kept"), [(20, 9, True), (60, 9, False), (60, 40, True)])
def test_a_curve_keeps_the_r_par_that_it_was_found_with(board, off, std, kept):
    """It makes up for what that was wrong by; a board that has changed is followed."""
    circuit = replace(board.supposed, r_par=board.r_par - off, r_line=board.r_line)
    tracker = follow(board, circuit, standing(board, 12), r_par_std=std)
    assert (tracker.circuit == circuit) == kept
    assert "calibrate again" in said(tracker)


def test_a_touch_tells_more_the_longer_it_stands(board):
    brief, long = (follow(board, board.supposed, standing(board, n)[:8]) for n in (2, 16))
    assert (long.std < 0.8 * brief.std).all()


def test_a_stretch_waits_for_a_pause_or_a_stop(board):
    """Two seconds at most, for what is asked while a hand presses delays a frame."""
    tracker = CircuitTracker(board.supposed)
    for k in range(2):
        tracker.offer(0.01 * k, board.touched[0], 0.5)
    assert not tracker.overdue(1.5, stopped=False)
    assert tracker.overdue(0.2, stopped=True)
    assert tracker.overdue(2.1, stopped=False)


def test_a_touch_that_moves_is_not_asked(board):
    """It was read row by row while it moved."""
    tracker = CircuitTracker(board.supposed)
    for k, adc in enumerate(board.touched[:6]):
        tracker.offer(0.5 * k, adc, 0.5)
        assert not tracker.ask(PressureCurve(), 0.5)
    assert tracker.values() == {}


def test_touches_tell_by_how_much_a_chip_reads_too_high():
    """Another's reads 40 mV more throughout: within 8 mV; its gain is one with r_par."""
    board = UnknownEsp32((8, 8), 3, 1000.0, None, offset=0.0, gain=0.0)
    board.chip._volts = board.chip._volts - 0.04
    rest = measure_rest(board.at_rest(), board.supposed)
    touched = board.frames(2.0 * bodies(20, (8, 8), np.random.default_rng(3)))
    found = identify(touched, board.supposed, rest, adc=board.adc)
    readings = np.array([400.0, 1200.0, 2400.0])
    off = board.adc.bent(found.bent).ratio(readings) * SUPPLY
    off -= np.interp(readings, board.chip._readings, board.chip._volts)
    assert np.abs(off).max() < 0.008 and found.told["r_par"]


def test_pressing_less_hard_is_advised_where_most_touches_end_the_converter():
    frames = np.full((6, 4, 4), 0.3) + 0.01 * np.random.default_rng(0).random((6, 4, 4))
    assert how_to_press(frames, Circuit(4, 4)).startswith("press hard in more places")
    frames[:4, 1, :2] = 0.95
    assert how_to_press(frames, Circuit(4, 4)).startswith("in 4 of 6 touches readings are at the")
