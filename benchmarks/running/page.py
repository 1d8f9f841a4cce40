# SPDX-License-Identifier: Apache-2.0
"""How often the page of a running skin is drawn in Chromium, and what a draw costs.

The board's scans are computed before. Prints the snapshots that were drawn in a second and the
processor time of each draw, in Chromium (all its processes, without a GPU), in the page's server
and, on ROS, in `view` and `skin`.
--space: with the cover in space. --ros: of a skin in a namespace, by ROS 2.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import re
import tempfile
import time
from pathlib import Path

from support.chromium import Chromium
from support.ros_graph import Graph, Player, program, record

from tactile_skin import launch
from tactile_skin.launch import share_dir
from tactile_skin.nodes.observers.view import View

from .. import harness

SIZE = 1400, 910  # of the page [px]
BEFORE = 15.0  # s that a board plays, at most, until the page is measured
CONFIG = share_dir() / "config" / "demo.yaml"
SPAWN = multiprocessing.get_context("spawn")  # a fork would copy this process's threads half


def processor_time(pid: int) -> float:
    """Of a process and its children, so far [s]."""
    parents, ticks = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            fields = (folder / "stat").read_text().rsplit(") ", 1)[1].split()
            parents[int(folder.name)] = int(fields[1])
            ticks[int(folder.name)] = int(fields[11]) + int(fields[12])
    total, todo = 0, [pid]
    while todo:
        each = todo.pop()
        total += ticks.get(each, 0)
        todo += [child for child, parent in parents.items() if parent == each]
    return total / os.sysconf("SC_CLK_TCK")


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=20.0, help="to measure (default 20)")
    parser.add_argument("--ros", action="store_true", help="of a skin in a namespace, on ROS 2")
    parser.add_argument("--space", action="store_true", help="with the cover in space")
    args = parser.parse_args(arguments)
    served = (on_ros if args.ros else in_process)(args.seconds)
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        Chromium(Path(folder), *SIZE) as browser,
        served as (address, pids, wait),
    ):
        browser.open(address)
        if args.space:
            browser.click("button", "in space")
        wait(2.0)
        pids = {"Chromium": browser._process.pid} | pids
        before = {name: processor_time(pid) for name, pid in pids.items()}
        frames, start = drawn(browser), time.monotonic()
        wait(args.seconds)
        frames, seconds = drawn(browser) - frames, time.monotonic() - start
        print(f"{frames / seconds:.1f} draws a second, load {os.getloadavg()[0]:.1f}")
        for name, pid in pids.items():
            used = processor_time(pid) - before[name]
            print(f"{1e3 * used / frames:.1f} ms a draw in {name}")
        assert not browser.errors, browser.errors


@contextlib.contextmanager
def in_process(seconds: float):
    """Run a skin; yield the page's address, whose times count, and how to wait."""
    arguments = {"method": "auto", "view": "true", "view_port": "0", "monitor": "false"}
    with board(seconds) as port, launch.launch(port=port, config=str(CONFIG), **arguments) as skin:
        view = next(node for node in skin._nodes if isinstance(node, View))
        yield view._page.address, {"the page's server": view._page._process.pid}, skin.spin


@contextlib.contextmanager
def on_ros(seconds: float):
    """Run a skin in a namespace and its page as processes on ROS; yield the same."""
    space = ["-r", "__ns:=/left"]
    with Graph() as graph, board(seconds) as port:
        given = ["-p", f"config:={CONFIG}"]
        words = [*given, "-p", f"port:={port}", "-p", "method:=auto"]
        graph.start("skin", program("skin", *space, *words))
        given += ["-p", "port:=0", "-p", "controls:=false"]
        graph.start("view", program("view", *space, *given))
        graph.wait_for(lambda: "http://" in graph.said("view"), "the page is served")
        (address,) = re.findall(r"http://[\d.]+:\d+", graph.said("view"))
        pids = {name: process.pid for name, process in graph.processes.items()}
        yield address, pids, time.sleep


@contextlib.contextmanager
def board(seconds: float):
    """Play a board in a process of its own; yield its port."""
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=play, args=(theirs, BEFORE + seconds), daemon=True)
    process.start()
    try:
        yield ours.recv()
    finally:
        process.terminate()


def play(pipe, seconds: float) -> None:
    """Compute a board's scans, say on which port it is, and play them."""
    player = Player()
    frames = record(round(player.rate * seconds))
    pipe.send(player.port)
    player.play(frames)


def drawn(browser: Chromium) -> int:
    """Snapshots that the page has drawn."""
    return browser.run("Number(document.body.dataset.draws)")


if __name__ == "__main__":
    harness.run(main)
