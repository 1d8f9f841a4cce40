# SPDX-License-Identifier: Apache-2.0
"""Readings of a touch that all fall back alike are those of a board that moves its zero."""

import numpy as np
import pytest
from health.seen import said, seen

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.health.standing import MovingZero
from tactile_skin.physics.adc import Adc
from tactile_skin.physics.readouts import READOUTS

CURVE = PressureCurve()
NOISE = 0.6  # ADC steps
PALM = 45.0 * np.exp(-((np.indices((8, 8)) - 3.4) ** 2).sum(0) / 8.0)
PALM /= PALM.sum() / 45.0


def played(readout, force, law=lambda t, excess: excess, rate=25, seconds=2.0):
    """What is said of force(t) on a board that prints law(t, excess over rest)."""
    circuit, rng = Circuit(8, 8, readout=readout, r_ref=500.0), np.random.default_rng(4)
    check, rest = MovingZero(Adc(circuit)), forward(circuit, CURVE.resistance(0.0 * PALM))
    for k in range(round(rate * seconds)):
        t = k / rate
        excess = forward(circuit, CURVE.resistance(force(t))) - rest
        adc = rest + law(t, excess) + NOISE / 1023 * rng.standard_normal(rest.shape)
        felt = compensate(adc, circuit, CURVE, "fixed_point").force
        check.frame(seen(t, adc=adc, rest=rest, noise=NOISE / 1023, force=felt))
    return said(check)


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize(
    "law",
    [
        lambda t, excess: excess * 0.5 ** np.floor(t / 0.7),
        lambda t, excess: np.maximum(excess - 0.4 * np.median(excess) * (t > 0.5), 0.0),
    ],
    ids=["steps", "one amount"],
)
def test_a_zero_that_follows_is_named_under_the_touch(readout, law):
    text = played(readout, lambda t: PALM, law)
    assert "as of no hand" in text


def test_it_is_named_though_what_it_took_for_rest_was_of_an_earlier_day():
    off = 5.0 / 1023 * np.random.default_rng(5).standard_normal(PALM.shape)

    def law(t, excess):
        return excess - 0.5 * (excess + off) * (t > 1.0)

    text = played("floating", lambda t: PALM, law)
    assert "as of no hand" in text


@pytest.mark.parametrize("readout", READOUTS)
def test_a_hand_of_which_the_edge_leaves_first_is_none(readout):
    edge = 1.0 - PALM / PALM.max()

    def course(t):
        return PALM * np.maximum(1.0 - min(max(t - 0.5, 0.0) / 0.1, 1.0) * (0.3 + 0.7 * edge), 0.0)

    assert played(readout, course) == ""


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("seconds", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("left", [0.0, 0.4])
def test_a_hand_that_lets_go_is_none(readout, seconds, left):
    """At any speed, all of it or a part, in proportion."""

    def course(t):
        return 1.0 - (1.0 - left) * min(max(t - 0.5, 0.0) / seconds, 1.0)

    assert played(readout, lambda t: course(t) * PALM) == ""


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("rate", [4, 12, 25, 100])
@pytest.mark.parametrize("constant", [0.02, 0.1, 0.5])
def test_a_low_pass_is_none(readout, rate, constant):
    """A hand leaves within a frame, behind a mean of scans: all readings fall alike, to none."""

    def law(t, excess):
        return excess * (np.exp(-(t - 0.5) / constant) if t > 0.5 else 1.0)

    assert played(readout, lambda t: PALM, law, rate) == ""


def test_what_stands_is_none():
    assert played("grounded", lambda t: PALM * (1.0 + 0.1 * np.log10(1.0 + t))) == ""
