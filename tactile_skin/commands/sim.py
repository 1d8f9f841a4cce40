# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin sim`: a simulated board on a pseudo-terminal."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

from ..middleware.config import read_skin
from ..middleware.parameter_file import ParameterFile
from ..simulation import scenes, simulator
from ..simulation.simulator import BAUD

EXAMPLES = """\
examples:
  tactile-skin sim --link /tmp/skin --scene two_fingers
  tactile-skin sim --link /tmp/skin --config my_skin.yaml     # text, if that says so"""


def register(parser) -> None:
    parser.add_argument(
        "--link", type=Path, required=True, help="symbolic link to make, the port to open"
    )
    parser.add_argument(
        "--once",
        action="store_true",
        help="end when whoever read the port, or started this, has left",
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
    parent = os.getppid()  # another one, once it is gone
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

    def ready():
        print(f"simulated board on {args.link}, scene {args.scene}", file=sys.stderr)

    scene = scenes.script(args.scene, *skin.circuit.shape)
    given = args.noise, args.rate, args.seed, kind, skin.adc
    board = simulator.Board(skin.circuit, skin.curve, scene, *given)
    baud = args.baud or baud

    def running() -> bool:
        return not done.is_set() and not (args.once and os.getppid() != parent)

    simulator.serve(board, args.link, running, baud, ready, args.once)
    return 0


def _line_of(config) -> tuple[str, int]:
    """Return the protocol and the baud rate of a parameter file's serial_driver."""
    overrides = [] if config is None else ParameterFile(config).overrides("/serial_driver")
    given = {p.name: p.value for p in overrides}
    return given.get("protocol", "binary"), given.get("baud", BAUD)
