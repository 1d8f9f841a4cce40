# SPDX-License-Identifier: Apache-2.0
"""Objects of known weight that are laid on unknown boards, and presses of a hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from support.lab.unknown import Unknown
from tactile_skin import PressureCurve, compensate
from tactile_skin.physics.creep import Creep
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes

LIGHTEST, HEAVIEST = 300.0 * GRAM, 5000.0 * GRAM  # N
HARDEST = 1000.0 * GRAM  # N on a cell
PRESSED, ROUND = (3.0, 40.0), (1.0, 2.5)  # N of a hand, and radius of what it presses with [cells]
PAUSE, RISE, HOLD = 0.5, 0.3, 1.0  # s between presses, of coming and going, of standing
STOOD = 1.0, 30.0  # s


def bodies(n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of one to four bodies each."""
    return scenes.sample("bodies", n, *shape, rng)


def objects(n: int, shape, rng) -> tuple[np.ndarray, np.ndarray]:
    """(n, rows, cols) force [N] of objects, each of one to three bodies, and their (n,) weights."""
    weights = np.exp(rng.uniform(np.log(LIGHTEST), np.log(HEAVIEST), n))
    laid = []
    for weight in weights:
        force = np.full(shape, np.inf)
        while not force.max() <= HARDEST:
            force = bodies(1, shape, rng)[0]
            force *= weight / force.sum()
        laid.append(force)
    return np.array(laid), weights


def presses(n: int, shape, rng) -> tuple[np.ndarray, np.ndarray]:
    """The same of a round scale that a hand presses on the skin."""
    row, col = np.indices(shape)
    pressed = []
    while len(pressed) < n:
        at, radius = rng.uniform(0.0, np.subtract(shape, 1)), rng.uniform(*ROUND)
        apart = ((row - at[0]) ** 2 + (col - at[1]) ** 2) / radius**2
        force = np.sqrt(np.clip(1.0 - apart, 0.0, None))
        force *= np.exp(rng.uniform(*np.log(PRESSED))) / force.sum()
        if force.max() <= HARDEST:
            pressed.append(force)
    pressed = np.array(pressed)
    return pressed, pressed.sum((1, 2))


def weighed(board: Unknown, laid: np.ndarray, creep: float, rng) -> np.ndarray:
    """(n, rows, cols) readings of objects that have stood for 1 to 30 s, and crept."""
    stood = np.exp(rng.uniform(*np.log(STOOD), len(laid)))
    gains = Creep(creep).gain(stood)
    crept = (np.where(force > 0.0, gain, 1.0) for force, gain in zip(laid, gains, strict=True))
    return np.array([board.sample(board.expose(f, c)) for f, c in zip(laid, crept, strict=True)])


def known(board: Unknown):
    """Its circuit, as it is."""
    return replace(board.supposed, r_par=board.r_par, r_line=board.r_line)


def stream(board: Unknown, times_laid: int, late: float, rng, drawn=objects):
    """frames, times, reference, reference_times: objects laid on and taken off, 30 frames a second,
    and a scale of 20 readings a second with 0.05 N of noise, a zero of its own, and late [s]."""
    laid, _ = drawn(times_laid, board.supposed.shape, rng)
    period = PAUSE + 2.0 * RISE + HOLD

    def course(t):
        number, phase = np.divmod(t, period)
        on = np.clip(np.minimum(phase - PAUSE, period - phase) / RISE, 0.0, 1.0)
        last = times_laid - 1
        return np.where(number <= last, on, 0.0), np.clip(number.astype(int), 0, last)

    times = np.arange(0.0, times_laid * period + 1.0, 1.0 / 30.0)
    at = np.arange(0.0, times_laid * period + 1.0, 1.0 / 20.0)
    on, which = course(times)
    frames = board.frames(laid[which] * on[:, None, None])
    on, which = course(at - late)
    reference = 3.2 + laid[which].sum((1, 2)) * on + 0.05 * rng.standard_normal(at.size)
    return frames, times, reference, at


def totals(frames, circuit, curve: PressureCurve, rest) -> np.ndarray:
    """(n,) [N] as a running skin finds them."""
    curve = curve.resting_at(1.0 / rest.conductance)
    return compensate(frames, circuit, curve, "map").force.sum((1, 2))
