# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin sim`: a simulated board on a pseudo-terminal."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from ..middleware.config import SkinConfig, read_skin
from ..middleware.parameter_file import ParameterFile
from ..middleware.processes import end_with_launcher
from ..simulation import scenes
from ..simulation.simulator import BAUD

EXAMPLES = """\
boards:
  model     the electronics in Python
  firmware  the binary of the ATmega328P, on a simulated chip that takes its commands as well;
            apt-get install gcc gcc-avr avr-libc libc6-dev libsimavr-dev libelf-dev
examples:
  tactile-skin sim --link /tmp/skin --scene two_fingers
  tactile-skin sim --link /tmp/skin --board firmware
  tactile-skin sim --link /tmp/skin --config my_skin.yaml     # text, if that says so"""
BOARDS = ("model", "firmware")


def register(parser) -> None:
    parser.add_argument(
        "--board", choices=BOARDS, default="model", help="what is simulated (default model)"
    )
    parser.add_argument(
        "--link", type=Path, required=True, help="symbolic link to make, the port to open"
    )
    parser.add_argument(
        "--once", action="store_true", help="end when whoever read the port has left"
    )
    parser.add_argument(
        "--scene", default="demo", help=f"what it feels: {', '.join(scenes.SCRIPTS)} (default demo)"
    )
    parser.add_argument(
        "--config", type=Path, help="parameter file with circuit, curve and protocol"
    )
    parser.add_argument(
        "--noise", type=float, default=1.0, help="RMS of a sample, in ADC steps (default 1)"
    )
    parser.add_argument("--rate", type=float, default=100.0, help="frames a second (default 100)")
    parser.add_argument(
        "--baud", type=int, help="pace of the bytes (default: the parameter file's, 1000000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of fabric and noise (default 0)")


def run(args) -> int:
    """Serve the board until a signal asks for the end."""
    for name, value, low in (("--baud", args.baud, 300), ("--seed", args.seed, 0)):
        if value is not None and value < low:
            raise ValueError(f"{name} = {value}: must be {low} or more")
    skin = read_skin(args.config)  # before signals are taken: a bad file ends it
    kind, baud = _line_of(args.config)
    done = threading.Event()
    numbers = [signal.SIGTERM, signal.SIGINT]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # nohup
        numbers.append(signal.SIGHUP)
    for number in numbers:
        signal.signal(number, lambda *_: done.set())
    end_with_launcher(done.set)

    def ready():
        what = "firmware on a simulated chip" if args.board == "firmware" else "simulated board"
        print(f"{what} on {args.link}, scene {args.scene}", file=sys.stderr)

    def running() -> bool:
        return not done.is_set()

    if args.board == "firmware":
        _serve_firmware(args, skin, kind, running, ready)
    else:
        _serve_model(args, skin, kind, args.baud or baud, running, ready)
    return 0


def _line_of(config) -> tuple[str, int]:
    """Return the protocol and the baud rate of a parameter file's serial_driver."""
    overrides = [] if config is None else ParameterFile(config).overrides("/serial_driver")
    given = {p.name: p.value for p in overrides}
    return given.get("protocol", "binary"), given.get("baud", BAUD)


def _serve_model(args, skin: SkinConfig, kind: str, baud: int, running, ready) -> None:
    from ..simulation import simulator

    scene = scenes.script(args.scene, *skin.circuit.shape)
    given = args.noise, args.rate, args.seed, kind, skin.adc
    board = simulator.Board(skin.circuit, skin.curve, scene, *given)
    simulator.serve(board, args.link, running, baud, ready, args.once)


def _serve_firmware(args, skin: SkinConfig, kind: str, running: Callable[[], bool], ready) -> None:
    from ..board.firmware import chip
    from ..simulation.matrix import resting_curve

    if args.rate != 100.0 or args.baud not in (None, BAUD):
        raise ValueError("--rate and --baud are of the board `model`; the firmware has its own")
    if kind != "binary":
        raise ValueError(f"protocol {kind!r} is of the board `model`; the firmware sends binary")
    scene = scenes.script(args.scene, *skin.circuit.shape)
    with chip.Chip(skin.circuit, noise=args.noise, seed=args.seed + 1, adc=skin.adc) as simulated:
        curve = resting_curve(skin.curve, skin.circuit.shape, args.seed)
        chip.serve(simulated, curve, scene, args.link, running, ready, args.once)
