# SPDX-License-Identifier: Apache-2.0
"""Time in a fault stop of a floating insole's recordings, sent as text through all nodes.

On a driven clock, or with --live in real time over a pty. The recordings are docs/lab/insole.md's.
"""

from __future__ import annotations

import json
import tempfile
import threading
import time
from pathlib import Path

from support import insole
from support.chain import Chain
from support.simulated import serving

from tactile_skin.launch import find, launch
from tactile_skin.middleware.threads import one_thread
from tactile_skin.msg import DiagnosticArray
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC
from tactile_skin.simulation.simulator import SCANS_PER_SECOND

from .. import harness
from ..accuracy import boards
from .text_board import Tally

START = 3.0  # s that do not count


def parameters(counts) -> dict:
    """Node -> {parameter: value}, of an insole whose frames these are."""
    skin, curve = insole.circuit(counts[0] >= 0), insole.curve()
    adc = {"circuit.adc_offset": insole.ADC_OFFSET, "circuit.adc_full_scale": insole.FULL_SCALE}
    given = {f"circuit.{k}": v for k, v in skin.describe().items()}
    given["circuit.mask"] = " ".join(given["circuit.mask"])
    force, resistance = zip(*curve.points, strict=True)
    fit = {"noise": insole.NOISE, "board_threshold": float(insole.THRESHOLD)}
    fit |= {"curve.force": list(force), "curve.resistance": list(resistance)}
    return {
        "serial_driver": given | adc | {"protocol": "text", "frozen_after": 0.0},
        "compensation": given | adc | fit,
        "gesture_feature": given,
        "stop_on_push": {"debounce": 0.01, "lead": 0.0},
    }


def line(frame) -> bytes:
    return b",".join(b"%d" % max(v, 0) for v in frame.ravel().tolist()) + b"\r\n"


def driven(counts, rate: float) -> Tally:
    tally = Tally()
    skin = insole.circuit(counts[0] >= 0)
    chain = Chain(skin, "text", parameters(counts))
    try:
        for k, frame in enumerate(counts):
            t = k / rate
            chain.feed(t + 0.01, line(frame))
            if t >= START:
                tally.add(1.0 / rate, chain.stop, chain.reason)
    finally:
        chain.close()
    return tally


class Player:
    """A board of `simulator.serve` that prints a recording once."""

    BAUD = 1_000_000

    def __init__(self, counts, rate: float):
        self._lines, self._rate, self._scans = [line(f) for f in counts], rate, 0
        self.sent = 0

    def restart(self) -> None:
        self._scans = self.sent = 0

    def skip(self, scans: int) -> None:
        self._scans += scans

    def scan(self) -> bytes:
        self._scans += 1
        due = int(self._scans / SCANS_PER_SECOND * self._rate)
        if due == self.sent or self.sent >= len(self._lines):
            return b""
        self.sent = due
        return self._lines[min(due, len(self._lines)) - 1]


def live(counts, rate: float) -> Tally:
    tally, player = Tally(), Player(counts, rate)
    state = [True, "start", time.monotonic()]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        given, nodes = parameters(counts), {}
        shared = given["serial_driver"] | given["compensation"]
        common = {k: v for k, v in shared.items() if k.startswith(("circuit.", "curve."))}
        common["geometry.pitch"] = 0.0075
        for name, own in ({"/**": common} | given).items():
            own = {k: v for k, v in own.items() if name == "/**" or k not in common}
            if own:
                nodes[name] = {"ros__parameters": own}
        (path / "mine.yaml").write_text(json.dumps(nodes))

        def on_status(message) -> None:
            now, status = time.monotonic(), message.status[0]
            stop, reason, since = state
            if now - began >= START and player.sent < len(counts):
                tally.add(now - since, stop, reason)
            state[:] = int(status.level) != 0, status.message, now

        with serving(path / "board", player):
            arguments = {"port": str(path / "board"), "config": str(path / "mine.yaml")}
            with launch(find("skin.launch.yaml"), **arguments) as skin:
                skin.node.create_subscription(DiagnosticArray, STATUS_TOPIC, on_status, 50)
                began = time.monotonic()
                spinning = threading.Thread(target=skin.spin)
                spinning.start()
                while player.sent < len(counts):
                    time.sleep(0.2)
                skin.shutdown()
                spinning.join(30.0)
    return tally


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("data", type=Path, help="folder of recordings (.npz)")
    parser.add_argument("--rate", type=float, nargs="+", default=[8.0, 30.0])
    parser.add_argument("--recording", default="", help="part of its name")
    parser.add_argument("--live", action="store_true")
    args = parser.parse_args(arguments)
    with one_thread():
        for name, counts in boards.recordings(args.data, 0):
            if args.recording not in name:
                continue
            for rate in args.rate:
                found = (live if args.live else driven)(counts, rate)
                print(f"{name:22} {rate:4.0f} Hz: {found}", flush=True)


if __name__ == "__main__":
    harness.run(main)
