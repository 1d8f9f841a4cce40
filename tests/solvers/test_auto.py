# SPDX-License-Identifier: Apache-2.0
"""The cheapest method that the frame allows, and an answer to whatever comes in."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import moving_touch
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS

CIRCUIT, CURVE = Circuit(), PressureCurve()
REST = forward(CIRCUIT, CURVE.resistance(np.zeros((16, 16))))
TOUCH = np.zeros((16, 16))
TOUCH[3:6, 3:6] = 100 * GRAM
TOUCHED = forward(CIRCUIT, CURVE.resistance(TOUCH))


def scan(adc, seed=0):
    return scenes.read_out(CIRCUIT, adc, "scan", np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("adc", "noise", "method"),
    [
        (scan(REST), None, "rest"),
        (REST, 0.0, "rest"),
        (TOUCHED, 0.0, "newton"),
        (TOUCHED, None, "map"),
        (scan(TOUCHED), None, "map"),
    ],
    ids=["idle", "idle, exact", "exact", "not said to be exact", "noisy"],
)
def test_it_says_what_it_took(adc, noise, method):
    estimate = compensate(adc, CIRCUIT, CURVE, noise=noise)
    assert (estimate.method, estimate.status) == (method, "ok")


def test_a_light_touch_on_one_cell_is_not_taken_for_rest():
    force = np.zeros((16, 16))
    force[8, 8] = 2 * GRAM
    found = compensate(scan(forward(CIRCUIT, CURVE.resistance(force))), CIRCUIT, CURVE)
    assert found.method == "map" and found.force[8, 8] == pytest.approx(2 * GRAM, rel=0.3)
    assert np.count_nonzero(found.force > 0.5 * GRAM) == 1


def test_a_touch_may_come_out_of_nothing_and_go():
    """The last frame is only a start: a wrong one changes nothing that matters."""
    last = compensate(scan(REST), CIRCUIT, CURVE)
    touched = compensate(scan(TOUCHED), CIRCUIT, CURVE, start=last)
    assert np.abs(touched.force - TOUCH).max() < 15 * GRAM
    gone = compensate(scan(REST, 1), CIRCUIT, CURVE, "map", start=touched)
    assert gone.force.max() < 1 * GRAM


def test_a_stream_is_as_good_as_its_frames():
    force = moving_touch(20, np.random.default_rng(1))
    adc = [scan(a, k) for k, a in enumerate(forward(CIRCUIT, CURVE.resistance(force)))]
    last, errors = None, []
    for truth, frame in zip(force, adc, strict=True):
        last = compensate(frame, CIRCUIT, CURVE, start=last)
        alone = compensate(frame, CIRCUIT, CURVE)
        errors.append([np.abs(e.force - truth).mean() / GRAM for e in (last, alone)])
    with_start, without = np.mean(errors, 0)
    assert with_start < 1.2 * without + 0.05


HOSTILE = {
    "all 0": np.zeros((16, 16)),
    "all 1": np.ones((16, 16)),
    "smallest": np.full((16, 16), 1e-300),
    "all pressed to the limit": forward(CIRCUIT, np.full((16, 16), CURVE.least_resistance)),
    "pressed past it": forward(CIRCUIT, np.full((16, 16), 1.0)),
    "far below rest": forward(CIRCUIT, np.full((16, 16), 4e6)),
    "noise": np.random.default_rng(2).random((16, 16)),
    "0 and 1": np.eye(16),
    "an open row": np.where(np.arange(16)[:, None] == 3, 0.0, REST),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", HOSTILE)
@pytest.mark.parametrize("time_limit", [None, 1e-6])
def test_whatever_comes_in_something_finite_comes_out(method, case, time_limit):
    estimate = compensate(HOSTILE[case], CIRCUIT, CURVE, method, time_limit=time_limit)
    for picture in (estimate.force, estimate.std):
        assert picture.shape == (16, 16) and np.isfinite(picture).all() and (picture >= 0).all()
    assert np.isfinite(estimate.residual) and 0 <= estimate.iterations <= 120
    assert estimate.method in METHODS and estimate.method != "auto"
    if method in ("map", "auto") and "limit" not in case:
        assert estimate.status != "ok" and estimate.message


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2), (3, 16), (16, 3)])
def test_any_number_of_rows_and_columns(shape):
    circuit = Circuit(*shape)
    truth = scenes.sample("random", 1, *shape, np.random.default_rng(3))[0]
    adc = forward(circuit, CURVE.resistance(truth))
    exact = compensate(adc, circuit, CURVE, noise=0.0)
    assert np.abs(exact.force - truth).max() < 1e-3 * GRAM
    noisy = scenes.read_out(circuit, adc, "scan", np.random.default_rng(4))
    assert np.abs(compensate(noisy, circuit, CURVE).force - truth).mean() < 40 * GRAM


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"threshold": 1.0}, "threshold = 1.0"),
        ({"noise": -1.0}, "noise = -1.0"),
        ({"time_limit": 0.0}, "time_limit = 0.0"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        compensate(TOUCHED, CIRCUIT, CURVE, **arguments)


def test_a_board_that_counts_to_1024_is_not_suspect():
    """Its readings are a thousandth low: less than anyone knows of a full scale."""
    rng = np.random.default_rng(12)
    circuit, curve, refused = Circuit(), PressureCurve(), 0
    for _ in range(60):
        place = rng.uniform(2, 13, 2)
        force = scenes.finger(16, 16, *place, rng.uniform(1, 25), rng.uniform(0.6, 1.5))
        steps = forward(circuit, curve.resistance(force)) * 1023
        counts = np.rint(steps + 0.3 * rng.standard_normal(steps.shape))
        refused += compensate(counts / 1024, circuit, curve).status != "ok"
    assert refused <= 2
