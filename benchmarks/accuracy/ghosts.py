# SPDX-License-Identifier: Apache-2.0
"""Two fingers and a palm are shown as they press, as they read, and as they are found."""

from __future__ import annotations

import sys

import numpy as np

from tactile_skin.bench.measure import NOISE
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import GRAM, PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.solvers import compensate

from .. import harness

_TITLES = {"naive": "each reading on its own", "auto": "tactile_skin"}


def measure(seed: int, track=lambda items: items) -> dict:
    """One `scan` reading of the scene, by two methods.

    Returns:
        the figure "ghosts" as plain data: panels of loads [g] and their sums [N].
    """
    circuit, curve = Circuit(), PressureCurve()
    force = scenes.script("two_fingers", *circuit.shape)(0.0)
    force += scenes.finger(*circuit.shape, 12.0, 3.5, 30.0, width=1.5)
    ideal = forward(circuit, curve.resistance(force))
    adc = scenes.read_out(circuit, ideal, "scan", np.random.default_rng(seed))
    shown = {"what is pressed": force}
    for method in track(list(_TITLES)):
        found = compensate(adc, circuit, curve, method, noise=NOISE["scan"])
        shown[_TITLES[method]] = found.force
    panels = [
        {
            "title": title,
            "load_g": np.round(force / GRAM, 2).tolist(),
            "sum_n": float(force.sum()),
        }
        for title, force in shown.items()
    ]
    return {"ghosts": {"panels": panels}}


def draw(data: dict):
    """A picture of each panel, all on one scale."""
    from matplotlib import pyplot as plt
    from matplotlib.colors import PowerNorm

    panels = data["panels"]
    figure, axes = plt.subplots(1, len(panels), figsize=(9.0, 3.3), layout="constrained")
    top = max(np.max(panel["load_g"]) for panel in panels)
    for axis, panel in zip(axes, panels, strict=True):
        # gamma: a ghost of 20 g must show beside a finger of 500 g
        image = axis.imshow(panel["load_g"], cmap="magma", norm=PowerNorm(0.5, 0.0, top))
        axis.set_title(f"{panel['title']}: {panel['sum_n']:.1f} N", fontsize=11)
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_visible(True)
        axis.spines[:].set_linewidth(0.5)
    bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.02, ticks=[0, 20, 100, 300, 600])
    bar.set_label("load on a cell [g]")
    return figure


DRAW = {"ghosts": draw}


def main(arguments=None) -> None:
    given = harness.picture_parser(__doc__, __spec__).parse_args(arguments)
    harness.draw(sys.modules[__name__], {}, given)


if __name__ == "__main__":
    harness.run(main)
