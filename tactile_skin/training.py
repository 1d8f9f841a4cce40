"""Train the learned inverse on scenes pushed through the forward model (paper section V-B)."""

from __future__ import annotations

import csv
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from . import network, scenes
from .circuit import Circuit, forward
from .curve import GRAM, PressureCurve

_CHUNK = 2000  # scenes made at a time: bounds memory, and seeds each chunk by its number


class TrainingDied(RuntimeError):
    """The run cannot recover: outputs all equal, no better than a constant, or not finite."""


@dataclass(frozen=True)
class TrainingConfig:
    """What a run depends on besides circuit and curve; kept beside its weights.

    Attributes:
        pairs, validation: number of (reading, force) pairs to learn from and to pick the best
            epoch by; one third from each scene family.
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
    rate: float = 4e-3
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
    """Draw n scenes, a third of each family, and their readings.

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
        family = scenes.FAMILIES[chunk % len(scenes.FAMILIES)]
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
    """Train the paper's net; returns the path of its weights, ``out / "cnn.pt"``.

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

    net = network.PaperNet(*circuit.shape, adc.mean().item(), adc.std().item())
    net.initialise()
    net = net.to(memory_format=torch.channels_last)
    optimizer = _optimizer(net, config)
    best = {"error": math.inf, "epoch": -1, "state": network.plain_state(net)}
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
            best = {"error": error_g, "epoch": epoch + 1, "state": network.plain_state(net)}
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
    path = out / "cnn.pt"
    meta = run | {"epoch": best["epoch"], "validation_g": best["error"]}
    network.save(path, best["state"], meta)
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


def _save_atomically(path: Path, state: dict) -> None:
    part = path.with_suffix(".part")
    torch.save(state, part)
    os.replace(part, path)


def _write_history(path: Path, history: list[dict]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, history[0])
        writer.writeheader()
        writer.writerows(history)
