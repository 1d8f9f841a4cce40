# SPDX-License-Identifier: Apache-2.0
"""Simulated people who touch a mat: how hands press on it in space and time.

A person has a size, a strength, a tempo, a tremor and ways of doing each gesture; each performance
varies about them. The numbers are chosen, and but for `_UNSTEADY` come from no recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .mat import Mat, texture

_PAD = 1.25  # radii of a pad at which its pressure ends
_SIZE_STD = 0.11  # of hands: a child's to a large man's
_SIZES = (0.72, 1.25)
_STRENGTH_STD = 0.45  # of its logarithm
_TEMPO_STD = 0.22  # of its logarithm
_TREMOR = 0.0006  # m
# Standard deviation of a force that is held, as a share of it: chosen so that it changes about as
# much from picture to picture as that of recorded hands (docs/lab/gestures.md).
_UNSTEADY = 0.02
_CALM_STD = 0.4  # of the logarithms of a tremor and of how unsteady a force is
_LEANS = 0.5  # std of the logarithm of what each part of a hand bears
_ROLLS = (0.0, 0.9)  # shares of the largest force at which the last part of a hand lands
_CORRECTS = 0.15  # s in which such a variation is forgotten: most of it is below 2 Hz
_LEFT_HANDED = 0.15  # share of people
_OWN = 0.65  # share of a gesture's number that is the person's own; the rest is this performance's
_SLIP = 0.08  # std of that share
_TASTE = 0.7  # Dirichlet parameter of the ways of doing a gesture: most people have a favourite
_START = 0.04  # s before the first touch

Pad = tuple[float, float, float, float, float]  # x, y, radius along x, along y [m], weight


def _finger(x: float, end: float) -> list[Pad]:
    middle, root = (x, end - 0.026, 0.009, 0.010, 0.7), (x, end - 0.050, 0.010, 0.011, 0.8)
    return [(x, end, 0.009, 0.011, 1.0), middle, root]


# Pads of a hand of size 1 whose fingers point to +y [m].
_FINGERS = ((-0.033, 0.088), (-0.011, 0.100), (0.011, 0.093), (0.031, 0.076))
_TIPS: list[Pad] = [(x, end, 0.009, 0.010, 1.0) for x, end in _FINGERS]
_PALM: list[Pad] = [
    (0.0, 0.012, 0.038, 0.016, 0.8),
    (-0.027, -0.030, 0.018, 0.030, 1.1),
    (0.024, -0.032, 0.017, 0.030, 1.2),
    (0.0, -0.062, 0.032, 0.012, 0.9),
]
_HEEL: Pad = (0.0, -0.022, 0.036, 0.010, 0.6)  # of a fist
_THUMB: list[Pad] = [(0.058, -0.002, 0.011, 0.013, 0.8)]
POSES: dict[str, list[Pad]] = {
    "flat": _PALM + [pad for finger in _FINGERS for pad in _finger(*finger)] + _THUMB,
    "palm": _PALM,
    "fingers": [pad for finger in _FINGERS for pad in _finger(*finger)[:2]],
    "four tips": _TIPS,
    "three tips": _TIPS[:3],
    "two tips": _TIPS[:2],
    "tip": [(0.0, 0.0, 0.009, 0.010, 1.0)],
    "thumb": [(0.0, 0.0, 0.012, 0.015, 1.0)],
    "fist": [*((x, 0.0, 0.010, 0.013, 1.0) for x in (-0.03, -0.01, 0.01, 0.03)), _HEEL],
    "side": [(0.0, 0.035, 0.012, 0.030, 1.0), (0.0, -0.030, 0.013, 0.030, 1.1)],
}


class Person:
    """One person; the same number, 0 or more, is the same person."""

    def __init__(self, number: int):
        self._rng = np.random.default_rng([number, 11])
        rng = self._rng
        self.size = float(np.clip(rng.normal(1.0, _SIZE_STD), *_SIZES))
        self.strength = float(np.exp(_STRENGTH_STD * rng.standard_normal()))
        self.tempo = float(np.exp(_TEMPO_STD * rng.standard_normal()))
        self.tremor = float(_TREMOR * np.exp(_CALM_STD * rng.standard_normal()))
        self.rough = float(rng.uniform(0.15, 0.5))
        own = np.random.default_rng([number, 12])
        self.unsteady = float(_UNSTEADY * np.exp(_CALM_STD * own.standard_normal()))
        self.left = bool(rng.random() < _LEFT_HANDED)
        self._habits: dict[str, float] = {}
        self._tastes: dict[str, np.ndarray] = {}

    def number(self, name: str, low: float, high: float, rng: np.random.Generator) -> float:
        """Return a number between low and high, above 0, that is mostly the person's own."""
        if name not in self._habits:
            self._habits[name] = self._rng.random()
        share = _OWN * self._habits[name] + (1.0 - _OWN) * rng.random()
        share = np.clip(share + _SLIP * rng.standard_normal(), 0.0, 1.0)
        return float(low * (high / low) ** share)

    def way(self, name: str, ways: Sequence, rng: np.random.Generator):
        """Return one of the ways of doing something; a person has favourites."""
        if name not in self._tastes:
            self._tastes[name] = self._rng.dirichlet(np.full(len(ways), _TASTE))
        return ways[rng.choice(len(ways), p=self._tastes[name])]


class Hand(NamedTuple):
    """A hand over the time of a performance."""

    pose: str
    force: np.ndarray  # (T,) [N]
    at: np.ndarray  # (T, 2) where the middle of its pads is [m]
    angle: float  # [rad], of its fingers
    weights: np.ndarray | None = None  # (T, pads) of each pad, where they move by themselves


def pressed(
    mat: Mat, hand: Hand, person: Person, rng: np.random.Generator, period: float
) -> np.ndarray:
    """Return (T, rows, cols) force [N] of a hand; what lies beyond the edge presses elsewhere.

    Args:
        period: between pictures [s].
    """
    steps = len(hand.force)
    out = np.zeros((steps, mat.rows, mat.cols))
    skin = texture(mat, person.rough, rng)
    tremor = person.tremor * np.cumsum(rng.standard_normal((steps, 2)), 0) / np.sqrt(10.0)
    force = hand.force * (1.0 + person.unsteady * _fluctuation(steps, period, rng))
    pads = np.array(POSES[hand.pose])
    pads[:, :2] -= np.average(pads[:, :2], axis=0, weights=pads[:, 4])
    leans = np.exp(_LEANS * np.array([_fluctuation(steps, period, rng) for _ in pads]).T)
    late = (pads[:, :2] @ rng.standard_normal(2)).argsort().argsort() / len(pads)
    lands = hand.force[:, None] / max(hand.force.max(), 1e-9) - rng.uniform(*_ROLLS) * late
    own = np.maximum(lands, 0.0) if hand.weights is None else hand.weights
    weights = pads[:, 4] * leans * own
    for k in hand.force.nonzero()[0]:
        u, v = mat.around(hand.at[k] + tremor[k], hand.angle)
        if person.left:
            u = -u
        picture = np.zeros(skin.shape)
        for (px, py, rx, ry, _), weight in zip(pads.tolist(), weights[k], strict=True):
            along = (u - px * person.size) / (rx * person.size * _PAD)
            across = (v - py * person.size) / (ry * person.size * _PAD)
            if weight > 0.0:
                picture += weight * np.sqrt(np.maximum(1.0 - along**2 - across**2, 0.0))
        picture *= skin
        total = picture.sum()
        if total > 0.0:
            out[k] = mat.cells(picture) / total * force[k]
    return out


def _fluctuation(steps: int, period: float, rng: np.random.Generator) -> np.ndarray:
    """Return (steps,) a random course of mean 0 and std 1 that _CORRECTS forgets."""
    from scipy.signal import lfilter  # here: most simulated boards feel no hands

    keeps = np.exp(-period / _CORRECTS)
    noise = rng.standard_normal(steps) * np.sqrt(1.0 - keeps**2)
    return lfilter([1.0], [1.0, -keeps], noise, zi=[keeps * rng.standard_normal()])[0]


def pulse(t: np.ndarray, start: float, duration: float, rise: float = 0.35) -> np.ndarray:
    """Return (T,) 0..1: a push that rises for a share of its duration, and falls."""
    u = (t - start) / duration
    up = 0.5 - 0.5 * np.cos(np.pi * u / rise)
    down = 0.5 + 0.5 * np.cos(np.pi * (u - rise) / (1.0 - rise))
    return np.where((u > 0) & (u < rise), up, np.where((u >= rise) & (u < 1), down, 0.0))


def ramp(t: np.ndarray, end: float, up: float, down: float) -> np.ndarray:
    """Return (T,) 0..1: a touch that comes within `up` s and is gone at `end` [s]."""
    return np.clip(np.minimum((t - _START) / up, (end - t) / down), 0.0, 1.0)


class _Stage:
    """What a performance has at hand: its person, its random numbers, where it takes place."""

    def __init__(self, gesture: str, person: Person, mat: Mat, seed: int, period: float):
        self.person, self.mat, self.gesture, self.period = person, mat, gesture, period
        self.rng = np.random.default_rng([seed, 5])
        own = person.number("angle", 0.25, 1.75, self.rng) - 1.0
        self.angle = self.rng.normal(own, 0.35) + (np.pi if self.rng.random() < 0.15 else 0.0)
        margin = min(0.06, *(mat.size / 4))
        self.place = self.rng.uniform(margin, mat.size - margin)
        turn = self.rng.uniform(0.0, 2.0 * np.pi)
        self.along = np.array([np.cos(turn), np.sin(turn)])

    def number(self, name: str, low: float, high: float) -> float:
        return self.person.number(f"{self.gesture} {name}", low, high, self.rng)

    def force(self, low: float, high: float) -> float:
        return self.number("force", low, high) * self.person.strength

    def way(self, name: str, *ways):
        return self.person.way(f"{self.gesture} {name}", ways, self.rng)

    def times(self, duration: float) -> np.ndarray:
        return np.arange(0.0, duration + self.period / 2, self.period)

    def still(self, t: np.ndarray) -> np.ndarray:
        return np.repeat(self.place[None], len(t), 0)

    def hands(self, pose: str, force, at) -> np.ndarray:
        """Return what one hand presses, or two side by side."""
        one = self.show(pose, force, at)
        if not self.way("hands", False, False, True):
            return one
        across = self.number("apart", 0.07, 0.2) * np.array([-self.along[1], self.along[0]])
        return one + self.show(pose, force, at + across)

    def show(self, pose: str, force, at, weights=None) -> np.ndarray:
        hand = Hand(pose, force, at, self.angle, weights)
        return pressed(self.mat, hand, self.person, self.rng, self.period)


def _tap(s: _Stage) -> np.ndarray:
    times, tempo = s.way("times", 1, 1, 2, 3), s.person.tempo
    duration, gap = s.number("duration", 0.07, 0.2) / tempo, s.number("gap", 0.15, 0.35) / tempo
    t = s.times(times * duration + (times - 1) * gap + 0.1)
    force = np.zeros(len(t))
    for i in range(times):
        strength = s.force(0.6, 5.0) * s.rng.uniform(0.7, 1.3)
        force += pulse(t, _START + i * (duration + gap), duration) * strength
    return s.show(s.way("pose", "tip", "two tips", "three tips"), force, s.still(t))


def _poke(s: _Stage) -> np.ndarray:
    duration = s.number("duration", 0.1, 0.6) / s.person.tempo
    t = s.times(duration + 0.1)
    force = ramp(t, duration + _START, s.rng.uniform(0.02, 0.15), 0.08) * s.force(2.0, 14.0)
    return s.show(s.way("pose", "tip", "tip", "thumb", "two tips"), force, s.still(t))


def _pat(s: _Stage) -> np.ndarray:
    times, duration = int(s.rng.integers(2, 12)), s.number("duration", 0.11, 0.3) / s.person.tempo
    every = duration + s.number("gap", 0.07, 0.22) / s.person.tempo
    t = s.times(times * every + 0.06)
    at, force = s.still(t), np.zeros(len(t))
    for i in range(times):
        push = pulse(t, _START + i * every, duration)
        force += push * s.force(3.0, 25.0) * s.rng.uniform(0.75, 1.3)
        at[push > 0.0] += s.rng.normal(0.0, 0.012, 2)
    return s.show(
        s.way("pose", "flat", "fingers", "four tips", "three tips", "two tips"), force, at
    )


def _slap(s: _Stage) -> np.ndarray:
    duration = s.number("duration", 0.1, 0.7)
    t = s.times(duration + 0.12)
    start = _START + s.rng.uniform(0.0, s.period)
    force = pulse(t, start, duration, 0.25) * s.force(18.0, 120.0)
    roll = np.clip((t - start) / duration, 0.0, 1.0)[:, None] - 0.5
    at = s.still(t) + s.number("roll", 0.02, 0.25) * roll * s.along
    return s.show(s.way("pose", "flat", "flat", "fingers", "side"), force, at)


def _stroke(s: _Stage) -> np.ndarray:
    times = s.way("times", 1, 1, 1, 2, 3)
    speed = s.number("speed", 0.11, 0.4) * s.person.tempo
    length = min(s.number("length", 0.12, 0.35), 0.85 * s.mat.size.max())
    duration, gap = length / speed, s.number("gap", 0.15, 0.5)
    t = s.times(times * duration + (times - 1) * gap + 0.1)
    at, force = s.still(t), np.zeros(len(t))
    middle = s.mat.size / 2 + s.rng.normal(0.0, 0.03, 2)
    for i in range(times):
        u = (t - _START - i * (duration + gap)) / duration
        on = (u > 0.0) & (u < 1.0)
        at[on] = middle + s.along * length * (u[on, None] - 0.5)
        edge = np.clip(np.minimum(u, 1.0 - u) * duration / 0.1, 0.0, 1.0)
        force += edge * s.force(3.0, 50.0) * s.rng.uniform(0.8, 1.2)
    return s.hands(s.way("pose", "flat", "flat", "fingers", "flat", "palm"), force, at)


def _rub(s: _Stage) -> np.ndarray:
    duration, reach = s.number("duration", 0.9, 3.0), s.number("reach", 0.012, 0.05)
    frequency = s.number("frequency", 0.9, 4.0) * s.person.tempo
    t = s.times(duration + 0.1)
    phase = 2 * np.pi * frequency * t + s.rng.uniform(0.0, 6.0)
    force = ramp(t, duration + _START, 0.15, 0.15) * s.force(3.0, 22.0)
    force *= 1.0 + 0.2 * np.sin(2 * phase)
    at = s.still(t) + reach * np.sin(phase)[:, None] * s.along
    if s.way("circles", False, False, True):
        at += 0.8 * reach * np.cos(phase)[:, None] * s.along[::-1] * (1.0, -1.0)
    return s.show(s.way("pose", "flat", "palm", "fingers", "fist", "thumb"), force, at)


def _tickle(s: _Stage) -> np.ndarray:
    duration, frequency = s.number("duration", 1.2, 6.5), s.number("frequency", 2.5, 8.0)
    t, pose = s.times(duration + 0.1), s.way("pose", "four tips", "four tips", "three tips")
    tips = len(POSES[pose])
    each = frequency * s.person.tempo * s.rng.uniform(0.8, 1.25, tips)
    wave = np.sin(2 * np.pi * each * t[:, None] + s.rng.uniform(0.0, 6.3, tips))
    weights = np.clip(wave + s.rng.uniform(-0.3, 0.6), 0.0, None)
    weights = np.clip(weights * (1.0 + 0.3 * s.rng.standard_normal(weights.shape)), 0.0, None)
    strength = s.number("force", 0.5, 3.0) * s.person.strength**0.5
    force = ramp(t, duration + _START, 0.08, 0.08) * weights.sum(1) * strength
    drift = s.rng.normal(0.0, s.number("drift", 0.002, 0.012), (len(t), 2))
    # per 20 ms: a walk that depends on the time, not on the pictures
    at = s.still(t) + np.cumsum(drift, 0) * np.sqrt(s.period / 0.02)
    return s.show(pose, force, at, weights)


def _scratch(s: _Stage) -> np.ndarray:
    duration, reach = s.number("duration", 0.6, 2.5), s.number("reach", 0.005, 0.022)
    frequency = s.number("frequency", 1.8, 6.0) * s.person.tempo
    t = s.times(duration + 0.1)
    saw = np.abs(((frequency * t + s.rng.random()) % 1.0) * 2.0 - 1.0) * 2.0 - 1.0
    lift = s.way("lift", 1.0, 0.5, 0.15)
    force = ramp(t, duration + _START, 0.08, 0.08) * s.force(1.5, 12.0)
    force *= np.where(np.diff(saw, prepend=saw[0]) > 0.0, lift, 1.0)
    back = np.array([-np.sin(s.angle), np.cos(s.angle)])
    at = s.still(t) + reach * saw[:, None] * back
    return s.show(s.way("pose", "four tips", "three tips", "two tips"), force, at)


def _press(s: _Stage) -> np.ndarray:
    duration, up = s.number("duration", 0.6, 3.0), s.number("rise", 0.15, 0.8)
    t = s.times(duration + up + 0.3)
    sway = 1.0 + 0.05 * np.sin(2 * np.pi * 1.5 * t + s.rng.uniform(0.0, 6.0))
    force = ramp(t, duration + up + 0.2, up, 0.2) * s.force(14.0, 70.0) * sway
    return s.show(s.way("pose", "flat", "palm", "fist", "thumb", "four tips"), force, s.still(t))


def _hold(s: _Stage) -> np.ndarray:
    duration, up = s.number("duration", 1.5, 4.0), s.number("rise", 0.05, 0.4)
    t = s.times(duration + up + 0.3)
    breath = 1.0 + 0.08 * np.sin(2 * np.pi * 0.4 * t + s.rng.uniform(0.0, 6.0))
    force = ramp(t, duration + up + 0.2, up, 0.2) * s.force(6.0, 90.0) * breath
    at = s.still(t) + s.number("drift", 0.002, 0.05) * t[:, None] / t[-1] * s.along
    return s.hands(s.way("pose", "flat", "flat", "flat", "palm"), force, at)


def _squeeze(s: _Stage) -> np.ndarray:
    duration = s.number("duration", 0.7, 3.0)
    t = s.times(duration + 0.2)
    force = ramp(t, duration + 0.1, s.number("rise", 0.08, 0.35), 0.15) * s.force(6.0, 45.0)
    if s.way("again", False, False, True):
        frequency = s.number("frequency", 0.7, 2.2)
        force *= 1.0 - 0.35 * (1.0 + np.cos(2 * np.pi * frequency * t))
    return _between(s, force, force, s.still(t))


def _massage(s: _Stage) -> np.ndarray:
    duration = s.number("duration", 1.5, 4.0)
    frequency = s.number("frequency", 0.5, 1.6) * s.person.tempo
    t = s.times(duration + 0.2)
    phase = 2 * np.pi * frequency * t + s.rng.uniform(0.0, 6.0)
    force = ramp(t, duration + 0.1, s.number("rise", 0.08, 0.35), 0.15) * s.force(8.0, 50.0)
    circle = np.stack([np.cos(phase), np.sin(phase)], 1)
    turns = s.way("turns", 1.0, -1.0, 0.5)
    front, back = (force * (0.55 + 0.45 * np.sin(phase) * turn) for turn in (1.0, -turns))
    return _between(s, front, back, s.still(t) + s.number("reach", 0.004, 0.02) * circle)


def _between(s: _Stage, front: np.ndarray, back: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return what fingers on one side and the thumb or the ball of the hand on the other press."""
    span = s.number("span", 0.05, 0.10)
    axis = np.array([-np.sin(s.angle), np.cos(s.angle)]) * span
    fingers = s.show(s.way("front", "four tips", "fingers", "fingers"), front, at + 0.15 * axis)
    return fingers + s.show(s.way("back", "thumb", "palm"), back, at - 0.85 * axis)


_ALL = _tap, _pat, _poke, _stroke, _rub, _tickle, _scratch, _squeeze, _press, _hold, _slap, _massage
GESTURES: dict[str, Callable[[_Stage], np.ndarray]] = {f.__name__[1:]: f for f in _ALL}


def perform(gesture: str, person: Person, mat: Mat, seed: int, period: float) -> np.ndarray:
    """Return what a performance presses, by its seed: (T, rows, cols) [N] every period [s]."""
    return GESTURES[gesture](_Stage(gesture, person, mat, seed, period))
