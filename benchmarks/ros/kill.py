# SPDX-License-Identifier: Apache-2.0
"""Kill -9 of each process of `ros2 launch`: how long does the robot still move, when again?

runs skin.launch.yaml and body.launch.yaml of two skins with separate:=true, while a planner asks
for motion; kills one process at a random moment, so many times each, which launch starts again. The
robot moves while cmd_vel is not zero, skin/stop is false, and neither has been silent for longer
than docs/robot.md lets twist_mux and the base's controller wait. Counted is the time from the kill
until it does not, and until it does again, with a rest that is known: nothing is measured first.
"""

from __future__ import annotations

import contextlib
import os
import random
import re
import signal
import time
from pathlib import Path

import numpy as np
import yaml
from support.plain import Plain
from support.ros_graph import PATIENCE, Graph, Player, board, endless

from .. import harness
from .interrupt import MOVES, until

PAGE = Path(__file__).parents[2] / "docs" / "robot.md"
NODES = ("serial_driver", "compensation", "gesture_feature", "stop_on_push", "cmd_vel_gate")
SKINS = "chest", "back"
LAUNCHES = {"skin": NODES, "body": (*(f"{name}/skin" for name in SKINS), "body", "cmd_vel_gate")}
BY_SILENCE = "cmd_vel_gate", "body"  # whose end is silence on what the robot hears
WATCHED = 0.6  # s after a kill
LIMIT = 0.13  # s, 95th percentile; where the end is silence, twist_mux' timeout


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
    parser.add_argument("--only", nargs="+", default=[*LAUNCHES], help="launch files, by name")
    parser.add_argument("--seed", type=int, default=1, help="of frames and moments (default 1)")
    args = parser.parse_args(arguments)
    dice, allowed = random.Random(args.seed), silence_allowed()
    print(f"[ms] from kill -9 until the robot stands; silence [s] for which it goes on: {allowed}")
    figures: dict[str, dict[str, list[float]]] = {}
    late = []
    for launched in args.only:
        with Graph() as graph, contextlib.ExitStack() as stack:
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            plain = stack.enter_context(Plain(graph.env))
            players = {name: stack.enter_context(board()) for name in SKINS}
            for player in players.values():
                stack.enter_context(player.playing(endless("idle", args.seed)))
            base, words = Base(plain), write(graph.folder, launched, players)
            asked = ["separate:=true", "cmd_vel_gate:=true", "monitor:=false", *words]
            graph.launch(launched, "tactile_skin", f"{launched}.launch.yaml", *asked)
            for kind in LAUNCHES[launched]:
                found = [killed(graph, base, launched, kind, dice) for _ in range(args.times)]
                seconds, again, words_said = zip(*found, strict=True)
                figures[f"{launched}: {kind}"] = {"stands": seconds, "again": again}
                median, high, most = 1e3 * np.percentile(seconds, [50, 95, 100])
                back = np.percentile(again, [50, 95])
                print(
                    f"{kind:16} median {median:4.0f}  p95 {high:4.0f}  max {most:4.0f}  "
                    f"by a message {np.mean(words_said):.0%}  moves again after {back[0]:.1f} s, "
                    f"p95 {back[1]:.1f} s",
                    flush=True,
                )
                limit = allowed["skin/stop"] if kind in BY_SILENCE else LIMIT
                late += [kind] if high > 1e3 * limit else []
    print(f"load {os.getloadavg()[0]:.1f}")
    print(f"later than allowed: {', '.join(late) or 'none'}")
    return figures


def write(folder: Path, launched: str, players: dict[str, Player]) -> list[str]:
    """Return the arguments of a launch: the file of its skins, whose rest is known, and ports."""
    path = folder / f"{launched}.yaml"
    data: dict = {"/**/compensation": {"ros__parameters": {"tare": False}}}
    if launched == "body":
        data["skins"] = {
            name: {
                "port": player.port,
                "geometry": {"shape": "plane", "translation": [0.5 * k, 0.0, 0.0]},
            }
            for k, (name, player) in enumerate(players.items())
        }
    path.write_text(yaml.safe_dump(data))
    port = [f"port:={players[SKINS[0]].port}"] if launched == "skin" else []
    return [f"config:={path}", *port]


def killed(graph: Graph, base: Base, launched: str, kind: str, dice) -> tuple[float, float, bool]:
    """Kill it; after how long the robot stood, and moved again [s], and whether by a message."""

    def wait_until_it_moves() -> None:
        if not until(lambda: base.moves, PATIENCE):
            say = graph.said(launched)[-2000:]
            raise RuntimeError(f"the robot does not move: {base.lasts()}\n{say}")

    wait_until_it_moves()
    time.sleep(dice.uniform(0.1, 0.6))
    wait_until_it_moves()  # a busy computer has stopped it meanwhile
    begin = time.monotonic()
    os.kill(graph.processes_of(launched)[kind], signal.SIGKILL)
    time.sleep(WATCHED)
    end, by_word = base.halts(begin)
    wait_until_it_moves()
    return end - begin, time.monotonic() - begin, by_word


if __name__ == "__main__":
    harness.run(main)
