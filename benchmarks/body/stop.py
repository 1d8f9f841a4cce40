# SPDX-License-Identifier: Apache-2.0
"""Time from a push to the stop hook, in turns: a body of four skins and one, or one skin and more.

Each turn starts the skins in a process of their own, and plays frames to them from this one, as
boards of 100 frames a second do that were simulated before: so both meet the same pushes, and no
simulation takes their processor. A push rises within a scan, in turn on each skin of the body. A
time is that from the write of the first frame after the push began, whose low-pass may still hide
it, to the hook's call with a push of this skin.
--shared: four skins, each of which runs in a process of its own, and all in one.
--page: one skin, with its page open in Chromium on this computer, and without. --gestures: one
skin, whose gestures are named, and are not.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from support.chromium import Chromium

from benchmarks import harness
from tactile_skin.board.terminal import open_terminal
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes, simulator

SKINS = "chest", "back", "left_arm", "right_arm"
# what is compared, the first with the second: name -> its skins, and what they are launched with
ONE: tuple[tuple[str, ...], dict] = (SKINS[:1], {})
BODY = {"four": (SKINS, {}), "one": ONE}
PAGE = {"page": (SKINS[:1], {"view": True, "view_port": 0}), "none": ONE}
GESTURES = {"gestures": (SKINS[:1], {"gestures": True}), "none": ONE}
OWN = {"own": (SKINS, {}), "shared": (SKINS, {"separate": "false"})}
# times of the second that the first may take, p50 and p99
GOALS = {"four": 1.3, "own": 1.0, "page": 1.1, "gestures": 1.1}
_START, _PERIOD, _LENGTH = 3.0, 0.6, 0.2  # s until the first push, between two, of one
SIZE = 1400, 910  # of the page [px]
_HOLD = 0.05  # s that a stop is held: the robot is free again before the next push
_SLOW = 0.5  # s after which a stop does not count as that push's
_PATIENCE = 60.0  # s, for the skins to open their ports
_SPAWN = multiprocessing.get_context("spawn")  # a fork would copy this process's threads half


def pushes_of(count: int, seed: list[int]) -> list[tuple[float, np.ndarray]]:
    """Return (when [s], (16, 16) force [N]) of each push."""
    rng = np.random.default_rng(seed)
    begins = _START + _PERIOD * np.arange(count) + rng.uniform(0.0, 0.05, count)
    return [
        (begin, scenes.finger(16, 16, *rng.uniform(4.0, 11.0, 2), rng.uniform(45.0, 90.0), 1.8))
        for begin in begins
    ]


def frames_of(pushes, seconds: float, seed: int) -> tuple[list[bytes], list[int]]:
    """Return a board's frames, and for each push the number of the first after it began."""
    circuit, curve = Circuit(), PressureCurve()

    def scene(t: float) -> np.ndarray:
        there = (force for begin, force in pushes if begin <= t < begin + _LENGTH)
        return next(there, np.zeros(circuit.shape))

    board, frames, shown = simulator.Board(circuit, curve, scene, seed=seed), [], []
    waiting = [begin for begin, _ in pushes]
    for k in range(int(seconds * simulator.SCANS_PER_SECOND)):
        if not (frame := board.scan()):
            continue
        if waiting and k / simulator.SCANS_PER_SECOND >= waiting[0]:
            waiting.pop(0)
            shown.append(len(frames))
        frames.append(frame)
    return frames, shown


def turn(names: tuple[str, ...], more: dict, pushes, seed: int) -> tuple[list[float], int, int]:
    """Play pushes in turn on these skins, launched with more arguments.

    Returns:
        the time to the hook of each [s]; how many were missed, and how many another
        skin was named for.
    """
    seconds = _START + _PERIOD * len(pushes) + 0.2
    played = {
        name: frames_of(pushes[k :: len(names)], seconds, seed + k) for k, name in enumerate(names)
    }
    with contextlib.ExitStack() as stack:
        made = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        folder = stack.enter_context(made)
        links = {name: Path(folder) / name for name in names}
        mine, theirs = _SPAWN.Pipe()
        skins = _SPAWN.Process(target=_skins, args=(theirs, folder, names, more), daemon=True)
        skins.start()
        if address := mine.recv():
            stack.enter_context(Chromium(Path(folder) / "profile", *SIZE)).open(address)
        frames = {link: played[name][0] for name, link in links.items()}
        written = dict(zip(names, _play(frames), strict=True))
        mine.send("end")
        calls = mine.recv()
        skins.join(5.0)
    times, missed, wrong = [], 0, 0
    for name in names:
        for number in played[name][1]:
            at = written[name][number]
            stops = [(t - at, why) for t, stop, why in calls if stop and at < t < at + _SLOW]
            own = [t for t, why in stops if (f"{name}: push" if len(names) > 1 else "push") in why]
            times += own[:1]
            missed += not own
            others = [f"{other}: push" for other in names if other != name]
            wrong += any(each in why for _, why in stops for each in others)
    return times, missed, wrong


def _play(boards: dict[Path, list[bytes]]) -> list[list[float]]:
    """Write frames at their pace, boards in turn; return when each was written [s, monotonic]."""
    written: list[list[float]] = [[] for _ in boards]
    step = 1.0 / simulator.FRAMES_PER_SECOND / len(boards)
    with contextlib.ExitStack() as stack:
        terminals = [stack.enter_context(open_terminal(link)) for link in boards]
        until = time.monotonic() + _PATIENCE
        while not all(terminal.connected() for terminal in terminals):
            if time.monotonic() > until:
                raise RuntimeError("the skins did not open their ports")
            time.sleep(0.01)
        due = time.monotonic()
        for frames in zip(*boards.values(), strict=True):
            for terminal, frame, times in zip(terminals, frames, written, strict=True):
                due += step
                time.sleep(max(0.0, due - time.monotonic()))
                terminal.write(frame)
                times.append(time.monotonic())
    return written


def _skins(pipe, folder: str, names: tuple[str, ...], more: dict) -> None:
    """In a process of its own: the skins, with a hook that notes when it is called."""
    from tactile_skin.launch import launch
    from tactile_skin.nodes.observers.view import View

    skins = {
        name: {
            "port": f"{folder}/{name}",
            "geometry": {"shape": "plane", "translation": [float(k), 0.0, 0.0]},
            "stop_on_push": {"hold": _HOLD},
        }
        for k, name in enumerate(names)
    }
    path = Path(folder) / "robot.yaml"
    path.write_text(json.dumps({"skins": skins}))
    arguments = {"config": str(path), "wait_for_port": _PATIENCE, "monitor": "false"} | more
    kind = "body.launch.yaml"
    if len(names) == 1:
        (name,) = names
        arguments["namespace"] = name
        kind = "skin.launch.yaml"
    calls: list[tuple[float, bool, str]] = []
    with launch(kind, **arguments) as skin:
        skin.on_stop(lambda stop, reason: calls.append((time.monotonic(), stop, reason)))
        pipe.send("".join(n._page.address for n in skin._nodes if isinstance(n, View)))
        while not pipe.poll(0.25):
            skin.spin(0.0)
        calls = list(calls)
    pipe.send(calls)


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--turns", type=int, default=14, help="of each (default 14)")
    parser.add_argument("--pushes", type=int, default=24, help="in a turn (default 24)")
    parser.add_argument("--seed", type=int, default=3830, help="of pushes and noise")
    parser.add_argument("--shared", action="store_true", help="processes and one, of four skins")
    parser.add_argument("--page", action="store_true", help="a page and none, of one skin")
    parser.add_argument("--gestures", action="store_true", help="gestures named and not, the same")
    args = parser.parse_args(arguments)
    compared = PAGE if args.page else GESTURES if args.gestures else BODY
    compared = OWN if args.shared else compared
    times: dict[str, list[float]] = {kind: [] for kind in compared}
    missed, wrong = dict.fromkeys(times, 0), dict.fromkeys(times, 0)
    loads = []
    for k in range(args.turns):
        pushes = pushes_of(args.pushes, harness.seed_of(args.seed, k))
        for kind in sorted(compared, reverse=bool(k % 2)):
            found, lost, other = turn(*compared[kind], pushes, args.seed + 10 * k)
            times[kind] += found
            missed[kind] += lost
            wrong[kind] += other
            loads.append(os.getloadavg()[0])
    quantiles = {kind: np.percentile(1e3 * np.array(t), (50, 99)) for kind, t in times.items()}
    for kind, (p50, p99) in quantiles.items():
        n = len(times[kind])
        said = f"missed {missed[kind]}, of another name {wrong[kind]}"
        print(f"{kind:8} p50 {p50:.2f} ms, p99 {p99:.2f} ms of {n} pushes; {said}")
    first, second = compared
    ratio, goal = quantiles[first] / quantiles[second], GOALS[first]
    print(f"{first} / {second}: p50 {ratio[0]:.2f}, p99 {ratio[1]:.2f} (goal {goal}); ", end="")
    print(f"load {np.median(loads):.1f} in the median of turns")
    return {"ms": quantiles, "ratio": ratio, "missed": missed, "wrong": wrong, "loads": loads}


if __name__ == "__main__":
    harness.run(main)
