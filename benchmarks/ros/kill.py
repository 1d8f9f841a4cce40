# SPDX-License-Identifier: Apache-2.0
"""Kill -9 of each process of a skin on ROS 2: how long does the robot still move?

runs each node as a process, and `skin` with all of them in one, while a planner asks for motion;
kills one at a random moment, so many times each. One that ends by itself, since ROS hides from it
what others publish, is started again, as `respawn` does, and counted. The robot moves while cmd_vel
is not zero, skin/stop is false, and neither has been silent for longer than docs/robot.md lets
twist_mux and the base's controller wait. Counted is the time from the kill until it does not.
"""

from __future__ import annotations

import os
import random
import re
import signal
import time
from pathlib import Path

import numpy as np
import yaml
from support.plain import Plain
from support.ros_graph import PATIENCE, Graph, Player, endless, program

from .. import harness
from .interrupt import MOVES, until

PAGE = Path(__file__).parents[2] / "docs" / "robot.md"
NODES = ("serial_driver", "compensation", "gesture_feature", "stop_on_push", "cmd_vel_gate")
WATCHED = 0.6  # s after a kill
LIMIT = 0.13  # s, 95th percentile; of the gate and `skin`, whose end is silence, twist_mux' timeout


def silence_allowed() -> dict[str, float]:
    """Return the timeouts of twist_mux' lock and of the base in docs/robot.md, topic -> [s]."""
    text = PAGE.read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    (found,) = (b["twist_mux"] for b in map(yaml.safe_load, blocks) if "twist_mux" in b)
    (base,) = re.findall(r"cmd_vel_timeout: ([\d.]+)", text)
    lock = found["ros__parameters"]["locks"]["skin"]["timeout"]
    return {"skin/stop": lock, "cmd_vel": float(base)}


class Base:
    """A planner, and a base that moves as skin/stop and cmd_vel let it, on rclpy alone.

    Attributes:
        heard: topic -> (arrival [s], whether the robot may move) of each message.
    """

    def __init__(self, plain: Plain):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import Twist
        from std_msgs.msg import Bool

        self._allowed = silence_allowed()
        asked = Twist()
        asked.linear.x = MOVES
        commands = plain.node.create_publisher(Twist, "cmd_vel_in", 1)
        plain.node.create_timer(0.05, lambda: commands.publish(asked))
        self.heard: dict[str, list[tuple[float, bool]]] = {"skin/stop": [], "cmd_vel": []}
        for kind, topic, free in (
            (Bool, "skin/stop", lambda m: not m.data),
            (Twist, "cmd_vel", lambda m: m.linear.x != 0.0),
        ):
            plain.node.create_subscription(kind, topic, self._noter(topic, free), 100)
        self._reason = ""
        plain.node.create_subscription(DiagnosticArray, "skin/stop_status", self._hear_reason, 10)

    def _hear_reason(self, message) -> None:
        self._reason = message.status[0].message

    def _noter(self, topic, free):
        return lambda m: self.heard[topic].append((time.monotonic(), free(m)))

    @property
    def moves(self) -> bool:
        now = time.monotonic()
        lasts = {t: heard[-1] if heard else (0.0, False) for t, heard in self.heard.items()}
        return all(free and now - at < self._allowed[t] for t, (at, free) in lasts.items())

    def lasts(self) -> str:
        """Return what was heard last of each topic, how long ago, and why it is stopped."""
        now = time.monotonic()
        return f"{self._reason or 'no reason'}; " + ", ".join(
            f"{topic} {'free' if heard[-1][1] else 'stop'} {now - heard[-1][0]:.2f} s ago"
            if heard
            else f"{topic} never"
            for topic, heard in self.heard.items()
        )

    def halts(self, since: float) -> tuple[float, bool]:
        """Return when it stood, and whether it was so by a message, not by silence."""
        ends = []
        for topic, heard in self.heard.items():
            last, allowed = since, self._allowed[topic]
            for at, free in (*heard, (since + WATCHED + allowed, False)):
                if at >= since and at - last > allowed:
                    ends.append((last + allowed, False))
                    break
                if at >= since and not free:
                    ends.append((at, True))
                    break
                last = at
        return min(ends)


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--times", type=int, default=20, help="that each is killed (default 20)")
    parser.add_argument("--only", nargs="+", default=(*NODES, "skin"), help="who is killed")
    parser.add_argument("--seed", type=int, default=1, help="of frames and moments (default 1)")
    args = parser.parse_args(arguments)
    dice, allowed = random.Random(args.seed), silence_allowed()
    print(f"[ms] from kill -9 until the robot stands; silence [s] for which it goes on: {allowed}")
    figures: dict[str, list[float]] = {}
    late = []
    given = ["-p", "tare:=false", "-p", "cmd_vel_gate:=true"]
    for kinds in (NODES, ("skin",)):
        if not (asked := [kind for kind in kinds if kind in args.only]):
            continue
        player = Player()
        port = ["-p", f"port:={player.port}"]
        words = {
            "serial_driver": port,
            "compensation": given[:2],
            "skin": port + given,
        }
        with Graph() as graph:
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            with Plain(graph.env) as plain, player.playing(endless("idle", args.seed)):
                base = Base(plain)
                for kind in kinds:
                    graph.start(kind, program(kind, *words.get(kind, ())))
                for kind in asked:
                    seconds, said, ended = killed(graph, base, kind, words, args.times, dice)
                    figures[kind] = [round(s, 4) for s in seconds]
                    median, high, most = 1e3 * np.percentile(seconds, [50, 95, 100])
                    times = f"median {median:4.0f}  p95 {high:4.0f}  max {most:4.0f}"
                    print(f"{kind:16} {times}  by a message {said:.0%}  ended {ended}", flush=True)
                    limit = allowed["skin/stop"] if kind in ("skin", "cmd_vel_gate") else LIMIT
                    late += [kind] if high > 1e3 * limit else []
        player.close()
    print(f"load {os.getloadavg()[0]:.1f}")
    print(f"later than allowed: {', '.join(late) or 'none'}")
    return figures


def killed(graph, base, kind, words, times, dice) -> tuple[list[float], float, int]:
    """Kill it so many times; the seconds that each took, the share by a message, who ended."""
    seconds, said, ended = [], 0, 0

    def moves() -> bool:
        nonlocal ended
        for name in [n for n, p in graph.processes.items() if p.poll() is not None]:
            ended += 1
            graph.start(name, program(name, *words.get(name, ())))
        return base.moves

    def wait_until_it_moves() -> None:
        if not until(moves, PATIENCE):
            say = "\n".join(f"--- {name}: {graph.said(name)[-500:]}" for name in graph.processes)
            raise RuntimeError(f"the robot does not move: {base.lasts()}\n{say}")

    for _ in range(times):
        wait_until_it_moves()
        time.sleep(dice.uniform(0.1, 0.6))
        wait_until_it_moves()  # a busy computer has stopped it meanwhile
        begin = time.monotonic()
        graph.stop(kind, signal.SIGKILL)
        time.sleep(WATCHED)
        end, by_word = base.halts(begin)
        seconds.append(end - begin)
        said += by_word
        graph.start(kind, program(kind, *words.get(kind, ())))
    return seconds, said / times, ended


if __name__ == "__main__":
    harness.run(main)
