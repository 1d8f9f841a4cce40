# SPDX-License-Identifier: Apache-2.0
"""Every method on a skin whose stripes have resistance; the readings are the literal network's."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS
from tactile_skin.solvers.reading import Reading

CURVE = PressureCurve()


def rects(shape, n, seed=0):
    return scenes.sample("rects", n, *shape, np.random.default_rng(seed))


@pytest.mark.parametrize("r_line", [3.0, 15.0, 30.0, np.linspace(0.0, 20.0, 14)])
def test_the_exact_inverse_stays_exact(r_line):
    """To a gram or a thousandth on cells of up to 1 kg, be the stripes alike or not."""
    circuit = Circuit(8, 6, r_line=r_line)
    force = rects((8, 6), 5)
    for f, adc in zip(force, forward(circuit, CURVE.resistance(force)), strict=True):
        for method in ("newton", "auto"):
            found = compensate(adc, circuit, CURVE, method, noise=0.0)
            assert found.status == "ok", found.message
            assert np.abs(found.force - f).max() < 5.0 * GRAM
            assert np.abs(found.force - f).mean() < 0.3 * GRAM


def test_noisy_readings_are_met_as_well_as_those_of_ideal_stripes():
    """Map's error with stripes of 12 ohm is within a tenth of that without; no frame is suspect."""
    errors = {}
    for r_line in (0.0, 12.0):
        circuit, rng = Circuit(r_line=r_line), np.random.default_rng(1)
        force, found = rects((16, 16), 12, seed=1), []
        for f in force:
            ideal = forward(circuit, CURVE.resistance(f))
            adc = scenes.read_out(circuit, ideal, "scan", rng)
            found.append(compensate(adc, circuit, CURVE, "map", noise=0.52))
        assert {e.status for e in found} == {"ok"}
        off = [np.abs(e.force - f).mean() for e, f in zip(found, force, strict=True)]
        errors[r_line] = np.mean(off)
    assert errors[12.0] < 1.1 * errors[0.0]


def test_stripes_that_nobody_told_of_are_not_met():
    """The same readings with r_line = 0 miss by far more: the others had something to find."""
    circuit, force = Circuit(r_line=12.0), rects((16, 16), 6, seed=2)
    adc = forward(circuit, CURVE.resistance(force))
    told, untold = (
        [compensate(a, c, CURVE, "newton", noise=0.0) for a in adc] for c in (circuit, Circuit())
    )
    off = [
        np.mean([np.abs(e.force - f).mean() for e, f in zip(found, force, strict=True)])
        for found in (told, untold)
    ]
    assert off[1] > 20.0 * off[0]


@pytest.mark.parametrize("method", METHODS)
def test_each_method_takes_such_a_circuit(method):
    """From the last frame, too; what fits nothing is far off, but answers."""
    circuit = Circuit(r_line=10.0)
    force = rects((16, 16), 1, seed=3)[0]
    adc = forward(circuit, CURVE.resistance(force))
    first = compensate(adc, circuit, CURVE, method)
    again = compensate(adc, circuit, CURVE, method, start=first)
    assert first.force.shape == again.force.shape == (16, 16)
    assert first.status != "failed"
    np.testing.assert_allclose(again.force.sum(), first.force.sum(), rtol=0.05)


def test_an_exact_reading_is_inverted_to_its_last_digits():
    """Its standard deviation says so: a fit of 0.006 ADC steps leaves 3 mN."""
    circuit = Circuit(2, 10, r_ref=150e3, r_par=0.0, adc_bits=8, r_line=np.linspace(0.0, 50.0, 12))
    force = np.random.default_rng(14).uniform(0.0, 2.3, (2, 10))
    found = compensate(forward(circuit, CURVE.resistance(force)), circuit, CURVE, noise=0.0)
    assert found.status == "ok"
    np.testing.assert_allclose(found.force, force, atol=1e-6)


@pytest.mark.parametrize("method", ["fixed_point", "newton", "map"])
def test_what_stripes_add_is_not_found_after_the_time_limit(method, monkeypatch):
    circuit = Circuit(10, 10, r_line=100.0)
    adc = forward(circuit, CURVE.resistance(np.full((10, 10), 4.0)))
    assert compensate(adc, circuit, CURVE, method, noise=0.5).status == "ok"
    monkeypatch.setattr(Reading, "late", lambda reading: True)
    found = compensate(adc, circuit, CURVE, method, noise=0.5)
    assert found.status == "failed" and "time_limit" in found.message
