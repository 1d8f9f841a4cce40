# SPDX-License-Identifier: Apache-2.0
"""Mains hum is named as such, and not as a supply that changes."""

import numpy as np
import pytest
from health.seen import said, seen

from tactile_skin import Circuit
from tactile_skin.health.untouched import Hum
from tactile_skin.physics.adc import Adc

CIRCUIT = Circuit(8, 8)
NOISE = 0.6 / 1023


def played(level, seconds=60.0, rate=50.0, touch=None):
    """What is said after readings whose common level is level(t) [ADC steps]."""
    rng, check = np.random.default_rng(3), Hum(Adc(CIRCUIT))
    rest = rng.uniform(30, 40, CIRCUIT.shape) / 1023
    for k in range(round(seconds * rate)):
        t = k / rate
        adc = rest + level(t) / 1023 + NOISE * rng.standard_normal(rest.shape)
        force = np.full(rest.shape, 3.0 if touch and touch(t) else 0.0)
        check.frame(seen(t, adc=adc, rest=rest, noise=NOISE, force=force))
    return said(check)


@pytest.mark.parametrize("hertz", [50.06, 50.3, 49.8, 57.0])
@pytest.mark.parametrize("steps", [1.0, 3.0])
def test_a_hum_is_named_with_its_size_and_its_remedy(hertz, steps):
    text = played(lambda t: steps * np.sin(2 * np.pi * hertz * t))
    assert "mains hum" in text and "20 ms" in text
    assert (
        f"by {steps:.0f}." in text or f"by {steps - 1:.0f}.9" in text or f"by {steps:.0f}" in text
    )


def test_it_is_named_between_touches():
    text = played(lambda t: 3.0 * np.sin(0.6 * t), touch=lambda t: t % 7.0 < 1.0)
    assert "mains hum" in text


@pytest.mark.parametrize(
    "level",
    [
        lambda t: 0.0,
        lambda t: -6.0 * (t > 20.0),  # a supply
        lambda t: 0.1 * t,  # fabric that warms up
        lambda t: 4.0 * np.exp(-(t % 20.0) / 3.0) * (t % 20.0 > 2.0),  # what touches leave behind
    ],
)
def test_nothing_else_is(level):
    assert played(level) == ""
