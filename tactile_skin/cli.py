"""The command `tactile-skin`."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import stat
import sys
import threading
from pathlib import Path

from . import __version__
from .files import one_line
from .middleware.stdin import at_the_end_of_stdin, keys
from .middleware.threads import one_thread


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 for a run that failed, 2 for a mistake."""
    args = _parser().parse_args(argv)
    logging.basicConfig(
        level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", stream=sys.stderr
    )
    try:
        if args.run is _launch:  # the skin does it itself, where no signal gets lost in it
            return _launch(args)
        with one_thread():  # the matrices are small: more threads wait for one another
            return args.run(args)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # "| head" has seen enough
        sys.stdout = None
        return 0
    except (ValueError, OSError, ModuleNotFoundError) as error:
        print(f"tactile-skin {args.command}: error: {one_line(error)}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tactile-skin",
        description="A robot's skin from a low-cost resistive pressure matrix.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name, run, text, **kwargs):
        sub = commands.add_parser(
            name,
            help=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            description=text,
            **kwargs,
        )
        sub.set_defaults(run=run)
        return sub

    sub = command(
        "launch",
        _launch,
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

    from .commands import doctor

    sub = command("doctor", doctor.run, doctor.ABOUT, epilog=doctor.EXAMPLES)
    sub.add_argument("words", nargs="*", metavar="FILE | NAME:=VALUE", help="frames; options")

    sub = command(
        "sim",
        _sim,
        "a simulated board: the real bytes on a pseudo-terminal that any serial program can open",
        epilog="example:\n  tactile-skin sim --link /tmp/skin --scene two_fingers",
    )
    from .learning import scenes

    sub.add_argument(
        "--link", type=Path, required=True, help="symbolic link to make, the port to open"
    )
    sub.add_argument(
        "--scene", default="demo", help=f"what it feels: {', '.join(scenes.SCRIPTS)} (default demo)"
    )
    sub.add_argument("--config", type=Path, help="parameter file with circuit and curve")
    sub.add_argument(
        "--noise", type=float, default=1.0, help="RMS of a sample, in ADC steps (default 1)"
    )
    sub.add_argument("--rate", type=float, default=100.0, help="frames a second (default 100)")
    sub.add_argument(
        "--baud", type=int, default=1_000_000, help="pace of the bytes (default 1000000)"
    )
    sub.add_argument("--seed", type=int, default=0, help="of the noise (default 0)")

    sub = command(
        "train",
        _train,
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
        _export,
        "write a trained network as ONNX, for a runtime without Python",
        epilog="examples:\n"
        "  tactile-skin export my_weights/paper.npz skin.onnx\n"
        "  tactile-skin export paper skin.onnx",
    )
    sub.add_argument("weights", help="file that `train` made, or the shipped ones: paper, physics")
    sub.add_argument("out", type=Path, help="file to write")

    sub = command(
        "bench",
        _bench,
        "measure every method and draw it: speed against accuracy, and where each method fails",
        epilog="Each picture NAME.png stands beside NAME.json, which holds the numbers drawn.\n"
        "parts: speed, cases, stability, growth, way (bytes in to stop hook), touch_to_stop; all\n"
        "of them take nine minutes, with --quick one. Times are best read on an idle machine.\n"
        "Only on request: faults, damaged boards through the whole chain, which takes an hour on\n"
        "two cores, with --quick one minute.\n"
        "examples:\n  tactile-skin bench --quick\n  tactile-skin bench speed growth --out figures\n"
        "  tactile-skin bench faults --shapes 4x4 16x16 --minutes 10",
    )
    sub.add_argument("parts", nargs="*", metavar="PART", help="what to measure (default: all)")
    sub.add_argument("--quick", action="store_true", help="few frames, for a look")
    sub.add_argument("--seed", type=int, default=1, help="of scenes and noise (default 1)")
    sub.add_argument(
        "--out", type=Path, default=Path("bench"), help="folder for the pictures (default bench)"
    )
    faults = sub.add_argument_group("faults")
    faults.add_argument("--shapes", nargs="+", metavar="SHAPE", help="such as 4x4 (default: all)")
    faults.add_argument(
        "--faults", nargs="+", metavar="NAME", help="names, or dead or electrical (default: all)"
    )
    faults.add_argument("--minutes", type=float, help="of sound streams, in all (default 60)")
    faults.add_argument("--streams", type=int, help="of each fault and begin (default 1)")
    faults.add_argument("--jobs", type=int, help="processes (default: one a core)")
    return parser


def _launch(args) -> int:
    from . import launch

    files = [word for word in args.words if ":=" not in word]
    for word in files:
        if "=" in word:
            raise ValueError(f"{word!r}: arguments of a launch file are written name:=value")
    if len(files) > 1:
        raise ValueError(f"one launch file, not {len(files)}: {' '.join(files)}")
    pairs = [word.split(":=", 1) for word in args.words if ":=" in word]
    arguments = dict(pairs)
    if len(arguments) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"argument {twice!r} is given twice")
    plan = launch.read_plan(launch.find(files[0] if files else "demo.launch.yaml"), arguments)
    if args.show_args:
        for argument in plan.arguments.values():
            print(f"{argument.name}:={argument.default}\n    {argument.description}")
        return 0
    if not plan.nodes and not plan.commands:
        raise ValueError(f"{files[0]}: starts nothing: must have a node or an executable")
    if args.ros:
        from . import ros

        return ros.launch_processes(plan, ros.choose(args.ros))
    skin = launch.Skin(plan)
    with skin, contextlib.suppress(KeyboardInterrupt), keys(skin.reset_stop):
        skin.spin()
    return 1 if skin.failed else 0


def _check_folder(out: Path) -> None:
    """Refuse an --out that cannot be a folder before long work."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out}: must be a folder")


def _sim(args) -> int:
    from .board import simulator
    from .learning import scenes
    from .middleware.config import read_skin
    from .middleware.processes import LAUNCHED

    for name, value, low in (("--baud", args.baud, 300), ("--seed", args.seed, 0)):
        if value < low:
            raise ValueError(f"{name} = {value}: must be {low} or more")
    circuit, curve, _ = read_skin(args.config)
    scene = scenes.script(args.scene, *circuit.shape)
    simulated = simulator.Board(circuit, curve, scene, args.noise, args.rate, args.seed)
    done = threading.Event()
    numbers = [signal.SIGTERM, signal.SIGINT]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # nohup
        numbers.append(signal.SIGHUP)
    for number in numbers:
        signal.signal(number, lambda *_: done.set())
    if LAUNCHED in os.environ and stat.S_ISFIFO(os.fstat(0).st_mode):
        threading.Thread(target=at_the_end_of_stdin, args=(done.set,), daemon=True).start()

    def ready():
        print(f"simulated board on {args.link}, scene {args.scene}", file=sys.stderr)

    simulator.serve(simulated, args.link, lambda: not done.is_set(), args.baud, ready)
    return 0


def _train(args) -> int:
    import dataclasses

    from .learning import network
    from .learning.dataset import TrainingConfig
    from .middleware.config import read_skin

    if args.threads < 1:
        raise ValueError(f"--threads = {args.threads}: must be 1 or more")
    _check_folder(args.out)
    circuit, curve, _ = read_skin(args.config)
    names = [item.name for item in dataclasses.fields(TrainingConfig)]
    config = TrainingConfig(**{name: getattr(args, name) for name in names})
    if config.start and config.start not in network.NETWORKS:
        network.load(config.start)
    torch, tqdm = _torch("train"), _tqdm()
    torch.set_num_threads(args.threads)
    from .learning import training

    def track(items, desc):
        return tqdm(items, desc=desc, leave=False, disable=None)

    try:
        path = training.train(circuit, curve, config, args.out, not args.restart, track, tqdm.write)
    except training.TrainingDied as error:
        print(f"tactile-skin train: {error}", file=sys.stderr)
        return 1
    print(f"weights: {path}")
    return 0


def _export(args) -> int:
    from .learning import network

    shipped = args.weights in network.NETWORKS
    weights = network.shipped(args.weights) if shipped else network.load(args.weights)
    if args.out.is_dir() or not args.out.parent.is_dir():
        raise ValueError(f"{args.out}: must be a file in a folder that exists")
    _torch("onnx")
    from .learning import export

    export.to_onnx(weights, args.out)
    print(f"{args.out}: {weights.kind} network, {weights.rows} x {weights.cols}, force in newton")
    return 0


def _bench(args) -> int:
    _check_folder(args.out)
    from .bench import choose, run, speed, touch_to_stop
    from .bench.damage import table

    unknown = [part for part in args.parts if part not in run.PARTS]
    if unknown:
        raise ValueError(f"part {unknown[0]!r}: must be one of {', '.join(run.PARTS)}")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    parts = args.parts or [part for part in run.PARTS if part not in run.ON_REQUEST]
    given = _given(args, parts)
    written = run.run(parts, args.out, args.quick, args.seed, _tqdm(), given)
    if "speed" in written:
        print(speed.table(written["speed"]))
        print("\n".join(["", *choose.lines(written["speed"]), ""]))
    if "stability" in written:
        print("auto, what fails silently:", *choose.silent(written["stability"]), "", sep="\n")
    if "touch_to_stop" in written:
        print(touch_to_stop.table(written["touch_to_stop"]), "", sep="\n")
    if "faults" in written:
        print(table.table(written["faults"]))
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0


def _given(args, parts) -> dict[str, dict]:
    """Part -> what the command line gives its `measure`: today for `faults` only."""
    from .bench.damage import reliability

    options = ("shapes", "faults", "minutes", "streams", "jobs")
    given = {name: getattr(args, name) for name in options if getattr(args, name) is not None}
    if given and "faults" not in parts:
        raise ValueError(f"--{next(iter(given))}: only with the part faults")
    for name in given.get("shapes", ()):
        if name not in reliability.SHAPES:
            raise ValueError(f"shape {name!r}: must be one of {', '.join(reliability.SHAPES)}")
    for name, least in (("minutes", 0.0), ("streams", 1), ("jobs", 1)):
        if not given.get(name, least) >= least:
            raise ValueError(f"--{name} = {given[name]}: must be {least:g} or more")
    if "faults" in given:
        given["faults"] = reliability.named(given["faults"])
    return {"faults": given}


def _torch(extra: str):
    try:
        import torch
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"needs PyTorch: pip install 'tactile_skin[{extra}]'") from error
    return torch


def _tqdm():
    try:
        from tqdm import tqdm
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "long work shows its progress by tqdm: pip install 'tactile_skin[progress]'"
        ) from error
    return tqdm


if __name__ == "__main__":
    sys.exit(main())
