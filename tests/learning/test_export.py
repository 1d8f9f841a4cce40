"""A network in a foreign runtime answers as ours."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.cli import main
from tactile_skin.learning import network
from tactile_skin.simulation import scenes

CIRCUIT, CURVE = Circuit(), PressureCurve()


@pytest.mark.filterwarnings("ignore")  # of PyTorch's exporter about itself
@pytest.mark.parametrize("kind", network.NETWORKS)
def test_onnx_gives_the_same_forces(kind, tmp_path, capsys):
    pytest.importorskip("torch", reason="the extra onnx")
    runtime = pytest.importorskip("onnxruntime", reason="the extra onnx and a runtime to try it")
    pytest.importorskip("onnxscript", reason="the extra onnx")
    path = tmp_path / "skin.onnx"
    assert main(["export", kind, str(path)]) == 0
    assert "force in newton" in capsys.readouterr().out
    adc = forward(
        CIRCUIT, CURVE.resistance(scenes.sample("blobs", 7, 16, 16, np.random.default_rng(1)))
    )
    inputs = adc[:, None].astype(np.float32)
    if kind == "physics":
        inputs = network.physics_inputs(adc, CIRCUIT, CURVE).swapaxes(0, 1)
    session = runtime.InferenceSession(str(path))
    (force,) = session.run(None, {"inputs": np.ascontiguousarray(inputs)})
    expected = network.shipped(kind).predict(adc)
    np.testing.assert_allclose(force, expected, atol=1e-3)


def test_weights_that_are_not_there_are_named(capsys):
    assert main(["export", "nothing.npz", "skin.onnx"]) == 2
    assert "nothing.npz: no such file" in capsys.readouterr().err
