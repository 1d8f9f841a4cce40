# SPDX-License-Identifier: Apache-2.0
"""A network is trained for the board of a parameter file."""

import numpy as np
import pytest

from tactile_skin import cli, compensate, forward
from tactile_skin.learning import network
from tactile_skin.middleware.config import read_skin

BOARD = """/**:
  ros__parameters:
    circuit: {rows: 6, cols: 7, r_par: 352.0, r_line: 9.0}
    curve: {gain: [1.5]}
"""
TINY = ["--pairs", "600", "--validation", "90", "--epochs", "2", "--batch", "50"]


@pytest.mark.parametrize(("kind", "method"), [("paper", "cnn"), ("physics", "physics")])
def test_a_network_is_trained_for_a_circuit_and_its_curve(tmp_path, capsys, kind, method):
    """With stripes, and cells with gains: both are no business of the network's."""
    pytest.importorskip("torch", reason="the extra train")
    config, out = tmp_path / "mine.yaml", tmp_path / "weights"
    config.write_text(BOARD)
    words = ["--config", str(config), "--out", str(out), "--network", kind, "--threads", "1"]
    assert cli.main(["train", *words, *TINY]) == 0
    assert f"weights: {out / kind}.npz" in capsys.readouterr().out
    weights, skin = network.load(out / f"{kind}.npz"), read_skin(config)
    force = np.full((6, 7), 0.3)
    adc = forward(skin.circuit, skin.curve.resistance(force))
    found = compensate(adc, skin.circuit, skin.curve, method, weights=weights)
    usual = compensate(adc, skin.circuit, skin.curve.usual, method, weights=weights)
    np.testing.assert_allclose(found.force, 1.5 * usual.force, rtol=0.05)
