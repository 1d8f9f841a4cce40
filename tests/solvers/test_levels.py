# SPDX-License-Identifier: Apache-2.0
"""What sums, cells unread and the end of a range leave open is in the standard deviation."""

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.calibration.rest import resting_conductance
from tactile_skin.simulation.matrix import Converter, Fabric, Matrix
from tactile_skin.simulation.network import Wiring

CURVE = PressureCurve()
NOISE = 0.3, 0.5, 1.0, 2.0  # ADC steps RMS, of the mean of four samples
SCATTER = 0.05, 0.08  # of what a load adds to a cell's conductance


def load(kind: str, circuit: Circuit, rng) -> np.ndarray:
    """(rows, cols) force [N] of 0.5 to 9 N a cell, that scatters by 5 to 20 %."""
    shape, level = circuit.shape, np.exp(rng.uniform(np.log(0.5), np.log(9.0)))
    on = np.zeros(shape)
    if kind == "all":
        on[:] = 1.0
    elif kind == "lines":
        lines = np.moveaxis(on, 1 - circuit.sense_axis, 0)
        lines[rng.choice(len(lines), rng.integers(1, 4), replace=False)] = 1.0
    elif kind == "plate":
        high, wide = (int(rng.integers(size // 3, size + 1)) for size in shape)
        y, x = rng.integers(0, shape[0] - high + 1), rng.integers(0, shape[1] - wide + 1)
        on[y : y + high, x : x + wide] = 1.0
    else:  # a palm, softer towards its rim
        row, col = np.mgrid[: shape[0], : shape[1]]
        (y, x), (high, wide) = (
            rng.uniform(*ends, 2) * shape for ends in ((0.15, 0.85), (0.2, 0.4))
        )
        on = np.exp(-(np.abs((row - y) / high) ** 3 + np.abs((col - x) / wide) ** 3))
        on[on < 1e-3] = 0.0
    texture = np.exp(rng.uniform(0.05, 0.2) * rng.standard_normal(shape))
    return np.minimum(on * level * texture, 0.9 * CURVE.max_force)


def read(circuit: Circuit, kind: str, rng):
    """Return a frame, the curve of its cells, the noise, and what they conduct as force [N]."""
    shape = circuit.shape
    gain = np.exp(rng.uniform(*SCATTER) * rng.standard_normal(shape))
    rest = np.exp(0.05 * rng.standard_normal(shape)) / CURVE.rest_resistance
    board = Matrix(circuit, Fabric(CURVE, circuit.populated, gain, rest), Wiring.ideal(circuit))
    noise = float(rng.choice(NOISE))
    converter = Converter(circuit.full_scale, 2.0 * noise)
    idle = board.ratio(np.zeros((1, *shape)))[0]
    idle = np.mean([converter.frame(idle, rng) for _ in range(40)], 0)
    curve = CURVE.resting_at(1.0 / resting_conductance(idle, circuit, 0.1))
    force = load(kind, circuit, rng)[None]
    adc = converter.frame(board.ratio(force)[0], rng)
    return adc, curve, noise, curve.force(1.0 / board.fabric.conductance(force)[0])


def boards(kinds, n: int, seed: int):
    for k in range(n):
        rng = np.random.default_rng([seed, k])
        yield (
            Circuit(
                *((8, 8), (16, 16))[k % 2],
                r_ref=rng.choice([1780.0, 4700.0]),
                r_par=rng.choice([0.0, 326.0]),
                readout="grounded",
                driven=str(rng.choice(["rows", "columns"])),
                r_drive=float(rng.choice([0.0, 25.0, 70.0])),
            ),
            kinds[k // 2 % len(kinds)],
            rng,
        )


def judged(found, true) -> tuple[float, float]:
    """Return the share of touched cells within their std, and the error of the sum in its own."""
    within = (np.abs(found.force - true) <= found.std)[true > 0.2]
    off = abs(found.force.sum() - true.sum()) / found.std.sum()
    return within.mean() if within.size else 1.0, off


@pytest.mark.parametrize(("given", "least"), [(True, 0.6), (False, 0.55)])
def test_a_hard_load_lies_within_its_standard_deviation(given, least):
    """A fit was up to three times too light, and sure of it to 10 %."""
    each, n, sound = [], 96, 0
    for circuit, kind, rng in boards(("all", "lines", "plate", "palm"), n, 901):
        adc, curve, noise, true = read(circuit, kind, rng)
        found = compensate(adc, circuit, curve, "map", noise=noise if given else None)
        sound += found.status == "ok"
        each.append(judged(found, true))
    within, sums = np.array(each).T
    assert sound >= 0.95 * n
    assert least < within.mean() < 0.76  # by noise of the frame itself it is a little too sure
    assert (sums < 2.0).mean() > 0.9


def test_cells_that_were_not_read_are_taken_for_such_as_those_next_to_them():
    """They may take what a line's readings leave: its load was found up to 200 times too light."""
    each = []
    for circuit, kind, rng in boards(("all", "lines", "plate", "palm"), 72, 904):
        adc, curve, noise, true = read(circuit, kind, rng)
        adc[rng.random(circuit.shape) < 0.04] = np.nan
        found = compensate(adc, circuit, curve, "map", noise=noise, missing=True)
        each += [judged(found, true)] * (found.status == "ok")
    within, sums = np.array(each).T
    assert len(each) > 56
    assert 0.6 < within.mean() < 0.76
    assert (sums < 2.0).mean() > 0.9  # 0.86 where nothing is supposed of such cells


def test_a_line_whose_hard_cell_was_not_read_is_not_open():
    """It draws what all cells at rest of its line lose: those are no dead readings."""
    circuit = Circuit(16, 16, r_ref=4700.0, r_par=0.0, readout="grounded")
    rng = np.random.default_rng(3)
    for hard in range(16):
        ohm = CURVE.rest_resistance * np.exp(0.05 * rng.standard_normal(circuit.shape))
        curve = CURVE.resting_at(ohm)
        ohm[hard, 5] = 120.0
        adc = Converter(circuit.full_scale, 1.0).frame(forward(circuit, ohm), rng)
        adc[hard, 5] = np.nan
        found = compensate(adc, circuit, curve, "map", noise=0.5, missing=True)
        assert found.status == "ok", found.message
        adc[(hard + 3) % 16] = 0.0  # an open driven line is still one
        found = compensate(adc, circuit, curve, "map", noise=0.5, missing=True)
        assert found.status == "suspect"


@pytest.mark.parametrize("readout", ["floating", "loaded", "grounded"])
def test_readings_at_the_end_of_their_range_leave_the_others_open(readout):
    """They may lie anywhere above it; a fit that holds them there was surer than it was right."""
    rng, circuit, within = np.random.default_rng(61), Circuit(8, 8, readout=readout), []
    converter = Converter(circuit.full_scale, 1.0)
    for kind in ("palm", "plate") * 24:
        force = load(kind, circuit, rng)
        adc = converter.frame(forward(circuit, CURVE.resistance(force)), rng)
        end = np.rint(1023 * np.quantile(adc[force > 0.2], 0.85)) / 1023
        found = compensate(np.minimum(adc, end), circuit, CURVE, "map", noise=0.5, ceiling=end)
        off = np.abs(found.force - force)[(force > 0.2) & (adc < end)]
        within.append((off <= found.std[(force > 0.2) & (adc < end)]).mean())
    assert 0.64 < np.mean(within) < 0.8  # 0.57 to 0.61 as if they were held there
