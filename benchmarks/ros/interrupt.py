# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C on a busy computer: does the skin end cleanly, and are its last messages a stop?

runs `skin` with the velocity gate on ROS 2, beside so many busy loops, while the robot moves, and
interrupts it at a random moment. Counted are exit statuses of 0, and last messages that are
skin/stop = true and cmd_vel = 0, as another process hears them.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time

from support.ros_graph import PATIENCE, Graph, Player, endless

from .. import harness

MOVES = 0.2  # m/s, what the planner asks for
WORDS_WITHIN = 2.0  # s after the process has ended, for messages to be taken here


class Robot:
    """A planner and a base, on rclpy alone.

    Attributes:
        stop, speed: what was heard last; None: nothing.
    """

    def __init__(self):
        import rclpy
        from geometry_msgs.msg import Twist
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions
        from std_msgs.msg import Bool

        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("robot")
        self.forget()
        asked = Twist()
        asked.linear.x = MOVES
        commands = node.create_publisher(Twist, "cmd_vel_in", 1)
        node.create_timer(0.05, lambda: commands.publish(asked))
        node.create_subscription(Bool, "skin/stop", self.on_stop, 100)
        node.create_subscription(Twist, "cmd_vel", self.on_velocity, 100)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, args=(executor,), daemon=True)
        self._thread.start()

    def _spin(self, executor) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    def close(self) -> None:
        import rclpy

        rclpy.try_shutdown()
        self._thread.join()

    def forget(self) -> None:
        self.stop = self.speed = None

    def on_stop(self, message) -> None:
        self.stop = message.data

    def on_velocity(self, message) -> None:
        self.speed = message.linear.x


def until(happened, seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while not happened():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--loops", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    dice, player = random.Random(args.seed), Player()
    clean = stopped = stood = 0
    seconds = []
    with Graph() as graph:
        os.environ.update(graph.env)
        robot = Robot()
        words = [sys.executable, "-m", "tactile_skin.ros", "skin", "--ros-args"]
        words += ["-p", f"port:={player.port}", "-p", "cmd_vel_gate:=true", "-p", "watchdog:=60.0"]
        busy = [
            subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(args.loops)
        ]
        try:
            for k in range(args.times):
                robot.forget()
                graph.start("skin", words)
                with player.playing(endless("idle", args.seed + k)):
                    if not until(lambda: robot.speed == MOVES, PATIENCE):
                        print(f"run {k}: the robot never moved: {graph.said('skin')[-500:]}")
                        graph.stop("skin")
                        continue
                    time.sleep(dice.uniform(0.0, 0.5))
                    begin = time.monotonic()
                    status = graph.stop("skin", signal.SIGINT)
                    seconds.append(time.monotonic() - begin)
                last = until(lambda: robot.stop and robot.speed == 0.0, WORDS_WITHIN)
                time.sleep(0.2)  # nothing else may follow
                clean += status == 0
                stopped += robot.stop is True
                stood += robot.speed == 0.0
                if status or not last or not robot.stop or robot.speed:
                    said = graph.said("skin")[-1000:]
                    print(f"run {k}: status {status}, stop {robot.stop}, {robot.speed} m/s: {said}")
        finally:
            for process in busy:
                process.kill()
                process.wait()
    player.close()
    robot.close()
    print(
        f"{args.times} times beside {args.loops} busy loops: {clean} ended with 0, last words stop "
        f"{stopped}, cmd_vel 0 {stood}; it took up to {max(seconds, default=0.0):.2f} s"
    )
    return 0 if clean == stopped == stood == args.times else 1


if __name__ == "__main__":
    harness.run(main)
