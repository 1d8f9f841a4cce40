"""`tactile-skin train`, and networks of a skin that was calibrated."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from pathlib import Path

import numpy as np

from .. import extras
from ..arguments import check_folder
from ..bench import measure
from ..errors import TrainingDied
from ..learning import network
from ..learning.dataset import CHOICES, TrainingConfig
from ..middleware.config import SkinConfig, read_skin
from ..middleware.parameter_file import ParameterFile
from ..middleware.written import entered, replace_file

NETWORK_OF = {"cnn": "paper", "physics": "physics"}  # method -> its network
_AGAIN_EPOCHS = 20  # from weights of a skin like it (docs/lab/training.md)
_AGAIN_RATE = 3e-3  # the same
_SCORED = 300  # frames that new weights are compared on
_SEED = 2  # of these: unlike training's and validation's

EXAMPLES = (
    "A run that was stopped goes on when started again with the same --out.\n"
    "examples:\n"
    "  tactile-skin train --config mine.yaml --out my_weights\n"
    "  tactile-skin train --config mine.yaml --out my_weights "
    "--network physics --readout board\n"
    "  tactile-skin train --config mine.yaml --out my_weights --start paper --rate 0.003 "
    "--epochs 20\n"
    "then, with `weights: my_weights/physics.npz` under compensation in mine.yaml:\n"
    "  tactile-skin launch skin.launch.yaml config:=mine.yaml method:=physics"
)


def register(parser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("--config", type=Path, help="parameter file with circuit and curve")
    parser.add_argument(
        "--out", type=Path, default=Path("weights"), help="folder (default weights)"
    )
    parser.add_argument("--restart", action="store_true", help="ignore the checkpoint in --out")
    parser.add_argument(
        "--threads", type=int, default=os.cpu_count(), help="of the processor (default: all)"
    )
    about = {
        "pairs": "readings to learn from",
        "validation": "readings to pick the best epoch by",
        "epochs": "passes over the pairs",
        "batch": "pairs a step",
        "rate": "highest learning rate",
        "readout": "what the readings are like",
        "seed": "of scenes, weights and order",
        "start": "weights to go on from: a file, paper or physics",
    }
    for item in dataclasses.fields(TrainingConfig):
        allowed = CHOICES.get(item.name)
        choice = f"one of {', '.join(allowed)}" if allowed else ""
        default = "new ones" if item.default == "" else item.default
        words = about.get(item.name, ""), choice, f"default {default}"
        parser.add_argument(
            f"--{item.name}",
            type=type(item.default),
            default=item.default,
            choices=allowed,
            help="; ".join(filter(None, words)),
            metavar=item.name.upper(),
        )


def run(args) -> int:
    """Train, and say where the weights are."""
    check_folder(args.out)
    if args.threads < 1:
        raise ValueError(f"--threads = {args.threads}: must be 1 or more")
    names = [item.name for item in dataclasses.fields(TrainingConfig)]
    config = TrainingConfig(**{name: getattr(args, name) for name in names})
    path = train(read_skin(args.config), config, args.out, args.restart, args.threads)
    if path is None:
        return 1
    print(f"weights: {path}")
    return 0


def train(
    skin: SkinConfig, config: TrainingConfig, out: Path, restart: bool = False, threads: int = 0
) -> Path | None:
    """The weights, in the folder `out`; None: the run died, and it was said why.

    Args:
        threads: of the processor; 0: all.

    Raises:
        ValueError, OSError: weights to start from that are none.
        ModuleNotFoundError: PyTorch or tqdm is not installed.
    """
    if config.start and config.start not in network.NETWORKS:
        network.load(config.start)
    torch, tqdm = extras.torch("train"), extras.tqdm()
    torch.set_num_threads(threads or os.cpu_count() or 1)
    from ..learning import training

    def track(items, desc):
        return tqdm(items, desc=desc, leave=False, disable=None)

    circuit, curve = skin.circuit, skin.curve.usual
    try:
        return training.train(circuit, curve, config, out, not restart, track, tqdm.write)
    except TrainingDied as error:
        print(f"tactile-skin train: {error}", file=sys.stderr)
        return None


def again(skin: SkinConfig, kind: str) -> TrainingConfig:
    """How the network of a kind, "paper" or "physics", is trained for another skin: from the
    shipped weights, where they have its shape."""
    shipped = network.shipped(kind)
    readout = "board" if kind == "physics" else "ideal"
    if kind == "paper" and (shipped.rows, shipped.cols) != skin.circuit.shape:
        return TrainingConfig(network=kind, readout=readout)
    return TrainingConfig(
        network=kind, readout=readout, start=kind, epochs=_AGAIN_EPOCHS, rate=_AGAIN_RATE
    )


def misfit(path: Path) -> str:
    """Why the network that a parameter file configures is not of its skin, and the command that
    trains one; empty: it is, or the file configures none."""
    given = {p.name: p.value for p in ParameterFile(path).overrides("/compensation")}
    method, file = given.get("method", "auto"), given.get("weights", "")
    if method not in NETWORK_OF and not file:
        return ""
    skin = read_skin(path)
    weights = network.load(file) if file else network.shipped(NETWORK_OF[method])
    try:
        weights.check(skin.circuit, skin.curve)
    except ValueError as error:
        config, folder = again(skin, weights.kind), _beside(path)
        options = [
            f"--{item.name} {getattr(config, item.name)}"
            for item in dataclasses.fields(config)
            if getattr(config, item.name) != item.default
        ]
        trains = " ".join(
            ["tactile-skin train --config", str(path), "--out", str(folder), *options]
        )
        return (
            f"{error}.\nTo train it, half an hour: {trains}\n"
            f"then set `weights: {folder / weights.kind}.npz` under compensation in {path}; "
            "calibrate --train does both"
        )
    return ""


def _beside(path: Path) -> Path:
    """The folder of the weights of a parameter file's skin."""
    return path.with_suffix("")


def enter(path: Path, kind: str) -> bool:
    """Train a network for the skin of a parameter file, and enter its weights there.

    They are in a folder beside it. What they are worth, and how long it took, is printed. Whether
    the training succeeded.
    """
    skin, begun = read_skin(path), time.monotonic()
    weights = train(skin, again(skin, kind), _beside(path.resolve()), restart=True)
    if weights is None:
        return False
    entry = {"weights": str(weights)}
    replace_file(path, entered(path, "/**/compensation", entry, None))
    method = next(m for m, network in NETWORK_OF.items() if network == kind)
    print(f"trained in {(time.monotonic() - begun) / 60.0:.1f} min: {worth(skin, weights)}")
    print(f"weights: {weights}, entered in {path}. Use them: method:={method}")
    return True


def worth(skin: SkinConfig, path: Path) -> str:
    """The mean error of new weights and of the shipped ones, on the same new simulated frames of
    the skin's circuit and curve: `bodies`, read as `scan`. Readings without the stripes' share,
    as the networks are given."""
    circuit, curve = dataclasses.replace(skin.circuit, r_line=0.0), skin.curve.usual
    rng = np.random.default_rng([_SEED, _SCORED])
    force, adc = measure.frames("bodies", "scan", _SCORED, rng, circuit, curve)

    def error(weights) -> str:
        if (weights.rows, weights.cols) != circuit.shape:
            return f"are for {weights.rows} x {weights.cols} cells"
        return f"err by {measure.errors(weights.predict(adc), force)['mean_g']:.1f} g a cell"

    new = network.load(path)
    return (
        f"on {_SCORED} new simulated frames of your circuit and curve the new weights "
        f"{error(new)}, the shipped ones {error(network.shipped(new.kind))}"
    )
