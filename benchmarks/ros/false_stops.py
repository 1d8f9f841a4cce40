# SPDX-License-Identifier: Apache-2.0
"""Minutes of an untouched skin on ROS 2: how often does the gate withhold motion, and why?

runs each node as a process, or with --composed `skin` with all of them in one, while a planner asks
for motion, beside so many busy loops. Counted are the times that cmd_vel falls to zero, with the
reason that the gate reports, and the gaps between messages as this process receives them: whoever
waits for them no longer than a gap would stop.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections import Counter

import numpy as np
from support.plain import Plain
from support.ros_graph import PATIENCE, Graph, Player, endless, program

from .. import harness
from .interrupt import until
from .kill import NODES, Base

GAPS = 0.06, 0.08, 0.1, 0.12, 0.15, 0.2  # s, that are counted
REPORTED = 0.3  # s after a zero by which its reason is here


class Reasons:
    """Why the gate withholds motion, as it reports it on /diagnostics."""

    def __init__(self, plain: Plain):
        from diagnostic_msgs.msg import DiagnosticArray

        self._reports: list[tuple[float, str]] = []  # when it came, and what it says
        plain.node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 100)

    def _take(self, message) -> None:
        for status in message.status:
            if "cmd_vel_gate" in status.name:
                self._reports.append((time.monotonic(), status.message))

    def of(self, at: float) -> str:
        """Return the reason for which motion is withheld from then on."""
        near = [text for t, text in self._reports if abs(t - at) < REPORTED and text != "ok"]
        return near[0].removeprefix("motion withheld: ") if near else "not reported"


def times_at_zero(heard: list[tuple[float, bool]]) -> list[tuple[float, float]]:
    """Return (from, until) of each time at zero, of (arrival, whether it moves)."""
    found, since, moved = [], None, False
    for at, moves in heard:
        if moved and not moves:
            since = at
        elif moves and since is not None:
            found.append((since, at))
            since = None
        moved = moves
    return found + ([(since, heard[-1][0])] if since is not None else [])


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--minutes", type=float, default=4.0, help="to run (default 4)")
    parser.add_argument("--loops", type=int, default=0, help="busy loops beside it (default 0)")
    parser.add_argument("--composed", action="store_true", help="all nodes in one process")
    parser.add_argument("--seed", type=int, default=1, help="of the frames (default 1)")
    args = parser.parse_args(arguments)
    player = Player()
    port = f"port:={player.port}"
    given = {
        "serial_driver": [port],
        "compensation": ["tare:=false"],
        "skin": [port, "tare:=false", "cmd_vel_gate:=true"],
    }
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(args.loops)]
    try:
        with Graph() as graph, Plain(graph.env) as plain:
            base, reasons = Base(plain), Reasons(plain)
            with player.playing(endless("idle", args.seed)):
                for kind in ("skin",) if args.composed else NODES:
                    words = [w for value in given.get(kind, ()) for w in ("-p", value)]
                    graph.start(kind, program(kind, *words))
                if not until(lambda: base.moves, PATIENCE):
                    raise RuntimeError("the robot never moved")
                time.sleep(2.0)  # s, until all have found one another
                begin = time.monotonic()
                time.sleep(60.0 * args.minutes)
                load = os.getloadavg()[0]
    finally:
        player.close()
        for process in busy:
            process.kill()
            process.wait()
    end = begin + 60.0 * args.minutes
    heard = {t: [h for h in every if begin <= h[0] < end] for t, every in base.heard.items()}
    stood = times_at_zero(heard["cmd_vel"])
    causes = Counter(reasons.of(since) for since, _ in stood)
    longest = max((b - a for a, b in stood), default=0.0)
    print(f"{args.minutes:g} minutes beside {args.loops} busy loops, load {load:.1f}")
    print(f"stood {len(stood)} times, up to {1e3 * longest:.0f} ms: {dict(causes) or 'never'}")
    figures = {"stood": len(stood), "causes": causes, "longest": longest, "load": load}
    for topic, messages in heard.items():
        gaps = np.diff([at for at, _ in messages])
        counted = {f"{1e3 * gap:.0f}": int((gaps > gap).sum()) for gap in GAPS}
        print(
            f"{topic}: {len(gaps)} gaps, max {1e3 * gaps.max():.0f} ms; longer than [ms] {counted}"
        )
        figures[topic] = counted | {"max": float(gaps.max())}
    return figures


if __name__ == "__main__":
    harness.run(main)
