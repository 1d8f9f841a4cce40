# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin record`: the skin, and all that it publishes, in a file."""

from __future__ import annotations

from .. import launch
from .launch import plan_of, spin

EXAMPLES = (
    "The same as launch with record:=OUT. A recording that is killed keeps all but its "
    "last second.\nexamples:\n"
    "  tactile-skin record touches.mcap port:=/dev/ttyUSB0 config:=mine.yaml duration:=60\n"
    "  tactile-skin record demo.mcap demo.launch.yaml duration:=20\n"
    "  tactile-skin record stops/ port:=/dev/ttyUSB0 --last 120\n"
    "On ROS: ros2 bag record -a -s mcap"
)


def register(parser) -> None:
    parser.add_argument(
        "out", metavar="OUT", help="file to make (.mcap), or folder/ for files named by time"
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="FILE | NAME:=VALUE",
        help="launch file (default skin.launch.yaml); its arguments",
    )
    parser.add_argument(
        "--last",
        type=float,
        metavar="S",
        help="keep only so long before each stop, and 2 s after it, each in a file of its own",
    )
    parser.add_argument("--max-duration", type=float, metavar="S", help="ends after so long")
    parser.add_argument("--max-size", type=float, metavar="MB", help="ends at that (default 2000)")


def run(args) -> int:
    """Record until it ends."""
    plan = plan_of(args.words, "skin.launch.yaml", record=args.out)
    recorder = plan.nodes[-1]
    for name in ("last", "max_duration", "max_size"):
        if (value := getattr(args, name)) is not None:
            recorder.give({name: value})
    return spin(launch.Skin(plan))
