"""Pictures of single cases: what is pressed, and what each method makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import scenes
from ..circuit import Circuit, forward
from ..curve import GRAM, PressureCurve
from ..solvers import compensate


def ghosts(path: Path, seed: int = 0) -> None:
    """Two fingers and a palm: pressed, naive, cnn, as one row of pictures."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    circuit, curve = Circuit(), PressureCurve()
    force = scenes.script("two_fingers", *circuit.shape)(0.0)
    force += scenes.finger(*circuit.shape, 12.0, 3.5, 30.0, width=1.5)
    rng = np.random.default_rng(seed)
    adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)
    panels = [("what is pressed", force)]
    for method, title in (("naive", "each reading on its own"), ("auto", "tactile_skin")):
        panels.append((title, compensate(adc, circuit, curve, method).force))

    figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.3), layout="constrained")
    top = max(found.max() for _, found in panels) / GRAM
    for axis, (title, found) in zip(axes, panels, strict=True):
        # gamma: a ghost of 20 g must show beside a finger of 500 g
        picture = axis.imshow(
            found / GRAM, cmap="magma", norm=matplotlib.colors.PowerNorm(0.5, 0.0, top)
        )
        axis.set_title(f"{title}: {found.sum():.1f} N", fontsize=11)
        axis.set_xticks([])
        axis.set_yticks([])
    bar = figure.colorbar(picture, ax=axes, shrink=0.9, pad=0.02, ticks=[0, 20, 100, 300, 600])
    bar.set_label("load on a cell [g]")
    figure.savefig(path, dpi=110)
    plt.close(figure)
