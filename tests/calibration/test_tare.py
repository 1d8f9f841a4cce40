# SPDX-License-Identifier: Apache-2.0
"""What is learnt of a skin at rest, and that a touch is never tared away (driven clock)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.marks import ci, slow

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.board.protocol import BinaryParser
from tactile_skin.calibration.tare import Tare
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes, simulator

CIRCUIT, CURVE = Circuit(), PressureCurve()
IDLE = np.zeros((16, 16))
REST = 1.0 / CURVE.rest_resistance  # S


class Skin:
    """A fabric whose cells conduct `rest` untouched, its board, and the node's loop around it."""

    def __init__(self, rest=REST, seed=0, circuit=CIRCUIT):
        self.rng = np.random.default_rng(seed)
        self.circuit, self.rest = circuit, rest
        self.tare = Tare(circuit, CURVE)
        self.t, self.last = 100.0, None

    def frame(self, force=IDLE, dt=0.01, creep=1.0):
        """Read and compensate one frame, dt after the last; `creep` times what the load adds."""
        self.t += dt
        pressed = creep * (1.0 / CURVE.resistance(force) - REST)
        adc = forward(self.circuit, 1.0 / (self.rest + pressed))
        adc = scenes.read_out(self.circuit, adc, "scan", self.rng)
        self.last = compensate(adc, self.circuit, self.tare.curve, "auto", start=self.last)
        if self.tare.update(self.t, adc, self.last.force):
            self.last = None
        return self.last

    def frames(self, n, *args, **kwargs):
        return [e for _ in range(n) if (e := self.frame(*args, **kwargs)) is not None]


def scatter(relative, seed=1):
    return REST * np.exp(relative * np.random.default_rng(seed).standard_normal((16, 16)))


def touch(total=12.0):
    return scenes.finger(16, 16, 7.0, 8.0, total, width=1.3)


@pytest.mark.parametrize("relative", [0.02, ci(0.05), 0.15])
def test_a_fabric_whose_cells_differ_is_trusted_after_a_second(relative):
    skin = Skin(scatter(relative))
    before = skin.frames(90)
    # until then it may be suspect, but nothing seems to touch it
    assert all(e.status == "suspect" or e.force.max() < 5 * GRAM for e in before)
    skin.frames(120)
    idle, pressed = skin.frames(50), skin.frames(50, touch())
    assert np.mean([e.status == "ok" for e in idle]) >= 0.96
    assert np.mean([e.status == "ok" for e in pressed[3:]]) >= 0.9
    assert pressed[-1].force.sum() == pytest.approx(12.0, rel=0.04)


def test_a_known_rest_changes_no_more_and_costs_nothing():
    skin = Skin(scatter(0.03))
    skin.frames(150)
    known = skin.tare.curve.rest_resistance
    assert np.mean([e.method == "rest" for e in skin.frames(450)]) > 0.97
    assert np.abs(skin.tare.curve.rest_resistance / known - 1.0).max() < 0.01


@pytest.mark.ci
def test_the_zero_follows_a_drift_of_ten_minutes():
    """Warm fabric conducts up to 60 % more; each cell drifts its own way."""
    skin = Skin(scatter(0.05), seed=3)
    skin.frames(150)
    start, speed = skin.rest, np.random.default_rng(4).uniform(0.2, 0.6, (16, 16))
    worst = 0.0
    for step in range(1, 21):
        skin.rest = start * (1.0 + speed * step / 20)
        found = skin.frames(45, dt=0.67)
        worst = max(worst, *(e.force.max() for e in found))
    assert worst < 2 * GRAM
    error = skin.tare.curve.rest_resistance * skin.rest - 1.0
    assert np.abs(error).max() < 0.05
    unaided = compensate(forward(CIRCUIT, 1.0 / skin.rest), CIRCUIT, CURVE, "newton")
    assert unaided.force.sum() > 20 * found[-1].force.sum() + 0.5


@pytest.mark.parametrize("grams", [4.0, 8.0, 15.0, 300.0])
def test_a_touch_however_light_is_never_tared_away(grams):
    skin = Skin(scatter(0.05), seed=5)
    skin.frames(150)
    force = np.zeros((16, 16))
    force[4:8, 5:9] = grams * GRAM
    first = skin.frames(20, force)[-1].force.sum()
    last = skin.frames(600, force)[-1].force.sum()
    assert last == pytest.approx(first, rel=0.15)
    assert last == pytest.approx(force.sum(), rel=0.35)


@pytest.mark.ci
def test_a_touch_that_begins_as_a_measurement_ends_is_not_learnt():
    """Its first frame, half of it from before, was learnt: the skin at rest was suspect then."""
    push = scenes.finger(16, 16, 7.0, 8.0, 60.0, width=1.8)
    for start in np.arange(0.996, 1.01, 0.002):
        pressed = lambda t, start=start: push * (start <= t < start + 0.2)  # noqa: E731
        played = simulator.Board(CIRCUIT, CURVE, pressed, seed=4)
        frames = BinaryParser().feed(b"".join(played.scan() for _ in range(600)))
        tare, last, after = Tare(CIRCUIT, CURVE), None, []
        for k, frame in enumerate(frames):
            adc = np.minimum(frame.samples / (64.0 * CIRCUIT.full_scale), 1.0)
            last = compensate(adc, CIRCUIT, tare.curve, "auto", start=last)
            tare.update(0.01 * k, adc, last.force)
            if 0.01 * k > start + 0.3:
                after.append(last.status)
        assert tare.curve.offset is None
        assert after.count("ok") > 0.9 * len(after)


@pytest.mark.parametrize("newtons", [2.0, slow(5.0)])
def test_a_soft_palm_is_not_learnt_while_it_comes_and_goes(newtons):
    """No cell of it weighs as much as a touch. Half learnt, the skin read below its rest after it,
    and was suspect for ten seconds."""
    y, x = np.indices((16, 16))
    palm = np.exp(-((y - 6.0) ** 2 + (x - 9.0) ** 2) / 32.0)
    palm *= newtons / palm.sum()
    assert palm.max() < 10 * GRAM
    for wait in range(0, 100, 40):
        skin = Skin(scatter(0.03), seed=wait)
        skin.frames(150 + wait)
        skin.frames(80, palm)
        after = skin.frames(60)[10:]
        assert np.mean([e.status == "ok" for e in after]) >= 0.95


@pytest.mark.parametrize("touched", [False, True])
def test_a_clock_that_is_set_back_an_hour_costs_seconds(touched):
    """Also during the pause after a touch: it begins anew, and what it learns is right."""
    tare, t, rest = Tare(CIRCUIT, CURVE), 5000.0, scatter(0.05)
    for frames, factor, force in (
        (150, 1.0, IDLE),
        (20, 1.0, touch(12.0 * touched)),
        (400, 1.2, IDLE),
    ):
        adc = forward(CIRCUIT, 1.0 / (factor * rest))
        for _ in range(frames):
            t += 0.01
            tare.update(t, adc, force)
        t -= 3600.0 * (force is not IDLE)
    error = tare.curve.rest_resistance * 1.2 * rest - 1.0
    assert np.abs(error).max() < 0.05


def test_a_cut_lead_is_no_rest():
    skin = Skin(seed=7)
    adc = forward(CIRCUIT, CURVE.resistance(IDLE))
    adc[3] = 0.0
    for k in range(300):
        assert not skin.tare.update(k * 0.01, adc, IDLE)
    assert "row 3" in str(skin.tare.found)


@pytest.mark.parametrize("level", [0.3, ci(0.8), ci(1.5), 2.5])
def test_a_fabric_may_rest_at_another_level_than_the_curve(level):
    """And a touch on it is found as it is."""
    skin = Skin(level * scatter(0.05))
    skin.frames(150)
    assert skin.tare.measured and skin.tare.found is None
    pressed = skin.frames(40, touch())
    assert pressed[-1].force.sum() == pytest.approx(12.0, rel=0.06)
    assert np.mean([e.status == "ok" for e in pressed[3:]]) >= 0.9


def test_a_hand_on_the_skin_from_the_start_is_no_rest():
    skin = Skin(scatter(0.05))
    skin.frames(300, touch())
    assert not skin.tare.measured and skin.tare.curve is CURVE
    assert "Does something press there?" in str(skin.tare.found)
    skin.frames(320)
    assert skin.tare.measured


@pytest.mark.ci
def test_a_level_that_no_fabric_has_is_named_in_ohm():
    skin = Skin(6.0 * scatter(0.03))
    skin.frames(200)
    assert not skin.tare.measured
    assert "the curve begins with 40000" in str(skin.tare.found)


def test_a_short_is_not_tared_away():
    g = scatter(0.03)
    merged = np.delete(g, 7, 0)
    merged[6] += g[7]
    adc = np.insert(forward(Circuit(15, 16), 1.0 / merged), 7, 0.0, 0)
    adc[7] = adc[6]
    tare = Tare(CIRCUIT, CURVE)
    rng = np.random.default_rng(10)
    for k in range(300):
        assert not tare.update(k * 0.01, scenes.read_out(CIRCUIT, adc, "scan", rng), IDLE)
    assert "row 6" in str(tare.found) or "row 7" in str(tare.found)


@pytest.mark.parametrize("ohm", [250.0, 400.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_lead_that_breaks_later_is_not_tared_away(ohm, axis):
    """10 kg on a cell behind 250 ohm read 230 g; at rest they change the line by a tenth."""
    skin = Skin(scatter(0.05), seed=11)
    skin.frames(150)
    known = skin.tare.curve
    lead = np.zeros((16, 16))
    np.moveaxis(lead, axis, 0)[3] = ohm
    adc = CIRCUIT.ratio(CIRCUIT.two_terminal(forward(CIRCUIT, 1.0 / skin.rest)) + lead)
    for k in range(600):
        reading = scenes.read_out(CIRCUIT, adc, "scan", skin.rng)
        skin.tare.update(skin.t + 0.01 * k, reading, IDLE)
    assert str(skin.tare.found).startswith(("row 3", "column 3")[axis])
    # the first measurement may hold frames of before the break
    taken = np.log(skin.tare.curve.rest_resistance / known.rest_resistance)
    assert np.median(np.moveaxis(taken, axis, 0)[3]) < 0.04


@pytest.mark.ci
def test_where_a_palm_lay_the_tare_goes_on():
    """What it touched, more than half of the skin, conducts 6 % more for a while."""
    skin = Skin(scatter(0.05), seed=12)
    skin.frames(150)
    before, skin.rest = skin.tare.curve, skin.rest.copy()
    skin.rest[:10] *= 1.06
    skin.frames(300)
    assert skin.tare.curve is not before and skin.tare.found is None
    known, skin.rest[:10] = skin.tare.curve, skin.rest[:10] / 1.03
    skin.frames(300)
    assert skin.tare.curve is not known


def test_cells_that_do_not_exist_stay_out_of_it():
    mask = np.ones((16, 16), bool)
    mask[:4, :4] = False
    skin = Skin(scatter(0.05), seed=8, circuit=Circuit(mask=mask))
    skin.frames(150)
    error = skin.tare.curve.rest_resistance * skin.rest - 1.0
    assert np.abs(error[mask]).max() < 0.04


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.5))
def test_whatever_is_read_no_more_is_tared_than_allowed(seed, spread):
    """Also over many measurements: each is bounded by itself, not by the last.

    By the curve: 0.03 N a cell beside the usual one, which bears 4.5 g or a cover of 6 N at most.
    """
    rng = np.random.default_rng(seed)
    tare = Tare(CIRCUIT, CURVE)
    for k in range(180):
        if k % 45 == 0:
            adc = forward(CIRCUIT, 1.0 / (REST * np.exp(spread * rng.standard_normal((16, 16)))))
        tare.update(0.03 * k, adc, IDLE)
    assert CURVE.force(tare.curve.rest_resistance).mean() <= 0.03 + 4.5 * GRAM


def test_a_jump_of_all_cells_is_no_drift():
    """A supply that changes, or an input that reads one voltage, is not taken for rest."""
    skin = Skin(scatter(0.03))
    skin.frames(250)
    assert skin.tare.found is None
    known = skin.tare.curve
    skin.rest = 1.25 * skin.rest
    skin.frames(250)
    assert "all cells conduct +25.0% at once" in str(skin.tare.found)
    assert skin.tare.curve is known


AT_REST = float(forward(CIRCUIT, np.full((16, 16), CURVE.rest_resistance)).mean()) * 1023  # steps


@pytest.mark.parametrize("steps", [60.0, AT_REST, 1.01 * AT_REST, 300.0])
def test_one_voltage_on_all_crossings_is_no_fabric(steps):
    """Nor where it is the very one that the curve says of an untouched skin."""
    tare, rng = Tare(CIRCUIT, CURVE), np.random.default_rng(3)
    for k in range(400):
        adc = np.full((16, 16), steps / 1023) + 0.5 / 1023 * rng.standard_normal((16, 16))
        tare.update(0.01 * k, adc, IDLE)
    assert not tare.measured
    assert "Is the matrix connected?" in str(tare.found)
    assert "threshold" not in str(tare.found)


def test_a_board_whose_untouched_cells_read_0_waits():
    tare = Tare(CIRCUIT, CURVE)
    for k in range(200):
        tare.update(0.01 * k, np.zeros((16, 16)), IDLE)
    assert "Is an offset or a threshold taken off" in str(tare.found) and tare.unseen


def fills(frames, shape, readings, seed):
    """Whether a tare measures the rest within so many frames of such readings [ADC steps]."""
    circuit, rng = Circuit(*shape), np.random.default_rng(seed)
    tare = Tare(circuit, CURVE)
    for k in range(frames):
        tare.update(0.01 * k, readings(rng) / circuit.full_scale, np.zeros(shape))
    return tare.measured


@pytest.mark.parametrize("noise", [0.5, 1.0, 2.0])  # ADC steps, of a reading
@pytest.mark.parametrize("shape", [(4, 4), (3, 20), (8, 8)])
def test_a_noisy_small_skin_is_told_from_one_voltage(shape, noise):
    """On 4 x 4 cells that scatter by 3 % read half a step apart, under noise of two."""
    circuit, found = Circuit(*shape), {"sound": 0, "dead": 0}
    for seed in range(12):
        rng = np.random.default_rng([57020, seed])
        rest = rng.uniform(0.7, 1.4) * REST * np.exp(0.03 * rng.standard_normal(shape))
        steps = forward(circuit, 1.0 / rest) * circuit.full_scale
        for name, level in (("sound", steps), ("dead", np.full(shape, steps.mean()))):
            read = lambda rng, level=level: np.rint(level + noise * rng.standard_normal(shape))  # noqa: E731
            found[name] += fills(400, shape, read, seed)
    assert found == {"sound": 12, "dead": 0}


@pytest.mark.parametrize(("touched", "times"), [ci(0.5, 30), (3.0, 12)])
def test_a_slow_drift_is_followed_where_touches_leave_no_time_for_a_measurement(touched, times):
    """0.1 % a second, as a robot's cover warms up, and half a second between two touches: if they
    are long, most of the drift is hidden by them."""
    skin = Skin(scatter(0.03), seed=8)
    skin.frames(150)
    first = skin.rest
    for _ in range(times):
        skin.rest = skin.rest * np.exp(0.001 * (touched + 0.5))
        skin.frames(10, touch(), dt=touched / 10)
        skin.frames(10, dt=0.05)
    known = np.log(skin.tare.curve.rest_resistance * first)
    assert np.median(known) == pytest.approx(-0.001 * (touched + 0.5) * times, abs=0.004)


@pytest.mark.parametrize("steps", [8.0, 15.0])
def test_a_noisy_reading_does_not_keep_the_rest_from_being_measured(steps):
    skin = Skin(scatter(0.03), seed=9)
    noise = np.zeros((16, 16))
    noise[4, 7] = steps / CIRCUIT.full_scale
    for _ in range(200):
        skin.t += 0.01
        adc = forward(CIRCUIT, 1.0 / skin.rest) + noise * skin.rng.standard_normal()
        adc = scenes.read_out(CIRCUIT, np.clip(adc, 0.0, 1.0), "scan", skin.rng)
        skin.tare.update(skin.t, adc, IDLE)
    assert skin.tare.measured


def test_a_hand_that_arrives_while_the_rest_is_measured_is_seen():
    skin = Skin(scatter(0.03), seed=10)
    skin.frames(60)
    skin.frames(10, 0.3 * touch())
    skin.frames(45)
    assert not skin.tare.measured


@pytest.mark.parametrize("grams", [20, 300])
def test_the_onset_of_touches_is_no_drift(grams):
    """It raises all readings a little; the rest stayed higher by 0.1 % for each that was taken."""
    skin = Skin(scatter(0.03), seed=9)
    skin.frames(150)
    known = skin.tare.curve
    press = touch(1.0)
    press *= grams * GRAM / press.max()
    for k in range(8):
        skin.frames(28 + k % 4)
        for share in (0.004, 0.015, 0.035, 0.06, 0.1, 0.3, 1.0, 1.0, 0.6, 0.1):
            skin.frame(share * press)
        skin.frames(4, press)
    np.testing.assert_allclose(skin.tare.curve.rest_resistance / known.rest_resistance, 1.0, 3e-4)


def test_cells_that_differ_by_less_than_a_seconds_noise_are_no_one_voltage_for_long():
    """Of a grounded matrix with a small r_ref untouched cells read 10 steps, 0.3 apart."""
    rng = np.random.default_rng(6641)
    circuit = Circuit(6, 9, r_ref=500.0, r_par=25.0, readout="grounded")
    curve = CURVE.resting_at(CURVE.rest_resistance * np.exp(0.03 * rng.standard_normal((6, 9))))
    adc, tare, t = forward(circuit, curve.rest_resistance), Tare(circuit, CURVE), 0.0
    while not tare.measured and t < 12.0:
        steps = np.rint(adc * 1023 + 1.5 * rng.standard_normal((6, 9)))
        tare.update(t, steps / 1023, np.zeros((6, 9)))
        t += 0.05
    assert tare.measured, tare.found


@pytest.mark.parametrize("rms", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("low_pass", [1.0, 0.2])
def test_the_noise_at_rest_is_measured(rms, low_pass):
    """A low-pass on the board, which makes successive frames alike, does not hide it."""
    rng, tare = np.random.default_rng(3), Tare(CIRCUIT, CURVE)
    at_rest = 1023.0 * forward(CIRCUIT, 1.0 / scatter(0.03))
    steps, left = at_rest, rms * (low_pass / (2.0 - low_pass)) ** 0.5
    for k in range(600):
        steps = steps + low_pass * (at_rest + rms * rng.standard_normal(steps.shape) - steps)
        tare.update(0.01 * k, np.maximum(steps, 0.0) / 1023.0, IDLE)
    assert tare.noise == pytest.approx(left, rel=0.1)


def test_a_clock_that_stands_still_gathers_nothing():
    """As that of a simulation that is paused: frames go on coming."""
    tare, adc = Tare(CIRCUIT, CURVE), forward(CIRCUIT, 1.0 / scatter(0.03))
    for _ in range(300):
        tare.update(5.0, adc, IDLE)
    assert not tare.measured and len(tare._frames) == 1
