"""Train the learned inverse on scenes pushed through the forward model (paper section V-B)."""

from __future__ import annotations

import csv
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from . import network, scenes
from .circuit import Circuit, forward
from .curve import GRAM, PressureCurve

_CHUNK = 2000  # scenes made at a time: bounds memory, and seeds each chunk by its number
# Families of the chunks, in turn. In equal parts, random scenes would rule the loss: their error
# is several times that of blobs.
_MIX = ("blobs", "rects", "blobs", "random", "blobs", "rects")


class PaperNet(nn.Module):
    """ADC picture -> force picture, the paper's architecture with its 4,544 parameters.

    One row kernel (1 x cols) and one column kernel (rows x 1) sum up each line and join the input
    as channels; three dilated 3x3 convolutions look around; four plain ones compute the force.
    All neurons are ReLUs.

    Args:
        rows, cols: size of the skin in cells.
        adc_mean, adc_std: input standardisation (fixed, not trained): without it a third of the
            runs dies at once.
    """

    def __init__(self, rows: int, cols: int, adc_mean: float = 0.0, adc_std: float = 1.0):
        super().__init__()
        self.register_buffer("adc_mean", torch.tensor(float(adc_mean)))
        self.register_buffer("adc_std", torch.tensor(float(adc_std)))
        self.row = nn.Conv2d(1, 1, (1, cols))
        self.col = nn.Conv2d(1, 1, (rows, 1))
        self.context = nn.ModuleList(
            nn.Conv2d(3, 9, 3, padding=d, dilation=d) for d in network.DILATIONS
        )
        self.head = nn.ModuleList(
            nn.Conv2d(c_in, c_out, 3, padding=1)
            for c_in, c_out in ((27, 9), (9, 9), (9, 9), (9, 1))
        )

    def initialise(self):
        """He initialisation; the last bias starts above 0, so that the output ReLU is open."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
                nn.init.zeros_(module.bias)
        nn.init.constant_(self.head[-1].bias, 0.1)

    def forward(self, adc):
        """(n, rows, cols) ADC ratio -> (n, rows, cols) force, as a share of the curve's maximum."""
        x = ((adc - self.adc_mean) / self.adc_std).unsqueeze(1)
        lines = [torch.relu(layer(x)).expand_as(x) for layer in (self.row, self.col)]
        x = torch.cat([x, *lines], 1)  # (n, 3, rows, cols)
        x = torch.relu(torch.cat([layer(x) for layer in self.context], 1))  # (n, 27, rows, cols)
        for layer in self.head:
            x = torch.relu(layer(x))
        return x.squeeze(1)


class TrainingDied(RuntimeError):
    """The run cannot recover: outputs all equal, no better than a constant, or not finite."""


@dataclass(frozen=True)
class TrainingConfig:
    """What a run depends on besides circuit and curve; kept beside its weights.

    Attributes:
        pairs, validation: number of (reading, force) pairs to learn from and to pick the best
            epoch by; half of them blobs, a third rects, a sixth random scenes.
        epochs, batch: passes over the pairs, and pairs per step.
        rate: highest learning rate; a short linear rise, then a cosine to 0.
        loss: "mse" as the paper, or "l1", which fits the mean absolute error that is reported.
        optimizer: "sgd" as the paper, or "adam".
        readout: what the readings are like, see `scenes.read_out`.
        seed: of scenes, initial weights and order.
    """

    pairs: int = 100_000
    validation: int = 30_000
    epochs: int = 100
    batch: int = 128
    rate: float = 1e-2
    loss: str = "l1"
    optimizer: str = "adam"
    readout: str = "ideal"
    seed: int = 0

    def __post_init__(self):
        for name in ("pairs", "validation", "epochs", "batch"):
            if not isinstance(getattr(self, name), int) or getattr(self, name) < 1:
                raise ValueError(
                    f"{name} = {getattr(self, name)!r}: must be a whole number above 0"
                )
        for name, allowed in (
            ("loss", ("l1", "mse")),
            ("optimizer", ("adam", "sgd")),
            ("readout", scenes.READOUTS),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be one of {allowed}")
        if not self.rate > 0:
            raise ValueError(f"rate = {self.rate!r}: must be above 0")


def make_pairs(circuit, curve, n: int, readout: str, seed, track=lambda chunks: chunks):
    """Draw n scenes of all families and their readings.

    Args:
        seed: an int or a tuple of them; chunks are seeded by number, so that the result does not
            depend on how the work is divided.
        track: wraps the iterable of chunks, for a progress bar.

    Returns:
        (n, rows, cols) ADC ratio, (n, rows, cols) force [N], both float32.
    """
    adc = np.empty((n, *circuit.shape), np.float32)
    force = np.empty_like(adc)
    for chunk in track(range(math.ceil(n / _CHUNK))):
        rng = np.random.default_rng([*np.atleast_1d(seed), chunk])
        family = _MIX[chunk % len(_MIX)]
        here = slice(chunk * _CHUNK, min((chunk + 1) * _CHUNK, n))
        truth = scenes.sample(family, here.stop - here.start, *circuit.shape, rng)
        truth = np.minimum(truth, curve.max_force) * circuit.populated
        reading = forward(circuit, curve.resistance(truth))
        adc[here] = scenes.read_out(circuit, reading, readout, rng)
        force[here] = truth
    return adc, force


def train(
    circuit: Circuit,
    curve: PressureCurve,
    config: TrainingConfig,
    out: Path,
    resume: bool = True,
    track=lambda items, **_: items,
    say=print,
) -> Path:
    """Train the paper's net; returns the path of its weights, ``out / "cnn.npz"``.

    After each epoch ``out / "checkpoint.pt"`` holds the whole state: a run that was killed goes
    on from its last epoch to the same result. ``out / "history.csv"`` has a line per epoch.

    Args:
        track: wraps an iterable and takes ``desc=``, ``total=``, as tqdm does.
        say: takes one line of text.

    Raises:
        TrainingDied: the run is lost; the message says how it shows.
        ValueError: the checkpoint in `out` belongs to another run.
    """
    out.mkdir(parents=True, exist_ok=True)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(config.seed)
    run = {
        "config": asdict(config),
        "circuit": circuit.describe(),
        "curve": curve.describe(),
    }
    scale = curve.max_force
    sets = {}
    for which, n in (("train", config.pairs), ("validation", config.validation)):
        bar = lambda chunks, which=which: track(chunks, desc=f"{which} pairs")  # noqa: E731
        seed = (config.seed, which == "validation")
        adc, force = make_pairs(circuit, curve, n, config.readout, seed, bar)
        sets[which] = torch.from_numpy(adc), torch.from_numpy(force) / scale
    adc, target = sets["train"]
    constant = _constant_loss(target, config.loss)

    net = PaperNet(*circuit.shape, adc.mean().item(), adc.std().item())
    net.initialise()
    net = net.to(memory_format=torch.channels_last)
    optimizer = _optimizer(net, config)
    best = {"error": math.inf, "epoch": -1, "state": _copy_of(net)}
    history: list[dict] = []
    checkpoint = out / "checkpoint.pt"
    if resume and checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        if state["run"] != run:
            changed = [
                k for k in run["config"] if state["run"]["config"].get(k) != run["config"][k]
            ]
            changed += [k for k in ("circuit", "curve") if state["run"][k] != run[k]]
            raise ValueError(
                f"{checkpoint} belongs to a run with another {', '.join(changed)}: "
                "give another --out, or --restart to begin anew"
            )
        net.load_state_dict(state["net"])
        optimizer.load_state_dict(state["optimizer"])
        best, history = state["best"], state["history"]
        say(f"resuming {checkpoint} after epoch {len(history)} of {config.epochs}")

    steps = math.ceil(config.pairs / config.batch)
    for epoch in range(len(history), config.epochs):
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
            loss = _loss(net(adc[pick]), target[pick], config.loss)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimizer.step()
            total += loss.item() * len(pick)
        train_loss = total / config.pairs
        error, spread = _validate(net, *sets["validation"])
        error_g = error * scale / GRAM
        history.append({"epoch": epoch + 1, "loss": train_loss, "validation_g": error_g})
        if error_g < best["error"]:
            best = {"error": error_g, "epoch": epoch + 1, "state": _copy_of(net)}
        _check_alive(epoch + 1, train_loss, constant, spread)
        _save_atomically(
            checkpoint,
            {
                "run": run,
                "net": net.state_dict(),
                "optimizer": optimizer.state_dict(),
                "best": best,
                "history": history,
            },
        )
        _write_history(out / "history.csv", history)
        say(
            f"epoch {epoch + 1}/{config.epochs}: loss {train_loss:.5f}, "
            f"validation {error_g:.2f} g a cell, best {best['error']:.2f} (epoch {best['epoch']})"
        )
    path = out / "cnn.npz"
    meta = run | {"epoch": best["epoch"], "validation_g": best["error"]}
    network.save(path, {k: v.numpy() for k, v in best["state"].items()}, meta)
    return path


def _schedule(progress: float, rise: float = 0.03) -> float:
    """Share of the highest learning rate at a share of the run."""
    if progress < rise:
        return progress / rise + 1e-3
    return 0.5 * (1.0 + math.cos(math.pi * (progress - rise) / (1.0 - rise)))


def _optimizer(net, config: TrainingConfig):
    if config.optimizer == "sgd":
        return torch.optim.SGD(net.parameters(), lr=config.rate, momentum=0.0)
    return torch.optim.Adam(net.parameters(), lr=config.rate)


def _loss(output, target, kind: str):
    return (output - target).abs().mean() if kind == "l1" else (output - target).square().mean()


def _constant_loss(target, kind: str) -> float:
    """Loss of the best answer that ignores the reading: median (l1) or mean (mse)."""
    best = target.median() if kind == "l1" else target.mean()
    return _loss(best.expand_as(target), target, kind).item()


@torch.inference_mode()
def _validate(net, adc, target) -> tuple[float, float]:
    """Mean absolute error, and the spread of the outputs (0: the net is dead)."""
    net.eval()
    outputs = torch.cat([net(part) for part in adc.split(1000)])
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


def _copy_of(net: nn.Module) -> dict:
    """The net's state now, free of memory layouts."""
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
