# SPDX-License-Identifier: Apache-2.0
"""`calibrate` on strangers' boards: what it says at the end, and how it looks on a terminal."""

import numpy as np
import pytest
from support.strangers import sim

from tactile_skin import Circuit, forward
from tactile_skin.cli import main
from tactile_skin.commands import calibrate
from tactile_skin.physics.curve import GRAM

SHAPE = 6, 10


@pytest.mark.parametrize("readout", ["grounded", "floating", "loaded"])
def test_a_curve_in_doubt_is_not_simply_to_be_used(tmp_path, capsys, readout):
    """Amplified sense lines, configured as a passive readout: where no curve explains the weights
    nothing is written; where one does, and the circuit not the frames, it says so at the end."""
    true = Circuit(*SHAPE, r_ref=300.0, r_par=0.0, adc_bits=12, readout="virtual_ground")
    curve, rng = sim.fabric(true, 4), np.random.default_rng(4)

    def save(name, force):
        steps = forward(true, curve.resistance(force)) * true.full_scale
        steps = steps + 0.8 * rng.standard_normal((40, *SHAPE))
        np.save(tmp_path / name, np.clip(np.rint(steps), 0, true.full_scale).astype(int))
        return f"{tmp_path / name}"

    given = [f"rest:={save('rest.npy', np.zeros(SHAPE))}"]
    for grams, width, at in ((400, 1.3, (2, 3)), (900, 1.6, (3, 6)), (2500, 2.1, (2, 5))):
        force = sim.finger(SHAPE, *at, grams * GRAM, width)
        given.append(f"{grams}g:={save(f'{grams}.npy', force)}")
    config, out = tmp_path / "mine.yaml", tmp_path / "out.yaml"
    config.write_text(
        "/**: {ros__parameters: {circuit: {rows: 6, cols: 10, r_ref: 300.0, r_par: 0.0, "
        f"adc_bits: 12, readout: {readout}}}}}}}\n"
    )
    status = main(["calibrate", "--config", str(config), "--out", str(out), *given])
    said, err = capsys.readouterr()
    assert out.exists() == (status == 0) == (readout != "grounded")
    assert "Use it" not in said + err and "is written." not in said + err
    assert ("this curve is not kept" in said) == ("is not written" in err) == (status == 1)
    assert ("do not fit the circuit: see" in " ".join(said.split())) == (status == 0)


def test_lines_break_between_words(capsys):
    """At the width of the terminal; pictures and short lines stay as they are."""
    calibrate._say("  touch 5: " + "the frames do not tell " * 9 + "\n  |  ..@@  |")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 2 and max(map(len, lines)) <= 80
    assert lines[0].startswith("  touch 5: the") and lines[1].startswith("    ")
    assert lines[-1] == "  |  ..@@  |"


def test_a_rest_that_drifted_before_a_weight_is_laid_on_is_no_weight(tmp_path, capsys):
    """An ADC of 16 bits sees that the fabric conducts 2 % more after some minutes."""
    circuit = Circuit(8, 8, r_ref=4700.0, r_par=140.0, adc_bits=16)
    curve, rng = sim.fabric(circuit, 4), np.random.default_rng(4)

    def save(name, *forces, warm=1.02):
        ratio = [forward(circuit, curve.resistance(f) / warm) for f in forces for _ in range(120)]
        steps = circuit.full_scale * np.array(ratio) + 6.0 * rng.standard_normal((len(ratio), 8, 8))
        np.save(tmp_path / name, np.rint(steps).astype(np.uint16))
        return f"{tmp_path / name}"

    rest = np.zeros(circuit.shape)
    given = ["rate:=40", f"rest:={save('rest.npy', rest, rest, rest, warm=1.0)}"]
    for grams, width, at in ((400, 1.3, (2, 3)), (900, 1.6, (3, 5)), (2500, 2.1, (4, 3))):
        load = sim.finger(circuit.shape, *at, grams * GRAM, width)
        given.append(f"{grams}g:={save(f'{grams}.npy', rest, load)}")
    config, out = tmp_path / "mine.yaml", tmp_path / "out.yaml"
    config.write_text(
        "/**: {ros__parameters: {circuit: {rows: 8, cols: 8, r_ref: 4700.0, r_par: 140.0, "
        "adc_bits: 16}}}\n"
    )
    assert main(["calibrate", "--config", str(config), "--out", str(out), *given]) == 0
    felt = capsys.readouterr().out.rpartition("felt: ")[2]
    assert float(felt.split()[0]) == pytest.approx(2500 * GRAM, rel=0.05)
