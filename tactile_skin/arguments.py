"""The commands of `tactile-skin` and their arguments."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from . import __version__
from .commands import detect, doctor, flash, replay, sim, view
from .commands.words import CommandParser
from .learning import scenes


def make_parser(run: dict) -> argparse.ArgumentParser:
    """Args:
    run: name of a command -> what carries it out, given its arguments.
    """
    parser = argparse.ArgumentParser(
        prog="tactile-skin",
        description="A robot's skin from a low-cost resistive pressure matrix.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=CommandParser
    )

    def command(name, text, **kwargs):
        sub = commands.add_parser(
            name,
            help=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            description=text,
            **kwargs,
        )
        sub.set_defaults(run=run[name])
        return sub

    sub = command(
        "launch",
        "start the skin that a launch file describes; without one, the demo on a simulated board",
        epilog="examples:\n"
        "  tactile-skin launch duration:=20\n"
        "  tactile-skin launch skin.launch.yaml port:=/dev/ttyUSB0\n"
        "  tactile-skin launch scene:=two_fingers method:=naive\n"
        "  tactile-skin launch --show-args skin.launch.yaml\n"
        "On a terminal, r and Enter reset a latched stop.",
    )
    sub.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="launch file; arguments"
    )
    sub.add_argument(
        "--ros",
        type=int,
        choices=(1, 2),
        help="each node in a process of its own, on ROS 1 or 2 (default: all in this one, no ROS)",
    )
    sub.add_argument("-s", "--show-args", action="store_true", help="print its arguments and end")

    sub = command("view", view.ABOUT, epilog=view.EXAMPLES)
    sub.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="recording or launch file; arguments"
    )

    sub = command("sim", sim.ABOUT, epilog=sim.EXAMPLES)
    sub.add_argument(
        "--board", choices=sim.BOARDS, default="model", help="what is simulated (default model)"
    )
    sub.add_argument(
        "--link", type=Path, required=True, help="symbolic link to make, the port to open"
    )
    sub.add_argument("--once", action="store_true", help="end when whoever read the port has left")
    sub.add_argument(
        "--scene", default="demo", help=f"what it feels: {', '.join(scenes.SCRIPTS)} (default demo)"
    )
    sub.add_argument("--config", type=Path, help="parameter file with circuit, curve and protocol")
    sub.add_argument(
        "--noise", type=float, default=1.0, help="RMS of a sample, in ADC steps (default 1)"
    )
    sub.add_argument("--rate", type=float, default=100.0, help="frames a second (default 100)")
    sub.add_argument(
        "--baud", type=int, help="pace of the bytes (default: the parameter file's, 1000000)"
    )
    sub.add_argument("--seed", type=int, default=0, help="of fabric and noise (default 0)")

    sub = command("detect", detect.ABOUT, epilog=detect.EXAMPLES)
    sub.add_argument(
        "words", nargs="*", metavar="FILE | NAME:=VALUE", help="file of bytes, or port; options"
    )

    sub = command("flash", flash.ABOUT, epilog=flash.EXAMPLES)
    sub.add_argument("words", nargs="*", metavar="NAME:=VALUE", help="port, and options")

    sub = command(
        "calibrate",
        "find your board's circuit from touches and its newtons from a few weights, step by step",
        epilog="You need ten minutes, the board, and up to ten things that a kitchen scale has "
        "weighed.\nexamples:\n"
        "  tactile-skin calibrate --config mine.yaml --out calibrated.yaml\n"
        "  tactile-skin calibrate --config mine.yaml --out mine.yaml port:=/dev/ttyUSB0\n"
        "  tactile-skin calibrate --config calibrated.yaml --out calibrated.yaml --creep\n"
        "from recordings (.mcap, .npy, .npz, .csv; rate:=60 if they have no times), one for each "
        "weight:\n"
        "  tactile-skin calibrate --config mine.yaml rest:=rest.mcap touches:=touches.mcap \\\n"
        "    500g:=bottle.mcap 1.2kg:=books.mcap 3kg:=bag.mcap\n"
        "with a scale in place of weights (lines of time [s],force [N]), and a load\n"
        "that stands for two minutes:\n"
        "  tactile-skin calibrate --config mine.yaml rest:=rest.mcap touches:=touches.mcap \\\n"
        "    reference:=scale.csv creep:=standing.mcap\n"
        "then:\n  tactile-skin launch skin.launch.yaml config:=calibrated.yaml",
    )
    sub.add_argument(
        "--creep",
        nargs="?",
        const=True,
        metavar="FILE",
        help="measure only by how much a load that stands grows with time: one object, two minutes",
    )
    sub.add_argument(
        "words",
        nargs="*",
        metavar="NAME:=VALUE",
        help="port, baud or protocol, instead of the parameter file's; or recordings",
    )
    sub.add_argument(
        "--train",
        choices=("paper", "physics"),
        help="then train this network for the board, and enter its weights in the file",
    )
    sub.add_argument("--config", type=Path, help="parameter file with what you know of the board")
    sub.add_argument(
        "--out",
        type=Path,
        default=Path("calibrated.yaml"),
        help="parameter file to write; one that is there is kept as NAME.bak "
        "(default calibrated.yaml)",
    )

    sub = command("doctor", doctor.ABOUT, epilog=doctor.EXAMPLES)
    sub.add_argument("words", nargs="*", metavar="FILE | NAME:=VALUE", help="frames; options")

    sub = command(
        "record",
        "start the skin and record all that it publishes, with its configuration (MCAP, ROS 2)",
        epilog="The same as launch with record:=OUT. A recording that is killed keeps all but its "
        "last second.\nexamples:\n"
        "  tactile-skin record touches.mcap port:=/dev/ttyUSB0 config:=mine.yaml duration:=60\n"
        "  tactile-skin record demo.mcap demo.launch.yaml duration:=20\n"
        "  tactile-skin record stops/ port:=/dev/ttyUSB0 --last 120\n"
        "On ROS: ros2 bag record -a -s mcap",
    )
    sub.add_argument(
        "out", metavar="OUT", help="file to make (.mcap), or folder/ for files named by time"
    )
    sub.add_argument(
        "words",
        nargs="*",
        metavar="FILE | NAME:=VALUE",
        help="launch file (default skin.launch.yaml); its arguments",
    )
    sub.add_argument(
        "--last",
        type=float,
        metavar="S",
        help="keep only so long before each stop, and 2 s after it, each in a file of its own",
    )
    sub.add_argument("--max-duration", type=float, metavar="S", help="ends after so long")
    sub.add_argument("--max-size", type=float, metavar="MB", help="ends at that (default 2000)")

    sub = command("replay", replay.ABOUT, epilog=replay.EXAMPLES)
    sub.add_argument("words", nargs="*", metavar="FILE | NAME:=VALUE", help="recording; options")
    sub.add_argument(
        "--speed", type=float, help="times real time (default: as fast as possible)", metavar="X"
    )
    sub.add_argument("--step", action="store_true", help="one reading at each Enter")
    sub.add_argument(
        "--compare", nargs="+", metavar="METHOD", help="these methods side by side, as a table"
    )
    sub.add_argument(
        "--picture",
        type=Path,
        default=Path("compared.png"),
        help="of --compare (default compared.png)",
    )
    sub.add_argument("--out", type=Path, help="recording to make of what the nodes publish (.mcap)")
    sub.add_argument(
        "--export", type=Path, help="write the readings to .npy, .npz or .csv, and end"
    )
    sub.add_argument(
        "--jobs",
        type=int,
        default=1,
        help="processes, each a part (default 1: to the bit as on the robot)",
    )

    sub = command(
        "train",
        "train a network for your board: its circuit and curve from a parameter file",
        epilog="A run that was stopped goes on when started again with the same --out.\n"
        "examples:\n"
        "  tactile-skin train --config mine.yaml --out my_weights\n"
        "  tactile-skin train --config mine.yaml --out my_weights "
        "--network physics --readout board\n"
        "  tactile-skin train --config mine.yaml --out my_weights --start paper --rate 0.003 "
        "--epochs 20\n"
        "then, with `weights: my_weights/physics.npz` under compensation in mine.yaml:\n"
        "  tactile-skin launch skin.launch.yaml config:=mine.yaml method:=physics",
    )
    sub.add_argument("--config", type=Path, help="parameter file with circuit and curve")
    sub.add_argument("--out", type=Path, default=Path("weights"), help="folder (default weights)")
    sub.add_argument("--restart", action="store_true", help="ignore the checkpoint in --out")
    sub.add_argument(
        "--threads", type=int, default=os.cpu_count(), help="of the processor (default: all)"
    )
    import dataclasses

    from .learning.dataset import CHOICES, TrainingConfig

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
        kind = {"int": int, "float": float, "str": str}[item.type]
        allowed = CHOICES.get(item.name)
        choice = f"one of {', '.join(allowed)}" if allowed else ""
        default = "new ones" if item.default == "" else item.default
        words = about.get(item.name, ""), choice, f"default {default}"
        sub.add_argument(
            f"--{item.name}",
            type=kind,
            default=item.default,
            choices=allowed,
            help="; ".join(filter(None, words)),
            metavar=item.name.upper(),
        )

    sub = command(
        "export",
        "write a trained network as ONNX, for a runtime without Python",
        epilog="examples:\n"
        "  tactile-skin export my_weights/paper.npz skin.onnx\n"
        "  tactile-skin export paper skin.onnx",
    )
    sub.add_argument("weights", help="file that `train` made, or the shipped ones: paper, physics")
    sub.add_argument("out", type=Path, help="file to write")

    sub = command(
        "bench",
        "measure every method and draw it: speed against accuracy, and where each method fails",
        epilog="Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
        "parts: speed, cases, stability, growth, way (bytes in to stop hook), touch_to_stop; all\n"
        "of them take 20 minutes, with --quick two. Times are best read on an idle machine.\n"
        "Only on request: faults, damaged boards through the whole chain, which takes an hour on\n"
        "two cores, with --quick one minute; recorded, every method on frames of your own board.\n"
        "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed growth --out figures\n"
        "  tactile-skin bench faults --shapes 4x4 16x16 --minutes 10\n"
        "  tactile-skin bench recorded --frames touches.csv --config mine.yaml",
    )
    sub.add_argument("parts", nargs="*", metavar="PART", help="what to measure (default: all)")
    sub.add_argument("--quick", action="store_true", help="few frames, for a look")
    sub.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    sub.add_argument(
        "--out", type=Path, default=Path("bench"), help="folder for the pictures (default bench)"
    )
    recorded = sub.add_argument_group("recorded")
    recorded.add_argument("--frames", metavar="FILE", help="frames: .mcap, .npy, .npz or .csv")
    recorded.add_argument("--config", help="parameter file (default: as recorded)")
    faults = sub.add_argument_group("faults")
    faults.add_argument("--shapes", nargs="+", metavar="SHAPE", help="such as 4x4 (default: all)")
    faults.add_argument(
        "--faults", nargs="+", metavar="NAME", help="names, or dead or electrical (default: all)"
    )
    faults.add_argument("--minutes", type=float, help="of sound streams, in all (default 60)")
    faults.add_argument("--streams", type=int, help="of each fault and begin (default 1)")
    faults.add_argument("--jobs", type=int, help="processes (default: one a core)")
    return parser
