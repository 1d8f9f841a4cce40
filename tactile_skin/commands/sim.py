# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin sim`: a simulated board on a pseudo-terminal."""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path

from ..middleware.config import read_skin
from ..middleware.parameter_file import ParameterFile
from ..middleware.processes import end_with_launcher
from ..simulation import scenes, simulator
from ..simulation.matrix import resting_curve

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
_NOISE = 1.0  # ADC steps RMS of a sample on the simulated chip, as on the model
_SEED = 0  # of the fabric, as the model's


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


def run(args) -> int:
    """Serve the board until a signal asks for the end."""
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

    scene = scenes.script(args.scene, *skin.circuit.shape)
    if args.board == "model":
        board = simulator.Board(skin.circuit, skin.curve, scene, kind=kind, adc=skin.adc)
        simulator.serve(board, args.link, running, baud, ready, args.once)
        return 0
    if kind != "binary":
        raise ValueError(f"protocol {kind!r} is of the board `model`; the firmware sends binary")
    from ..board.firmware import chip

    with chip.Chip(skin.circuit, noise=_NOISE, adc=skin.adc) as simulated:
        curve = resting_curve(skin.curve, skin.circuit.shape, _SEED)
        chip.serve(simulated, curve, scene, args.link, running, ready, args.once)
    return 0


def _line_of(config) -> tuple[str, int]:
    """Return the protocol and the baud rate of a parameter file's serial_driver."""
    overrides = [] if config is None else ParameterFile(config).overrides("/serial_driver")
    given = {p.name: p.value for p in overrides}
    return given.get("protocol", "binary"), given.get("baud", simulator.BAUD)
