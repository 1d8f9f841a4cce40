# SPDX-License-Identifier: Apache-2.0
"""What the doctor and the running skin say of strangers' boards, and what becomes of who obeys."""

import re
import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.chain import Chain
from support.marks import ci
from support.strangers.sim import counts, fabric, finger, touches

from tactile_skin import Circuit, diagnose, identify, measure_rest
from tactile_skin.health.doctor.advice import Change, is_safe

PALM = 45.0  # N
RATE = 20.0  # frames a second
TEXT = {"debounce": 0.01, "lead": 0.0}  # of stop_on_push, for a board that sends text


def played(samples, circuit, *, pressed=None, **of_adc):
    """Return all reasons, without numbers, and the share of `pressed` frames that were free."""
    given = {f"circuit.{name}": value for name, value in of_adc.items()}
    nodes = {"serial_driver": given, "compensation": given, "stop_on_push": TEXT}
    chain, reasons, free = Chain(circuit, "text", nodes), [], []
    for k, sample in enumerate(samples):
        chain.feed(k / RATE + 0.1, (",".join(map(str, sample.ravel())) + "\r\n").encode())
        if pressed is not None and pressed[k]:
            free.append(not chain.stop)
        said = chain.reason or chain.levels.get("compensation", (0, ""))[1]
        reasons.append(re.sub(r"\d+(\.\d+)?", "#", said))
    chain.close()
    return list(dict.fromkeys(reasons)), float(np.mean(free)) if free else 0.0


@cache
def minus_baseline(dead: int, seconds: float = 18.0):
    """Return samples of firmware that takes off its rest and a dead band; when a palm presses."""
    circuit = Circuit(6, 6, r_ref=10000.0, r_par=25.0, adc_bits=12, readout="loaded")
    curve, rng = fabric(circuit, scatter=0.08), np.random.default_rng(7)
    t = np.arange(seconds * RATE) / RATE
    on = (t > 8.0) & ((t - 8.0) % 6.0 < 3.0)
    palm = finger(circuit.shape, 2.5, 2.5, PALM, 1.2)
    sent = np.array([counts(circuit, curve, palm * k, rng, noise=2.0) for k in on])
    sent = np.maximum(sent - sent[:20].mean(0).astype(int), 0)
    return circuit, np.where(sent < dead, 0, sent), on & ((t - 8.0) % 6.0 > 0.5)


@pytest.mark.parametrize(
    ("dead", "readout"),
    [
        *((0, "loaded"), ci(400, "floating")),
        *(ci(0, "floating"), ci(200, "floating"), ci(200, "loaded"), ci(400, "loaded")),
    ],
)
def test_who_enters_inverted_for_readings_that_are_0_at_rest_is_never_free(dead, readout):
    """The skin reads as pressed, and under a palm over all of it as less: that is no rest."""
    circuit, samples, pressed = minus_baseline(dead)
    wired = circuit.read_as(readout, "rows")
    reasons, free = played(samples, wired, pressed=pressed, inverted=True)
    assert free == 0.0
    assert any("these are not ADC readings" in reason for reason in reasons)


@pytest.mark.parametrize("load", ["heavy", ci("light"), ci("stays")])
def test_what_stands_on_the_skin_at_the_start_is_the_reason_until_it_is_gone(load):
    circuit = Circuit(8, 8, r_ref=10000.0, r_par=140.0)
    curve, rng = fabric(circuit, seed=3), np.random.default_rng(4)
    t = np.arange(26.0 * RATE) / RATE
    stands = finger(circuit.shape, *((5, 5, 12.0, 1.0) if load == "light" else (4, 3, 300.0, 2.5)))
    palm = finger(circuit.shape, 2.0, 2.0, PALM, 1.3)
    force = [stands * (s < 12.0 or load == "stays") + palm * (20.0 < s < 24.0) for s in t]
    samples = [counts(circuit, curve, f, rng) for f in force]
    reasons, free = played(samples, circuit, pressed=(t > 20.5) & (t < 24.0))
    assert free == 0.0
    assert not any("is the matrix connected" in reason for reason in reasons)


@pytest.mark.parametrize("mask", [ci(1), ci(2), ci(3), 6])
def test_all_stuck_address_bits_are_named_and_stop(mask):
    circuit = Circuit(16, 16, r_ref=10000.0, r_par=140.0)
    curve, rng = fabric(circuit, scatter=0.12, seed=mask), np.random.default_rng(5)
    read = np.arange(16) & ~mask
    force = touches(circuit.shape, 40.0, 10.0, rest=5.0, hard=(5, 40), hold=1.2)
    sent = np.array([counts(circuit, curve, f, rng, noise=0.0)[:, read] for f in force])
    sent = np.clip(np.rint(sent + rng.normal(0.0, 0.8, sent.shape)), 0, 1023).astype(int)
    found = diagnose(sent / 1023.0, circuit)
    bits = [bit for bit in range(4) if mask >> bit & 1]
    assert [f.where for f in found] == [f"address bit {bit} of the columns" for bit in bits]
    reasons, free = played(sent[:200], circuit, pressed=np.arange(200) > 60)
    named = "bits # and #" if bits[1:] else "bit #"
    assert any(f"address {named} of the columns" in reason for reason in reasons)
    assert free == 0.0


WIRED = {"loaded": {"r_ref": 35000.0, "r_par": 25.0}, "floating": {"r_ref": 4700.0, "r_par": 120.0}}


@cache
def recorded(shape, readout, inverted, seed=0):
    """Return a board's circuit and frames of a minute, as it sends them."""
    circuit = Circuit(*shape, readout=readout, **WIRED[readout])
    curve, rng = fabric(circuit, seed=seed, scatter=0.05), np.random.default_rng(seed)
    force = touches(shape, 60.0, 10.0, seed=seed, rest=5.0, hard=(2, 30), hold=1.2)
    sent = np.array([counts(circuit, curve, f, rng, inverted=inverted) for f in force])
    return circuit, sent / circuit.full_scale


@pytest.mark.parametrize("shape", [ci((14, 15)), (8, 8)])
@pytest.mark.parametrize("readout", ["loaded", "floating"])
def test_a_forgotten_polarity_is_named_with_its_value(shape, readout):
    circuit, frames = recorded(shape, readout, inverted=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = diagnose(frames, circuit, series=False)
        (turned,) = diagnose(1.0 - (1.0 - frames), circuit, series=False, inverted=False)
        other = diagnose(1.0 - frames, circuit, series=False, inverted=True)
    assert found[0].change.settings(circuit) == {"circuit.inverted": True}
    assert "Set circuit.inverted: true" in str(found[0])
    assert turned == found[0] and other == []


@pytest.mark.ci
def test_readings_that_the_firmware_turned_are_named_with_the_value_to_enter():
    """The sketch sends 1023 - analogRead, and its owner entered that readings fall."""
    circuit, frames = recorded((16, 16), "floating", inverted=False)
    (finding,) = diagnose(1.0 - frames, circuit, series=False, inverted=True)
    assert "Set circuit.inverted: false" in str(finding)


@pytest.mark.parametrize("shape", [ci((14, 15)), (8, 8)])
def test_rows_and_columns_exchanged_are_named_with_what_is_driven(shape):
    circuit, frames = recorded(shape, "loaded", inverted=False)
    mine = replace(circuit, rows=shape[1], cols=shape[0], driven="columns")
    (finding,) = diagnose(frames.reshape(-1, *mine.shape), mine)
    assert finding.change.circuit == circuit


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "seed"), [((12, 10), 2), ((6, 9), 5)])
def test_torn_touches_are_no_virtual_ground(shape, seed):
    """Rows and columns are exchanged: what no network reads is not each cell alone."""
    circuit = Circuit(*shape, r_ref=4700.0, r_par=25.0, adc_bits=12, readout="loaded")
    curve, rng = fabric(circuit, seed=seed, scatter=0.05), np.random.default_rng(seed)
    force = touches(shape, 60.0, 10.0, seed=seed, rest=6.0, hard=(3, 45), hold=0.9, gap=0.7)
    sent = np.array([counts(circuit, curve, f, rng) for f in force]) / circuit.full_scale
    found = diagnose(sent.reshape(-1, *shape[::-1]), replace(circuit, rows=shape[1], cols=shape[0]))
    assert "virtual_ground" not in str(found)


@pytest.mark.parametrize(("seed", "supposed"), [(1, 0.0), ci(6, 0.0), ci(4, 900.0)])
def test_an_r_par_that_is_far_off_is_found_roughly_rather_than_kept(seed, supposed):
    """With r_par = 0 a palm is felt as a quarter of it, and no reading contradicts."""
    circuit = Circuit(8, 8, r_ref=1780.0, r_par=342.0)
    curve, rng = fabric(circuit, seed=seed, scatter=0.05), np.random.default_rng(seed)
    force = touches((8, 8), 60.0, 10.0, seed=seed, rest=6.0, hard=(3, 45), hold=0.9, gap=0.7)
    sent = np.array([counts(circuit, curve, f, rng) for f in force]) / circuit.full_scale
    wrong = replace(circuit, r_par=supposed)
    found = identify(sent[60::4], wrong, measure_rest(sent[:50], wrong))
    assert found.circuit.r_par == pytest.approx(342.0, rel=0.25)


@pytest.mark.ci
def test_an_r_par_that_touches_only_bound_is_not_named():
    """Less of it explains them as well, and would be felt as less."""
    circuit = Circuit(6, 9, r_ref=1780.0, r_par=262.0)
    curve, rng = fabric(circuit, seed=6, scatter=0.05), np.random.default_rng(6)
    force = touches((6, 9), 60.0, 10.0, seed=7, rest=6.0, hard=(3, 45), hold=0.9, gap=0.7)
    sent = np.array([counts(circuit, curve, f, rng) for f in force]) / circuit.full_scale
    (finding,) = diagnose(sent, replace(circuit, r_par=523.0))
    assert finding.change is None and "set circuit" not in str(finding).lower()
    assert 262.0 <= float(re.search(r"r_par is (\d+) ohm or less", str(finding))[1]) < 393.0


@pytest.mark.ci
def test_a_running_skin_names_no_setting_where_it_is_wired_otherwise():
    circuit, frames = recorded((8, 8), "loaded", inverted=True)
    samples = np.rint(frames[:250] * circuit.full_scale).astype(int)
    for wrong, inverted in ((circuit, False), (replace(circuit, readout="floating"), True)):
        reasons, _ = played(samples, wrong, inverted=inverted)
        assert any("more: doctor" in reason for reason in reasons)
        said = " ".join(reasons)
        assert "lead" not in said and not re.search(r"\b[Ss]et [a-z_.]+:", said)


@pytest.mark.parametrize("r_ref", [1000.0, ci(470.0), ci(200.0)])
@pytest.mark.parametrize("spread", [0.9, ci(1.3), ci(1.8)])
def test_a_palm_stops_where_amplifiers_end_below_it(r_ref, spread):
    """At 1 kohm 1 N ends the range of a cell, and a palm of 45 N reads as one of 18 N."""
    circuit = Circuit(8, 8, r_ref=r_ref, r_par=100.0, readout="virtual_ground")
    curve, rng = fabric(circuit, seed=3), np.random.default_rng(4)
    t = np.arange(14.0 * RATE) / RATE
    palm = finger(circuit.shape, 3.0, 4.0, PALM, spread)
    samples = [counts(circuit, curve, palm * (s > 10.0), rng) for s in t]
    _, free = played(samples, circuit, pressed=t > 10.1)
    assert free == 0.0
    reasons, _ = played([counts(circuit, curve, 0.1 * palm * (s > 10.0), rng) for s in t], circuit)
    assert any("push" in reason for reason in reasons) == (r_ref == 1000.0 and spread < 1.0)


def test_advice_after_which_a_touch_is_not_felt_is_not_safe():
    circuit, frames = recorded((8, 8), "floating", inverted=False)
    quiet = np.arange(len(frames)) < 40
    assert is_safe(Change(circuit), frames, quiet, 0.7)
    assert not is_safe(Change(circuit, turned=True), frames, quiet, 0.7)
    assert not is_safe(Change(circuit, scale=1.0 / 16.0), frames, quiet, 0.7)


@pytest.mark.parametrize("cells", [2, 16])
def test_a_strip_works(cells):
    circuit = Circuit(1, cells, r_ref=10000.0, r_par=0.0, adc_bits=12)
    curve, rng = fabric(circuit, scatter=0.1), np.random.default_rng(2)
    t = np.arange(18.0 * RATE) / RATE
    press = np.zeros(circuit.shape)
    press[0, 0] = 9.5
    force = [press * (10.0 < s < 14.0) for s in t]
    samples = [counts(circuit, curve, f, rng, noise=3.0, inverted=True) for f in force]
    pressed = (t > 10.5) & (t < 13.9)
    reasons, free = played(samples, circuit, pressed=pressed, inverted=True)
    assert free == 0.0 and "" in [r.replace("ok", "") for r in reasons], reasons
