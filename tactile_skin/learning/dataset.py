# SPDX-License-Identifier: Apache-2.0
"""What the learned inverse learns from: scenes pushed through the forward model (paper V-B)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..physics.circuit import forward
from ..physics.curve import GRAM
from ..simulation import scenes
from ..simulation.bodies import bodies
from . import network

_CHUNK = 2000  # scenes made at a time: bounds memory, and seeds each chunk by its number
# What a real board has, in turn: noise, noise with R_par and curve off, rounding alone, nothing.
_BOARD = ("scan", "off", "scan", "adc10", "ideal")
# Fingers, so that pairs of touches leave no ghosts; large bodies, as a hip or a lying arm; touches
# of all loads, so that light ones are seen, twice.
_FAMILIES = (*scenes.FAMILIES, "fingers", "bodies", "large bodies", "touches", "touches")
_LARGE = 1.0, 6.0  # cells, half of a side
_LIGHTEST = 0.1  # N, of touches
_HARDEST = 20.0  # N, of touches
CHOICES = {
    "loss": ("l1", "mse"),
    "optimizer": ("soap", "sgd"),
    "readout": (*scenes.READOUTS, "board"),
    "network": network.NETWORKS,
}


@dataclass(frozen=True)
class TrainingConfig:
    """What a run depends on besides circuit and curve; kept beside its weights."""

    # pairs, validation: number of (reading, force) pairs to learn from and to pick the best epoch
    # by; a sixth each of blobs, rects, random, fingers, bodies and large bodies
    pairs: int = 100_000
    validation: int = 30_000
    # epochs, batch: passes over the pairs, and pairs per step
    epochs: int = 16
    batch: int = 64
    rate: float = 1e-2  # highest learning rate; a short linear rise, then a cosine to 0
    # "mse" as the paper, or "l1", which fits the mean absolute error that is reported; it counts
    # lightly loaded frames more
    loss: str = "l1"
    optimizer: str = "soap"  # "sgd" as the paper, or "soap" (soap.py)
    # what the readings are like, see `scenes.read_out`; "board": a mix of all, some from boards
    # whose R_par is off by up to 5 % and whose curve by up to 20 %
    readout: str = "ideal"
    # "paper", or "physics": fed with what the circuit says, for noisy boards
    network: str = "paper"
    seed: int = 0  # of scenes, initial weights and order
    # weights to go on from, a file or one of `network.NETWORKS` for the shipped ones; empty: new
    # ones. A lower rate suits.
    start: str = ""

    def __post_init__(self):
        for name in ("pairs", "validation", "epochs", "batch"):
            if not isinstance(getattr(self, name), int) or getattr(self, name) < 1:
                raise ValueError(
                    f"{name} = {getattr(self, name)!r}: must be a whole number above 0"
                )
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be one of {allowed}")
        if not self.rate > 0:
            raise ValueError(f"rate = {self.rate!r}: must be above 0")


def make_pairs(circuit, curve, n: int, network_kind: str, readout: str, seed, track=iter):
    """Draw n scenes of all families, and what a network sees of them.

    Args:
        network_kind: of `network.NETWORKS`: what the inputs are.
        readout: of `CHOICES`.
        seed: an int or a tuple of them; chunks are seeded by number.

    Returns:
        (n, channels, rows, cols) inputs, (n, rows, cols) force [N], both float32.

    Raises:
        ValueError: the circuit's readout is not the floating one, or it has one line.
    """
    if min(circuit.shape) < 2:
        raise ValueError(
            f"circuit of {circuit.rows} x {circuit.cols} cells: one line has no cross-talk to "
            "learn: use the method auto or map, which need no training"
        )
    if not circuit.readout_class.two_terminal:
        raise ValueError(
            f"the networks know the floating readout only, not {circuit.readout!r}: use the "
            "method auto or map, which need no training"
        )
    channels = 1 if network_kind == "paper" else network.PHYSICS_INPUTS
    inputs = np.empty((n, channels, *circuit.shape), np.float32)
    force = np.empty((n, *circuit.shape), np.float32)
    for chunk in track(range(math.ceil(n / _CHUNK))):
        rng = np.random.default_rng([*np.atleast_1d(seed), chunk])
        here = slice(chunk * _CHUNK, min((chunk + 1) * _CHUNK, n))
        family, kind = _FAMILIES[chunk % len(_FAMILIES)], readout
        sample: _Sample = _OWN.get(family) or partial(scenes.sample, family)
        rows, cols = circuit.shape
        truth = sample(here.stop - here.start, rows, cols, rng)
        truth = np.minimum(truth, curve.max_force) * circuit.populated
        resistance = curve.resistance(truth)
        if readout == "board":
            kind = _BOARD[chunk // len(_FAMILIES) % len(_BOARD)]
        if kind == "off":  # other boards and fabrics than the configuration says
            resistance *= 1.0 + rng.uniform(-0.2, 0.2, (len(truth), 1, 1))
        adc = forward(circuit, resistance)
        if kind == "off":
            rho = circuit.r_ref / adc - circuit.r_ref - circuit.r_par
            r_par_error = circuit.r_par * rng.uniform(-0.05, 0.05, (len(truth), 1, 1))
            adc, kind = circuit.ratio(rho + r_par_error), "scan"
        adc = scenes.read_out(circuit, adc, kind, rng)
        if network_kind == "paper":
            inputs[here, 0] = adc
        else:
            inputs[here] = network.physics_inputs(adc, circuit, curve).swapaxes(0, 1)
        force[here] = truth
    return inputs, force


def _fingers(n: int, rows: int, cols: int, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of 2 to 4 fingertips of 2 to 20 N each, anywhere."""
    return _tips(n, rows, cols, rng, (2, 4), (0.6, 1.6), lambda k: rng.uniform(2.0, 20.0, k))


def _touches(n: int, rows: int, cols: int, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of 1 to 3 round touches whose loads are spread over decades."""
    ends = np.log(_LIGHTEST), np.log(_HARDEST)
    return _tips(n, rows, cols, rng, (1, 3), (0.6, 2.0), lambda k: np.exp(rng.uniform(*ends, k)))


def _tips(n: int, rows: int, cols: int, rng, counts, widths, load) -> np.ndarray:
    """Draw round touches: how many, how wide [cells], and by a function of a shape how hard [N]."""
    y, x = np.arange(rows)[:, None], np.arange(cols)
    force, each = np.zeros((n, rows, cols)), (n, 1, 1)
    count = rng.integers(counts[0], counts[1] + 1, n)
    for k in range(counts[1]):
        row, col, width = (
            rng.uniform(*ends, each) for ends in ((0.0, rows - 1.0), (0.0, cols - 1.0), widths)
        )
        newtons = load(each)
        distance2 = ((y - row) ** 2 + (x - col) ** 2) / width**2
        tip = np.where(distance2 < 9.0, np.exp(-0.5 * distance2), 0.0)
        tip *= newtons / tip.sum((1, 2), keepdims=True)
        force += np.where(count[:, None, None] > k, tip, 0.0)
    return np.minimum(force, scenes.MAX_LOAD * GRAM)


def _large_bodies(n: int, rows: int, cols: int, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of bodies of up to 12 cells a side."""
    return np.minimum(bodies(n, rows, cols, rng, _LARGE), scenes.MAX_LOAD) * GRAM


_Sample = Callable[[int, int, int, np.random.Generator], np.ndarray]
# families of training alone
_OWN: dict[str, _Sample] = {"fingers": _fingers, "large bodies": _large_bodies, "touches": _touches}
