# SPDX-License-Identifier: Apache-2.0
"""What open pages cost the stop: last byte to stop hook, with and without them, in turns.

One run of skin.launch.yaml on a simulated board. In every second turn ("shown") five pages are
open, in a process of their own at the lowest priority (the computers of those who look are others):
three draw 60 times a second, one is asleep, one reads 20 kB a second. Prints p50 and p99 [ms] of
both kinds of turn, and the median of the turns' p99: on a busy computer the bursts of others fall
into a few turns. --bare: a third kind, with no node `view` at all, started and destroyed in
turns.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import re
import time
from pathlib import Path

import numpy as np

from tactile_skin.launch import Skin, find, read_plan
from tactile_skin.middleware.bus import Time
from tactile_skin.middleware.plan import make_node
from tactile_skin.msg import DiagnosticArray, Image

from .. import harness

SHOWN = "shown"  # turns in which somebody looks
WARM_UP = 0.7  # s of a turn that do not count: pages open, the processor's clock changes
FRAME = 1.0 / 60.0  # s, of a page that is drawn
NUMBER = re.compile(rb'"number":(\d+)')
SPAWN = multiprocessing.get_context("spawn")


async def page(url: str, kind: str, opened: asyncio.Event, drawn: dict) -> None:
    from websockets.asyncio.client import connect

    address = url.replace("http", "ws", 1) + "/snapshots"
    async with connect(address, origin=url, max_size=None, max_queue=1) as socket:
        await socket.recv()
        opened.set()
        number = 0
        while True:
            begun = time.monotonic()
            await socket.send(json.dumps({"after": number, "drawn": number}))
            if kind == "asleep":
                await asyncio.sleep(3600.0)
            data = await socket.recv()
            number = int(NUMBER.search(data)[1])  # a browser that draws it is another computer's
            drawn[kind] = drawn.get(kind, 0) + 1
            pause = len(data) / 20e3 if kind == "slow" else FRAME - (time.monotonic() - begun)
            await asyncio.sleep(max(0.0, pause))


def pages(url: str, pipe) -> None:
    """Five pages, opened and closed in turns; answers with their snapshots a second."""
    os.nice(19)

    async def run() -> dict:
        kinds, drawn = ("drawn", "drawn", "drawn", "asleep", "slow"), {}
        events = [asyncio.Event() for _ in kinds]
        tasks = [
            asyncio.create_task(page(url, kind, event, drawn))
            for kind, event in zip(kinds, events, strict=True)
        ]
        for event in events:
            await event.wait()
        pipe.send("they are open")
        await asyncio.sleep(WARM_UP)
        drawn.clear()
        begun, own = time.monotonic(), time.process_time()
        while not pipe.poll():
            await asyncio.sleep(0.05)
        seconds, own = time.monotonic() - begun, time.process_time() - own
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return {kind: n / seconds for kind, n in drawn.items()} | {"cpu": own / seconds}

    while pipe.recv() == "open":
        found = asyncio.run(run())
        pipe.recv()  # "close"
        pipe.send(found)


class Page:
    """The node `view` of a skin, and who looks."""

    def __init__(self, skin: Skin, action):
        self._handle = make_node(action, skin._context)
        self._view = action.made_by(self._handle)
        skin._executor.add_node(self._handle)
        self._pipe, theirs = SPAWN.Pipe()
        self._pid = self._view._page._process.pid
        url = self._view._page.address
        self._process = SPAWN.Process(target=pages, args=(url, theirs), daemon=True)
        self._process.start()
        self.open()
        self.shut()

    def open(self) -> None:
        self._pipe.send("open")
        self._pipe.recv()

    def shut(self) -> dict:
        self._pipe.send("close")
        return self._pipe.recv()

    def cpu(self) -> float:
        """Processor time of who serves so far [s]."""
        fields = Path(f"/proc/{self._pid}/stat").read_text().split(") ")[1]
        return sum(map(int, fields.split()[11:13])) / os.sysconf("SC_CLK_TCK")

    def end(self) -> None:
        self._process.terminate()
        self._process.join()
        self._view.close()
        self._handle.destroy_node()


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--turns", type=int, default=20, help="of each kind (default 20)")
    parser.add_argument("--seconds", type=float, default=3.0, help="of a turn (default 3)")
    parser.add_argument("--bare", action="store_true", help="turns without the node `view`, too")
    args = parser.parse_args(arguments)
    kinds = ["no page", SHOWN] + ["no view"] * args.bare
    arguments = {"method": "auto", "monitor": "false", "view": "true", "view_port": "0"}
    plan = read_plan(find("demo.launch.yaml"), arguments)
    (action,) = [a for a in plan.nodes if a.executable == "view"]
    plan.nodes.remove(action)
    action.give({"port": 0})
    with Skin(plan) as skin:
        measure(skin, action, kinds, args)


def measure(skin: Skin, action, kinds: list[str], args) -> None:
    latencies: dict[str, list[list[float]]] = {kind: [] for kind in kinds}
    here: list[float] = []
    arrived: dict[int, bool] = {}

    def on_adc(message: Image) -> None:
        arrived[Time.from_msg(message.header.stamp).nanoseconds] = True
        while len(arrived) > 100:
            del arrived[next(iter(arrived))]

    def on_status(message: DiagnosticArray) -> None:
        now = skin.node.get_clock().now().nanoseconds
        if arrived.pop(stamp := Time.from_msg(message.header.stamp).nanoseconds, False):
            here.append((now - stamp) / 1e6)

    skin.node.create_subscription(Image, "skin/adc", on_adc, 100)
    skin.node.create_subscription(DiagnosticArray, "skin/stop_status", on_status, 100)
    rates, cpu, shown = [], [], None
    used: dict[str, list[float]] = {kind: [] for kind in kinds}  # of the skin's process [s]
    rng = np.random.default_rng(1)
    for _ in range(args.turns):
        for kind in rng.permutation(kinds):
            if kind == "no view" and shown is not None:
                shown.end()
                shown = None
            elif kind != "no view" and shown is None:
                shown = Page(skin, action)
            if kind == SHOWN:
                shown.open()
            time.sleep(WARM_UP)
            here.clear()
            begun, own = shown.cpu() if shown else 0.0, time.process_time()
            skin.spin(args.seconds)
            used[kind].append((time.process_time() - own) / max(len(here), 1))
            latencies[kind].append(list(here))
            if kind == SHOWN:
                cpu.append((shown.cpu() - begun) / args.seconds)
                rates.append(shown.shut())
    if shown is not None:
        shown.end()
    for kind, turns in latencies.items():
        p50, p99 = np.percentile(np.concatenate(turns), (50, 99))
        usual = np.median([np.percentile(turn, 99) for turn in turns])
        n = sum(map(len, turns))
        print(
            f"{kind:>11}: p50 {p50:.2f} ms, p99 {p99:.2f} ms of {n} readings; "
            f"p99 of the median turn {usual:.2f} ms; the skin's process takes "
            f"{1e3 * np.median(used[kind]):.2f} ms a reading"
        )
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for kind in ("drawn", "slow"):
        each = np.mean([r.get(kind, 0.0) for r in rates]) / (3 if kind == "drawn" else 1)
        print(f"a page that is {kind}: {each:.1f} snapshots a second")
    print(f"the page's process: {100 * np.mean(cpu):.0f} % of a core for all of them")
    looking = 100 * np.mean([r["cpu"] for r in rates])
    print(f"those who look take {looking:.0f} % of a core, which in life is another computer's")


if __name__ == "__main__":
    harness.run(main)
