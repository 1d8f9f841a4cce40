# SPDX-License-Identifier: Apache-2.0
"""Whether a recording of the demo, played with a simulated clock, brings the same stops.

plays the readings of the demo with /clock, as `ros2 bag play --clock -r SPEED` does, to `skin`
without its driver on ROS 2, and notes when the stop changes, on the simulated clock. A computer
that is too slow for the speed adds stops for stale readings: pushes are compared alone as well.
"""

from __future__ import annotations

import os
import sys
import time

from support.plain import Plain
from support.ros_graph import Graph, record

from tactile_skin.board.protocol import BinaryParser

from .. import harness

RATE = 100.0  # readings a second, simulated
BEGIN = 1000.0  # s, of the simulated clock
FREE_WITHIN = 2.0  # s, of rest before the demo: the start of the nodes is no part of it
LISTENS = 60.0  # s until the nodes listen


def play(frames: list[bytes], speed: float) -> list[tuple[float, str]]:
    """(time of the reading [s], reason) of each change of the stop once the robot was free."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import Image

    with Graph() as graph, Plain(graph.env) as plain:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        words = [sys.executable, "-m", "tactile_skin.ros", "skin", "--ros-args"]
        words += ["-p", "serial_driver:=false", "-p", "use_sim_time:=true", "-p", "method:=map"]
        words += ["-p", "tare:=false", "-p", "noise:=0.5", "-p", "time_limit:=10.0"]
        graph.start("skin", words)
        clock = plain.node.create_publisher(Clock, "/clock", 100)
        adc = plain.node.create_publisher(Image, "skin/adc", 100)
        plain.hear(DiagnosticArray, "skin/stop_status")
        deadline = time.monotonic() + LISTENS
        while not (adc.get_subscription_count() and clock.get_subscription_count()):
            if time.monotonic() > deadline:
                raise RuntimeError(graph.said("skin"))
            time.sleep(0.05)
        parser, tick = BinaryParser(), time.monotonic()
        for k, data in enumerate(frames):
            (frame,) = parser.feed(data)
            now = Clock()
            now.clock.sec, now.clock.nanosec = divmod(round((BEGIN + k / RATE) * 1e9), 10**9)
            picture = Image(height=16, width=16, encoding="16UC1", step=32)
            picture.header.frame_id, picture.header.stamp = "base_link", now.clock
            picture.data.frombytes(frame.samples.astype("<u2").tobytes())
            clock.publish(now)
            adc.publish(picture)
            tick = max(tick + 1.0 / (RATE * speed), time.monotonic())  # late: not faster then
            time.sleep(max(0.0, tick - time.monotonic()))
        heard = list(plain.heard["skin/stop_status"])
    changes, last, free = [], None, False
    for message in heard:
        status, stamp = message.status[0], message.header.stamp
        reason = status.message if status.level != b"\0" else ""
        free = free or not reason
        t = stamp.sec + stamp.nanosec * 1e-9 - BEGIN
        if free and reason != last and t < (len(frames) - 1) / RATE:
            changes.append((round(t, 2), reason))
        last = reason
    return changes


def pushed(changes: list[tuple[float, str]]) -> list[float]:
    """When a push began or ended [s], whatever else stopped the robot."""
    found, before = [], False
    for t, reason in changes:
        now = any(why.startswith("push") for why in reason.split(" + "))
        if now != before:
            found.append(t)
        before = now
    return found


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.5, 1.0, 4.0])
    args = parser.parse_args(arguments)
    frames = record(round(FREE_WITHIN * RATE), "idle", args.seed)
    frames += record(round(args.seconds * RATE), "demo", args.seed)
    found = {}
    for speed in args.speeds:
        found[speed] = play(frames, speed)
        print(f"{speed:g} times: {len(found[speed])} changes")
        for t, reason in found[speed]:
            print(f"  {t:7.2f} s  {reason or 'free'}")
    stops = [[c for c in changes if c[0] > FREE_WITHIN] for changes in found.values()]
    same = all(other == stops[0] for other in stops) and any(reason for _, reason in stops[0])
    pushes = [pushed(changes) for changes in found.values()]
    alike = all(other == pushes[0] for other in pushes) and pushes[0]
    print(f"pushes at {pushes[0]} s" if alike else f"NOT the same pushes: {pushes}")
    print("the same stops" if same else "NOT the same stops")
    return 0 if same else 1


if __name__ == "__main__":
    harness.run(main)
