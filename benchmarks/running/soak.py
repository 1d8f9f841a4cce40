# SPDX-License-Identifier: Apache-2.0
"""The skin for a long time: does it miss frames, slow down, leak, or let go of the robot?

The first runs the nodes of skin.launch.yaml on a simulated board of 16 x 16 cells, a process of its
own that plays touches, and prints a line a minute. The second pulls that board's plug again and
again. Both compare memory, threads and file descriptors with what they were once warm. A frame that
is missed is the host's where a ticker, a process on each processor, tells that it stood still, or
where the skin's own threads waited for a processor that others had; else it is the skin's.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import select
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from tactile_skin import Circuit, PressureCurve
from tactile_skin.launch import Skin, find, read_plan
from tactile_skin.middleware.bus import Time
from tactile_skin.msg import DiagnosticArray, Image
from tactile_skin.nodes.stop_on_push import STATUS, STATUS_TOPIC
from tactile_skin.simulation import scenes, simulator

from .. import harness

TICK, STALL = 1e-3, 0.02  # s between a ticker's ticks; s without one that are a stall
BUSY = 0.25  # of the time between two looks in which threads could run, and had no processor
NEAR = 0.1  # s about a stall in which what is missed is the host's
WARM = 60.0  # s after which memory is what it will be
MEMORY = 5.0  # MiB that it may grow by
STOPPED_WITHIN = 0.3  # s from the unplugging to the stop hook
PATIENCE = 30.0  # s for what must happen
BAUD = 4_000_000  # 390 frames of 529 bytes are more than the board's 1 Mbaud carries
LOOK = 0.05  # s between two looks at the counters
SECONDS_KEPT = 61  # of latencies


# --- processes of its own ---


def run_board(link: str, rate: float, scene: str) -> None:
    """A board that follows words on stdin: unplug, plug.

    Whenever it is unplugged it says how many frames it sent, and when its end of the wire was gone.
    """
    circuit = Circuit()
    plugged, over = threading.Event(), threading.Event()
    plugged.set()

    def listen():
        for line in sys.stdin:
            plugged.set() if line.strip() == "plug" else plugged.clear()
        over.set()
        plugged.clear()

    threading.Thread(target=listen, daemon=True).start()
    sent = 0
    while not over.is_set():
        if not plugged.wait(0.01):
            continue
        simulated = simulator.Board(
            circuit, PressureCurve(), scenes.script(scene, *circuit.shape), frames_per_second=rate
        )
        simulator.serve(simulated, Path(link), plugged.is_set, BAUD)
        sent += simulated._sent
        with contextlib.suppress(BrokenPipeError):
            print(sent, time.monotonic(), flush=True)


def run_ticker(cpu: int) -> None:
    """Say from when to when this processor, or the whole machine, stood still."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cpu})
    last = time.monotonic()
    while not select.select([sys.stdin], [], [], TICK)[0]:
        now = time.monotonic()
        if now - last > STALL:
            print(last, now, flush=True)
        last = now


class Helper:
    """A process of this script; what it says is in `lines`."""

    def __init__(self, *words):
        command = [sys.executable, "-m", "benchmarks.running.soak", *map(str, words)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.lines: list[str] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line)

    def say(self, word: str) -> None:
        self._process.stdin.write(word + "\n")
        self._process.stdin.flush()

    def end(self) -> None:
        self._process.stdin.close()
        self._process.wait(PATIENCE)
        self._thread.join(PATIENCE)
        self._process.stdout.close()


# --- what is watched ---


def resources() -> dict[str, float]:
    """Of this process: memory [MiB], threads, file descriptors."""
    status = Path("/proc/self/status").read_text()
    memory = next(int(row.split()[1]) for row in status.splitlines() if row.startswith("VmRSS"))
    return {
        "MiB": memory / 1024,
        "threads": threading.active_count(),
        "fds": len(os.listdir("/proc/self/fd")),
    }


class Waiting:
    """How long threads of this process were ready to run and had no processor, as Linux tells."""

    def __init__(self):
        self._before: dict[str, int] = {}

    def look(self) -> float:
        """All such time since the last look [s]."""
        now = {}
        for place in Path("/proc/self/task").iterdir():
            with contextlib.suppress(OSError, IndexError, ValueError):  # it has just ended
                now[place.name] = int((place / "schedstat").read_text().split()[1])
        waited = sum(t - self._before.get(name, t) for name, t in now.items())
        self._before = now
        return waited / 1e9


class Watch:
    """Counts readings and decisions in their publishers' threads: none is lost to a queue."""

    def __init__(self, skin: Skin, rate: float):
        self.skin, self.clock = skin, skin.node.get_clock()
        plan = zip(skin._plan.nodes, skin._nodes, strict=True)
        nodes = {action.executable: node for action, node in plan}
        self._reader = nodes["serial_driver"]._reader
        self._compensation = nodes["compensation"]
        self.readings = self.decisions = 0
        self.stops: dict[str, int] = {}  # reason -> how often it began
        self.changes: list[tuple[float, str]] = []  # monotonic [s], reason of the stop or ""
        self.changed = threading.Condition()
        self._stamp, self._reason = 0, "at the start"
        self._latencies, self._n = np.zeros(round(rate * SECONDS_KEPT)), 0
        self._listen(Image, "skin/adc", 1, self._on_adc)
        self._listen(DiagnosticArray, STATUS_TOPIC, STATUS, self._on_status)
        skin.on_stop(self._on_stop)

    def _listen(self, kind, topic, qos, callback) -> None:
        self.skin.node.create_subscription(kind, topic, callback, qos).put = callback

    def _on_adc(self, _) -> None:
        self.readings += 1

    def _on_status(self, message: DiagnosticArray) -> None:
        reason = message.status[0].message
        if reason != self._reason and reason:
            whole = reason.startswith("fault")
            kind = reason if whole else ":".join(reason.split(":")[:2])  # without figures
            self.stops[kind] = self.stops.get(kind, 0) + 1
        self._reason = reason
        stamp = Time.from_msg(message.header.stamp)
        if stamp.nanoseconds > self._stamp:
            self._stamp = stamp.nanoseconds
            self._latencies[self._n % len(self._latencies)] = self.clock.now().nanoseconds - (
                stamp.nanoseconds
            )
            self._n += 1
            self.decisions += 1

    def _on_stop(self, stop: bool, reason: str) -> None:
        with self.changed:
            self.changes.append((time.monotonic(), reason if stop else ""))
            self.changed.notify_all()

    def wait_for(self, stop: bool, since: int = 0) -> float:
        """When the first change to that came, of those after the `since` first."""
        with self.changed:

            def found():
                return next((t for t, r in self.changes[since:] if bool(r) is stop), None)

            if not self.changed.wait_for(lambda: found() is not None, PATIENCE):
                raise RuntimeError(f"stop is not {stop} after {PATIENCE:g} s: {self.changes[-3:]}")
            return found()

    def latencies(self) -> tuple[float, float, float]:
        """p50, p99 and largest since the last call [ms]."""
        n, self._n = min(self._n, len(self._latencies)), 0
        seen = self._latencies[:n]
        return tuple(np.percentile(seen, [50, 99, 100]) / 1e6) if n else (np.nan,) * 3

    @property
    def missed(self) -> dict[str, int]:
        """Frames lost before the driver, that a queue on the way dropped, and that were skipped."""
        counters = self._reader.parser.counters
        dropped = sum(s.dropped for h in self.skin._handles for s in h._subscriptions)
        lost = max(counters.lost, counters.corrupt)
        return {"lost": lost, "dropped": dropped, "skipped": self._compensation.skipped}

    @property
    def received(self) -> int:
        return self._reader.parser.counters.frames


# --- the runs ---


def soak(args, watch: Watch, board_process: Helper, tickers: list[Helper]) -> list[str]:
    start = now = time.monotonic()
    warm, missed, misses = None, watch.missed, []
    minute, next_line = 0, min(60.0, 60.0 * args.minutes)
    waiting, waited, busy, used = Waiting(), 0.0, [], time.process_time()
    waiting.look()
    watch.latencies()
    watch.stops.clear()
    while now - start < 60.0 * args.minutes:
        time.sleep(LOOK)
        before, now = now, time.monotonic()
        lack = waiting.look()
        waited += lack
        if lack > BUSY * (now - before):
            begin = busy.pop()[0] if busy and busy[-1][1] == before else before
            busy.append((begin, now))
        if watch.missed != missed:
            misses.append((now, sum(watch.missed.values()) - sum(missed.values())))
            missed = watch.missed
        if warm is None and now - start >= min(WARM, 20.0 * args.minutes):
            warm = resources()
        if now - start >= next_line:
            minute, next_line = minute + 1, next_line + 60.0
            p50, p99, most = watch.latencies()
            del watch.changes[:-1]
            print(
                f"{minute:3d} min: {watch.received} frames, missed {missed}, latency "
                f"{p50:.2f} / {p99:.2f} / {most:.1f} ms, {said(resources())}, "
                f"{sum(len(t.lines) for t in tickers)} stalls, stops {watch.stops}; of a processor "
                f"used {(time.process_time() - used) / (now - start):.0%}, waited for "
                f"{waited / (now - start):.0%}",
                flush=True,
            )
    end, stops = resources(), dict(watch.stops)
    stalls = stalls_of(tickers)
    blamed = {"the host stood still": 0, "no processor": 0, "the skin": 0}
    for t, n in misses:
        whose = (
            "the host stood still"
            if near(t, stalls)
            else "no processor"
            if near(t, busy)
            else "the skin"
        )
        blamed[whose] += n
        if whose == "the skin":
            print(f"missed {n} frames at {t - start:.2f} s with nobody else to blame")
    longest = max((e - b for b, e in stalls), default=0.0)
    counters = watch._reader.parser.counters
    board_process.end()
    print(
        f"sent {board_process.lines[-1].split()[0]}, received {watch.received}, lost "
        f"{counters.lost}, damaged {counters.corrupt}, published {watch.readings}, decided "
        f"{watch.decisions}; {len(stalls)} stalls of the host, "
        f"{1e3 * longest:.0f} ms the longest; stops {stops}"
    )
    print(f"missed frames by whose they are: {blamed}")
    own = blamed["the skin"]
    wrong = [f"{own} frames missed with no stall of the host"] if own else []
    faults = {reason: n for reason, n in stops.items() if reason.startswith("fault: ")}
    wrong += [f"fault stops {faults}"] if faults else []
    return wrong + grown(warm, end)


def unplug(args, watch: Watch, board_process: Helper) -> list[str]:
    rng = random.Random(1)
    warm, stops, frees = None, [], []
    watch.wait_for(False)
    for cycle in range(args.unplug):
        time.sleep(rng.uniform(0.1, 0.4))
        if watch.changes[-1][1]:  # a stall, say
            watch.wait_for(False, len(watch.changes) - 1)
        said_before = len(board_process.lines)
        board_process.say("unplug")
        time.sleep(STOPPED_WITHIN + rng.uniform(0.0, 0.3))
        while len(board_process.lines) == said_before:  # a busy machine
            time.sleep(LOOK)
        gone = float(board_process.lines[-1].split()[1])
        if not watch.changes[-1][1]:
            return [f"free {time.monotonic() - gone:.2f} s after the board was unplugged"]
        last_free = max(k for k, (_, reason) in enumerate(watch.changes) if not reason)
        # a stop that was there before, for a stall of the host, and went on
        stops.append(max(0.0, watch.changes[last_free + 1][0] - gone))
        before = len(watch.changes)
        asked = time.monotonic()
        board_process.say("plug")
        frees.append(watch.wait_for(False, before) - asked)
        del watch.changes[:-1]
        if cycle == min(20, args.unplug // 2):
            warm = resources()
        if cycle % 50 == 49:
            print(f"{cycle + 1:4d} cycles: {said(resources())}", flush=True)
    end = resources()
    board_process.end()
    print(
        f"{args.unplug} cycles; to the stop: median {1e3 * np.median(stops):.0f} ms, longest "
        f"{1e3 * max(stops):.0f} ms; from the plug to free: median {np.median(frees):.2f} s, "
        f"longest {max(frees):.2f} s; reconnects {watch._reader.reconnects}"
    )
    late = sum(seconds > STOPPED_WITHIN for seconds in stops)
    wrong = [f"{late} stops later than {STOPPED_WITHIN:g} s"] if late else []
    return wrong + grown(warm, end)


def stalls_of(tickers: list[Helper]) -> list[tuple[float, float]]:
    for ticker in tickers:
        ticker.end()
    return sorted(tuple(map(float, row.split())) for ticker in tickers for row in ticker.lines)


def near(t: float, times) -> bool:
    """Whether what was seen at t happened in or soon after one of these (begin, end)."""
    return any(begin - LOOK <= t <= end + NEAR + LOOK for begin, end in times)


def said(found: dict[str, float]) -> str:
    return f"{found['MiB']:.1f} MiB, {found['threads']} threads, {found['fds']} fds"


def grown(warm: dict[str, float], end: dict[str, float]) -> list[str]:
    """What is more than it was when warm."""
    print(f"warm: {said(warm)}; at the end: {said(end)}")
    allowed = {"MiB": MEMORY, "threads": 0, "fds": 0}
    return [
        f"{name} grew from {warm[name]:.1f} to {end[name]:.1f}"
        for name, most in allowed.items()
        if end[name] - warm[name] > most
    ]


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=390.0, help="frames a second")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--unplug", type=int, default=0, help="cycles; instead of the long run")
    parser.add_argument("--board", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--ticker", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.board:
        link, rate, scene = args.board
        run_board(link, float(rate), scene)
        return 0
    if args.ticker is not None:
        run_ticker(args.ticker)
        return 0
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scene = "one_finger" if args.unplug else "demo"
        board_process = Helper("--board", folder / "skin", args.rate, scene)
        cpus = sorted(os.sched_getaffinity(0))
        tickers = [] if args.unplug else [Helper("--ticker", cpu) for cpu in cpus]
        given = {"port": str(folder / "skin"), "wait_for_port": "15.0", "method": args.method}
        plan = read_plan(find("skin.launch.yaml"), given)
        plan.nodes = [action for action in plan.nodes if action.executable != "monitor"]
        with Skin(plan) as skin:
            watch = Watch(skin, args.rate)
            watch.wait_for(False)
            if args.unplug:
                wrong = unplug(args, watch, board_process)
            else:
                wrong = soak(args, watch, board_process, tickers)
    print("bad: " + "; ".join(wrong) if wrong else "good")
    return 1 if wrong else 0


if __name__ == "__main__":
    harness.run(main)
