# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin train`: a network for a board."""

from __future__ import annotations

import dataclasses
import os
import sys
from pathlib import Path

from .. import extras
from ..arguments import check_folder
from ..errors import TrainingDied
from ..learning import network
from ..learning.dataset import CHOICES, TrainingConfig
from ..middleware.config import read_skin

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
    """Train, and say where the weights are; 1: the training died, and it was said why."""
    check_folder(args.out)
    if args.threads < 1:
        raise ValueError(f"--threads = {args.threads}: must be 1 or more")
    names = [item.name for item in dataclasses.fields(TrainingConfig)]
    config = TrainingConfig(**{name: getattr(args, name) for name in names})
    skin = read_skin(args.config)
    if config.start and config.start not in network.NETWORKS:
        network.load(config.start)
    torch, tqdm = extras.torch(), extras.tqdm()
    torch.set_num_threads(args.threads)
    from ..learning import training

    circuit, curve, go_on = skin.circuit, skin.curve.usual, not args.restart
    try:
        path = training.train(circuit, curve, config, args.out, go_on, extras.track, tqdm.write)
    except TrainingDied as error:
        print(f"tactile-skin train: {error}", file=sys.stderr)
        return 1
    print(f"weights: {path}")
    return 0
