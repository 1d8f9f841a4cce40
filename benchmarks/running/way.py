# SPDX-License-Identifier: Apache-2.0
"""Time from bytes to the stop hook, through the nodes and a real serial device.

A process plays one simulated board on as many pseudo-terminals as there are skins, each of which is
touched for a fifth of the time, in turn; each skin is a process of its own that runs
`launch/skin.launch.yaml`, as a robot would.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import multiprocessing
import os
import sys
import time
import tty

import numpy as np

from tactile_skin.bench import chart
from tactile_skin.board import protocol
from tactile_skin.board.frame import Frame
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes, simulator
from tactile_skin.solvers import METHODS

from .. import harness

RATES = (100, 390)  # frames a second: over USB serial, and each scan of the board
_TOUCHES = "one_finger", "two_fingers", "push_left", "stroke"  # one after the other
_EVERY = 10.0  # s from one touch to the next
_TOUCHED = 0.2  # of the time
_WARM_UP = _EVERY  # s, not counted: each skin has measured its rest then
SKINS = (1, 2, 4, 8, 12, 16)  # at 100 frames a second, with auto
_PATIENCE = 120.0  # s, for the skins to start
_SPAWN = multiprocessing.get_context("spawn")  # a fork would copy this process's threads half


def measure(
    methods, seconds: float, long: float, skins, seed: int, track=lambda items: items
) -> dict:
    """Each of the methods at each rate for `seconds` (auto at 390 frames/s: `long`), many skins.

    Returns:
        the figure "way" as plain data: `methods`, a list of {method, rate, seconds} with
        `run_skins`' figures, and `skins`, the same for several at once with auto, up to the first
        number that misses frames.
    """
    cases = [
        (method, rate, long if (method, rate) == ("auto", RATES[-1]) else seconds)
        for rate in RATES
        for method in methods
    ]
    singles, crowds = [], []
    for case in track([*cases, *skins]):
        if isinstance(case, tuple):
            method, rate, length = case
            found = run_skins(1, method, rate, length, seed)
            singles.append({"method": method, "rate": rate, "seconds": length, **found})
        elif not crowds or crowds[-1]["missed"] == 0:
            found = run_skins(case, "auto", RATES[0], seconds, seed)
            crowds.append({"skins": case, "seconds": seconds, **found})
    return {"way": {"methods": singles, "skins": crowds, "cores": os.cpu_count()}}


def run_skins(n: int, method: str, rate: int, seconds: float, seed: int) -> dict:
    """n skins of one method for some seconds.

    Returns:
        frames, decided by all of them; missed, lost on the wire or on the way; p50_ms, p99_ms and
        max_ms from a frame's last byte to the stop hook; cpu, processors that one skin keeps busy.

    Raises:
        RuntimeError: a skin or the board ended, or did not start in time.
    """
    barrier = _SPAWN.Barrier(n)
    ports, board_end = _SPAWN.Pipe(duplex=False)
    board = _SPAWN.Process(target=play, args=(board_end, n, rate, seed), daemon=True)
    board.start()
    skins, ends = [], []
    try:
        if not ports.poll(_PATIENCE):
            raise RuntimeError("the simulated board did not start")
        for port in ports.recv():
            mine, theirs = _SPAWN.Pipe(duplex=False)
            ends.append(mine)
            skins.append(
                _SPAWN.Process(target=_skin, args=(theirs, barrier, port, method, seconds))
            )
            skins[-1].start()
            theirs.close()
        found = []
        for end in ends:
            try:
                found.append(end.recv() if end.poll(_PATIENCE + seconds) else None)
            except EOFError:
                found.append(None)
        if None in found:
            raise RuntimeError(f"{found.count(None)} of {n} skins gave no figures")
    finally:
        for process in (*skins, board):
            process.join(0.0 if process is board else 10.0)
            if process.is_alive():
                process.terminate()
                process.join()
    latency = np.concatenate([f["latencies"] for f in found]) * 1e3
    p50, p99, worst = np.percentile(latency, (50, 99, 100))
    return {
        "frames": len(latency),
        "missed": int(sum(f["missed"] for f in found)),
        "p50_ms": float(p50),
        "p99_ms": float(p99),
        "max_ms": float(worst),
        "cpu": float(np.mean([f["cpu"] for f in found])),
    }


def play(pipe, n: int, rate: int, seed: int) -> None:
    """Play the touches' bytes on n pseudo-terminals, each at another moment, until terminated."""
    circuit = Circuit()
    played = simulator.Board(circuit, PressureCurve(), _scene, frames_per_second=rate, seed=seed)
    parser = protocol.BinaryParser()
    found: list[Frame] = []
    while len(found) < rate * _EVERY * len(_TOUCHES):
        found += parser.feed(played.scan())
    frames = [frame.samples.copy() for frame in found]
    masters, slaves = zip(*(os.openpty() for _ in range(n)), strict=True)
    for master, slave in zip(masters, slaves, strict=True):
        tty.setraw(slave)
        os.set_blocking(master, False)
    pipe.send([os.ttyname(slave) for slave in slaves])
    begun = time.monotonic()
    for i in itertools.count():
        time.sleep(max(0.0, begun + i / rate - time.monotonic()))
        for k, master in enumerate(masters):
            frame = frames[(i + round(k * rate * _EVERY / n)) % len(frames)]
            # a step of one cell: a board whose frames repeat to the last bit is taken for frozen
            frame.flat[i % frame.size] ^= 1 << (16 - circuit.adc_bits)
            sent = protocol.encode(
                i, round(i / rate * 1e6), frame, circuit.adc_bits, 16 - circuit.adc_bits
            )
            with contextlib.suppress(BlockingIOError):  # nobody reads yet, or reads too late
                os.write(master, sent)


def _scene(t: float) -> np.ndarray:
    """Return what presses at time t [s]: (rows, cols) force [N]."""
    turn, t = divmod(t, _EVERY)
    shape = Circuit().shape
    if t < (1.0 - _TOUCHED) * _EVERY:
        return np.zeros(shape)
    return scenes.script(_TOUCHES[int(turn) % len(_TOUCHES)], *shape)(t)


def _skin(pipe, barrier, port: str, method: str, seconds: float) -> None:
    """Run a skin and send what its monitor counted."""
    from tactile_skin.launch import Skin, find, read_plan
    from tactile_skin.nodes.observers.monitor import Monitor

    plan = read_plan(find("skin.launch.yaml"), {"port": port, "method": method})
    plan.nodes = [action for action in plan.nodes if action.executable != "monitor"]
    with Skin(plan) as skin:
        monitor = Monitor(skin.node)
        monitor.out = io.StringIO()
        (frames,) = monitor.skins
        deadline = time.monotonic() + _PATIENCE
        while not frames.latencies and time.monotonic() < deadline:
            time.sleep(0.05)
        barrier.wait(_PATIENCE)
        time.sleep(_WARM_UP)
        missed, cpu, start = monitor.drops, time.process_time(), time.monotonic()
        frames.latencies.clear()
        skin.spin(seconds)
        latencies = np.array(frames.latencies)
        cpu = (time.process_time() - cpu) / (time.monotonic() - start)
    # closed by now: the driver's last word has the final counts
    pipe.send({"latencies": latencies, "missed": monitor.drops - missed, "cpu": cpu})
    pipe.close()


# --- picture -------------------------------------------------------------------------------------


_TICKS = (0.5, 1, 2, 3, 5, 10, 20, 50, 100, 200, 500)  # ms


def draw(data: dict):
    from matplotlib import pyplot as plt

    figure, (latency, crowd) = plt.subplots(
        1, 2, figsize=(9.0, 4.6), layout="constrained", width_ratios=(3, 2)
    )
    names = list(dict.fromkeys(entry["method"] for entry in data["methods"]))
    rates = sorted({entry["rate"] for entry in data["methods"]})
    for entry in data["methods"]:
        y = names.index(entry["method"]) + 0.32 * rates.index(entry["rate"]) - 0.16
        look = chart.style(entry["method"], size=5.5) | {"linestyle": "none"}
        if entry["rate"] != rates[0]:
            look |= {"markerfacecolor": "white", "markeredgecolor": look["color"]}
        line = [entry["p50_ms"], entry["p99_ms"]]
        latency.plot(line, [y, y], color=look["color"], linewidth=1.6)
        latency.plot(entry["p50_ms"], y, **look)
        latency.plot(entry["max_ms"], y, marker="|", color=look["color"], markersize=8)
        if entry["missed"]:
            latency.annotate(
                f"{entry['missed']} missed",
                (entry["max_ms"], y),
                (5, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.5,
            )
    latency.set_xscale("log")
    latency.set_xticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
    latency.minorticks_off()
    latency.set_yticks(range(len(names)), names, fontsize=10.5)
    latency.invert_yaxis()
    latency.axvline(3.0, color="black", linewidth=0.8, linestyle=(0, (2, 3)))
    latency.text(3.1, 0.01, "3 ms", fontsize=8.5, transform=latency.get_xaxis_transform())
    latency.xaxis.set_major_formatter("{x:g}")
    latency.grid(alpha=0.25, linewidth=0.6, axis="x", which="both")
    latency.set_xlabel("last byte to stop hook [ms]: p50, line to p99, | max", fontsize=10)
    latency.set_title(f"filled {rates[0]}, hollow {rates[1]} frames/s", fontsize=10.5)

    crowds = data["skins"]
    skins = [c["skins"] for c in crowds]
    for key, look in (("p50", {}), ("p99", {"linestyle": "--", "marker": "o"})):
        values = [c[f"{key}_ms"] for c in crowds]
        crowd.plot(skins, values, **chart.style("auto") | look, label=key)
    for c in crowds:
        crowd.annotate(
            f"{c['missed']} missed" if c["missed"] else "0",
            (c["skins"], c["p99_ms"]),
            (0, 8),
            textcoords="offset points",
            ha="center",
            fontsize=8.5,
        )
    crowd.set_yscale("log")
    crowd.minorticks_off()
    crowd.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    crowd.set_ylim(0.7 * min(c["p50_ms"] for c in crowds), 1.6 * max(c["p99_ms"] for c in crowds))
    crowd.set_xticks(skins)
    crowd.grid(alpha=0.25, linewidth=0.6)
    crowd.set_xlabel(f"skins at {rates[0]} frames/s on {data['cores']} cores", fontsize=10)
    crowd.set_ylabel("last byte to stop hook [ms]", fontsize=10)
    crowd.set_title("auto; numbers: missed frames", fontsize=10.5)
    crowd.legend(fontsize=10, frameon=False)
    return figure


DRAW = {"way": draw}


FULL = {"methods": tuple(METHODS), "seconds": 6.0, "long": 60.0, "skins": SKINS}
QUICK = {"methods": ("naive", "auto"), "seconds": 0.5, "long": 0.5, "skins": (2,)}


def main(arguments=None) -> None:
    given = harness.picture_parser(__doc__, __spec__).parse_args(arguments)
    harness.draw(sys.modules[__name__], QUICK if given.quick else FULL, given)


if __name__ == "__main__":
    harness.run(main)
