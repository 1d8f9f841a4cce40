# SPDX-License-Identifier: Apache-2.0
"""Converters and circuits as strangers have them: an ESP32's ADC, one sensor."""

import datetime
from dataclasses import replace

import numpy as np
import pytest
from support import esp32
from support.marks import ci, slow
from support.strangers.sim import counts, fabric, finger, touches

from tactile_skin import (
    Circuit,
    PressureCurve,
    cli,
    compensate,
    diagnose,
    fit_curve,
    forward,
    identify,
    measure_rest,
)
from tactile_skin.health.skin import Follower
from tactile_skin.middleware.config import read_skin
from tactile_skin.physics import readouts
from tactile_skin.physics.adc import TABLES, Adc
from tactile_skin.physics.creep import Creep
from tactile_skin.physics.proof import Proof

CURVE = PressureCurve()


def skin_of(adc: Adc, **given) -> Follower:
    usual = {"r_par_std": None, "follows": True, "noise": None, "threshold": 0.0}
    usual |= {"time_limit": 60.0, "weights": None, "warn": lambda text: None}
    usual |= {"proof": Proof(), "today": datetime.date(2026, 11, 28)}
    skin = Follower(adc, CURVE, Creep(), **(usual | given))
    skin.use("auto")
    return skin


# --- an ESP32's ADC ---


def board(r_ref: float) -> Circuit:
    return Circuit(8, 8, r_ref=r_ref, r_par=140.0, adc_bits=12)


def test_the_shipped_table_is_near_the_chips_that_others_measured():
    adc = Adc(board(1000.0), table="esp32")
    for chip in esp32.CHIPS:
        volts, readings = chip[1:-1].T
        np.testing.assert_allclose(esp32.SUPPLY * adc.ratio(readings), volts, atol=0.06)
    low, high = adc.range
    assert esp32.SUPPLY * low == pytest.approx(0.142, abs=0.001)
    assert esp32.SUPPLY * high == pytest.approx(3.134, abs=0.002)


@pytest.mark.parametrize("bits", [9, 10, 12, 16])
@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("trim", [{}, {"offset": 20.0, "full_scale": 4200.0}])
def test_count_undoes_the_table(bits, inverted, trim):
    trim = {k: v * 2.0 ** (bits - 12) for k, v in trim.items()}
    adc = Adc(Circuit(2, 3, adc_bits=bits), inverted=inverted, table="esp32", **trim)
    ratio = np.linspace(0.1, 0.9, 30)
    np.testing.assert_allclose(adc.ratio(adc.count(ratio)), ratio, atol=1e-9)
    assert adc.share(1.0) == pytest.approx(1.0 / 2**bits, rel=0.05)


def test_a_table_of_ones_own_is_a_list_of_readings_and_shares():
    adc = Adc(Circuit(2, 3), table=[0.0, 0.1, 500.0, 0.5, 1023.0, 0.9])
    np.testing.assert_allclose(adc.ratio(np.array([0.0, 250.0, 1023.0])), [0.1, 0.3, 0.9])
    assert adc.range == (0.1, 0.9)
    assert adc.bounds(np.array([0.1, 0.3, 0.9])).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("esp8266", "adc_table = 'esp8266': must be esp32, or a list"),
        ([0.0, 0.1, 5.0], "must be two or more pairs"),
        ([0.0, 0.1], "must be two or more pairs"),
        (True, "must be two or more pairs"),
        (["a", "b", "c", "d"], "must be two or more pairs"),
        ([5.0, 0.1, 0.0, 0.5], "must be finite and rise"),
        ([0.0, 0.5, 5.0, 0.1], "must be from 0 to 1 and never fall"),
        ([0.0, 0.1, 5.0, 1.5], "must be from 0 to 1 and never fall"),
    ],
)
def test_what_is_no_table_is_refused(table, message):
    with pytest.raises(ValueError, match=message):
        Adc(Circuit(2, 3), table=table)


@pytest.mark.parametrize("method", ["map", "auto"])
def test_a_reading_at_the_end_of_the_range_is_a_bound(method):
    """Of 15 N at 10 kohm a few cells read 4095: they are felt as more than that, not as that."""
    circuit, force = board(10000.0), finger((8, 8), 3.3, 4.2, 15.0, 0.8)
    adc = Adc(circuit, table="esp32")
    steps = np.rint(np.clip(adc.count(forward(circuit, CURVE.resistance(force))), 0, 4095))
    ended = steps == 4095
    assert 2 <= np.count_nonzero(ended) <= 6
    ratio, (low, high) = adc.ratio(steps), adc.range
    told = compensate(ratio, circuit, CURVE, method, noise=1.0, threshold=low, ceiling=high)
    assert told.status == "ok"
    assert told.force.sum() == pytest.approx(15.0, rel=0.2)
    np.testing.assert_allclose(told.force[~ended], force[~ended], atol=0.15)
    taken = compensate(ratio, circuit, CURVE, method, noise=1.0)
    assert taken.force[ended].sum() < told.force[ended].sum()


def test_a_method_that_takes_values_only_refuses_bounds():
    adc = np.full((4, 4), 0.3)
    adc[1, 1] = 0.9
    with pytest.raises(ValueError, match="1 are missing, below the threshold or at the ceiling"):
        compensate(adc, Circuit(4, 4), CURVE, "newton", ceiling=0.7)


@pytest.mark.parametrize("r_ref", [1000.0, 4700.0])
def test_an_esp32_is_felt_right_and_does_not_stop(r_ref):
    """Of the chips that others measured, with noise; benchmarks/boards/esp32.py has more."""
    circuit, felt = board(r_ref), []
    readings, force = esp32.frames(circuit, (7, 1), 1, seconds=25.0, offset=0.0, gain=0.0)
    skin, faults = skin_of(Adc(circuit, table="esp32")), 0
    for k, frame in enumerate(readings):
        picture = skin.frame(k / esp32.RATE, (16 * frame).astype(np.uint16))
        faults += k > 100 and skin.fault
        if force[k].sum() > 5.0 and (force[k] == force[k - 3]).all():
            felt.append(picture.sum() / force[k].sum())
    low, middle, high = np.quantile(felt, (0.1, 0.5, 0.9))
    assert 0.9 < middle < 1.1 and low > 0.8 and high < 1.25
    assert faults <= 0.02 * len(readings)


def test_readings_at_the_end_of_the_range_are_said():
    circuit = board(10000.0)
    adc = Adc(circuit, table="esp32")
    skin, rng, curve = skin_of(adc), np.random.default_rng(5), fabric(circuit)
    for k in range(80):
        force = finger((8, 8), 3, 3, 20.0) * (k > 50)
        steps = adc.count(forward(circuit, curve.resistance(force))) + rng.standard_normal((8, 8))
        skin.frame(k / 20.0, np.rint(16 * np.clip(steps, 0, 4095)).astype(np.uint16))
    assert any(f.form == "range" for f in skin.findings()) and not skin.fault


def test_an_offset_is_no_stuck_bit():
    """What an untouched skin reads is compared in ADC steps."""
    circuit = Circuit(8, 8, r_ref=10000.0, adc_bits=12)
    adc = Adc(circuit, offset=900.0, full_scale=5000.0)
    skin, rng, curve = skin_of(adc), np.random.default_rng(5), fabric(circuit)
    for k in range(200):
        steps = adc.count(forward(circuit, curve.resistance(np.zeros((8, 8)))))
        steps = steps + rng.standard_normal((8, 8))
        skin.frame(k / 50.0, np.rint(16 * np.clip(steps, 0, 4095)).astype(np.uint16))
    assert skin.findings() == []


def test_untouched_cells_below_the_range_are_named():
    """A reference resistor of 100 ohm leaves less than 142 mV."""
    circuit = board(100.0)
    adc, curve = Adc(circuit, table="esp32"), fabric(circuit)
    skin, rng = skin_of(adc), np.random.default_rng(5)
    for k in range(80):
        volts = 3.3 * forward(circuit, curve.resistance(np.zeros((8, 8))))
        steps = esp32.Chip(rng, 0).read(volts + 0.0015 * rng.standard_normal((8, 8)))
        skin.frame(k / 20.0, (16 * steps).astype(np.uint16))
    assert skin.waits and "is no matrix connected" in str(skin.findings()[0])


def test_shipped_tables_name_their_source():
    assert TABLES
    for path in TABLES.values():
        assert "Source:" in path.read_text()


# --- a virtual ground: each reading is of its own cell ---


def amplified(**other) -> Circuit:
    parts = {"r_ref": 200.0, "r_par": 20.0, "adc_bits": 12, "readout": "virtual_ground"} | other
    return Circuit(8, 8, **parts)


@pytest.mark.parametrize("driven", ["rows", "columns"])
def test_an_amplifier_reads_each_cell_by_ohms_law(driven):
    """I = V / (R + r_par) into the virtual ground, r_ref I at its output, up to the supply."""
    circuit, rng = amplified(driven=driven), np.random.default_rng(3)
    ohm = np.exp(rng.uniform(np.log(50.0), np.log(40000.0), (5, 8, 8)))
    volt = np.minimum(5.0 / (ohm + 20.0) * 200.0, 5.0)
    np.testing.assert_allclose(forward(circuit, ohm), volt / 5.0, rtol=1e-12)


@pytest.mark.parametrize("method", ["naive", "fixed_point", "newton", "map", "auto"])
def test_every_method_undoes_it(method):
    circuit, force = amplified(), finger((8, 8), 3, 4, 20.0, 1.2)
    curve = fabric(circuit)
    found = compensate(forward(circuit, curve.resistance(force)), circuit, curve, method, noise=0.0)
    assert found.status == "ok"
    np.testing.assert_allclose(found.force, force, atol=0.02 if method == "map" else 1e-6)


def test_its_derivatives_are_those_of_the_readings():
    circuit = amplified()
    g = 1.0 / fabric(circuit).resistance(finger((8, 8), 3, 4, 20.0, 1.2))
    network, step = readouts.solve(circuit, g), 1e-6
    p = g * np.random.default_rng(2).standard_normal(g.shape)
    moved = readouts.solve(circuit, g + step * p).adc - readouts.solve(circuit, g - step * p).adc
    np.testing.assert_allclose(network.change(p), moved / (2 * step), rtol=1e-5, atol=1e-9)
    every = np.arange(64, dtype=np.int32)
    row, col = np.divmod(every, np.int32(8))
    matrix = network.sensitivity(np.ones(g.shape), every, row, col + np.int32(8))
    np.testing.assert_allclose(matrix @ p.ravel(), network.change(p).ravel(), rtol=1e-4, atol=1e-6)
    other = replace(circuit, r_par=circuit.r_par + 0.01)
    by_r_par = (readouts.solve(other, g).adc - network.adc) / 0.01
    np.testing.assert_allclose(network.by_r_par, by_r_par, rtol=1e-3, atol=1e-9)


def test_a_reading_at_full_scale_is_a_bound():
    """A cell of 85 ohm asks for 1.9 times full scale."""
    circuit, force = amplified(), np.zeros((8, 8))
    force[3:6, 3:6] = 8.0
    steps = counts(circuit, CURVE, force, np.random.default_rng(2), noise=0.0)
    assert (steps[3:6, 3:6] == 4095).all()
    found = compensate(steps / 4095.0, circuit, CURVE, "auto", noise=1.0)
    assert found.status == "ok" and found.force.sum() > 9 * 3.9
    assert found.std[4, 4] > 0.2


def test_a_skin_behind_amplifiers_is_followed():
    circuit = amplified()
    force = touches((8, 8), 30.0, 20.0, seed=5, rest=5.0, hard=(3, 15), hold=1.2)
    steps = counts(circuit, fabric(circuit), force, np.random.default_rng(2), noise=0.8)
    skin, felt, faults = skin_of(Adc(circuit)), [], 0
    for k, frame in enumerate(steps):
        picture = skin.frame(k / 20.0, (16 * frame).astype(np.uint16))
        faults += k > 100 and skin.fault
        if force[k].sum() > 3.0:
            felt.append(picture.sum() / force[k].sum())
    low, middle, high = np.quantile(felt, (0.1, 0.5, 0.9))
    assert low > 0.95 and high < 1.05 and 0.98 < middle < 1.02 and not faults
    assert skin.circuit == circuit, "the touches tell nothing of r_par"


def test_its_curve_is_fitted_by_weights():
    circuit, rng = amplified(), np.random.default_rng(4)
    newtons, ohm = np.array(CURVE.points).T
    true = fabric(circuit, curve=PressureCurve(newtons, 0.7 * ohm))
    frames, weights = [], []
    for newtons in (3.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 8.0):
        at = rng.uniform(2, 5, 2)
        frames.append(counts(circuit, true, finger((8, 8), *at, newtons, 1.3), rng) / 4095.0)
        weights.append(newtons)
    at_rest = [counts(circuit, true, np.zeros((8, 8)), rng) / 4095.0 for _ in range(40)]
    rest = measure_rest(np.array(at_rest), circuit)
    fitted = fit_curve(np.array(frames), weights, circuit, rest)
    assert fitted.error < 0.05
    assert "is taken as 0" in identify(np.array(frames), circuit, rest).message


@pytest.mark.parametrize("configured", [ci("floating"), slow("loaded"), ci("grounded")])
@pytest.mark.parametrize("r_ref", [slow(200.0), 500.0, slow(1000.0)])
def test_the_doctor_names_it_by_what_no_network_reads(configured, r_ref):
    circuit = amplified(r_ref=r_ref)
    force = touches((8, 8), 20.0, 20.0, seed=7, rest=5.0, hard=(5, 40), hold=1.2)
    steps = counts(circuit, fabric(circuit), force, np.random.default_rng(2), noise=0.8)
    found = diagnose(steps / 4095.0, replace(circuit, readout=configured))
    assert [f.kind for f in found] == ["readout"] and "virtual_ground" in found[0].remedy
    assert not diagnose(steps / 4095.0, circuit)


@pytest.mark.parametrize("wired", ["floating", ci("loaded"), "grounded"])
@pytest.mark.parametrize(
    "off", [{"r_par": 400.0}, ci({"r_ref": 300.0}), ci({"readout": "floating"})]
)
def test_no_network_of_resistors_is_taken_for_it(wired, off):
    circuit = Circuit(8, 8, r_ref=1000.0, r_par=20.0, adc_bits=12, readout=wired)
    force = touches((8, 8), 20.0, 20.0, seed=8, rest=5.0, hard=(5, 40), hold=1.2)
    steps = counts(circuit, fabric(circuit), force, np.random.default_rng(2), noise=0.8)
    found = diagnose(steps / 4095.0, replace(circuit, **off))
    assert not any("virtual_ground" in str(f) for f in found)


# --- one sensor, thresholds, time limits ---


def written(folder, circuit: str, compensation: str = "") -> str:
    path = folder / "mine.yaml"
    path.write_text(
        f"/**: {{ros__parameters: {{circuit: {{{circuit}}}}}}}\n"
        f"/**/compensation: {{ros__parameters: {{{compensation}}}}}\n"
    )
    return str(path)


def test_one_cell_is_refused_by_the_configuration(tmp_path):
    """It has no second reading to compare with: the robot would wait for ever, or trust a wire."""
    with pytest.raises(ValueError, match=r"line 1: circuit.rows = 1, .*two cells or more"):
        read_skin(written(tmp_path, "rows: 1, cols: 1, r_ref: 10000.0"))
    assert read_skin(written(tmp_path, "rows: 1, cols: 2")).circuit.shape == (1, 2)


@pytest.mark.parametrize("table", ["esp32", "[0.0, 0.05, 2000.0, 0.5, 4095.0, 0.95]"])
def test_a_table_is_configured_by_name_or_as_a_list(tmp_path, table):
    skin = read_skin(written(tmp_path, f"rows: 8, cols: 8, adc_bits: 12, adc_table: {table}"))
    assert 0.04 < skin.adc.range[0] <= 0.05 < 0.94 < skin.adc.range[1] <= 0.95


@pytest.mark.parametrize("table", ["esp8266", "[1.0, 2.0, 3.0]", "true", "[a, b, c, d]"])
def test_a_configured_table_that_is_none_is_refused_by_name(tmp_path, table):
    with pytest.raises(ValueError, match=r"mine.yaml: line 1: adc_table = .*: must be"):
        read_skin(written(tmp_path, f"rows: 8, cols: 8, adc_table: {table}"))


def sparse_board(folder) -> tuple[str, str]:
    """A file of a board that prints 0 up to 900 steps, and its configuration."""
    circuit = board(4700.0)
    force = touches((8, 8), 30.0, 20.0, seed=5, rest=5.0)
    steps = counts(circuit, fabric(circuit), force, np.random.default_rng(2), noise=1.0)
    steps[steps <= 1500] = 0
    np.savetxt(folder / "touches.csv", steps.reshape(len(steps), -1), fmt="%d", delimiter=",")
    named = "rows: 8, cols: 8, r_ref: 4700.0, r_par: 140.0, adc_bits: 12"
    return str(folder / "touches.csv"), written(folder, named, "board_threshold: 1500.0")


@pytest.mark.parametrize("command", ["doctor", "calibrate"])
def test_what_a_threshold_hides_is_said_where_the_untouched_cells_are_needed(
    tmp_path, capsys, command
):
    file, config = sparse_board(tmp_path)
    words = [file] if command == "doctor" else [f"rest:={file}", "--out", f"{tmp_path}/out.yaml"]
    config = f"config:={config}" if command == "doctor" else f"--config={config}"
    assert cli.main([command, *words, config]) == 2
    error = capsys.readouterr().err
    assert "untouched cells read no more than compensation's board_threshold = 1500" in error


def test_a_fit_that_ran_out_of_time_says_so():
    circuit = Circuit(32, 32, adc_bits=12)
    force = finger((32, 32), 12, 15, 400.0, 6.0)
    adc = counts(circuit, fabric(circuit), force, np.random.default_rng(3)) / 4095.0
    adc[5] *= 0.7  # a bad lead, too, which nothing proves in that time
    found = compensate(adc, circuit, CURVE, "map", noise=1.0, time_limit=1e-4)
    assert found.status == "failed" and "time_limit" in found.message
    assert "lead" not in found.message


@pytest.mark.parametrize(("rate", "limit"), [(100.0, 0.05), (8.0, 0.25), (0.5, 0.5)])
def test_the_time_limit_follows_the_boards_rate(monkeypatch, rate, limit):
    from tactile_skin.health import skin as module

    given = []

    def solve(*args, time_limit=None, **kwargs):
        given.append(time_limit)
        return compensate(*args, **kwargs)

    monkeypatch.setattr(module, "compensate", solve)
    circuit = Circuit(8, 8)
    skin = skin_of(Adc(circuit), time_limit=0.0)
    steps = counts(circuit, CURVE, np.zeros((8, 8)), np.random.default_rng(1))
    for k in range(60):
        skin.frame(k / rate, (64 * steps).astype(np.uint16))
    assert given[-1] == pytest.approx(limit, rel=0.02)


@pytest.mark.parametrize("top", [2003, 3980])
def test_a_limit_of_the_readings_is_seen_and_not_taken_for_the_adcs(top):
    """In mid-range and near the end: what limits them no frame shows."""
    circuit = Circuit(8, 8, r_ref=20000.0, adc_bits=12)
    steps = counts(circuit, CURVE, finger((8, 8), 3, 3, 60.0, 2.5), np.random.default_rng(1))
    assert (steps > top).sum() > 8
    found = compensate(np.minimum(steps, top) / 4095.0, circuit, CURVE, "newton", noise=1.0)
    assert found.status == "suspect"
    assert "What limits them: the ADC, an amplifier, or the sketch?" in found.message


def test_readings_of_12_bits_that_are_stretched_to_16_are_read():
    """A Pico's `read_u16`: v << 4 | v >> 8, so that the supply reads 65535."""
    wired = {"r_ref": 10000.0, "r_par": 0.0, "r_drive": 25.0, "readout": "grounded"}
    circuits = [Circuit(8, 8, adc_bits=bits, driven="columns", **wired) for bits in (12, 16)]
    skins, curve = [skin_of(Adc(c)) for c in circuits], fabric(circuits[0])
    rng, felt = np.random.default_rng(5), []
    for k in range(120):
        force = finger((8, 8), 3.5, 3.5, 8.0, 1.3) * (k > 80)
        steps = counts(circuits[0], curve, force, rng, noise=1.0)
        sent = (steps << 4), (steps << 4 | steps >> 8)
        found = [s.frame(k / 20.0, f.astype(np.uint16)) for s, f in zip(skins, sent, strict=True)]
        felt.append([f.sum() for f in found])
    assert not skins[1].fault, skins[1].findings()
    plain, stretched = np.median(felt[90:], axis=0)
    assert np.max(felt[60:80]) < 1.0
    assert stretched == pytest.approx(plain, rel=0.02) and stretched == pytest.approx(8.0, rel=0.1)
