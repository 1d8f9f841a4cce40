# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin gestures`: record your own gestures, train a recogniser, see how good it is."""

from __future__ import annotations

import argparse
from pathlib import Path

EXAMPLES = """\
Gestures of your own: record some takes of each, train, and run the skin with the model.

examples:
  tactile-skin gestures record wave port:=/dev/ttyUSB0 config:=mine.yaml --person anna --times 5
  tactile-skin gestures record stroke touches.mcap --person ben
  tactile-skin gestures record labelled.csv config:=mine.yaml
  tactile-skin gestures train takes/ --out mine.gestures.npz
  tactile-skin gestures evaluate takes/
then, in mine.yaml, gestures.model: mine.gestures.npz, and
  tactile-skin launch skin.launch.yaml port:=/dev/ttyUSB0 config:=mine.yaml gestures:=true"""

_TAKES = "files, folders of them, or with --config tables that hold a column of labels"


def register(parser) -> None:
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP")

    def step(name: str, text: str):
        return steps.add_parser(
            name,
            help=text,
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    record = step("record", "takes of one gesture, from the live skin or a recording")
    record.add_argument(
        "name",
        metavar="NAME",
        help="of the gesture, such as stroke; other: no gesture; or a table with a column of "
        "labels, of which each touch is a take of its label",
    )
    record.add_argument(
        "words",
        nargs="*",
        metavar="RECORDING | NAME:=VALUE",
        help="a recording (.mcap) or a table, of which each touch is a take, and namespace:= of "
        "the skin where it holds several, config:=, rate:= and full_scale:= of a table; or "
        "arguments of the launch file",
    )
    record.add_argument("--person", default="me", help="who makes the gesture (default me)")
    record.add_argument("--times", type=int, default=5, metavar="N", help="takes (default 5)")
    record.add_argument(
        "--out", type=Path, default=Path("takes"), metavar="FOLDER", help="default takes/"
    )
    train = step("train", "a recogniser from takes; without any, from simulated hands")
    train.add_argument("takes", nargs="*", metavar="TAKES", help=_TAKES)
    train.add_argument("--out", type=Path, required=True, metavar="FILE", help="model to write")
    hands = "add simulated hands and contacts, which a few takes are lost in"
    train.add_argument("--simulated", action="store_true", help=hands)
    train.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)  # it was no default
    train.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    evaluate = step("evaluate", "which gestures are taken for which, people left out in turn")
    evaluate.add_argument("takes", nargs="+", metavar="TAKES", help=_TAKES)
    for each in (train, evaluate):
        each.add_argument(
            "--config", type=Path, metavar="FILE", help="parameter file of the skin of tables"
        )
    evaluate.add_argument(
        "--model", type=Path, metavar="FILE", help="a model to judge by all takes instead"
    )
    evaluate.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw it as well (.png); needs matplotlib"
    )


def run(args) -> int:
    """Carry out one step."""
    from . import record, study

    steps = {"record": record.record, "train": study.train, "evaluate": study.evaluate}
    return steps[args.step](args)
