# SPDX-License-Identifier: Apache-2.0
"""One body of boards on two computers: two processes that share nothing but a network.

They meet over UDP on loopback, as computers do: shared memory is switched off.
"""

import os
import signal
import sys

import pytest
from support.ros_graph import board, endless, program
from test_ros_body import NAMES, write

# A computer's clock is its own: the same program, whose time of day is so many seconds ahead.
OTHER_CLOCK = """
import sys, time
real = time.time_ns
time.time_ns = lambda: real() + round({ahead} * 1e9)
from tactile_skin import ros
sys.exit(ros.run("skin", {words}))
"""


@pytest.mark.ros
def test_a_skin_of_another_computer_is_part_of_the_body(graph, plain, tmp_path):
    """A push on it, its silence, and a clock that is not the body's stop by its name."""
    from diagnostic_msgs.msg import DiagnosticArray

    graph.env["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
    plain.hear(DiagnosticArray, "skin/stop_status")

    def status():
        return plain.heard["skin/stop_status"][-1].status[0]

    def says(words: str) -> bool:
        return bool(plain.heard["skin/stop_status"]) and words in (status().message or "free")

    def start_arm(ahead: float) -> None:
        words = ["--ros-args", "-p", f"config:={config}", "-r", "__ns:=/back"]
        code = OTHER_CLOCK.format(ahead=ahead, words=words)
        graph.start("arm", [sys.executable, "-c", code])

    def age() -> float:
        words = {pair.key: pair.value for pair in status().values}["ages"].split()
        return float(words[words.index("back") + 1])

    with board() as chest, board() as back:
        boards = dict(zip(NAMES, (chest, back), strict=True))
        config = write(tmp_path, boards, elsewhere={"back"})
        graph.start("body", program("body", "-p", f"config:={config}"))
        with chest.playing(endless("idle", 1)):
            plain.until(lambda: says("back: stale: no message"), "not there yet", graph)
            start_arm(0.0)
            with back.playing(endless("idle", 2)):
                plain.until(lambda: says("free"), "free", graph)
                assert 0.0 <= age() < 0.5
            with back.playing(endless("push_left", 2)):
                plain.until(lambda: says("back: push"), "a push there", graph)
            with back.playing(endless("idle", 2)):
                plain.until(lambda: says("free"), "free again", graph)
                os.kill(graph.processes["arm"].pid, signal.SIGSTOP)
                plain.until(lambda: says("back: stale: no message"), "a silent computer", graph)
                os.kill(graph.processes["arm"].pid, signal.SIGCONT)
                plain.until(lambda: says("free"), "free after its silence", graph)
                for ahead, words in ((0.3, "its clock is ahead"), (-1.0, "its clock is behind")):
                    graph.stop("arm")
                    start_arm(ahead)
                    plain.until(lambda w=words: says("back: stale: its ") and says(w), words, graph)
                    assert (age() < 0.0) == (ahead > 0.0)
