# SPDX-License-Identifier: Apache-2.0
"""Train a learned inverse on scenes pushed through the forward model (paper section V-B)."""

from __future__ import annotations

import csv
import math
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from ..errors import TrainingDied
from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve
from . import network
from .dataset import TrainingConfig, make_pairs
from .soap import Soap

_LEAK = 0.05
# A frame counts in the loss by its mean load to the power -_EVEN; else light touches count nothing,
# and a finger of 0.5 N reads 0. Chosen of 0.5 and 0.6 (docs/lab/training.md).
_EVEN = 0.6
# Mean load, a share of the curve's end, below which frames count alike: 0.2 N on 256 cells.
_LIGHT = 0.2 / 256 / 9.8
_RISE = 0.03  # share of the run in which the learning rate rises
_USUAL = 0.03  # mean load of a frame that counts once


class _Net(nn.Module):
    """A network of standardised inputs: without that a third of the runs dies at once."""

    input_mean: torch.Tensor
    input_std: torch.Tensor
    context: nn.ModuleList
    head: nn.ModuleList

    def __init__(self, channels: int):
        super().__init__()
        self.register_buffer("input_mean", torch.zeros(channels, 1, 1))
        self.register_buffer("input_std", torch.ones(channels, 1, 1))


class PaperNet(_Net):
    """ADC picture -> force picture, the paper's architecture with its 4,544 parameters.

    One row kernel (1 x cols) and one column kernel (rows x 1) sum up each line and join the input
    as channels; three dilated 3x3 convolutions look around; four plain ones compute the force.
    All neurons are ReLUs.
    """

    def __init__(self, rows: int, cols: int):
        super().__init__(1)
        self.row = nn.Conv2d(1, 1, (1, cols))
        self.col = nn.Conv2d(1, 1, (rows, 1))
        self.context, self.head = _stages("paper", 3)

    def forward(self, adc):
        """(n, 1, rows, cols) ADC ratio -> (n, rows, cols) force, a share of the curve's maximum."""
        x = (adc - self.input_mean) / self.input_std
        lines = [torch.relu(layer(x)).expand_as(x) for layer in (self.row, self.col)]
        force = _through(torch.cat([x, *lines], 1), self.context, self.head).squeeze(1)
        return _last(force, self.training)


class PhysicsNet(_Net):
    """What the physics says -> force picture: the paper's later stages, 5,078 parameters.

    Its inputs are `network.physics_inputs`. Its outputs say what to add to the fixed point's force
    and by how much to scale it: with a scale of -1 the answer is the network's own.
    """

    def __init__(self):
        super().__init__(network.PHYSICS_INPUTS)
        self.context, self.head = _stages("physics", network.PHYSICS_INPUTS)

    def forward(self, inputs):
        """(n, 5, rows, cols) -> (n, rows, cols) force, as a share of the curve's maximum."""
        x = (inputs - self.input_mean) / self.input_std
        added, scaled = _through(x, self.context, self.head).unbind(1)
        force = added + (1.0 + scaled) * inputs[:, network.FIXED_POINT]
        return _last(force, self.training)


def _stages(kind: str, channels: int) -> tuple[nn.ModuleList, nn.ModuleList]:
    """Make the paper's dilated convolutions side by side, and the plain ones behind them."""
    context = [nn.Conv2d(channels, 9, 3, padding=d, dilation=d) for d in network.DILATIONS]
    head = [nn.Conv2d(a, b, 3, padding=1) for a, b in network.head(kind)]
    return nn.ModuleList(context), nn.ModuleList(head)


def _through(x, context, head):
    """(n, channels, rows, cols) -> what the last convolution says, before its ReLU."""
    x = torch.relu(torch.cat([layer(x) for layer in context], 1))  # (n, 27, rows, cols)
    *hidden, last = head
    for layer in hidden:
        x = torch.relu(layer(x))
    return last(x)


def _last(force, training: bool):
    """Apply the output neuron: a ReLU, which leaks in training.

    Most cells are at rest, so that the answer 0 everywhere is tempting, and a plain ReLU would
    never come back from it.
    """
    return nn.functional.leaky_relu(force, _LEAK if training else 0.0)


def make_net(kind: str, rows: int, cols: int) -> PaperNet | PhysicsNet:
    """Make a new network of `network.NETWORKS`, He-initialised from torch's global seed.

    The physics network starts as the fixed point: its last weights are 0. Of the paper's, neurons
    that have no sibling start open: with random signs six of ten runs lost both for good.
    """
    net = PaperNet(rows, cols) if kind == "paper" else PhysicsNet()
    parameters = dict(net.named_parameters())
    for name, values in parameters.items():
        if name.endswith("weight"):
            nn.init.kaiming_normal_(values, nonlinearity="relu")
        else:
            nn.init.zeros_(values)
    last = f"head.{len(net.head) - 1}"
    if kind == "physics":
        nn.init.zeros_(parameters[f"{last}.weight"])
    else:
        nn.init.constant_(parameters[f"{last}.bias"], 0.1)
        for line in ("row", "col"):
            weight = parameters[f"{line}.weight"]
            nn.init.constant_(weight, 1.0 / weight.numel())
            nn.init.ones_(parameters[f"{line}.bias"])
    return net


@dataclass
class _Best:
    """The best epoch so far."""

    error: float  # of the validation [g a cell]
    epoch: int  # its number, from 1; -1: none yet
    state: dict[str, torch.Tensor]  # of the net after it


def train(
    circuit: Circuit,
    curve: PressureCurve,
    config: TrainingConfig,
    out: Path,
    resume: bool = True,
    track=lambda items, **_: items,
    say=print,
) -> Path:
    """Train a network, on a GPU where there is one; returns its weights, ``out / "NETWORK.npz"``.

    After each epoch ``out / "checkpoint.pt"`` holds the whole state: a run that was killed goes
    on from its last epoch to the same result. ``out / "history.csv"`` has a line per epoch.

    Args:
        track: wraps an iterable and takes ``desc=``, ``total=``, as tqdm does.
        say: takes one line of text.

    Raises:
        TrainingDied: the run is lost; the message says how it shows.
        ValueError: the checkpoint in `out` belongs to another run.
    """
    # The networks are given readings without the stripes' share (`solvers._one`).
    circuit = replace(circuit, r_line=0.0)
    out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # a GPU's sums in a fixed order
    torch.use_deterministic_algorithms(True)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.manual_seed(config.seed)
    run = {"config": asdict(config), "circuit": circuit.describe(), "curve": curve.describe()}
    scale = curve.max_force
    checkpoint = out / "checkpoint.pt"
    state = _resumed(checkpoint, run, device) if resume and checkpoint.exists() else None
    pairs = _pairs(circuit, curve, config, "train", device, track)
    validation = _pairs(circuit, curve, config, "validation", device, track)
    inputs, target = pairs
    constant = _constant_loss(target, config.loss)

    net = make_net(config.network, *circuit.shape)
    if config.start:
        net.load_state_dict(_state_of(config, circuit.shape))
    else:
        net.input_mean.copy_(inputs.mean((0, 2, 3))[:, None, None])
        net.input_std.copy_(inputs.std((0, 2, 3))[:, None, None])
    net = nn.utils.convert_conv2d_weight_memory_format(net.to(device), torch.channels_last)
    optimizer = _optimizer(net, config)
    best = _Best(math.inf, -1, _copy_of(net))
    history: list[dict] = []
    if state is not None:
        net.load_state_dict(state["net"])
        optimizer.load_state_dict(state["optimizer"])
        best, history = _Best(**state["best"]), state["history"]
        say(f"resuming {checkpoint} after epoch {len(history)} of {config.epochs}")

    for epoch in range(len(history), config.epochs):
        train_loss = _train_epoch(net, optimizer, pairs, config, epoch, track)
        error, spread = _validate(net, *validation)
        error_g = error * scale / GRAM
        history.append({"epoch": epoch + 1, "loss": train_loss, "validation_g": error_g})
        if error_g < best.error:
            best = _Best(error_g, epoch + 1, _copy_of(net))
        _check_alive(epoch + 1, train_loss, constant, spread)
        _save_atomically(
            checkpoint,
            {
                "run": run,
                "net": net.state_dict(),
                "optimizer": optimizer.state_dict(),
                "best": vars(best),
                "history": history,
            },
        )
        _write_history(out / "history.csv", history)
        say(
            f"epoch {epoch + 1}/{config.epochs}: loss {train_loss:.5f}, "
            f"validation {error_g:.2f} g a cell, best {best.error:.2f} (epoch {best.epoch})"
        )
    path = out / f"{config.network}.npz"
    meta = run | {"epoch": best.epoch, "validation_g": best.error}
    network.save(path, {k: v.cpu().numpy() for k, v in best.state.items()}, meta)
    return path


def _resumed(checkpoint: Path, run: dict, device: str) -> dict:
    """Return what the run's checkpoint holds; ValueError if it is damaged or another run's."""
    advice = "give another --out, or --restart to begin anew"
    try:
        state = torch.load(checkpoint, weights_only=True, map_location=device)
        made = state["run"]
        changed = [k for k in run["config"] if made["config"].get(k) != run["config"][k]]
        changed += [k for k in ("circuit", "curve") if made[k] != run[k]]
        absent = {"net", "optimizer", "best", "history"} - state.keys()
    except Exception as error:  # whatever a foreign or damaged file raises
        raise ValueError(f"{checkpoint}: is no checkpoint of a training: {advice}") from error
    if absent:
        raise ValueError(f"{checkpoint}: {min(absent)} is missing: {advice}")
    if made != run:
        raise ValueError(
            f"{checkpoint} belongs to a run with another {', '.join(changed)}: {advice}"
        )
    return state


def _state_of(config: TrainingConfig, shape: tuple[int, int]) -> dict:
    """Return the state of the weights to start from; ValueError if they are of another network."""
    start = config.start
    weights = network.shipped(start) if start in network.NETWORKS else network.load(start)
    if weights.kind != config.network:
        raise ValueError(f"start = {start!r}: of a {weights.kind} network, not {config.network!r}")
    if weights.kind == "paper" and (weights.rows, weights.cols) != shape:
        raise ValueError(
            f"start = {start!r}: a paper network's lines are those of its skin, "
            f"{weights.rows} x {weights.cols}, not {shape[0]} x {shape[1]}"
        )
    return {name: torch.from_numpy(np.array(array)) for name, array in weights.state.items()}


def _pairs(
    circuit: Circuit, curve: PressureCurve, config: TrainingConfig, which: str, device: str, track
) -> tuple[torch.Tensor, torch.Tensor]:
    """Make the pairs "train" or "validation": inputs, and force as a share of the curve's end."""
    validation = which == "validation"
    n = config.validation if validation else config.pairs
    inputs, force = make_pairs(
        circuit,
        curve,
        n,
        config.network,
        config.readout,
        (config.seed, validation),
        lambda chunks: track(chunks, desc=f"{which} pairs"),
    )
    target = torch.from_numpy(force) / curve.max_force
    return torch.from_numpy(inputs).to(device), target.to(device)


def _train_epoch(
    net: _Net,
    optimizer: torch.optim.Optimizer,
    pairs: tuple[torch.Tensor, torch.Tensor],
    config: TrainingConfig,
    epoch: int,
    track,
) -> float:
    """Train the net on all pairs once, in an order of the epoch's own; return the mean loss."""
    inputs, target = pairs
    steps = math.ceil(config.pairs / config.batch)
    order = torch.randperm(
        config.pairs, generator=torch.Generator().manual_seed(config.seed * 100_003 + epoch)
    )
    net.train()
    total = 0.0
    batches = track(order.split(config.batch), desc=f"epoch {epoch + 1}/{config.epochs}")
    for step, pick in enumerate(batches):
        progress = (epoch + step / steps) / config.epochs
        for group in optimizer.param_groups:
            group["lr"] = config.rate * _schedule(progress)
        optimizer.zero_grad(set_to_none=True)
        loss = _loss(net(inputs[pick]), target[pick], config.loss)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
        total += loss.item() * len(pick)
    return total / config.pairs


def _schedule(progress: float) -> float:
    """Share of the highest learning rate at a share of the run."""
    if progress < _RISE:
        return progress / _RISE + 1e-3
    return 0.5 * (1.0 + math.cos(math.pi * (progress - _RISE) / (1.0 - _RISE)))


def _optimizer(net, config: TrainingConfig):
    if config.optimizer == "sgd":
        return torch.optim.SGD(net.parameters(), lr=config.rate, momentum=0.0)
    return Soap(net.parameters(), lr=config.rate)


def _loss(output, target, kind: str):
    if kind == "mse":
        return (output - target).square().mean()
    counts = ((target.mean((1, 2)) + _LIGHT) / _USUAL) ** -_EVEN
    return ((output - target).abs().mean((1, 2)) * counts).mean()


def _constant_loss(target, kind: str) -> float:
    """Loss of the best answer that ignores the reading: median (l1) or mean (mse)."""
    best = target.median() if kind == "l1" else target.mean()
    return _loss(best.expand_as(target), target, kind).item()


@torch.inference_mode()
def _validate(net, inputs, target) -> tuple[float, float]:
    """Mean absolute error, and the spread of the outputs (0: the net is dead)."""
    net.eval()
    outputs = torch.cat([net(part) for part in inputs.split(1000)])
    return (outputs - target).abs().mean().item(), outputs.std().item()


def _check_alive(epoch: int, loss: float, constant: float, spread: float) -> None:
    if not math.isfinite(loss):
        raise TrainingDied(f"epoch {epoch}: the loss is {loss}; try a lower --rate")
    if spread < 1e-6:
        raise TrainingDied(
            f"epoch {epoch}: all outputs are equal (dead ReLUs); try another --seed or lower --rate"
        )
    if epoch >= 3 and loss > 0.98 * constant:
        raise TrainingDied(
            f"epoch {epoch}: loss {loss:.5f} is that of a constant answer ({constant:.5f}); "
            "try another --seed or --rate"
        )


def _copy_of(net: nn.Module) -> dict[str, torch.Tensor]:
    """Return the net's state now, free of memory layouts."""
    return {k: v.detach().clone().contiguous() for k, v in net.state_dict().items()}


def _save_atomically(path: Path, state: dict) -> None:
    part = path.with_suffix(".part")
    torch.save(state, part)
    os.replace(part, path)


def _write_history(path: Path, history: list[dict]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, history[0])
        writer.writeheader()
        writer.writerows(history)
