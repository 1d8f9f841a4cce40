# SPDX-License-Identifier: Apache-2.0
"""Makes the weights of the paper's network.

Ten minutes of one core. A run from nothing on exact readings, from there a short one on noisy
scans, and the mean of both (docs/lab/training.md says why). Interrupted, it goes on where it was.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from tactile_skin import Circuit, PressureCurve
from tactile_skin.learning import network
from tactile_skin.learning.dataset import TrainingConfig
from tactile_skin.learning.training import train

from .. import harness

EXACT = TrainingConfig(pairs=80_000, validation=16_000, epochs=24, seed=51)
SCAN = replace(EXACT, readout="scan", pairs=24_000, epochs=5, rate=0.003, seed=42)
SHARE = 0.2  # of the second run; chosen on seed 91043, scored on 91051


def mean(one: network.Weights, other: network.Weights, share: float) -> dict:
    """The state between two of which the second went on from the first."""
    return {
        name: (1.0 - share) * value + share * other.state[name] for name, value in one.state.items()
    }


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    torch.set_num_threads(1)
    circuit, curve = Circuit(), PressureCurve()
    exact = network.load(train(circuit, curve, EXACT, folder / "exact"))
    start = replace(SCAN, start=str(exact.path))
    scan = network.load(train(circuit, curve, start, folder / "scan"))
    second = scan.meta["config"] | {"share": SHARE, "start": "the first run"}
    meta = exact.meta | {"second run": second, "made by": Path(__file__).name}
    network.save(folder / "paper.npz", mean(exact, scan, SHARE), meta)
    print(f"weights: {folder / 'paper.npz'}")


if __name__ == "__main__":
    harness.run(main)
