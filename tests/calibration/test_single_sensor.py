# SPDX-License-Identifier: Apache-2.0
"""A row of single sensors is a skin: from its recordings to newtons of a running one."""

import numpy as np
import pytest
import yaml

from tactile_skin import Circuit, PressureCurve, cli, fit_curve, fit_reference, measure_rest
from tactile_skin.launch import read_skin

ROW = {"rows": 1, "cols": 3, "r_ref": 2e3, "r_par": 0.0, "adc_bits": 12, "readout": "grounded"}


@pytest.mark.ci
def test_a_row_of_sensors_from_files_to_newtons(tmp_path, capsys):
    """`measure_rest`, `fit_curve`, `fit_reference`, `calibrate` by weights, `doctor`, its file."""
    circuit, rng, curve = Circuit(**ROW), np.random.default_rng(3), PressureCurve()
    times, force = np.arange(0.0, 85.0, 0.04), np.zeros((2125, 1, 3))
    for k, load in enumerate([0.7, 7.0, 2.0, 4.0, 1.0, 3.0, 6.0, 1.5, 5.0]):
        stood = times - 4.0 - 9.0 * k
        force[:, 0, k % 3] += load * np.clip(stood / 0.5, 0.0, 1.0) * (stood < 5.5)
    uneven = curve.resting_at(np.array([[2e4, 4e4, 6e4]]))
    ratio = circuit.ratio(uneven.resistance(force))
    steps = np.rint(4095 * ratio + rng.standard_normal(ratio.shape)).clip(0.0, 4095)
    lies = [int(np.argmin(np.abs(times - 8.0 - 9.0 * k))) for k in range(9)]
    frames = np.array([steps[i - 10 : i].mean(0) for i in lies]) / 4095
    rest = measure_rest(steps[times < 3.0] / 4095, circuit)
    fitted = fit_curve(frames, force[lies].sum((1, 2)), circuit, rest)
    by_scale, _ = fit_reference(steps / 4095, times, force.sum((1, 2)) + 2.0, times, circuit, rest)
    assert fitted.error < 0.1 and by_scale.error < 0.1
    parts = {"rest": times < 3.0, "all": times >= 0.0}
    parts |= {f"w{k}": (times > times[i] - 1.0) & (times <= times[i]) for k, i in enumerate(lies)}
    for name, part in parts.items():
        np.savetxt(tmp_path / f"{name}.csv", steps[part, 0], "%d", ",")
    config, out = tmp_path / "mine.yaml", tmp_path / "out.yaml"
    config.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": ROW}}}))
    words = [f"{force[i].sum()}N:={tmp_path / f'w{k}.csv'}" for k, i in enumerate(lies)]
    words += ["--config", str(config), "--out", str(out), f"rest:={tmp_path / 'rest.csv'}"]
    assert cli.main(["calibrate", *words]) == 0
    skin = read_skin(out)
    for own in (skin.curve, by_scale.curve):
        ohm = skin.circuit.two_terminal(frames)
        felt = own.resting_at(1.0 / rest.conductance).force(ohm).sum((1, 2))
        np.testing.assert_allclose(felt, force[lies].sum((1, 2)), rtol=0.15)
    assert cli.main(["doctor", "--config", str(out), str(tmp_path / "all.csv")]) == 0
    assert "nothing found" in capsys.readouterr().out
