# SPDX-License-Identifier: Apache-2.0
"""The pass through the network equals PyTorch's, and weights know what they were made for."""

from pathlib import Path

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.bench.measure import GHOST, frames
from tactile_skin.learning import network
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes

torch = pytest.importorskip("torch", reason="the extra train")
make_net = pytest.importorskip("tactile_skin.learning.training").make_net


def random_weights(rows, cols, kind="paper"):
    torch.manual_seed(0)
    net = make_net(kind, rows, cols)
    for parameter in net.parameters():  # biases too: the pass must not forget them
        parameter.data += 0.1 * torch.randn_like(parameter)
    net.input_mean += 0.3
    net.input_std *= 0.4
    state = {k: v.numpy() for k, v in net.state_dict().items()}
    meta = {"circuit": Circuit(rows, cols).describe(), "curve": PressureCurve().describe()}
    return net, state, meta


@pytest.mark.parametrize(("kind", "n"), [("paper", 4544), ("physics", 5078)])
def test_a_network_has_as_many_parameters_as_agreed(kind, n):
    assert sum(p.numel() for p in make_net(kind, 16, 16).parameters()) == n


@pytest.mark.parametrize("kind", network.NETWORKS)
@pytest.mark.parametrize("shape", [(16, 16), (5, 9), (12, 3)])
def test_the_pass_equals_pytorchs(kind, shape):
    net, state, meta = random_weights(*shape, kind)
    weights = network.Weights(state, meta, "here")
    adc = np.random.default_rng(1).uniform(0.05, 0.8, (7, *shape))
    inputs = adc[:, None]
    if kind == "physics":
        inputs = network.physics_inputs(adc, Circuit(*shape), PressureCurve()).swapaxes(0, 1)
    with torch.inference_mode():
        expected = net.eval()(torch.from_numpy(inputs).float()).numpy() * PressureCurve().max_force
    assert expected.std() > 0.1
    for found in (weights.predict(adc), np.stack([weights.predict(a) for a in adc])):
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_physics_inputs_are_the_truth_where_the_touch_is_light():
    """After the steps of the fixed point little is left for the network to do."""
    circuit, curve = Circuit(), PressureCurve()
    force = np.zeros((1, 16, 16))
    force[0, 5, 5:8] = 0.3
    inputs = network.physics_inputs(forward(circuit, curve.resistance(force)), circuit, curve)
    assert inputs.shape == (5, 1, 16, 16) and np.isfinite(inputs).all()
    found = inputs[network.FIXED_POINT] * curve.max_force
    np.testing.assert_allclose(found, force, atol=0.003)
    assert np.abs(inputs[0] - inputs[1]).max() > 0.1 > 10.0 * np.abs(inputs[2]).max()


def test_the_physics_fed_network_starts_as_the_fixed_point():
    net = make_net("physics", 16, 16).eval()
    force = scenes.sample("bodies", 5, 16, 16, np.random.default_rng(4))
    adc = forward(Circuit(), PressureCurve().resistance(force))
    inputs = network.physics_inputs(adc, Circuit(), PressureCurve()).swapaxes(0, 1)
    with torch.inference_mode():
        found = net(torch.from_numpy(np.ascontiguousarray(inputs))).numpy()
    np.testing.assert_allclose(found, inputs[:, network.FIXED_POINT], atol=1e-6)


def test_weights_survive_the_disk(tmp_path):
    _, state, meta = random_weights(6, 6)
    network.save(tmp_path / "w.npz", state, meta)
    loaded = network.load(tmp_path / "w.npz")
    adc = np.random.default_rng(3).random((6, 6))
    np.testing.assert_array_equal(
        loaded.predict(adc), network.Weights(state, meta, "here").predict(adc)
    )
    loaded.check(Circuit(6, 6), PressureCurve())
    loaded.check(Circuit(6, 6, adc_bits=12), PressureCurve())
    with pytest.raises(ValueError, match=r"r_par = 326.0 \(yours: 100.0\)"):
        loaded.check(Circuit(6, 6, r_par=100.0), PressureCurve())
    with pytest.raises(ValueError, match=r"rows = 6 \(yours: 16\)"):
        loaded.check(Circuit(), PressureCurve())
    with pytest.raises(ValueError, match="know the floating readout only, not 'grounded'"):
        loaded.check(Circuit(6, 6, readout="grounded"), PressureCurve())


def test_another_size_of_reading_is_refused():
    _, state, meta = random_weights(6, 6)
    with pytest.raises(ValueError, match=r"wants \(..., 6, 6\)"):
        network.Weights(state, meta, "here").predict(np.zeros((16, 16)))


def test_shipped_weights_say_what_they_are():
    weights = network.shipped("paper")
    weights.check(Circuit(), PressureCurve())
    assert weights.meta["config"]["pairs"] >= 48_000
    assert weights.meta["config"]["validation"] >= 12_000
    assert weights.meta["config"]["start"] == ""  # from nothing, by a script that is here
    assert (Path(__file__).parents[2] / "benchmarks/training" / weights.meta["made by"]).exists()
    assert {"seed", "epochs", "loss"} <= set(weights.meta["config"])
    assert weights.meta["epoch"] >= 1 and weights.meta["validation_g"] > 0


# --- what the shipped ones must do, on scenes that they have not seen -----------------------------


def error(kind, family, readout, n=900):
    """Mean error [g a cell] of a shipped network; scenes, readings [N, ADC ratio]."""
    rng = np.random.default_rng(20261)
    force, adc = frames(family, readout, n, rng, Circuit(), PressureCurve())
    return np.abs(network.shipped(kind).predict(adc) - force).mean() / GRAM, force, adc


@pytest.mark.parametrize(("family", "most"), [("blobs", 11), ("rects", 30), ("random", 52)])
def test_the_papers_network_errs_no_more_than_the_papers(family, most):
    assert error("paper", family, "ideal")[0] < most


@pytest.mark.parametrize(("family", "most"), [("blobs", 5), ("rects", 14), ("bodies", 8)])
def test_the_physics_fed_network_on_noisy_scans(family, most):
    assert error("physics", family, "scan", 300)[0] < most


@pytest.mark.parametrize("kind", network.NETWORKS)
def test_two_fingers_leave_no_ghost(kind):
    force = scenes.script("two_fingers", 16, 16)(0.0)
    adc = forward(Circuit(), PressureCurve().resistance(force))
    found = network.shipped(kind).predict(adc)
    assert found[force == 0].max() < GHOST * GRAM


@pytest.mark.parametrize("newtons", [0.5, 2.0, 8.0])
def test_the_papers_network_reads_light_and_hard_fingers(newtons):
    """On noisy scans, anywhere on the mat; in the median within 15 %."""
    rng, circuit, curve = np.random.default_rng(7012), Circuit(), PressureCurve()
    places = rng.uniform(2.0, 13.0, (100, 2))
    force = np.array([scenes.finger(16, 16, *place, newtons) for place in places])
    adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)
    found = network.shipped("paper").predict(adc).sum((1, 2))
    assert np.median(found) == pytest.approx(newtons, rel=0.15)
