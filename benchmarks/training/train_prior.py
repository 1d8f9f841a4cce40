# SPDX-License-Identifier: Apache-2.0
"""Trains the network behind `map`'s last step.

Scenes: six tenths bodies whose sizes, number, texture and noise differ from scene to scene, blobs,
rects, and clouds (smooth random fields above a threshold). Each is read with a noise of 0.3 to 2
ADC steps, half of them as `scan`, and fitted under the built-in prior alone. What is minimised is
the error after the last step, whose equations PyTorch solves, so the network learns what the
readings leave open. No picture of the family `pictures` is drawn. About an hour on one core.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import NamedTuple
from unittest import mock

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from torch import nn
from tqdm import tqdm

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.learning import denoiser
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import bodies as bodies_module
from tactile_skin.simulation import scenes
from tactile_skin.solvers import prior
from tactile_skin.solvers.reading import SCAN_NOISE

from .. import harness

CIRCUIT, CURVE = Circuit(), PressureCurve()
SHARES = {"bodies": 0.59, "blobs": 0.16, "rects": 0.16, "clouds": 0.09}
BATCH = 32
RATE = 5e-3  # of Adam, largest
FARTHEST = 2.0  # change of x in the last step
TABLE_X = torch.tensor(CURVE._log_g, dtype=torch.float32)
TABLE_ROOT = torch.tensor(CURVE._root, dtype=torch.float32)


class Fit(NamedTuple):
    """One fit under the built-in prior: n unknowns of 16 x 16 cells."""

    inputs: np.ndarray  # (5, rows, cols)
    x: np.ndarray  # (cells,) log g
    unknowns: np.ndarray  # (n,) flat
    hessian: np.ndarray  # (n, n) J^T J
    pull: np.ndarray  # (n,) J^T misfit
    std: np.ndarray  # (n,) of x
    force: np.ndarray  # (cells,) the truth [N]


def scene(family: str, rng) -> np.ndarray:
    """(rows, cols) force [N]."""
    if family == "clouds":
        grain = np.exp(rng.uniform(np.log(3.0), np.log(40.0)))
        field = gaussian_filter(rng.standard_normal((128, 128)), grain)
        field = np.maximum(field / field.std() - rng.uniform(-1.0, 1.5), 0.0) ** rng.uniform(0.6, 2)
        cells = field.reshape(16, 8, 16, 8).mean((1, 3))
        cells *= 1.0 + rng.uniform(0.0, 0.1) * rng.standard_normal(cells.shape)
        load = np.maximum(cells, 0.0) / max(cells.max(), 1e-3) * rng.uniform(30.0, 1000.0)
    elif family == "bodies":
        other = {
            "_TEXTURE": rng.uniform(0.05, 0.4),
            "_GRAIN": rng.uniform(3.0, 16.0),
            "_NOISE": rng.uniform(0.0, 0.12),
            "_MOST_BODIES": int(rng.integers(1, 7)),
        }
        half = rng.uniform(0.5, 1.5), rng.uniform(2.0, 6.0)
        with ExitStack() as stack:
            for name, value in other.items():
                stack.enter_context(mock.patch.object(bodies_module, name, value))
            load = bodies_module.bodies(1, *CIRCUIT.shape, rng, half=half)[0]
    else:
        return scenes.sample(family, 1, *CIRCUIT.shape, rng)[0]
    return np.minimum(np.clip(load, 0.0, scenes.MAX_LOAD) * GRAM, CURVE.max_force)


def fit(force: np.ndarray, rng) -> Fit | None:
    """The fit of one reading of it; None: nothing to learn from (the level prior, or no touch)."""
    adc, noise = forward(CIRCUIT, CURVE.resistance(force)), SCAN_NOISE
    if rng.random() < 0.5:
        adc = scenes.read_out(CIRCUIT, adc, "scan", rng)
    else:
        noise = float(np.exp(rng.uniform(np.log(0.3), np.log(2.0))))
        steps = np.rint((adc * CIRCUIT.full_scale + noise * rng.standard_normal(adc.shape)) * 8) / 8
        adc = np.clip(steps / CIRCUIT.full_scale, 0.0, 1.0)
    seen = []
    with mock.patch.object(prior, "with_neighbours", lambda *given: seen.append(given)):
        compensate(adc, CIRCUIT, CURVE, "map", noise=noise)
    if not seen or not seen[-1][2].unknowns.size:
        return None
    _, point, equations, std = seen[-1]
    free, information = equations.unknowns, np.triu(equations.information)
    unknown = np.zeros(std.shape, bool)
    unknown.flat[free] = True
    return Fit(
        denoiser.inputs(point.x, std, point.own, unknown, CIRCUIT.populated),
        np.log(point.model.g).ravel().astype(np.float32),
        free.astype(np.int64),
        information + np.triu(information, 1).T,
        point.pull.ravel()[free].astype(np.float32),
        np.clip(std.ravel()[free], *denoiser.STD).astype(np.float32),
        force.ravel().astype(np.float32),
    )


class Net(nn.Module):
    """What `denoiser.Denoiser` computes, on (n, 5, rows, cols)."""

    def __init__(self, channels: int, inner: int):
        super().__init__()

        def layer(a, b):
            return nn.Conv2d(a, b, 3, padding=1)

        self.add_module("in", layer(denoiser.INPUTS, channels))
        self.inner = nn.ModuleList(layer(channels, channels) for _ in range(inner))
        self.out = layer(channels, denoiser.OUTPUTS)
        nn.init.zeros_(self.out.bias)
        self.out.weight.data *= 0.1

    def forward(self, inputs):
        h = torch.relu(self.get_submodule("in")(inputs))
        for layer in self.inner:
            h = h + torch.relu(layer(h))
        return self.out(h)


def batch_of(fits: list[Fit]) -> tuple[torch.Tensor, ...]:
    """Stacked, padded to the most unknowns, and which are there."""
    most = max(f.unknowns.size for f in fits)

    def padded(name, fill=0):
        values = [getattr(f, name) for f in fits]
        out = np.full((len(fits), *(most,) * values[0].ndim), fill, values[0].dtype)
        for k, value in enumerate(values):
            out[(k, *(slice(len(value)),) * value.ndim)] = value
        return torch.from_numpy(out)

    def stacked(name):
        return torch.from_numpy(np.stack([getattr(f, name) for f in fits]))

    there = torch.tensor([[k < f.unknowns.size for k in range(most)] for f in fits])
    return (
        *(stacked(name) for name in ("inputs", "x", "force")),
        *(padded(name) for name in ("unknowns", "hessian", "pull")),
        padded("std", 1),
        there,
    )


def force_of(x: torch.Tensor) -> torch.Tensor:
    """Force [N] of log conductances, by the curve's table."""
    x = x.clamp(TABLE_X[0], TABLE_X[-1])
    k = torch.searchsorted(TABLE_X, x.detach().contiguous()).clamp(1, len(TABLE_X) - 1)
    share = (x - TABLE_X[k - 1]) / (TABLE_X[k] - TABLE_X[k - 1])
    return (TABLE_ROOT[k - 1] + share * (TABLE_ROOT[k] - TABLE_ROOT[k - 1])) ** 2


def last_step(net: Net, batch, turn: int) -> tuple[torch.Tensor, torch.Tensor]:
    """x (n, cells) after it, the unknowns' standard deviation; the net sees it turned."""
    inputs, x, _, unknowns, hessian, pull, std, there = batch
    turns = [(turn & 1, lambda p: p.flip(-1)), (turn & 2, lambda p: p.flip(-2))]
    turns.append((turn & 4, lambda p: p.transpose(-1, -2)))
    for taken, move in turns:
        inputs = move(inputs) if taken else inputs
    out = net(inputs)
    for taken, move in reversed(turns):
        out = move(out) if taken else out
    shift, log_share = (out[:, k].flatten(1).gather(1, unknowns) for k in (0, 1))
    precision = (std * torch.exp(log_share.clamp(*denoiser.SHARE))) ** -2
    factor = torch.linalg.cholesky(hessian + torch.diag_embed(precision))
    b = pull + precision * shift * std
    dx = torch.cholesky_solve(b[..., None], factor)[..., 0].clamp(-FARTHEST, FARTHEST) * there
    eye = torch.eye(hessian.shape[-1]).expand_as(hessian)
    spread = torch.linalg.solve_triangular(factor, eye, upper=False).square().sum(1).sqrt()
    return x.scatter_add(1, unknowns, dx), spread


def loss_of(net: Net, batch, turn: int) -> torch.Tensor:
    """Mean absolute error, of a frame's own before and in all; a little of the spread's own."""
    _, before, force, unknowns, *_, there = batch
    x, spread = last_step(net, batch, turn)
    error = (force_of(x) - force).abs().mean(1)
    was = (force_of(before) - force).abs().mean(1)
    truth = np.log(1.0 / CURVE.resistance(force.numpy().astype(float)))
    truth = torch.from_numpy(truth.astype(np.float32)).gather(1, unknowns)
    off = ((x.gather(1, unknowns) - truth) / spread).abs()
    likely = torch.where(off < 2.0, 0.5 * off**2, 2.0 * off - 2.0) + torch.log(spread)
    likely = (likely * there).sum() / there.sum()
    return 0.5 * (error / (was + 0.01)).mean() + 5.0 * error.mean() + 0.05 * likely


def train(net: Net, fits: list[Fit], passes: int, rng) -> None:
    optimizer = torch.optim.Adam(net.parameters())
    steps = passes * (len(fits) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps + 1)
    size = np.array([f.unknowns.size for f in fits])
    for _ in tqdm(range(passes), "passes", disable=None):
        order = np.argsort(size * np.exp(0.15 * rng.standard_normal(size.size)))  # alike in size
        batches = [order[k : k + BATCH] for k in range(0, len(order) - BATCH + 1, BATCH)]
        rng.shuffle(batches)
        for chosen in batches:
            optimizer.zero_grad()
            loss_of(net, batch_of([fits[k] for k in chosen]), int(rng.integers(8))).backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            schedule.step()


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("out", metavar="OUT.npz")
    parser.add_argument("--fits", type=int, default=17_000)
    parser.add_argument("--passes", type=int, default=11)
    parser.add_argument("--channels", type=int, default=16)
    parser.add_argument("--inner", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(arguments)
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    rng, fits = np.random.default_rng([7, args.seed]), []
    families = rng.choice(list(SHARES), args.fits, p=list(SHARES.values()))
    for family in tqdm(families, "fits", disable=None):
        if (found := fit(scene(str(family), rng), rng)) is not None:
            fits.append(found)
    net = Net(args.channels, args.inner)
    train(net, fits, args.passes, rng)
    np.savez(args.out, **{name: value.numpy() for name, value in net.state_dict().items()})


if __name__ == "__main__":
    harness.run(main)
