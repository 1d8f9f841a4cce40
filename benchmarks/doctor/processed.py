# SPDX-License-Identifier: Apache-2.0
"""Which streams are named as processed, and by what; of kinds, and of sound boards.

A stream is 30 s of touches on a simulated board: every passive readout, 8 to 12 bits, 4 x 4 to
16 x 16 cells, fabric that scatters by 3 to 15 %, noise of 0.3 to 2 steps at 12 bits, pressed hard
or lightly, often or seldom. N streams of each kind are processed as sketches and recorders do it;
as many of each kind of sound board are not: coarse ADCs whose untouched cells really read 0, an
ESP32 that reads nothing below 142 mV, saturated inputs, cells that are not populated, a loose line,
a skin that is never left alone.

Prints for each kind how often it is named rightly, by another kind, and not at all, and how often
by a running skin (of what a board may send); for sound boards how often they are named at all.
What the doctor, which sees the same frames as a file, proposes to enter is counted with --doctor.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from health.seen import seen
from support.strangers import sim

from tactile_skin import Circuit, PressureCurve, diagnose
from tactile_skin.health.sent import Sent
from tactile_skin.physics.adc import Adc
from tactile_skin.readings.processed import Done, processed
from tactile_skin.readings.scale import VOLTS, Numbers, scale_of

from .. import harness

FPS = 10.0
SECONDS = 30.0
ESP32_DEAD = 142.0 / 3300.0  # share of its range below which it reads 0
OHMS = {"floating": (1780.0, 10e3), "loaded": (4.7e3, 35e3), "grounded": (1000.0, 4.7e3)}


class Board:
    """A random board and what it reads; `bits` and the rest's ohms may be given."""

    def __init__(self, rng, bits=None, rest_ohms=None, hard=None, share=None):
        self.rng = rng
        shape = tuple(int(n) for n in rng.integers(4, 17, 2))
        readout = str(rng.choice(list(OHMS)))
        r_ref = float(np.exp(rng.uniform(*np.log(OHMS[readout]))))
        self.bits = int(bits or rng.choice([10, 10, 12]))
        self.circuit = Circuit(
            *shape, r_ref, float(rng.uniform(20, 200)), self.bits, readout=readout
        )
        force, ohms = np.array(PressureCurve().points).T
        rest = float(np.exp(rng.uniform(*np.log(rest_ohms or (15e3, 80e3)))))
        curve = PressureCurve(force, ohms * rest / ohms[0])
        self.curve = sim.fabric(
            self.circuit, int(rng.integers(1 << 30)), float(rng.uniform(0.03, 0.15)), curve
        )
        self.noise = float(rng.uniform(0.3, 2.0)) * 2.0 ** (self.bits - 12) + 0.2
        gap = float(rng.choice([0.5, 1.5, 4.0])) if share is None else share
        force = sim.touches(
            shape,
            SECONDS,
            FPS,
            seed=int(rng.integers(1 << 30)),
            rest=float(rng.uniform(1, 4)),
            hard=hard or [(2, 25), (1, 8), (10, 60)][rng.integers(3)],
            hold=float(rng.uniform(0.6, 1.5)),
            gap=gap,
        )
        self.force = force
        self.steps = sim.counts(self.circuit, self.curve, force, rng, noise=self.noise)
        self.full = self.circuit.full_scale

    def zeroed(self):
        """Its readings with the mean of the first ten taken off, not cut."""
        still = sim.counts(
            self.circuit,
            self.curve,
            np.zeros((10, *self.circuit.shape)),
            self.rng,
            noise=self.noise,
        )
        return self.steps - np.rint(still.mean(0)).astype(int)


def baseline(board):
    return np.maximum(board.zeroed(), 0)


def dead_band(board):
    off = np.maximum(board.zeroed(), 0)
    dead = board.rng.uniform(0.01, 0.15) * board.full
    return np.where(off < max(dead, 4.0 * board.noise + 3.0), 0, off)


def threshold(board):
    """Raw, but 0 where less than a bit more than the untouched cells is read."""
    at = np.quantile(board.steps[:5], board.rng.uniform(0.5, 0.98)) + 3
    return np.where(board.steps <= at, 0, board.steps)


def ceiling(board):
    off = baseline(board)
    top = 50 * max(1, int(board.rng.uniform(0.3, 0.7) * np.quantile(off.max((1, 2)), 0.9) / 50))
    return np.minimum(off, top)


def stretched(board, top):
    low, high = (end(board.steps, (1, 2), keepdims=True) for end in (np.min, np.max))
    return (board.steps - low) / np.maximum(high - low, 1) * top


def each_to_255(board):
    return np.rint(stretched(board, 255.0))


def each_to_1(board):
    return stretched(board, 1.0)


def all_to_1(board):
    return (board.steps - board.steps.min()) / np.ptp(board.steps)


def negative(board):
    return board.zeroed()


def volts(board):
    supply = board.rng.choice([3.3, 5.0])
    return np.round(board.steps / board.full * supply, int(board.rng.integers(2, 4)))


def volts_below_1(board):
    return np.round(board.steps / board.steps.max() * board.rng.uniform(0.5, 0.98), 3)


PROCESSED = {
    "a baseline taken off": (baseline, {Done.OFFSET}),
    "a baseline and a dead band": (dead_band, {Done.THRESHOLD, Done.OFFSET}),
    "a threshold": (threshold, {Done.THRESHOLD}),
    "a baseline, and a ceiling": (ceiling, {Done.OFFSET}),
    "each frame to 0..255": (each_to_255, {Done.NORMALISED}),
    "each frame to 0..1": (each_to_1, {Numbers.NORMALISED}),
    "all frames to 0..1": (all_to_1, {Numbers.NORMALISED}),
    "a baseline, below 0": (negative, {Numbers.NEGATIVE}),
    "volts": (volts, {Numbers.VOLTS, Numbers.RATIOS_OR_VOLTS}),
    "volts below 1": (volts_below_1, {Numbers.RATIOS_OR_VOLTS}),
}


def plain(board):
    return board.steps


def upside_down(board):
    return board.full - board.steps


def saturated(board):
    return np.minimum(np.rint(board.steps * board.rng.uniform(1.2, 2.0)), board.full)


def sparse(board):
    mask = board.rng.random(board.circuit.shape) < 0.5
    return np.where(mask, 0, board.steps)


def loose(board):
    out = np.random.default_rng(0).random(len(board.steps)) < 0.3
    steps = board.steps.copy()
    steps[out, 1] = 0
    return steps


def loaded(board):
    return board.steps[board.force.sum((1, 2)) > 0]


def esp32(board):
    dead = ESP32_DEAD * board.full
    return np.maximum(np.rint((board.steps - dead) * board.full / (board.full - dead)), 0)


def ratios(board):
    return np.round(board.steps / board.full, int(board.rng.integers(5, 9)))


SOUND = {
    "as it is read": (plain, {}),
    "pull-ups": (upside_down, {}),
    "saturated": (saturated, {"hard": (10, 60)}),
    "half of the cells": (sparse, {}),
    "a loose line": (loose, {}),
    "never left alone": (loaded, {"share": 0.3}),
    "8 bits": (plain, {"bits": 8}),
    "8 bits, 0 at rest": (plain, {"bits": 8, "rest_ohms": (1e6, 6e6)}),
    "10 bits, 0 at rest": (plain, {"bits": 10, "rest_ohms": (4e6, 20e6)}),
    "an ESP32": (esp32, {"bits": 12}),
    "ratios": (ratios, {}),
}


def taken_for(steps, bits: int, unresolved: float = 0.0) -> Done | Numbers | None:
    """What a file of these numbers is taken for."""
    scale = scale_of(np.asarray(steps, float) if steps.dtype.kind == "f" else steps).kind
    if scale not in (Numbers.STEPS, Numbers.RATIOS):
        return scale
    found = processed(steps, bits, unresolved=unresolved) if scale is Numbers.STEPS else None
    return found and found.kind


def named_live(steps, board, dead: float) -> bool:
    """Whether a running skin, which sees frame after frame, names what was done."""
    if (steps.dtype.kind == "f" and steps.max() <= VOLTS) or steps.min() < 0:
        return False  # a file's numbers
    sent = Sent(Adc(board.circuit, offset=dead), 0.0)
    samples = np.rint(steps * 2.0 ** (16 - board.bits)).astype("u2")
    for k, frame in enumerate(samples):
        sent.frame(seen(k / FPS, samples=frame))
    return bool(sent.findings())


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--n", type=int, default=40, help="streams of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--doctor", action="store_true", help="what the doctor would enter")
    args = parser.parse_args(arguments)
    print(f"{'processed':28}{'right':>7}{'other':>7}{'silent':>7}{'live':>7}   as what")
    total = Counter()
    for k, (name, (make, right)) in enumerate(PROCESSED.items()):
        counts, others, entered, live = Counter(), Counter(), 0, 0
        for n in range(args.n):
            board = Board(np.random.default_rng([args.seed, k, n]))
            steps = make(board)
            kind = taken_for(steps, board.bits)
            result = "right" if kind in right else "other" if kind else "silent"
            counts[result] += 1
            others[kind.value if kind else "-"] += 1
            live += named_live(steps, board, 0.0)
            if args.doctor and np.min(steps) >= 0 and np.max(steps) > 5.5:
                found = diagnose(steps / board.full, board.circuit, series=False)
                entered += any(f.change for f in found)
        total += counts
        row = "".join(f"{counts[c]:7}" for c in ("right", "other", "silent"))
        doctor = f", the doctor enters something in {entered}" if args.doctor else ""
        print(f"{name:28}{row}{live:7}   {dict(others)}{doctor}")
    print(f"{'all':28}" + "".join(f"{total[c]:7}" for c in ("right", "other", "silent")))
    print(f"\n{'sound':28}{'named':>7}{'live':>7}{'of':>7}   as what")
    wrong = alive = of = 0
    for k, (name, (make, given)) in enumerate(SOUND.items()):
        named, live = Counter(), 0
        for n in range(args.n):
            board = Board(np.random.default_rng([args.seed, 100 + k, n]), **given)
            dead = ESP32_DEAD * board.full if make is esp32 else 0.0
            steps = make(board)
            live += named_live(steps, board, dead)
            if kind := taken_for(steps, board.bits, dead):
                named[kind.value] += 1
        wrong, alive, of = wrong + named.total(), alive + live, of + args.n
        print(f"{name:28}{named.total():7}{live:7}{args.n:7}   {dict(named) or ''}")
    print(f"{'all':28}{wrong:7}{alive:7}{of:7}")
    return {"processed": total, "sound": {"named": wrong, "live": alive, "of": of}}


if __name__ == "__main__":
    harness.run(main)
