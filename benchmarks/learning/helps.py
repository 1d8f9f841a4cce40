# SPDX-License-Identifier: Apache-2.0
"""Does compensation help to learn: what lies there, and where, by raw, naive and compensated touch.

One of four bodies of 10 to 60 N lies on the skin, a finger of 2 to 20 N presses elsewhere. The same
small network learns from each picture, with the same frames and epochs, on one board; it is asked
about frames of that board, and of others (r_par 30 % off, other rests, 10 % scatter), each of whose
circuit is known to what compensates.
"""

from __future__ import annotations

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.simulation.scenes import finger, read_out
from tactile_skin.simulation.textile import Sample, Textile

from .. import harness

BODIES = "disc", "box", "ring", "pair"
FORCE = 10.0, 60.0  # N
FINE = 4  # points a cell and side
WAYS = "raw", "naive", "auto"


def body(kind: str, y: float, x: float, turn: float, size: float, rows: int, cols: int):
    """(rows, cols) share of its force on each cell."""
    v, u = (np.mgrid[: rows * FINE, : cols * FINE] + 0.5) / FINE - 0.5
    v, u = v - y, u - x
    v, u = v * np.cos(turn) + u * np.sin(turn), u * np.cos(turn) - v * np.sin(turn)
    r = np.hypot(v, u) / size
    if kind == "disc":
        shape = np.sqrt(np.maximum(1.0 - r**2, 0.0))
    elif kind == "box":
        shape = 1.0 * (np.maximum(abs(v), 1.6 * abs(u)) < size)
    elif kind == "ring":
        shape = 1.0 * ((r < 1.0) & (r > 0.55))
    else:
        ends = (np.hypot(v - side * 0.75 * size, u) for side in (-1.0, 1.0))
        shape = sum(np.sqrt(np.maximum(1.0 - (d / (0.45 * size)) ** 2, 0.0)) for d in ends)
    cells = shape.reshape(rows, FINE, cols, FINE).mean((1, 3))
    return cells / cells.sum()


def scenes(n: int, rng, rows=16, cols=16):
    """(n, rows, cols) forces [N], which body, and (n, 2) where it lies [cells]."""
    force, kinds, places = np.zeros((n, rows, cols)), rng.integers(len(BODIES), size=n), []
    for k in range(n):
        y, x = rng.uniform(3.5, rows - 4.5), rng.uniform(3.5, cols - 4.5)
        given = rng.uniform(0.0, np.pi), rng.uniform(2.0, 3.2)
        force[k] = rng.uniform(*FORCE) * body(BODIES[kinds[k]], y, x, *given, rows, cols)
        while True:
            at = rng.uniform(0.0, rows - 1.0), rng.uniform(0.0, cols - 1.0)
            if np.hypot(at[0] - y, at[1] - x) > 5.0:
                break
        force[k] += finger(rows, cols, *at, rng.uniform(2.0, 20.0))
        places.append((y, x))
    return force, kinds, np.array(places)


def pictures(force, circuit: Circuit, textile: Textile, seed: int, rng) -> dict[str, np.ndarray]:
    """What each way of reading makes of it: (n, rows, cols)."""
    curve = PressureCurve()
    sample = Sample(textile, circuit, curve, seed)
    adc = read_out(circuit, sample.expose(force), "scan", rng)
    own = curve.resting_at(1.0 / sample.matrix.fabric.rest)
    found = {"raw": adc}
    for way in WAYS[1:]:
        found[way] = np.array([compensate(a, circuit, own, method=way).force for a in adc])
    return found


def train(x, kinds, places, epochs: int, seed: int):
    """Return a function of pictures: which body, and where."""
    import torch
    from torch import nn

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    mean, std = x.mean(), x.std()
    layers = [nn.Conv2d(1, 12, 3, padding=1), nn.ReLU(), nn.Conv2d(12, 24, 3, 2, 1), nn.ReLU()]
    layers += [nn.Conv2d(24, 32, 3, 2, 1), nn.ReLU(), nn.Flatten(), nn.Linear(512, 64), nn.ReLU()]
    net = nn.Sequential(*layers, nn.Linear(64, len(BODIES) + 2))

    def ready(of):
        return torch.tensor((of - mean) / std, dtype=torch.float32)[:, None]

    inputs, kind = ready(x), torch.tensor(kinds)
    place = torch.tensor(places / 8.0 - 1.0, dtype=torch.float32)
    way, batch = torch.optim.Adam(net.parameters(), 2e-3), 50
    for _ in range(epochs):
        for part in torch.randperm(len(x)).split(batch):
            out = net(inputs[part])
            loss = nn.functional.cross_entropy(out[:, :-2], kind[part])
            loss = loss + 4.0 * nn.functional.mse_loss(out[:, -2:], place[part])
            way.zero_grad()
            loss.backward()
            way.step()

    def answer(of):
        with torch.no_grad():
            out = net(ready(of))
        return out[:, :-2].argmax(1).numpy(), (out[:, -2:].numpy() + 1.0) * 8.0

    return answer


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--frames", type=int, default=1500, help="to learn from")
    parser.add_argument("--tests", type=int, default=300, help="frames of each test")
    parser.add_argument("--boards", type=int, default=3, help="others")
    parser.add_argument("--epochs", type=int, default=30)
    parser.add_argument("--seeds", type=int, default=5)
    args = parser.parse_args(arguments)
    rng = np.random.default_rng(61)
    own, kind = Circuit(), Textile(rest=0.03, scatter=0.05)
    force, kinds, places = scenes(args.frames, rng)
    learnt = pictures(force, own, kind, 0, rng)
    tests: dict[str, list] = {"the same board": [], "other boards": []}
    for board in range(args.boards + 1):
        r_par = own.r_par * (1.0 if not board else rng.choice((0.7, 1.3)))
        circuit = own if not board else Circuit(r_par=float(r_par))
        textile = kind if not board else Textile(rest=0.05, scatter=0.1)
        asked, *truth = scenes(args.tests, rng)
        seen = pictures(asked, circuit, textile, board, rng)
        tests["other boards" if board else "the same board"].append((seen, *truth))
    rows = []
    for way in WAYS:
        scores: dict[str, list] = {name: [] for name in tests}
        for seed in range(args.seeds):
            answer = train(learnt[way], kinds, places, args.epochs, seed)
            for name, boards in tests.items():
                right, off = [], []
                for seen, which, where in boards:
                    said, at = answer(seen[way])
                    right.append(said == which)
                    off.append(np.hypot(*(at - where).T))
                scores[name].append((100.0 * np.mean(right), np.mean(off)))
        for name, of in scores.items():
            mean, error = np.mean(of, 0), np.std(of, 0, ddof=1) / np.sqrt(args.seeds)
            row = {"picture": way, "asked about": name, "right": mean[0], "right_error": error[0]}
            rows.append(row | {"off": mean[1], "off_error": error[1]})
            print(
                f"{way:6} {name:15} {mean[0]:5.1f} +- {error[0]:.1f} % right, "
                f"{mean[1]:.2f} +- {error[1]:.2f} cells off"
            )
    return rows


if __name__ == "__main__":
    harness.run(main)
