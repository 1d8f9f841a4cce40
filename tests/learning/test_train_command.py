"""Weights that are not of the configured skin are named, and made anew on request."""

import re
import shlex

import numpy as np
import pytest

from tactile_skin import cli, compensate, forward
from tactile_skin.commands import train
from tactile_skin.learning import network
from tactile_skin.learning.dataset import TrainingConfig
from tactile_skin.middleware.config import read_skin

TINY = {"pairs": 600, "validation": 90, "epochs": 2, "batch": 50}
CALIBRATED = """# made by tactile-skin calibrate
/**:
  ros__parameters:
    circuit: {rows: 6, cols: 7, r_par: 352.0, r_line: 9.0}
    curve: {gain: [1.5]}
"""


def written(tmp_path, text=CALIBRATED, **compensation):
    path = tmp_path / "calibrated.yaml"
    given = "".join(f"    {name}: {value}\n" for name, value in compensation.items())
    section = f"/**/compensation:\n  ros__parameters:\n{given}" if given else ""
    path.write_text(text + section)
    return path


def test_a_file_without_a_network_needs_none(tmp_path):
    assert train.misfit(written(tmp_path)) == ""
    assert train.misfit(written(tmp_path, method="map")) == ""


@pytest.mark.parametrize(("method", "kind"), [("cnn", "paper"), ("physics", "physics")])
def test_weights_of_another_skin_are_named_with_the_command_that_trains_them(
    tmp_path, monkeypatch, method, kind
):
    path = written(tmp_path, method=method)
    said = train.misfit(path)
    assert "r_par = 326.0 (yours: 352.0)" in said
    command = next(line for line in said.splitlines() if "tactile-skin train --config" in line)
    asked = []
    monkeypatch.setattr(train, "train", lambda *given: asked.append(given) or path)
    assert cli.main(shlex.split(command.split("tactile-skin ", 1)[1])) == 0
    (skin, config, out, restart, _), *_ = asked
    assert skin.circuit == read_skin(path).circuit and not restart
    assert config == train.again(skin, kind) and config.network == kind
    assert f"{out / kind}.npz" in said


def test_what_is_shipped_is_gone_on_from_where_it_has_the_skins_shape(tmp_path):
    skin = read_skin(written(tmp_path))
    assert train.again(skin, "paper").start == ""
    assert train.again(skin, "physics").start == "physics"
    assert train.again(read_skin(), "paper").start == "paper"


@pytest.mark.parametrize("kind", ["paper", "physics"])
def test_what_weights_are_worth_is_said_of_the_circuit_that_was_found(tmp_path, kind):
    """Against the shipped ones, which err more the further their circuit is off."""
    file = network.SHIPPED / f"{kind}.npz"
    said = {
        r_par: train.worth(
            read_skin(
                written(tmp_path, f"/**: {{ros__parameters: {{circuit: {{r_par: {r_par}}}}}}}")
            ),
            file,
        )
        for r_par in (326.0, 400.0)
    }
    grams = {r_par: re.findall(r"([0-9.]+) g a cell", text) for r_par, text in said.items()}
    for new, shipped in grams.values():  # the same weights on the same frames
        assert new == shipped
    assert float(grams[400.0][0]) > 1.2 * float(grams[326.0][0]) > 0.0


@pytest.mark.parametrize(("kind", "method"), [("paper", "cnn"), ("physics", "physics")])
def test_a_trained_network_is_entered_and_fits(tmp_path, monkeypatch, capsys, kind, method):
    """A circuit with stripes, and cells with gains: both are no business of the network's."""
    pytest.importorskip("torch", reason="the extra train")
    tiny = TrainingConfig(network=kind, **TINY)
    monkeypatch.setattr(train, "again", lambda skin, kind: tiny)
    monkeypatch.setattr(train.os, "cpu_count", lambda: 1)
    path = written(tmp_path, method=method)
    assert train.misfit(path)
    for _ in range(2):  # and again, once the skin was calibrated anew
        assert train.enter(path, kind)
        assert train.misfit(path) == ""
        assert path.read_text().startswith("# made by tactile-skin calibrate\n")
        said = capsys.readouterr().out
        assert re.search(
            r"trained in [0-9.]+ min: .* the new weights err by [0-9.]+ g a cell", said
        )
        assert "the shipped ones are for 16 x 16 cells" in said
    weights = network.load(tmp_path / "calibrated" / f"{kind}.npz")
    skin = read_skin(path)
    force = np.full((6, 7), 0.3)
    adc = forward(skin.circuit, skin.curve.resistance(force))
    found = compensate(adc, skin.circuit, skin.curve, method, weights=weights)
    usual = compensate(adc, skin.circuit, skin.curve.usual, method, weights=weights)
    np.testing.assert_allclose(found.force, 1.5 * usual.force, rtol=0.05)
