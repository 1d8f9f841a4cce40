# SPDX-License-Identifier: Apache-2.0
"""Training repeats itself, survives being killed, and notices its own death."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, cli, compensate, forward
from tactile_skin.learning import dataset, network
from tactile_skin.learning.dataset import TrainingConfig, make_pairs
from tactile_skin.middleware.config import read_skin

torch = pytest.importorskip("torch", reason="the extra train")
training = pytest.importorskip("tactile_skin.learning.training")
TrainingDied, train, Soap = training.TrainingDied, training.train, training.Soap

CIRCUIT, CURVE = Circuit(6, 7), PressureCurve()
TINY = TrainingConfig(pairs=600, validation=90, epochs=4, batch=50, rate=5e-3, seed=4)


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """The runs are tiny: two threads would wait for one another, long where a core is busy."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def run(out, config=TINY, **kwargs):
    lines = []
    path = train(CIRCUIT, CURVE, config, out, say=lines.append, **kwargs)
    return network.load(path), lines


def same(a: network.Weights, b: network.Weights) -> bool:
    adc = np.random.default_rng(0).random((5, 6, 7))
    return np.array_equal(a.predict(adc), b.predict(adc))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return run(tmp_path_factory.mktemp("whole"))[0]


@pytest.mark.ci
def test_the_same_seed_gives_the_same_weights_and_another_does_not(whole, tmp_path):
    assert same(whole, run(tmp_path / "b")[0])
    assert not same(whole, run(tmp_path / "c", replace(TINY, seed=5))[0])


def test_stripes_are_no_business_of_the_network(tmp_path):
    """Their share is taken out of each reading before it sees it."""
    first, _ = run(tmp_path / "ideal", replace(TINY, epochs=1))
    line = replace(CIRCUIT, r_line=12.0)
    path = train(line, CURVE, replace(TINY, epochs=1), tmp_path / "line", say=lambda text: None)
    assert same(first, network.load(path))


def test_a_killed_run_resumes_to_the_same_result(whole, tmp_path):
    class Killed(Exception):
        pass

    def kill_in_third_epoch(items, desc):
        for k, item in enumerate(items):
            if desc.startswith("epoch 3") and k == 5:
                raise Killed
            yield item

    with pytest.raises(Killed):
        run(tmp_path / "killed", track=kill_in_third_epoch)
    resumed, lines = run(tmp_path / "killed")
    assert any("resuming" in line and "after epoch 2 of 4" in line for line in lines)
    assert same(whole, resumed)


def test_a_checkpoint_of_another_run_is_refused_with_what_differs(tmp_path):
    short = replace(TINY, epochs=1)
    run(tmp_path, short)
    with pytest.raises(ValueError, match="another rate"):
        run(tmp_path, replace(short, rate=1e-3))
    restarted, _ = run(tmp_path, replace(short, rate=1e-3), resume=False)
    assert restarted.meta["config"]["rate"] == 1e-3


@pytest.mark.ci
def test_it_learns_and_keeps_the_best_epoch(tmp_path):
    weights, _ = run(tmp_path, replace(TINY, epochs=24))
    with (tmp_path / "history.csv").open() as file:
        history = list(csv.DictReader(file))
    errors = [float(line["validation_g"]) for line in history]
    assert len(errors) == 24
    assert min(errors) < 0.7 * errors[0]
    assert weights.meta["validation_g"] == min(errors)
    assert weights.meta["epoch"] == errors.index(min(errors)) + 1
    weights.check(CIRCUIT, CURVE)


def test_the_optimiser_needs_fewer_steps_than_adam_where_inputs_are_alike():
    """A layer whose inputs are nearly the same: what tells them apart is learnt no slower."""
    rng = np.random.default_rng(2)
    alike = np.linalg.qr(rng.standard_normal((12, 12)))[0] * np.geomspace(1.0, 0.02, 12)[:, None]
    seen = torch.from_numpy(rng.standard_normal((200, 12)) @ alike).float()
    told = seen @ torch.from_numpy(rng.standard_normal((12, 3))).float()

    def left(optimizer) -> float:
        weights = torch.nn.Parameter(torch.zeros(3, 12))
        steps = optimizer([weights], lr=0.03)
        for _ in range(300):
            steps.zero_grad()
            loss = (seen @ weights.T - told).square().mean()
            loss.backward()
            steps.step()
        return loss.item()

    assert left(Soap) < 0.1 * left(torch.optim.Adam)


def test_dead_outputs_stop_the_run(tmp_path, monkeypatch):
    make_net = training.make_net

    def dead(*args):
        net = make_net(*args)
        for parameter in net.parameters():
            torch.nn.init.constant_(parameter, -0.1)
        return net

    monkeypatch.setattr(training, "make_net", dead)
    with pytest.raises(TrainingDied, match="epoch 1: all outputs are equal"):
        run(tmp_path)


def test_a_diverging_run_stops(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.nn.utils, "clip_grad_norm_", lambda *_: None)
    with pytest.raises(TrainingDied):
        run(tmp_path, replace(TINY, rate=1e30, optimizer="sgd", loss="mse"))


def test_a_run_that_learns_nothing_stops(tmp_path):
    with pytest.raises(TrainingDied, match="that of a constant answer"):
        run(tmp_path, replace(TINY, rate=1e-12))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epochs": 0}, "epochs = 0"),
        ({"loss": "huber"}, "loss = 'huber'"),
        ({"readout": "film"}, "readout = 'film'"),
        ({"rate": -1.0}, "rate = -1.0"),
    ],
)
def test_a_config_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(TINY, **change)


@pytest.mark.parametrize("network_kind", network.NETWORKS)
def test_another_readout_is_refused_before_the_training(network_kind):
    with pytest.raises(ValueError, match="floating readout only, not 'grounded'"):
        make_pairs(replace(CIRCUIT, readout="grounded"), CURVE, 10, network_kind, "ideal", 5)


@pytest.mark.parametrize("shape", [(1, 8), (8, 1)])
def test_a_single_line_has_nothing_to_learn(shape):
    with pytest.raises(ValueError, match="one line has no cross-talk"):
        make_pairs(Circuit(*shape), CURVE, 10, "paper", "ideal", 5)


@pytest.mark.parametrize("network_kind", network.NETWORKS)
def test_pairs_do_not_depend_on_how_many_are_made(network_kind, monkeypatch):
    """The first pairs of a larger set are those of a smaller one."""
    monkeypatch.setattr(dataset, "_CHUNK", 100)
    few = make_pairs(CIRCUIT, CURVE, 200, network_kind, "board", 5)
    many = make_pairs(CIRCUIT, CURVE, 400, network_kind, "board", 5)
    np.testing.assert_array_equal(few[0], many[0][:200])
    np.testing.assert_array_equal(few[1], many[1][:200])


@pytest.mark.ci
def test_a_run_goes_on_from_weights_that_are_there(tmp_path):
    weights, _ = run(tmp_path / "first", replace(TINY, epochs=8, rate=2.5e-3))
    _, anew = run(tmp_path / "anew", replace(TINY, epochs=1))
    more = replace(TINY, epochs=1, rate=1e-3, start=str(weights.path))
    _, further = run(tmp_path / "further", more)
    error = [float(lines[-1].split("best ")[1].split()[0]) for lines in (anew, further)]
    assert error[1] < 0.9 * error[0]
    with pytest.raises(ValueError, match="of a paper network, not 'physics'"):
        run(tmp_path / "kind", replace(more, network="physics"))
    with pytest.raises(ValueError, match="16 x 16, not 6 x 7"):
        run(tmp_path / "shape", replace(more, start="paper"))


@pytest.mark.parametrize("seed", range(6))
def test_the_line_kernels_start_open(seed):
    """There is one of each: dead, the network would not know of its lines."""
    torch.manual_seed(seed)
    net = training.make_net("paper", *CIRCUIT.shape)
    inputs = torch.from_numpy(make_pairs(CIRCUIT, CURVE, 300, "paper", "ideal", seed)[0])
    inputs = (inputs - inputs.mean()) / inputs.std()
    with torch.inference_mode():
        for line in (net.row, net.col):
            assert (line(inputs) > 0).float().mean() > 0.7


BOARD = """/**:
  ros__parameters:
    circuit: {rows: 6, cols: 7, r_par: 352.0, r_line: 9.0}
    curve: {gain: [1.5]}
"""
FEW = ["--pairs", "600", "--validation", "90", "--epochs", "2", "--batch", "50"]


@pytest.mark.parametrize(("kind", "method"), [("paper", "cnn"), ("physics", "physics")])
def test_a_network_is_trained_for_a_circuit_and_its_curve(tmp_path, capsys, kind, method):
    """With stripes, and cells with gains: both are no business of the network's."""
    config, out = tmp_path / "mine.yaml", tmp_path / "weights"
    config.write_text(BOARD)
    words = ["--config", str(config), "--out", str(out), "--network", kind, "--threads", "1"]
    assert cli.main(["train", *words, *FEW]) == 0
    assert f"weights: {out / kind}.npz" in capsys.readouterr().out
    weights, skin = str(out / f"{kind}.npz"), read_skin(config)
    force = np.full((6, 7), 0.3)
    adc = forward(skin.circuit, skin.curve.resistance(force))
    found = compensate(adc, skin.circuit, skin.curve, method, weights=weights)
    usual = compensate(adc, skin.circuit, skin.curve.usual, method, weights=weights)
    np.testing.assert_allclose(found.force, 1.5 * usual.force, rtol=0.05)
