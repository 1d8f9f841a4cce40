# SPDX-License-Identifier: Apache-2.0
"""How often a fault stops the robot: a hobby board's text lines, five minutes of touches.

The board of docs/boards.md as support/simulated.py plays it: 8 x 12, 12 bits, cells that
scatter by 10 % and drift by 5 %, two noisy ones, 1 step of noise. The skin is given what its maker
knows, not the curve. In the last 5 s a lead is off. On a driven clock, or with --live on a pty. At
115200 baud a line of 481 bytes is carried 24 times a second.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
from support.chain import Chain
from support.lab.board import KNOTS
from support.lab.touches import everyday
from support.simulated import TextBoard, serving

from tactile_skin import PressureCurve
from tactile_skin.behaviours.stop import Cause
from tactile_skin.launch import find, launch
from tactile_skin.middleware.threads import one_thread
from tactile_skin.msg import DiagnosticArray
from tactile_skin.nodes.stop_on_push import STATUS_TOPIC
from tactile_skin.simulation.simulator import SCANS_PER_SECOND

from .. import harness

START, END = 3.0, 5.0  # s, at the start, that do not count; at the end, with a lead off
GIVEN = {"debounce": 0.01, "lead": 0.0}  # of text, docs/boards.md


class Board(TextBoard):
    """Touched as in a day; from `off_at` [s] on a column's lead is off.

    Attributes:
        column: whose lead it is.
    """

    def __init__(self, seconds: float, seed: int, rate: float):
        super().__init__(rate=rate, seed=seed)
        rng = np.random.default_rng([seed, 1])
        cells = np.ones(self.CIRCUIT.shape, bool)
        most = PressureCurve().max_force
        self._force = everyday(cells, seconds, rng, most, hard=False).force
        self.scene = lambda t: self._force[min(int(t * KNOTS), len(self._force) - 1)]
        self._gain = np.exp(0.1 * rng.standard_normal(self.CIRCUIT.shape))
        where = [(int(k) // 12, int(k) % 12) for k in rng.choice(96, 2, replace=False)]
        self._noise[:] = 1.0
        for cell in where:
            self._noise[cell] = 8.0
        self.off_at, self.column = seconds - END, int(rng.integers(12))
        self._line = self._with_lead(self._line)

    def _with_lead(self, line):
        def printed(steps):
            if self._scans / SCANS_PER_SECOND >= self.off_at:
                steps[:, self.column] = 0.0
            return line(steps)

        return printed


class Tally:
    """Attributes:
    faults: seconds of each reason that is not a push, since START, before the lead is off.
    seconds: that were looked at.
    """

    def __init__(self):
        self.faults: Counter[str] = Counter()
        self.seconds, self.stops, self._before = 0.0, 0, False

    def add(self, seconds: float, stop: bool, reason: str) -> None:
        fault = stop and reason != Cause.PUSH.value
        self.seconds += seconds
        self.stops += fault and not self._before
        self._before = fault
        if fault:
            self.faults[reason] += seconds

    def __str__(self):
        share = 100 * sum(self.faults.values()) / max(self.seconds, 1e-9)
        why = "; ".join(f"{s:.1f} s {reason[:110]}" for reason, s in self.faults.most_common(4))
        return f"fault {share:.2f} % of {self.seconds:.0f} s, {self.stops} stops  {why}"


def driven(seconds: float, seed: int, rate: float) -> tuple[Tally, bool, str]:
    board, tally = Board(seconds, seed, rate), Tally()
    chain = Chain(TextBoard.CIRCUIT, "text", {"stop_on_push": GIVEN})
    told = ""
    try:
        for k in range(1, int(seconds * SCANS_PER_SECOND)):
            t = k / SCANS_PER_SECOND
            if data := board.scan():
                chain.feed(t + len(data) * 10 / TextBoard.BAUD, data)
            if START <= t < board.off_at:
                tally.add(1.0 / SCANS_PER_SECOND, chain.stop, chain.reason)
            elif t >= board.off_at and chain.stop and not chain.for_push_alone:
                told = told or f"after {t - board.off_at:.2f} s: {chain.reason[:110]}"
    finally:
        chain.close()
    return tally, bool(told), told


def live(seconds: float, seed: int, rate: float) -> tuple[Tally, bool, str]:
    """The same in real time, over a pty."""
    board, tally, told = Board(seconds, seed, rate), Tally(), []
    lock, state = threading.Lock(), [True, "start", time.monotonic()]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        circuit = {
            f"circuit.{k}": v for k, v in TextBoard.CIRCUIT.describe().items() if k != "mask"
        }
        lines = [f"    {k}: {v}" for k, v in circuit.items()] + ["    geometry.pitch: 0.018"]
        text = (
            "/**:\n  ros__parameters:\n"
            + "\n".join(lines)
            + (
                "\nserial_driver:\n  ros__parameters: {protocol: text, baud: 115200}\n"
                f"stop_on_push:\n  ros__parameters: {GIVEN}\n".replace("'", "")
            )
        )
        (path / "mine.yaml").write_text(text)

        def on_status(message) -> None:
            now, status = time.monotonic(), message.status[0]
            with lock:
                stop, reason, since = state
                if START <= now - began < board.off_at:
                    tally.add(now - since, stop, reason)
                elif (
                    now - began > board.off_at + 0.3
                    and status.level
                    and status.message != Cause.PUSH.value
                ):
                    told.append(status.message)
                state[:] = status.level != b"\0" and status.level != 0, status.message, now

        with serving(path / "board", board):
            arguments = {"port": str(path / "board"), "config": str(path / "mine.yaml")}
            with launch(find("skin.launch.yaml"), **arguments) as skin:
                skin.node.create_subscription(DiagnosticArray, STATUS_TOPIC, on_status, 50)
                began = time.monotonic()
                spinning = threading.Thread(target=skin.spin)
                spinning.start()
                time.sleep(seconds)
                skin.shutdown()
                spinning.join(30.0)
    return tally, bool(told), told[0][:110] if told else ""


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--rate", type=float, default=24.0, help="frames a second")
    parser.add_argument("--live", action="store_true", help="in real time, on a pty")
    args = parser.parse_args(arguments)
    with one_thread():
        for seed in args.seed:
            found = (live if args.live else driven)(args.seconds, seed, args.rate)
            print(f"seed {seed}: {found[0]}\n   lead off: {found[2] or 'NOT TOLD'}", flush=True)


if __name__ == "__main__":
    harness.run(main)
