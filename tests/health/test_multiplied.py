# SPDX-License-Identifier: Apache-2.0
"""Millivolts that are taken for ADC steps are found; ADC steps are what they are."""

import numpy as np
import pytest
from support.strangers.sim import counts, fabric, touches

from tactile_skin import Circuit, diagnose
from tactile_skin.findings.finding import Kind

BITS = 12
RATE = 10.0  # frames a second


def recording(readout: str, full: float, seed=3, noise=0.7) -> tuple[Circuit, np.ndarray]:
    """Return a board, and (n, rows, cols) numbers that it prints, of which the supply is `full`."""
    circuit = Circuit(8, 8, r_ref=4700.0, r_par=25.0, adc_bits=BITS, readout=readout)
    force = touches(circuit.shape, 60.0, RATE, seed=seed, hard=(3, 45))
    rng = np.random.default_rng(seed)
    steps = counts(circuit, fabric(circuit), force, rng, noise=noise)
    return circuit, np.rint(steps * full / circuit.full_scale)


@pytest.mark.parametrize("readout", ["floating", "loaded"])
@pytest.mark.parametrize("inverted", [False, True])
def test_millivolts_that_are_taken_for_steps_are_found(readout, inverted):
    """The palm that is felt at a third of its force looks like one on another fabric."""
    circuit, printed = recording(readout, 3300.0)
    printed = 3300.0 - printed if inverted else printed
    ratio = printed / circuit.full_scale
    (finding,) = diagnose(1.0 - ratio if inverted else ratio, circuit, series=False)
    assert (finding.kind, finding.form) == (Kind.ZEROS, "multiplied")
    assert "circuit.adc_full_scale" in str(finding)


@pytest.mark.parametrize("readout", ["floating", "loaded", "grounded", "virtual_ground"])
@pytest.mark.parametrize("noise", [0.1, 0.7, 2.0])
def test_steps_are_not(readout, noise):
    for seed in range(11, 15):
        circuit, printed = recording(readout, 4095.0, seed, noise)
        found = diagnose(printed / circuit.full_scale, circuit, series=False)
        assert not [f for f in found if f.form == "multiplied"]


def test_millivolts_that_are_configured_are_not():
    circuit, printed = recording("loaded", 3300.0)
    assert not diagnose(printed / 3300.0, circuit, series=False)


def test_means_of_steps_are_not():
    circuit, printed = recording("loaded", 4095.0)
    means = (printed[:-1] + printed[1:]) / 2.0
    found = diagnose(means / circuit.full_scale, circuit, series=False)
    assert not [f for f in found if f.form == "multiplied"]
