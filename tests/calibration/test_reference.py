# SPDX-License-Identifier: Apache-2.0
"""Curve and creep of one sensor by a force sensor above it."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, fit_reference, measure_rest
from tactile_skin.calibration.creep import Standing
from tactile_skin.physics.creep import Creep

CIRCUIT = Circuit(1, 1, r_ref=2000.0, r_par=0.0, adc_bits=12, readout="grounded")
CURVE = PressureCurve()


def sensor(share, time, presses, seed):
    """times, readings and forces of presses of 0.5 to 8 N: down in 0.5 s, five there, off."""
    rng, at_rest = np.random.default_rng(seed), 1.0 / CURVE.rest_resistance
    times = np.arange(0.0, 9.0 * presses + 1.0, 0.02)
    loads = np.exp(np.linspace(np.log(0.5), np.log(8.0), presses))[rng.permutation(presses)]
    number, phase = np.divmod(times, 9.0)
    course = np.where(phase < 7.5, np.clip((phase - 2.0) / 0.5, 0.0, 1.0), 0.0)
    force = course * np.append(loads, 0.0)[number.astype(int)]
    added = 1.0 / CURVE.resistance(force) - at_rest
    conducts, came = np.zeros(times.size), np.diff(added, prepend=0.0)
    for k, t in enumerate(times):
        begun = np.flatnonzero(force[: k + 1] <= 0.0)[-1]
        gain = 1.0 + share * np.log10(1.0 + (t - times[begun : k + 1]) / time)
        conducts[k] = came[begun : k + 1] @ gain if force[k] > 0.0 else 0.0
    adc = CIRCUIT.r_ref / (CIRCUIT.r_ref + 1.0 / (conducts + at_rest))
    adc = np.rint(adc * 4095 + rng.standard_normal(adc.size)) / 4095
    return times, np.clip(adc, 0.0, 1.0)[:, None, None], force


@pytest.mark.parametrize(("share", "time"), [(0.1, 0.3), (0.2, 0.1), (0.3, 0.1)])
def test_five_presses_give_creep_and_a_curve_that_is_right_at_once(share, time):
    times, adc, force = sensor(share, time, 5, 1)
    rest = measure_rest(adc[times < 1.5], CIRCUIT)
    fitted, late = fit_reference(adc, times, force + 3.0, times, CIRCUIT, rest)
    assert abs(late) < 0.02
    assert fitted.creep.share == pytest.approx(share, abs=0.1)
    times, adc, force = sensor(share, time, 5, 2)
    curve = fitted.curve.resting_at(1.0 / rest.conductance)
    standing, found = Standing(fitted.creep, fitted.curve), []
    for t, now in zip(times, curve.force(CIRCUIT.two_terminal(adc)), strict=True):
        found.append(standing.update(t, now)[0, 0])
    pressed = force > 0.4
    off = np.abs(np.array(found)[pressed] / force[pressed] - 1.0)
    assert np.median(off) < 0.05 and np.quantile(off, 0.9) < 0.12


def test_no_creep_is_found_where_there_is_none():
    times, adc, force = sensor(0.0, 1.0, 5, 3)
    rest = measure_rest(adc[times < 1.5], CIRCUIT)
    fitted, _ = fit_reference(adc, times, force, times, CIRCUIT, rest)
    assert fitted.creep == Creep()
    assert "curve.creep is 0" in fitted.message
    assert fitted.first is not None and fitted.first.median < 0.05
    assert fitted.holds is not None and fitted.holds.p90 < 0.1
