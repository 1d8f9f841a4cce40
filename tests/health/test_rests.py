# SPDX-License-Identifier: Apache-2.0
"""Sound skins whose untouched cells are open, uneven, signed or shaken; and what is none."""

import numpy as np
import pytest
from health.seen import seen

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.board.text import TextParser
from tactile_skin.calibration.at_rest import NO_REST, odd_cell
from tactile_skin.findings.finding import Kind
from tactile_skin.health.monitor import SkinMonitor
from tactile_skin.physics.adc import Adc
from tactile_skin.readings.processed import processed
from tactile_skin.solvers.suspect import LIGHTER

CURVE = PressureCurve()
CELLS = np.ones((8, 8), bool)
SPREAD = np.random.default_rng(2).standard_normal((8, 8))


@pytest.mark.parametrize("spread", [0.1, 0.5, 1.0])
def test_cells_that_scatter_are_at_rest(spread):
    conducts = np.exp(spread * SPREAD) / CURVE.rest_resistance
    found = odd_cell(conducts, CELLS, CURVE)
    assert found is None or found.form != NO_REST


@pytest.mark.parametrize("spread", [0.03, 0.3])
@pytest.mark.parametrize(("newtons", "stops"), [(0.1, False), (0.5, True)])
def test_a_cell_that_bears_a_load_is_not(spread, newtons, stops):
    conducts = np.exp(spread * SPREAD) / CURVE.rest_resistance
    conducts[3, 4] = 1.0 / CURVE.resistance(newtons)
    found = odd_cell(conducts, CELLS, CURVE)
    assert (found is not None and found.form == NO_REST) is stops
    if stops:
        assert (found.kind, found.rows, found.cols) == (Kind.STUCK, (3,), (4,))


def test_a_load_on_many_cells_is_none():
    bears = np.where(np.arange(8) < 3, 0.15, 0.0) * CELLS
    assert odd_cell(1.0 / CURVE.resistance(bears), CELLS, CURVE).form == NO_REST


@pytest.mark.parametrize("opens", [15.0, 0.0])
def test_zeros_show_an_offset_only_where_the_curve_conducts_at_rest(opens):
    rng = np.random.default_rng(1)
    steps = np.maximum(np.rint(2.0 * rng.standard_normal((40, 8, 8))), 0.0)
    steps[20:, 2:5, 2:5] += 700.0
    assert (processed(steps, 10, opens=opens) is None) is bool(opens)


def test_a_signed_adc_reads_a_little_below_0():
    parser = TextParser(1, 3)
    frames = parser.feed(b"\r\n-3,0,500\r\n-30,0,500\r\n")
    assert [frame.samples.tolist() for frame in frames] == [[[0, 0, 500 << 6]]]


def _lighter(readout, share):
    """Return readings of a skin, cells of which conduct so much less, and the estimate."""
    circuit = Circuit(8, 8, readout=readout, r_ref=1780.0)
    curve = CURVE.resting_at(np.exp(0.05 * SPREAD) * CURVE.rest_resistance)
    ohm = curve.rest_resistance / np.where(np.arange(8) % 2, share, 1.0)
    noise = 0.3 * np.random.default_rng(3).standard_normal((8, 8)) / 1023
    adc = forward(circuit, ohm) + noise
    return (
        Adc(circuit),
        adc,
        forward(circuit, curve.rest_resistance),
        compensate(adc, circuit, curve, "map", noise=0.3),
    )


@pytest.mark.parametrize("readout", ["floating", "loaded", "grounded", "virtual_ground"])
@pytest.mark.parametrize(("share", "explained"), [(0.7, True), (0.2, False)])
def test_cells_that_conduct_less_than_at_rest_are_named(readout, share, explained):
    *_, found = _lighter(readout, share)
    assert found.status == "suspect"
    assert (LIGHTER in found.finding.numbers) is explained


@pytest.mark.parametrize(("hertz", "stops"), [(5.0, False), (0.5, True)])
def test_they_stop_a_robot_where_they_stay(hertz, stops):
    adc, read, rest, estimate = _lighter("floating", 0.7)
    monitor = SkinMonitor(adc, 0.0)
    calm = compensate(rest, adc.circuit, CURVE, "map", noise=0.3)
    for k in range(300):
        low = k > 40 and (k / 100.0 * hertz) % 1.0 < 0.5
        now, said = (read, estimate) if low else (rest, calm)
        samples = np.round(now * 65472).astype(np.uint16)
        given = {"force": said.force, "samples": samples, "adc": now, "rest": rest}
        frame = seen(k / 100.0, noise=0.3 / 1023, **given)._replace(estimate=said)
        monitor.frame(frame, judged=True)
    assert monitor.doubtful is stops


@pytest.mark.parametrize("readout", ["floating", "grounded"])
@pytest.mark.parametrize(("fades", "stops"), [(2.0, False), (np.inf, True)])
@pytest.mark.parametrize("next_", [0.0, 2.0])
def test_a_fabric_that_rests_lower_after_a_touch_stops_nothing(readout, fades, stops, next_):
    """Velostat is back in 5 s, also below the next touch [N]; what stays low is a fault."""
    circuit = Circuit(8, 8, readout=readout, r_ref=1780.0)
    curve = CURVE.resting_at(np.exp(0.05 * SPREAD) * CURVE.rest_resistance)
    adc, rng = Adc(circuit), np.random.default_rng(4)
    rest, monitor, faults = forward(circuit, curve.rest_resistance), SkinMonitor(adc, 0.0), []
    for k in range(160):
        t = k / 20.0
        lower = 1.0 - 0.35 * np.exp((3.0 - t) / fades) * (t >= 3.0)
        force = np.zeros((8, 8))
        force[:, :4] = 2.0 <= t < 3.0
        force[2:6, 4:] = next_ * (3.4 <= t < 6.0)
        touched = np.where(np.arange(8) < 4, lower, 1.0)
        ohm = curve.resistance((1.0 + 0.1 * SPREAD) * force) / touched
        now = forward(circuit, ohm) + 0.3 * rng.standard_normal((8, 8)) / 1023
        said = compensate(now, circuit, curve, "auto", noise=0.3)
        given = {"force": said.force, "samples": np.uint16(np.round(now * 65472)), "adc": now}
        frame = seen(t, noise=0.3 / 1023, rest=rest, **given)._replace(
            estimate=said, resting=curve.rest_resistance
        )
        monitor.frame(frame, judged=True)
        faults.append(monitor.doubtful or any(f.stops for f in monitor.findings()))
    assert any(faults[30:]) is stops, faults


def test_a_clock_that_is_set_back_after_a_touch_costs_no_exception():
    circuit = Circuit(8, 8)
    adc, rest = Adc(circuit), forward(circuit, np.full((8, 8), CURVE.rest_resistance))
    monitor = SkinMonitor(adc, 0.0)
    for t, share in ((100.0, 1.0), (100.1, 0.8), (4.0, 0.8), (4.1, 0.8)):
        force = np.full((8, 8), float(t == 100.0))
        now = forward(circuit, CURVE.resistance(force) / share)
        said = compensate(now, circuit, CURVE, "auto", noise=0.3)
        given = {"force": said.force, "samples": np.uint16(np.round(now * 65472)), "adc": now}
        frame = seen(t, noise=0.3 / 1023, rest=rest, **given)
        monitor.frame(frame._replace(estimate=said, resting=CURVE.rest_resistance), judged=True)
    assert not monitor.doubtful
