"""A prior, a start and weights that `compensate` cannot use are refused by name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward

CIRCUIT, CURVE = Circuit(4, 6), PressureCurve()
FORCE = np.zeros((4, 6))
FORCE[1:3, 2:4] = 2.0
ADC = np.rint(forward(CIRCUIT, CURVE.resistance(FORCE)) * 1023) / 1023
LAST = compensate(ADC, CIRCUIT, CURVE)


def hole(value) -> np.ndarray:
    force = np.ones((4, 6))
    force[2, 3] = value
    return force


PRIORS = {  # what is wrong -> (prior, message)
    "a number": (5.0, "prior = 5.0: must be two, mean and std"),
    "one": ((1.0,), "prior = (1.0,): must be two"),
    "three": ((1.0, 2.0, 3.0), "must be two, mean and std"),
    "an array": (np.ones((4, 6)), "must be two, mean and std"),
    "mean NaN": ((np.nan, 1.0), "prior mean = nan at row 0, column 0: must be from 0"),
    "mean negative": ((-1.0, 1.0), "prior mean = -1.0 at row 0, column 0"),
    "mean infinite": ((np.inf, 1.0), "prior mean = inf"),
    "a cell's mean NaN": ((hole(np.nan), 1.0), "prior mean = nan at row 2, column 3"),
    "std 0": ((1.0, 0.0), "prior std = 0.0 at row 0, column 0: must be above 0 N"),
    "std negative": ((1.0, -1.0), "prior std = -1.0"),
    "a cell's std NaN": ((1.0, hole(np.nan)), "prior std = nan at row 2, column 3"),
    "length": ((np.ones(6), 1.0), r"prior mean has shape (6,): must be a number or (4, 6)"),
    "shape": ((1.0, np.ones((6, 4))), r"prior std has shape (6, 4)"),
    "text": (("a", 1.0), "prior mean is of type str: must be a number"),
    "None": ((None, 1.0), "prior mean is of type NoneType"),
    "uneven": (([[1.0], [1.0, 2.0]], 1.0), "prior mean is of type list"),
    "complex": ((1j, 1.0), "prior mean is of type complex"),
}
STARTS = {
    "an array": (LAST.force, "start is of type ndarray: must be an Estimate"),
    "a number": (5.0, "start is of type float"),
    "NaN": (replace(LAST, force=hole(np.nan)), "start.force = nan at row 2, column 3"),
    "infinite": (replace(LAST, force=hole(np.inf)), "start.force = inf at row 2, column 3"),
    "negative": (replace(LAST, force=hole(-1.0)), "start.force = -1.0 at row 2, column 3"),
    "shape": (replace(LAST, force=np.ones((6, 4))), "start has shape (6, 4): the circuit is"),
    "length": (replace(LAST, force=[1.0]), "start has shape (1,)"),
}


@pytest.mark.parametrize("method", ["map", "auto"])
@pytest.mark.parametrize("wrong", PRIORS)
def test_a_bad_prior_is_refused(method, wrong):
    prior, message = PRIORS[wrong]
    with pytest.raises(ValueError, match=re.escape(message)):
        compensate(ADC, CIRCUIT, CURVE, method, prior=prior)


@pytest.mark.parametrize("method", ["map", "auto", "newton"])
@pytest.mark.parametrize("wrong", STARTS)
def test_a_bad_start_is_refused(method, wrong):
    start, message = STARTS[wrong]
    with pytest.raises(ValueError, match=re.escape(message)):
        compensate(ADC, CIRCUIT, CURVE, method, start=start)


def test_a_prior_may_say_nothing_of_a_cell_or_all_of_it():
    """Infinite where nothing is known, 1e-300 N, and 0 where there is no cell."""
    plain = compensate(ADC, CIRCUIT, CURVE, "map")
    open_ended = compensate(ADC, CIRCUIT, CURVE, "map", prior=(1.0, np.inf))
    np.testing.assert_allclose(open_ended.force, plain.force, atol=0.01)
    sure = compensate(ADC, CIRCUIT, CURVE, "map", prior=(FORCE, 1e-300))
    assert np.isfinite(sure.std).all()
    np.testing.assert_allclose(sure.force, FORCE, atol=0.01)
    mask = np.ones((4, 6), bool)
    mask[0, 0] = False
    circuit = replace(CIRCUIT, mask=mask)
    adc = forward(circuit, CURVE.resistance(FORCE))
    known = np.where(mask, FORCE, np.nan), np.where(mask, 0.1, 0.0)
    assert np.isfinite(compensate(adc, circuit, CURVE, "map", prior=known).force).all()


def test_weights_must_be_weights():
    with pytest.raises(ValueError, match="weights are of type str: must be Weights"):
        compensate(ADC, CIRCUIT, CURVE, "cnn", weights="mine.npz")
