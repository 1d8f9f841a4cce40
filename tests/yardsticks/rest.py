"""How often `measure_rest` takes a board with noisy cells, and refuses one that is touched:
`python tests/yardsticks/rest.py [--boards N] [--seed S]`.

Boards as in `identify.py`. Sound: also with slow noise or a hum of 0.5 to 2.5 steps. Noisy: one to
three cells whose readings scatter by 5 to 40 ADC steps, jump between two values, or drop to 0; or
one that loses its contact with the fabric now and then. Touched: a finger of 0.3 to 3 N that comes,
goes, taps (for two frames or more) or stays for part of the time, or a drift of all cells by 10 to
30 %. What stands all the time no rest tells. Chosen on
seeds 0 to 19; others score it.
"""

from __future__ import annotations

import argparse

import numpy as np
from yardsticks.identify import Unknown

from tactile_skin import measure_rest
from tactile_skin.bench import textile
from tactile_skin.learning import scenes

SHAPES = (4, 4), (6, 6), (8, 8), (8, 12), (16, 16)
SOUND = "sound", "slow noise", "hum"
NOISY = "scatters", "jumps", "drops to 0", "loses contact"
TOUCHED = "comes", "goes", "part of the time", "taps", "drifts"


def switching(n: int, rng, least: int = 1) -> np.ndarray:
    """(n,) bool, on and off at random, for `least` frames or more; both occur."""
    while True:
        dwell = least + rng.geometric(1.0 / rng.uniform(1.0, 10.0), n) - 1
        on = np.repeat(np.arange(n) % 2 == rng.integers(2), dwell)[:n]
        if 0 < on.sum() < n:
            return on


def noisy_cells(board: Unknown, kind: str, rng) -> tuple:
    """Cells that are noisy, and what makes (n, rows, cols) readings those of a board with them."""
    shape = board.supposed.shape
    count = rng.integers(1, 4)
    cells = [tuple(np.unravel_index(k, shape))
             for k in rng.choice(np.prod(shape), count, replace=False)]  # fmt: skip
    sigmas = {cell: rng.uniform(5.0, 40.0) for cell in cells}
    jumps = {cell: rng.choice([-1, 1]) * rng.uniform(20.0, 200.0) for cell in cells}

    def spoil(frames: np.ndarray) -> np.ndarray:
        frames, full, n = frames.copy(), board.supposed.full_scale, len(frames)
        for cell in cells:
            own = frames[(slice(None), *cell)]
            if kind == "scatters":
                own = own + sigmas[cell] * rng.standard_normal(n) / full
            elif kind == "jumps":
                own = own + jumps[cell] * switching(n, rng) / full
            else:
                own = np.where(switching(n, rng), 0.0, own)
            frames[(slice(None), *cell)] = np.clip(own, 0.0, 1.0)
        return frames

    return cells, spoil


def resting(board: Unknown, n: int, factor, rng) -> np.ndarray:
    """(n, rows, cols) readings of the untouched board whose cells conduct (n, rows, cols) times
    what they do at rest."""
    shape = board.supposed.shape
    if np.ndim(factor) == 0:
        pictures = [board.expose(np.zeros(shape))] * n
    else:
        pictures = [board.expose(np.zeros(shape), f) for f in factor]
    return np.array([textile.sample(board.textile, board.supposed, p, rng) for p in pictures])


def sound(board: Unknown, kind: str, n: int, rng) -> np.ndarray:
    """Of a board without noisy cells; each reading's noise may be slow, or common to all."""
    frames = resting(board, n, 1.0, rng)
    size = rng.uniform(0.5, 2.5) / board.supposed.full_scale
    if kind == "slow noise":  # that of a board whose low-pass takes ten frames
        noise = size * rng.standard_normal(frames.shape)
        for k in range(1, n):
            noise[k] = 0.9 * noise[k - 1] + 0.19**0.5 * noise[k]
        frames = frames + noise
    elif kind == "hum":
        turn = 2.0 * np.pi * (rng.uniform(0.02, 0.5) * np.arange(n) + rng.random())
        frames = frames + 2**0.5 * size * np.sin(turn)[:, None, None]
    return np.clip(frames, 0.0, 1.0)


def noisy(board: Unknown, kind: str, n: int, rng) -> tuple[list, np.ndarray]:
    if kind != "loses contact":
        cells, spoil = noisy_cells(board, kind, rng)
        return cells, spoil(resting(board, n, 1.0, rng))
    shape = board.supposed.shape
    cell = tuple(int(rng.integers(k)) for k in shape)
    factor = np.ones((n, *shape))
    factor[(switching(n, rng), *cell)] = 1e-3
    return [cell], resting(board, n, factor, rng)


def touched(board: Unknown, kind: str, n: int, rng) -> np.ndarray:
    shape = board.supposed.shape
    if kind == "drifts":
        drift = rng.choice([-1, 1]) * rng.uniform(0.1, 0.3) * np.linspace(0.0, 1.0, n)
        return resting(board, n, np.ones(shape) * (1.0 + drift)[:, None, None], rng)
    at = rng.uniform(0.0, shape[0] - 1), rng.uniform(0.0, shape[1] - 1)
    newtons, width = np.exp(rng.uniform(np.log(0.3), np.log(3.0))), rng.uniform(0.4, 1.2)
    finger = scenes.finger(*shape, *at, newtons, width)
    change = rng.integers(2, n - 1)
    on = np.zeros(n, bool)
    if kind == "comes":
        on[change:] = True
    elif kind == "goes":
        on[:change] = True
    elif kind == "taps":
        on = switching(n, rng, least=2)
    else:
        first = rng.integers(1, n - 2)
        on[first : rng.integers(first + 1, n)] = True
    ratio = board.expose(np.zeros(shape)), board.expose(finger)
    return np.array(
        [textile.sample(board.textile, board.supposed, ratio[int(yes)], rng) for yes in on]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=20, help="of each size and kind")
    parser.add_argument("--seed", type=int, default=100, help="of the first board")
    args = parser.parse_args()
    print(f"of {args.boards} boards each: sound and refused; noisy and refused; named wrongly; ")
    print("off by, conductance of the worst cell; touched and taken")
    for shape in SHAPES:
        refused = dict.fromkeys((*SOUND, *NOISY), 0)
        taken, wrong, off, why = dict.fromkeys(TOUCHED, 0), 0, [], []
        for seed in range(args.seed, args.seed + args.boards):
            board = Unknown(shape, seed)
            rng = np.random.default_rng([seed, 7])
            true = measure_rest(board.at_rest(300), board.supposed).conductance
            for kind in refused:
                n = int(rng.choice([20, 30, 100, 300]))
                if kind in SOUND:
                    cells, frames = [], sound(board, kind, n, rng)
                else:
                    cells, frames = noisy(board, kind, n, rng)
                try:
                    rest = measure_rest(frames, board.supposed)
                except ValueError as error:
                    refused[kind] += 1
                    why.append(f"{seed} {kind}: {error}")
                    continue
                wrong += len(set(rest.noisy) - set(cells))
                off.append(np.abs(np.log(rest.conductance / true)).max())
            for kind in taken:
                n = int(rng.choice([20, 30, 100, 300]))
                try:
                    rest = measure_rest(touched(board, kind, n, rng), board.supposed)
                except ValueError:
                    continue
                taken[kind] += 1
                why.append(f"{seed} {kind} taken, {rest.noisy}")
        print(f"{shape}: {refused}; {wrong}; {np.quantile(off, 0.95):.1%}; {taken}", flush=True)
        for line in why[:8]:
            print("   ", line)


if __name__ == "__main__":
    main()
