# SPDX-License-Identifier: Apache-2.0
"""What `compensate` takes and returns: one frame or a batch, and arguments by method."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS, Estimate

CIRCUIT, CURVE = Circuit(), PressureCurve()


def frames(n: int = 3) -> np.ndarray:
    """Scans of an untouched skin and of n - 1 blobs."""
    force = scenes.sample("blobs", n, 16, 16, np.random.default_rng(1))
    force[0] = 0.0
    adc = forward(CIRCUIT, CURVE.resistance(force))
    return scenes.read_out(CIRCUIT, adc, "scan", np.random.default_rng(2))


@pytest.mark.parametrize("method", METHODS)
def test_a_batch_is_its_frames(method):
    adc = frames()
    found = compensate(adc, CIRCUIT, CURVE, method)
    alone = [compensate(frame, CIRCUIT, CURVE, method) for frame in adc]
    assert found.force.shape == found.std.shape == (3, 16, 16)
    for name in ("residual", "status", "message", "method", "iterations"):
        values = getattr(found, name)
        assert isinstance(values, np.ndarray) and values.shape == (3,)
        expected = [getattr(e, name) for e in alone]
        np.testing.assert_array_equal(values, expected)
    assert found.status.dtype.kind == found.message.dtype.kind == found.method.dtype.kind == "U"
    for k, estimate in enumerate(alone):
        np.testing.assert_array_equal(found.force[k], estimate.force)
        np.testing.assert_array_equal(found.std[k], estimate.std)


def test_a_batch_of_none_keeps_its_shape():
    found = compensate(np.zeros((0, 16, 16)), CIRCUIT, CURVE)
    assert found.force.shape == (0, 16, 16) and found.status.shape == (0,)
    assert "0 frames of 16 x 16 cells" in repr(found)


def test_each_frame_of_a_batch_goes_on_from_the_start():
    adc = frames()
    last = compensate(adc[1], CIRCUIT, CURVE, "newton")
    found = compensate(adc, CIRCUIT, CURVE, "newton", start=last)
    for force, frame in zip(found.force, adc, strict=True):
        alone = compensate(frame, CIRCUIT, CURVE, "newton", start=last)
        np.testing.assert_array_equal(force, alone.force)


def test_the_bad_frame_of_a_batch_is_named():
    adc = frames()
    adc[2, 5, 7] = 1.5
    with pytest.raises(ValueError, match=r"frame 2 of 3: .* 1.5 at row 5, column 7"):
        compensate(adc, CIRCUIT, CURVE)
    with pytest.raises(ValueError, match=r"frame 0 of 3: reading has shape \(8, 16\)"):
        compensate(frames()[:, :8], CIRCUIT, CURVE)


@pytest.mark.parametrize("shape", [(), (16,), (2, 3, 16, 16)])
def test_what_is_neither_a_frame_nor_a_batch_is_refused(shape):
    with pytest.raises(ValueError, match="reading has shape"):
        compensate(np.zeros(shape), CIRCUIT, CURVE)


@pytest.mark.parametrize("method", METHODS)
def test_an_estimate_cannot_be_written_to_whatever_its_method(method):
    adc = frames(2)
    for found in (
        *(compensate(frame, CIRCUIT, CURVE, method) for frame in adc),
        compensate(adc, CIRCUIT, CURVE, method),
    ):
        for picture in (found.force, found.std):
            with pytest.raises(ValueError, match="read-only"):
                picture[:] = 0.0


def test_making_an_estimate_leaves_the_callers_arrays_writable():
    force = np.zeros((4, 6))
    Estimate(force, force, 0.0, "ok", "", "map", 1)
    force[0, 0] = 1.0


@pytest.mark.parametrize("method", METHODS)
def test_an_estimate_prints_as_a_line(method):
    idle, touched = (repr(compensate(frame, CIRCUIT, CURVE, method)) for frame in frames(2))
    for text in (idle, touched):
        assert len(text) < 300 and "\n" not in text
        assert "16 x 16 cells" in text and "ADC steps" in text
    assert f"Estimate({'map' if method == 'auto' else method}: ok; " in touched
    assert " N at row " in touched


def test_what_is_wrong_stands_in_the_line():
    text = repr(compensate(np.zeros((16, 16)), CIRCUIT, CURVE))
    assert "suspect (" in text and "are at most 0 ADC steps (an untouched cell reads 262)" in text
    batch = repr(compensate(np.stack([frames(1)[0], np.zeros((16, 16))]), CIRCUIT, CURVE, "map"))
    assert batch.startswith("Estimate(map: 1 ok, 1 suspect; 2 frames of 16 x 16 cells")
    assert len(batch) < 200


@pytest.mark.parametrize("method", ["naive", "fixed_point", "newton", "map", "auto"])
def test_an_argument_that_a_method_does_not_use_is_refused(method):
    message = f"method '{method}' does not use weights: only cnn and physics do"
    with pytest.raises(ValueError, match=message):
        compensate(frames(1), CIRCUIT, CURVE, method, weights="rubbish")


@pytest.mark.parametrize("method", METHODS)
def test_what_a_stream_hands_on_serves_every_method(method):
    """As nodes/compensation.py calls it."""
    arguments = {"weights": None, "threshold": 0.0, "time_limit": 0.5, "noise": 0.5}
    last = None
    for frame in frames():
        last = compensate(frame, CIRCUIT, CURVE, method, start=last, **arguments)
        assert last.status == "ok"


@pytest.mark.parametrize(
    "low, remedy",
    [
        ([(3, 4)], "Check the lead"),  # a bad contact
        ([(3, k) for k in range(8)], "row 3 is open: .* Check the lead"),
        ([(k, k) for k in range(8)], "Is it wired, or read, as it is configured"),  # on no one line
    ],
)
def test_readings_below_rest_name_the_likelier_cause(low, remedy):
    circuit = Circuit(8, 8, readout="grounded")
    adc = forward(circuit, PressureCurve().resistance(np.zeros((8, 8))))
    adc[tuple(zip(*low, strict=True))] *= 0.1
    found = compensate(adc, circuit, PressureCurve(), "newton", noise=0.5)
    assert found.status == "suspect"
    assert re.search(remedy, found.message)


# --- a start and weights that cannot be used ---

SMALL = Circuit(4, 6)
FORCE = np.zeros((4, 6))
FORCE[1:3, 2:4] = 2.0
ADC = np.rint(forward(SMALL, CURVE.resistance(FORCE)) * 1023) / 1023
LAST = compensate(ADC, SMALL, CURVE)


def hole(value) -> np.ndarray:
    force = np.ones((4, 6))
    force[2, 3] = value
    return force


STARTS = {
    "NaN": (replace(LAST, force=hole(np.nan)), "start.force = nan at row 2, column 3"),
    "infinite": (replace(LAST, force=hole(np.inf)), "start.force = inf at row 2, column 3"),
    "negative": (replace(LAST, force=hole(-1.0)), "start.force = -1.0 at row 2, column 3"),
    "shape": (replace(LAST, force=np.ones((6, 4))), "start has shape (6, 4): the circuit is"),
    "length": (replace(LAST, force=[1.0]), "start has shape (1,)"),
    "batch": (compensate(np.stack([ADC] * 3), SMALL, CURVE), "start has shape (3, 4, 6)"),
    "picture": (FORCE, "start is of type ndarray: must be an Estimate, that of the last frame"),
    "name": ("map", "start is of type str: must be an Estimate"),
}


@pytest.mark.parametrize("wrong", STARTS)
def test_a_bad_start_is_refused(wrong):
    start, message = STARTS[wrong]
    with pytest.raises(ValueError, match=re.escape(message)):
        compensate(ADC, SMALL, CURVE, start=start)


def test_weights_must_be_weights_or_their_file():
    with pytest.raises(ValueError, match="weights are of type dict: must be Weights"):
        compensate(ADC, SMALL, CURVE, "cnn", weights={})
    with pytest.raises(FileNotFoundError, match=r"weights mine\.npz: no such file"):
        compensate(ADC, SMALL, CURVE, "cnn", weights="mine.npz")
