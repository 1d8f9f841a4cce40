# SPDX-License-Identifier: Apache-2.0
"""Troubles of growing strength, as `textile.Textile` has them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import GRAM
from ..simulation import scenes
from ..simulation.textile import Textile

# What every real skin has a little of: the ADC's noise, the paper's coupling of 0.5 %, 1 ohm of a
# silver-coated stripe, cells that are not quite alike. At rest they are: that can be measured.
EVERYDAY = Textile(noise=1.0, lateral=0.005, line=1.0, scatter=0.05)

# The boards of TROUBLES: their cells differ at rest, too.
UNEVEN = replace(EVERYDAY, rest=0.03)


@dataclass(frozen=True)
class Trouble:
    """One thing that goes wrong, and how badly."""

    # name, unit: of the strength, for figures
    name: str
    unit: str
    strengths: tuple[float, ...]  # rising in severity; `sound` is the one that is no trouble
    # strength -> what the skin is like
    textile: Callable[[float], Textile] = lambda strength: UNEVEN
    # (n, strength, circuit, rng) -> (n, rows, cols) force [N]
    scene: Callable = lambda n, strength, circuit, rng: _bodies(n, circuit, rng)
    # strength -> width of the ADC, which the solver knows; None: the board's
    bits: Callable[[float], int | None] = lambda strength: None
    sound: float | None = 0.0
    reason: str = ""  # why failures are silent, if they are


def _bodies(n: int, circuit: Circuit, rng) -> np.ndarray:
    return scenes.sample("bodies", n, *circuit.shape, rng)


def touches(n: int, circuit: Circuit, rng) -> np.ndarray:
    """(n, rows, cols) force [N]: blobs and rectangles in turn."""
    force = np.empty((n, *circuit.shape))
    force[::2] = scenes.sample("blobs", -(-n // 2), *circuit.shape, rng)
    force[1::2] = scenes.sample("rects", n // 2, *circuit.shape, rng)
    return force


def pressed(n: int, share: float, load: float, circuit: Circuit, rng) -> np.ndarray:
    """(n, rows, cols) force [N]: `share` of the skin under `load` g a cell, give or take 30 %."""
    rows, cols = circuit.shape
    height = round(rows * share**0.5)
    width = min(cols, round(share * rows * cols / height))
    force = np.zeros((n, rows, cols))
    for frame in force:
        top, left = rng.integers(rows - height + 1), rng.integers(cols - width + 1)
        cells = load * (1.0 + 0.3 * rng.standard_normal((height, width)))
        frame[top : top + height, left : left + width] = np.clip(cells, 0.0, scenes.MAX_LOAD)
    return force * GRAM


def _with(field: str, scale: float = 1.0, offset: float = 0.0):
    """strength -> UNEVEN with one field at offset + scale * strength."""
    kind = type(getattr(UNEVEN, field))
    return lambda strength: replace(UNEVEN, **{field: kind(offset + scale * strength)})


_OFF = (-20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0)  # %
TROUBLES = (
    Trouble(
        "noise", "ADC steps", (0, 1, 2, 4, 8), _with("noise"), sound=1,
        reason="noise hides light cells",
    ),
    Trouble(
        "ADC width", "bits", (14, 12, 10, 8), bits=int, sound=10,
        reason="steps are coarser than light cells",
    ),
    Trouble(
        "R_par off", "%", _OFF, _with("r_par", 0.01, 1.0),
        reason="more than touches show",
    ),
    Trouble(
        "R_ref off", "%", _OFF, _with("r_ref", 0.01, 1.0),
        reason="scales all forces: the doctor names it",
    ),
    Trouble(
        "curve off", "% of R", (0, 10, 20, 35, 50), _with("curve", 0.01),
        reason="reads like a harder touch: calibrate",
    ),
    Trouble(
        "scatter at rest", "% of R", (0, 3, 5, 10, 20), _with("rest", 0.01), sound=3,
        reason="reads like a touch",
    ),
    Trouble(
        "line resistance", "ohm a stripe", (0, 1, 3, 10, 30), _with("line"), sound=1,
        reason="more than touches show",
    ),
    Trouble(
        "lateral coupling", "%", (0, 0.5, 1, 2, 5), _with("lateral", 0.01), sound=0.5,
        reason="reads like a softer touch",
    ),
    Trouble(
        "moving contact", "cells a scan", (0, 1, 2, 4, 6), _with("moving"),
        reason="rows are read one after the other",
    ),
    Trouble(
        "open leads", "lines", (0, 1, 2, 3, 4), _with("open"),
        reason="the fabric leads around it",
    ),
    Trouble(
        "broken stripes", "lines", (0, 1, 2, 3, 4), _with("broken"),
        reason="the fabric leads around it",
    ),
    Trouble(
        "short", "pairs of lines", (0, 1, 2), _with("short"),
        reason="weak where the pressure is low",
    ),
    Trouble(
        "stuck cells", "cells", (0, 1, 2, 4, 8), _with("stuck"),
        reason="reads like a finger",
    ),
    Trouble(
        "pressed area", "% at 300 g", (10, 25, 50, 75, 100),
        scene=lambda n, strength, circuit, rng: pressed(n, strength / 100, 300.0, circuit, rng),
        sound=None,
        reason="no cell differs from the others: trust the sum",
    ),
    Trouble(
        "all pressed", "g a cell", (50, 100, 300, 600, 1000),
        scene=lambda n, strength, circuit, rng: pressed(n, 1.0, strength, circuit, rng),
        sound=None,
        reason="no cell differs from the others: trust the sum",
    ),
    Trouble(
        "saturated ADC", "% of full scale", (100, 80, 70, 60, 40), _with("ceiling", 0.01),
        sound=100, reason="few cells reach the ceiling: the doctor names it",
    ),
    Trouble(
        "lines at full scale", "lines", (0, 1, 2, 4), _with("full_scale"),
        reason="reads like a touch",
    ),
)  # fmt: skip
