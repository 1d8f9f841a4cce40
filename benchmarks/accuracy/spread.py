# SPDX-License-Identifier: Apache-2.0
"""How many touched cells err by less than their standard deviation.

A normal error does in 68 % of the cells. Boards whose cells scatter by 5 % at rest, which was
measured; `scan` readings, the noise given.
"""

from __future__ import annotations

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.calibration.rest import resting_conductance
from tactile_skin.physics.curve import GRAM
from tactile_skin.physics.readouts import PASSIVE
from tactile_skin.simulation import scenes
from tactile_skin.solvers.reading import SCAN_NOISE

from .. import harness

CURVE = PressureCurve()
SHAPES = (16, 16), (8, 8)
FAMILIES = "blobs", "rects", "bodies", "random", "plate", "even", "smooth"
TOUCHED = 20.0 * GRAM  # N


def draw(family: str, n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N]."""
    if family in (*scenes.FAMILIES, "bodies"):
        return np.minimum(scenes.sample(family, n, *shape, rng), CURVE.max_force)
    rows, cols = shape
    found = np.zeros((n, rows, cols))
    for force in found:
        if family == "plate":  # on half of the lines or more, either way
            high, wide = rng.integers(rows // 2, rows + 1), rng.integers(cols // 2, cols + 1)
            i, j = rng.integers(0, rows - high + 1), rng.integers(0, cols - wide + 1)
            each = rng.uniform(20.0, 200.0) / (high * wide)
            force[i : i + high, j : j + wide] = each
        elif family == "even":
            force[:] = np.exp(rng.uniform(np.log(0.05), np.log(3.0)))
        else:
            y, x = np.mgrid[:rows, :cols]
            along, across = rng.uniform(0.0, 6.0, 2)
            force[:] = np.exp(rng.uniform(np.log(0.1), np.log(2.0)))
            force *= 1.0 + 0.6 * np.sin(3.0 * y / rows + along)
            force *= 1.0 + 0.6 * np.cos(3.0 * x / cols + across)
        force *= np.exp(0.1 * rng.standard_normal(shape))
    return np.minimum(found, CURVE.max_force)


def within(circuit: Circuit, family: str, n: int, seed: int) -> tuple[float, int]:
    """Share of the touched cells within one standard deviation; frames that are not ok."""
    rng, shares, doubted = np.random.default_rng(seed), [], 0
    for force in draw(family, n, circuit.shape, rng):
        scatter = np.exp(0.05 * rng.standard_normal(circuit.shape))
        fabric = CURVE.resting_at(CURVE.rest_resistance * scatter)
        at_rest = resting_conductance(forward(circuit, fabric.rest_resistance), circuit, 0.1)
        curve = CURVE.resting_at(1.0 / at_rest)
        adc = scenes.read_out(circuit, forward(circuit, fabric.resistance(force)), "scan", rng)
        found = compensate(adc, circuit, curve, "map", noise=SCAN_NOISE)
        touched = force > TOUCHED
        doubted += found.status != "ok"
        if touched.any():
            shares.append((np.abs(found.force - force) <= found.std)[touched].mean())
    return float(np.mean(shares)), doubted


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--n", type=int, default=30, help="frames of each family")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    print("within one standard deviation [%] (frames in doubt)")
    rows = []
    for shape in SHAPES:
        for readout in PASSIVE:
            circuit, line = Circuit(*shape, readout=readout), []
            for family in FAMILIES:
                share, doubted = within(circuit, family, args.n, args.seed)
                found = {"shape": shape, "readout": readout, "family": family}
                rows.append(found | {"within": share, "doubted": doubted})
                line.append(f"{family} {100.0 * share:.0f} ({doubted})")
            print(f"{shape[0]} x {shape[1]} {readout:9s}", *line, flush=True)
    return rows


if __name__ == "__main__":
    harness.run(main)
