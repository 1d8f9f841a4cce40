# SPDX-License-Identifier: Apache-2.0
"""From counts to the circuit's ratio, of boards whose ADC is not the paper's."""

from pathlib import Path

import numpy as np
import pytest
from support import insole
from support.kirchhoff import DIODES, behind_diodes, forward_voltage, nodal_reading

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.board.text import TextParser
from tactile_skin.physics.adc import NOT_READ, Adc

CIRCUIT = Circuit(2, 3, adc_bits=12)
STEPS = np.array([[0, 1, 500], [2047, 4000, 4095]])
SAMPLES = (STEPS * 16).astype(np.uint16)


def test_by_default_a_count_is_the_ratio_times_the_largest_one():
    np.testing.assert_allclose(Adc(CIRCUIT).ratio_of(SAMPLES), STEPS / 4095.0)


def test_an_esp32_reads_nothing_up_to_142_mv():
    """Of the insole's recorder: 176.2 counts, on a divider of 4096.3 counts (support/insole)."""
    adc = Adc(CIRCUIT, offset=176.2, full_scale=4096.3)
    np.testing.assert_allclose(adc.ratio_of(SAMPLES), np.minimum((STEPS + 176.2) / 4096.3, 1.0))
    assert adc.threshold(500.0) == pytest.approx(676.2 / 4096.3)
    assert adc.threshold(0.0) == 0.0


def test_readings_that_fall_with_pressure_are_turned():
    adc = Adc(CIRCUIT, inverted=True)
    np.testing.assert_allclose(adc.ratio_of(SAMPLES), 1.0 - STEPS / 4095.0)
    np.testing.assert_array_equal(adc.rising(SAMPLES), (4095 - STEPS) * 16)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("offset", [-20.0, 0.0, 20.0])
@pytest.mark.parametrize("full_scale", [0.0, 2703.0, 4300.0])
def test_count_undoes_ratio_and_rising_rises(inverted, offset, full_scale):
    adc = Adc(CIRCUIT, offset, full_scale, inverted)
    ratio = np.linspace(0.1, 0.6, 50)
    count = adc.count(ratio)
    np.testing.assert_allclose(adc.ratio(count), ratio)
    rising = adc.rising(np.rint(count * 16).astype(np.uint16)) / 16
    assert (np.diff(rising.astype(float)) > 0).all()
    np.testing.assert_allclose(rising, [adc.rising_count(r) for r in ratio], atol=0.04)


def test_what_lies_beyond_the_range_is_cut_off():
    adc = Adc(CIRCUIT, offset=-100.0, full_scale=3000.0)
    np.testing.assert_array_equal(adc.ratio_of(SAMPLES)[0, :2], 0.0)
    np.testing.assert_array_equal(adc.ratio_of(SAMPLES)[1, 1:], 1.0)


def test_a_crossing_that_was_not_read_is_nan_and_never_a_reading():
    samples = SAMPLES.copy()
    samples[1, 2] = NOT_READ
    adc = Adc(CIRCUIT)
    assert np.isnan(adc.ratio_of(samples)).tolist() == [[False] * 3, [False, False, True]]
    assert adc.rising(samples)[1, 2] == 0


def test_a_crossing_that_is_named_is_not_read_whatever_the_board_prints():
    scanned = np.ones((2, 3), bool)
    scanned[0, 2] = scanned[1, 1] = False
    adc = Adc(CIRCUIT, scanned=scanned)
    np.testing.assert_array_equal(np.isnan(adc.ratio_of(SAMPLES)), ~scanned)
    np.testing.assert_array_equal(adc.marked(SAMPLES) == NOT_READ, ~scanned)


def test_a_crossing_with_no_cell_is_not_read_where_it_is_0():
    """A floating matrix reads its neighbours' paths there; a board that skips it prints 0."""
    mask = np.ones((2, 3), bool)
    mask[0, 0] = mask[0, 2] = False
    adc = Adc(Circuit(2, 3, adc_bits=12, mask=mask))
    assert np.isnan(adc.ratio_of(SAMPLES)).tolist() == [[True, False, False], [False] * 3]


def test_the_largest_reading_of_16_bits_is_no_mark():
    """A saturated input must not pass for a crossing that was not read."""
    adc = Adc(Circuit(1, 2, adc_bits=16))
    samples = np.array([[65535, 3]], np.uint16)
    assert adc.marked(samples).tolist() == [[65534, 3]]
    unread = np.array([[False, True]])
    assert adc.marked(samples, unread).tolist() == [[65534, NOT_READ]]
    assert adc.marked(samples).dtype == np.uint16


@pytest.mark.parametrize("diode", DIODES)
@pytest.mark.parametrize("supply", [3.3, 5.0])
@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("kind", ["loaded rows", "loaded columns", "floating rows"])
def test_what_a_diode_keeps_from_a_line_is_given_back(diode, supply, inverted, kind):
    readout, driven = kind.split()
    circuit = Circuit(6, 8, r_ref=4700.0, r_par=25.0, adc_bits=12, readout=readout, driven=driven)
    curve, force = PressureCurve(), np.zeros(circuit.shape)
    force[2:4, 3:6], force[5, 0] = 2.0, 0.2
    ideal = nodal_reading(curve.resistance(force), circuit)
    parts = {"full_scale": 4095.0, "inverted": inverted, "supply": supply}
    counts = Adc(circuit, **parts).count(behind_diodes(ideal, circuit, diode, supply))
    volts = forward_voltage(diode, 1e-3)
    ratio = Adc(circuit, diode=volts, **parts).ratio(counts)
    # what is left: slope and series resistance of this diode, 10 mV
    np.testing.assert_allclose(ratio, ideal, rtol=0.004)
    felt = compensate(ratio, circuit, curve, "map", noise=1.0)
    assert felt.status == "ok"
    assert felt.force.sum() == pytest.approx(force.sum(), rel=0.05)
    if readout == "loaded":  # without it most of the force is lost, or the frame is suspect
        ignored = compensate(Adc(circuit, **parts).ratio(counts), circuit, curve, "map", noise=1.0)
        assert ignored.status == "suspect" or ignored.force.sum() < 0.8 * force.sum()


@pytest.mark.parametrize("kind", ["loaded rows", "loaded columns", "floating rows"])
def test_count_undoes_ratio_of_pictures_behind_diodes(kind):
    readout, driven = kind.split()
    circuit = Circuit(2, 3, adc_bits=12, readout=readout, driven=driven)
    adc = Adc(circuit, offset=9.0, full_scale=4000.0, inverted=True, diode=0.58, supply=3.3)
    ratio = np.random.default_rng(1).uniform(0.02, 0.8, (5, 2, 3))
    np.testing.assert_allclose(adc.ratio(adc.count(ratio)), ratio, rtol=1e-9)


@pytest.mark.parametrize("how", ["marked", "named"])
def test_a_crossing_that_is_not_read_is_no_current(how):
    """The mark is no reading of full scale, nor is what the board prints there one."""
    circuit, samples, scanned = Circuit(2, 3, readout="loaded", adc_bits=12), SAMPLES.copy(), None
    alike = Adc(circuit, diode=0.6).ratio_of(np.full((2, 3), samples[1, 0]))
    samples[:] = samples[1, 0]
    samples[1, 1] = NOT_READ if how == "marked" else 0
    if how == "named":
        scanned = np.ones((2, 3), bool)
        scanned[1, 1] = False
    ratio = Adc(circuit, diode=0.6, scanned=scanned).ratio_of(samples)
    assert np.isnan(ratio[1, 1])
    np.testing.assert_allclose(ratio[1, ::2], alike[1, ::2])


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"diode": -0.6}, "diode = -0.6 V: must be at least 0, below half of supply = 5.0 V"),
        ({"diode": 1.8, "supply": 3.3}, "diode = 1.8 V"),
        (
            {"circuit": Circuit(2, 3, readout="grounded"), "diode": 0.6},
            "must be 0 for readout = 'grounded'.* those of readout = 'loaded'",
        ),
        ({"full_scale": 0.5}, "adc_full_scale = 0.5"),
        ({"offset": 4095.0}, r"adc_offset = 4095.0 ADC steps: must be less than the full scale"),
        ({"scanned": np.ones((3, 2))}, r"scanned has shape \(3, 2\): the circuit is \(2, 3\)"),
        ({"scanned": np.zeros((2, 3))}, "no crossing is read"),
    ],
)
def test_what_leaves_no_reading_is_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        Adc(**{"circuit": CIRCUIT} | kwargs)


def test_the_lines_of_a_real_insole_become_the_ratios_of_its_source():
    """32 x 10 with no sensor in some places, an ESP32's ADC, printed with empty fields."""
    with np.load(Path(__file__).parents[1] / "data" / "insole_floating.npz") as data:
        counts = data["counts"][::9]
    mask = counts[0] >= 0
    skin = insole.circuit(mask)
    adc = Adc(skin, offset=insole.ADC_OFFSET, full_scale=insole.FULL_SCALE)
    assert adc.threshold(insole.THRESHOLD) == pytest.approx(insole.ratio(insole.THRESHOLD))
    for absent in (b"", b"nan", b"0"):
        parser = TextParser(*mask.shape, 12)
        parser.feed(b"\n")
        for frame in counts:
            words = [b"%d" % c if c >= 0 else absent for c in frame.ravel()]
            read = parser.feed(b";".join(words) + b"\n")
        ratio = adc.ratio_of(adc.marked(read[0].samples, read[0].unread))
        expected = np.where(mask, insole.ratio(counts[-1].astype(float)), np.nan)
        np.testing.assert_allclose(ratio, expected, atol=1e-9)
