"""Three ways to read a matrix, compared by what noise makes of the force:
`python tests/yardsticks/readouts.py`.

For each, the exact inverse of the readings of a scripted scene is taken to first order: one
standard deviation of each cell's force if each reading has NOISE ADC steps of noise, and the
largest reading of an untouched cell beside that of the hardest pressed one, both less what they
read at rest. Paper's circuit, 16 x 16, default curve. `floating`: one row driven, one column read,
the others open. `loaded`: all columns on a resistor of their own, the other rows open. `grounded`:
the other rows at 0 V as well.
"""

from __future__ import annotations

import numpy as np

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.learning import scenes

NOISE = (
    3 / 13
) ** 0.5  # ADC steps: 1 step behind a low-pass of 3/8 has a / (2 - a) of its variance
STEPS = 1024
CIRCUIT, CURVE = Circuit(), PressureCurve()
SCENES = "one_finger", "two_fingers", "push_left"


def floating(g: np.ndarray) -> np.ndarray:
    """(rows, cols) conductance [S] -> (rows, cols) share of the supply."""
    return forward(CIRCUIT, 1.0 / g)


def loaded(g: np.ndarray) -> np.ndarray:
    rows, cols = g.shape
    network = np.zeros((rows + cols, rows + cols))
    network[:rows, rows:], network[rows:, :rows] = -g, -g.T
    network[np.diag_indices(rows + cols)] = np.r_[g.sum(1), g.sum(0) + 1.0 / CIRCUIT.r_ref]
    k = np.linalg.inv(network)
    return k[:rows, rows:] / (np.diag(k)[:rows, None] + CIRCUIT.r_par)


def grounded(g: np.ndarray) -> np.ndarray:
    return g / (1.0 / CIRCUIT.r_ref + g.sum(0))


def spread(readout, force: np.ndarray) -> np.ndarray:
    """(rows, cols) one standard deviation of each cell's force [N]."""
    resistance = CURVE.resistance(force)
    g = 1.0 / resistance
    here, columns = readout(g), []
    for cell in np.ndindex(g.shape):
        step = 1e-5 * g[cell]
        moved = g.copy()
        moved[cell] += step
        columns.append((readout(moved) - here).ravel() / step)
    inverse = np.linalg.inv(np.array(columns).T)
    std_g = np.sqrt((inverse**2).sum(1)).reshape(g.shape) * NOISE / STEPS
    dforce = 1e-4 + 1e-4 * force
    slope = (1.0 / CURVE.resistance(force + dforce) - g) / dforce  # S/N
    return std_g / slope


def main():
    print("readout   scene        ghost   std of a touched cell [g], median")
    for readout in (floating, loaded, grounded):
        for scene in SCENES:
            force = scenes.script(scene, *CIRCUIT.shape)(0.0)
            touched, idle = force > 0.05, force == 0.0
            u = readout(1.0 / CURVE.resistance(force))
            rest = readout(1.0 / CURVE.resistance(np.zeros_like(force)))
            ghost = (u - rest)[idle].max() / (u - rest).max()
            std = spread(readout, force) / 9.80665e-3
            median = np.median(std[touched])
            print(f"{readout.__name__:9} {scene:12} {100 * ghost:4.0f} %  {median:5.2f}")


if __name__ == "__main__":
    main()
