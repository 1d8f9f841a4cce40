# SPDX-License-Identifier: Apache-2.0
"""Changes of an untouched skin's picture that are none of the fabric's are told; others are not."""

from dataclasses import replace

import numpy as np
import pytest
from health.seen import said, seen

from tactile_skin import Circuit, forward
from tactile_skin.health.untouched import Untouched
from tactile_skin.physics.adc import Adc

FRAME = 0.01  # s
SPARSE = 0.05  # s, of a slow board: each look still has the frames that it needs
NOISE = 0.5 / 1023  # RMS of a reading, as ADC ratio
READOUTS = ["floating", "loaded", "grounded"]
SHAPES = [(4, 4), (8, 8), (8, 16), (16, 16)]


class Skin:
    """A skin at rest: what it reads, and what it read when its rest was measured."""

    def __init__(self, shape, scatter=0.03, seed=3, **circuit):
        self.rng = np.random.default_rng(seed)
        self.circuit = Circuit(*shape, **circuit)
        self.resistance = 40000.0 * np.exp(scatter * self.rng.standard_normal(shape))
        self.rest = forward(self.circuit, self.resistance)
        self.known = self.rest + 0.1 * NOISE * self.rng.standard_normal(shape)
        self.untouched, self.t = Untouched(Adc(self.circuit)), 0.0

    def run(self, adc, seconds=0.5, touched=False, dt=FRAME) -> Untouched:
        for _ in range(round(seconds / dt)):
            noise = NOISE * self.rng.standard_normal(self.circuit.shape)
            self.look(adc + noise, touched=touched, dt=dt)
        return self.untouched

    def look(self, adc, noise=NOISE, touched=False, dt=FRAME) -> None:
        self.untouched.frame(seen(self.t, adc=adc, stirs=touched, rest=self.known, noise=noise))
        self.t += dt

    def of(self, **circuit):
        return forward(replace(self.circuit, **circuit), self.resistance)


def stops(check) -> bool:
    return any(f.stops for f in check.findings())


@pytest.mark.parametrize("scatter", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_sound_skin_is_silent(shape, scatter):
    assert not said(Skin(shape, scatter).run(Skin(shape, scatter).rest, 60.0))


@pytest.mark.parametrize("noise", [0.05, 0.15, 0.3])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_board_of_whole_steps_and_little_noise_is_silent(shape, noise):
    """Its rest is known to a fifth of a step: the tare follows no less."""
    for seed in range(10):
        skin = Skin(shape, 0.01, seed)
        skin.known = skin.rest + 0.2 / 1023 * skin.rng.standard_normal(shape)
        for _ in range(100):
            steps = skin.rest * 1023 + noise * skin.rng.standard_normal(shape)
            skin.look(np.rint(steps) / 1023, 0.3 / 1023)
            assert not stops(skin.untouched)


@pytest.mark.parametrize("shape", SHAPES)
def test_lines_that_are_exchanged_are_named_and_stop(shape):
    skin = Skin(shape)
    order = [2, 1, 0, *range(3, shape[1])]
    found = skin.run(skin.rest[:, order])
    assert found.found.stops
    named = [f"column {a}: reads at rest as column {b} did" for a, b in ((0, 2), (2, 0))]
    assert said(found).split(",")[0] in named
    assert not said(skin.run(skin.rest)), "they are put right"


def test_what_is_left_of_a_touch_for_a_moment_stops_nothing():
    """It may make a line of a noisy skin read as another one."""
    skin = Skin((8, 8))
    skin.run(skin.rest)
    assert said(skin.run(skin.rest[[7, *range(1, 8)]], 0.3)) and not stops(skin.untouched)
    assert not said(skin.run(skin.rest))


def test_crossings_that_are_not_read_hide_no_other_line():
    skin = Skin((8, 16))
    adc = skin.rest[:, [2, 1, 0, *range(3, 16)]]
    adc[5, 9] = np.nan
    assert stops(skin.run(adc))


def test_it_is_told_under_a_drift_too():
    skin = Skin((8, 8))
    warm = forward(skin.circuit, 0.98 * skin.resistance)
    assert "row 1: reads at rest as row 0 did" in said(skin.run(warm[[0, 0, *range(2, 8)]]))


def test_what_a_touch_leaves_behind_is_no_other_line():
    """However strange a line became: cells that were touched conduct more, for a while."""
    for seed in range(20):
        skin = Skin((8, 8), 0.005, seed)
        for left in np.linspace(0.3, 0.0, 7):
            skin.resistance[2, 2:4] *= np.exp(-left)
            assert not stops(skin.run(forward(skin.circuit, skin.resistance), 0.2))


@pytest.mark.parametrize("scatter", [0.0, 0.003])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_line_that_something_lay_on_at_the_tare_is_no_other_line(shape, scatter):
    """On even fabric it reads as all others, once that is gone."""
    for seed in range(300, 320):
        skin = Skin(shape, scatter, seed)
        pressed = skin.resistance.copy()
        pressed[:, 2] *= np.exp(-0.06 * np.abs(skin.rng.standard_normal(shape[0])))
        skin.known = forward(skin.circuit, pressed)
        assert not stops(skin.run(skin.rest, 0.2))


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_an_r_par_that_changes_at_once_is_a_warning(share):
    skin = Skin((16, 16))
    adc = skin.of(r_par=share * skin.circuit.r_par)
    skin.run(skin.rest, 1.0)
    found = skin.run(adc)
    assert f"conduct {'+' if share < 1.0 else '-'}" in said(found) and not found.found.stops
    skin.known = adc  # as the tare follows it
    assert said(skin.run(adc, 30.0))
    assert not said(skin.run(adc, 60.0)), "by then it is followed"


def test_a_clock_that_is_set_back_does_not_prolong_a_warning():
    skin = Skin((8, 8))
    skin.t = 1000.0
    adc = skin.of(r_par=0.8 * skin.circuit.r_par)
    skin.run(skin.rest, 1.0)
    assert said(skin.run(adc))
    skin.known, skin.t = adc, 0.0
    assert not said(skin.run(adc, 90.0))


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("tared", [False, True])
def test_a_supply_that_falls_stops(shape, readout, tared):
    """Also one that falls before the rest was measured, and is tared away."""
    skin = Skin(shape, readout=readout)
    known, skin.known = skin.known, None if tared else skin.known
    for share in np.linspace(1.0, 0.9, 15):
        skin.run(share * skin.rest, 0.2)
    if tared:
        skin.known = 0.9 * known
    else:
        assert stops(skin.untouched)
    assert stops(skin.run(0.9 * skin.rest, 100.0, dt=SPARSE)), "until it is back"
    back = skin.run(skin.rest)
    assert not stops(back) and (tared or not said(back))


def test_a_supply_that_falls_under_a_long_touch_stops_after_it():
    """No fabric drifts for so long that it explains 8 %."""
    skin = Skin((8, 8))
    skin.run(skin.rest, 30.0, touched=True)
    assert stops(skin.run(0.92 * skin.rest))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_skin_that_waits_for_its_rest_and_warms_up_is_silent(shape):
    """At 2 % a minute, as long as somebody leans on it now and then."""
    skin = Skin(shape)
    skin.known = None
    for k in range(60):
        warm = forward(skin.circuit, skin.resistance * 0.98 ** (k / 60.0))
        skin.run(2.0 * warm, 0.5, touched=True)
        assert not said(skin.run(warm, 0.5))


def test_a_fabric_that_warms_up_is_silent():
    """At 0.2 % a second, as the tare follows it; and after a touch of five seconds."""
    skin = Skin((16, 16))
    for k in range(100):
        skin.known = forward(skin.circuit, skin.resistance * 0.998 ** (0.2 * k))
        assert not said(skin.run(skin.known, 0.2))
    later = forward(skin.circuit, skin.resistance * 0.998 ** (0.2 * k + 5.0))
    skin.run(skin.rest, 5.0, touched=True)
    assert not said(skin.run(later, 0.2))


def test_a_palm_that_leaves_half_of_the_skin_warm_is_silent():
    skin = Skin((16, 16))
    skin.resistance[:, :8] *= 0.9
    assert not said(skin.run(forward(skin.circuit, skin.resistance), 2.0))


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize(
    ("shape", "weight", "seeds"),
    [*((shape, 0.4, [3]) for shape in SHAPES), ((16, 16), 0.1, range(300, 310))],
)
def test_a_cloth_that_is_taken_off_is_a_warning(shape, weight, seeds, readout):
    """Its weight is never as even as what a supply does."""
    for seed in seeds:
        skin = Skin(shape, seed=seed, readout=readout)
        skin.resistance *= np.exp(weight * np.exp(0.3 * skin.rng.standard_normal(shape)))
        found = skin.run(forward(skin.circuit, skin.resistance))
        assert "conduct -" in said(found) and not found.found.stops


@pytest.mark.parametrize("rate", [20, 100, 390])
def test_looks_take_no_more_time_on_a_fast_board(rate, monkeypatch):
    """Each may ask for the exact inverse."""
    skin, looks = Skin((8, 8)), []
    monkeypatch.setattr(Untouched, "_look", lambda self, t, *_: looks.append(t))
    for k in range(10 * rate):
        skin.t = k / rate
        skin.look(skin.rest)
    assert len(looks) == {20: 10, 100: 50, 390: 54}[rate]


def test_a_clock_that_is_set_back_does_not_end_the_looks():
    skin = Skin((8, 8))
    skin.t = 5000.0
    skin.run(skin.rest, 0.1)
    skin.t = 1000.0
    assert stops(skin.run(0.9 * skin.rest))


def test_crossings_without_a_current_are_left_out():
    """A board whose other rows are grounded reads 0 where a cell conducts next to nothing."""
    skin = Skin((8, 8), readout="grounded")
    skin.rest[2, 3] = skin.known[2, 3] = 0.0
    with np.errstate(all="raise"):
        for _ in range(40):
            skin.look(0.98 * skin.rest)
    assert "conduct -" in said(skin.untouched)


def test_a_person_who_checked_the_skin_ends_it():
    skin = Skin((8, 8))
    assert stops(skin.run(0.9 * skin.rest))
    skin.untouched.forget()
    assert not said(skin.untouched) and not stops(skin.untouched)
