"""The command `tactile-skin`."""

from __future__ import annotations

import contextlib
import logging
import sys
from pathlib import Path

from .arguments import make_parser
from .files import one_line
from .middleware.stdin import keys
from .middleware.threads import one_thread


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 for a run that failed, 2 for a mistake."""
    try:
        args = make_parser(_COMMANDS).parse_args(argv)
        above = "\r\x1b[2K" if sys.stderr.isatty() else ""  # a live line, which is drawn anew
        logging.basicConfig(
            level=logging.INFO,
            format=f"{above}%(levelname)s %(name)s: %(message)s",
            stream=sys.stderr,
        )
        if args.run in (_launch, _record, _view):  # the skin does it, where no signal gets lost
            return args.run(args)
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


def _detect(args) -> int:
    from .commands import detect

    return detect.run(args)


def _doctor(args) -> int:
    from .commands import doctor

    return doctor.run(args)


def _view(args) -> int:
    from .commands import view

    if view.is_recording(args.words):
        from .commands import extras

        return view.run(args.words, extras.tqdm())
    args.words, args.show_args, args.ros = [*args.words, "view:=true"], False, None
    return _launch(args)


def _calibrate(args) -> int:
    from .commands import calibrate

    words, live = args.words, args.creep is True
    if args.creep and not live:  # creep:=FILE is one of the recordings
        words = [*words, f"creep:={args.creep}"]
    return calibrate.run(args.out, args.config, words, live, args.train)


def _launch(args) -> int:
    from . import launch

    plan, file = _plan(args.words, in_process=not args.ros)
    if args.show_args:
        for argument in plan.arguments.values():
            print(f"{argument.name}:={argument.default}\n    {argument.description}")
        return 0
    if not plan.nodes and not plan.commands:
        raise ValueError(f"{file}: starts nothing: must have a node or an executable")
    if args.ros:
        from . import ros

        return ros.launch_processes(plan, ros.choose(args.ros))
    return _spin(launch.Skin(plan))


def _plan(words: list[str], default: str = "", in_process: bool = True, **given: str):
    """Return the plan of a launch file, or of the default one, with its arguments; and the file."""
    from . import launch
    from .commands.words import split

    files, arguments = split(words)
    if len(files) > 1:
        raise ValueError(f"one launch file, not {len(files)}: {' '.join(files)}")
    file = files[0] if files else default or launch.default_file(arguments)
    return launch.read_plan(launch.find(file), arguments | given, in_process), file


def _spin(skin) -> int:
    """Until it ends; the exit status."""
    with skin, contextlib.suppress(KeyboardInterrupt), keys(skin.reset_stop):
        skin.spin()
    return 1 if skin.failed else 0


def _record(args) -> int:
    from . import launch

    plan, _ = _plan(args.words, "skin.launch.yaml", record=args.out)
    recorder = plan.nodes[-1]
    for name in ("last", "max_duration", "max_size"):
        if (value := getattr(args, name)) is not None:
            recorder.parameters.append((name, value))
    return _spin(launch.Skin(plan))


def _replay(args) -> int:
    from .commands import replay

    return replay.run(args)


def _check_folder(out: Path) -> None:
    """Refuse an --out that cannot be a folder before long work."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out}: must be a folder")


def _sim(args) -> int:
    from .commands import sim

    return sim.run(args)


def _flash(args) -> int:
    from .commands import flash

    return flash.run(args)


def _train(args) -> int:
    _check_folder(args.out)
    from .commands import train

    return train.run(args)


def _export(args) -> int:
    from .learning import network

    shipped = args.weights in network.NETWORKS
    weights = network.shipped(args.weights) if shipped else network.load(args.weights)
    if args.out.is_dir() or not args.out.parent.is_dir():
        raise ValueError(f"{args.out}: must be a file in a folder that exists")
    from .commands import extras

    extras.torch("onnx")
    from .learning import export

    export.to_onnx(weights, args.out)
    print(f"{args.out}: {weights.kind} network, {weights.rows} x {weights.cols}, force in newton")
    return 0


def _bench(args) -> int:
    _check_folder(args.out)
    from .bench import choose, run, speed, touch_to_stop
    from .bench.damage import table
    from .commands import extras
    from .replay import methods

    unknown = [part for part in args.parts if part not in run.PARTS]
    if unknown:
        raise ValueError(f"part {unknown[0]!r}: must be one of {', '.join(run.PARTS)}")
    if args.seed < 0:
        raise ValueError(f"--seed = {args.seed}: must be 0 or more")
    parts = args.parts or [part for part in run.PARTS if part not in run.ON_REQUEST]
    given = _given(args, parts)
    written = run.run(parts, args.out, args.quick, args.seed, extras.tqdm(), given)
    if "speed" in written:
        print(speed.table(written["speed"]))
        print("\n".join(["", *choose.lines(written["speed"]), ""]))
    if "stability" in written:
        print("what a running skin is silent about:")
        print(*choose.silent(written["stability"]), "", sep="\n")
    if "touch_to_stop" in written:
        print(touch_to_stop.table(written["touch_to_stop"]), "", sep="\n")
    if "recorded" in written:
        print(methods.table(written["recorded"]), "", sep="\n")
    if "faults" in written:
        print(table.table(written["faults"]))
    print(f"pictures: {', '.join(str(args.out / f'{name}.png') for name in written)}")
    return 0


def _given(args, parts) -> dict[str, dict]:
    """Part -> what the command line gives its `measure`."""
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
    if (args.frames is not None) != ("recorded" in parts):
        raise ValueError("the part recorded needs --frames FILE, and no other part takes it")
    return {"faults": given, "recorded": {"frames": args.frames, "config": args.config}}


_COMMANDS = {
    "launch": _launch,
    "view": _view,
    "sim": _sim,
    "flash": _flash,
    "calibrate": _calibrate,
    "detect": _detect,
    "doctor": _doctor,
    "record": _record,
    "replay": _replay,
    "train": _train,
    "export": _export,
    "bench": _bench,
}
