"""Time from a push to the stop hook: on a body of four skins, and on one skin, in turns.

Each turn starts the skins in a process of their own, and plays frames to them from this one, as
boards of 100 frames a second do that were simulated before: so both meet the same pushes, and no
simulation takes their processor. A push rises within a scan, in turn on each skin of the body. A
time is that from the write of the first frame whose samples show a force above the threshold.
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

from benchmarks import harness
from tactile_skin.board.terminal import open_terminal
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes, simulator
from tactile_skin.solvers import compensate

SKINS = "chest", "back", "left_arm", "right_arm"
GOAL = 1.2  # times of one skin, that a body of four may take in the median and at p99
_START, _PERIOD, _LENGTH = 3.0, 0.6, 0.2  # s until the first push, between two, of one
_THRESHOLD = 30.0  # N, of config/skin.yaml
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


def frames_of(pushes, seconds: float, seed: int) -> tuple[list[bytes], list[int | None]]:
    """Return a board's frames, and for each push the number of the first that shows it."""
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
            ratio = board._filtered / (2 ** (16 - circuit.adc_bits) * circuit.full_scale)
            force = compensate(np.minimum(ratio, 1.0), circuit, board.curve).force
            if force.sum() >= _THRESHOLD:
                waiting.pop(0)
                shown.append(len(frames))
        frames.append(frame)
    return frames, shown


def turn(names: tuple[str, ...], pushes, seed: int) -> tuple[list[float], int, int]:
    """Play pushes in turn on these skins.

    Returns:
        the time to the hook of each [s]; how many were missed, or named another skin.
    """
    seconds = _START + _PERIOD * len(pushes) + 0.2
    played = {
        name: frames_of(pushes[k :: len(names)], seconds, seed + k) for k, name in enumerate(names)
    }
    with tempfile.TemporaryDirectory() as folder:
        links = {name: Path(folder) / name for name in names}
        mine, theirs = _SPAWN.Pipe()
        skins = _SPAWN.Process(target=_skins, args=(theirs, folder, names), daemon=True)
        skins.start()
        frames = {link: played[name][0] for name, link in links.items()}
        written = dict(zip(names, _play(frames), strict=True))
        mine.send("end")
        calls = mine.recv()
        skins.join(5.0)
    times, missed, wrong = [], 0, 0
    for name in names:
        for number in played[name][1]:
            at = written[name][number]
            stops = [(t, why) for t, stop, why in calls if stop and at < t < at + _SLOW]
            if not stops:
                missed += 1
            else:
                times.append(stops[0][0] - at)
                wrong += len(names) > 1 and not stops[0][1].startswith(f"{name}: push")
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


def _skins(pipe, folder: str, names: tuple[str, ...]) -> None:
    """In a process of its own: the skins, with a hook that notes when it is called."""
    from tactile_skin.launch import launch

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
    arguments = {"config": str(path), "wait_for_port": _PATIENCE}
    kind = "body.launch.yaml"
    if len(names) == 1:
        (name,) = names
        arguments |= {"namespace": name, "monitor": "false"}
        kind = "skin.launch.yaml"
    calls: list[tuple[float, bool, str]] = []
    with launch(kind, **arguments) as skin:
        skin.on_stop(lambda stop, reason: calls.append((time.monotonic(), stop, reason)))
        while not pipe.poll(0.25):
            skin.spin(0.0)
        calls = list(calls)
    pipe.send(calls)


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--turns", type=int, default=14, help="of each (default 14)")
    parser.add_argument("--pushes", type=int, default=24, help="in a turn (default 24)")
    parser.add_argument("--seed", type=int, default=3830, help="of pushes and noise")
    args = parser.parse_args(arguments)
    times: dict[str, list[float]] = {"one": [], "four": []}
    missed, wrong = dict.fromkeys(times, 0), dict.fromkeys(times, 0)
    loads = []
    for k in range(args.turns):
        pushes = pushes_of(args.pushes, harness.seed_of(args.seed, k))
        for kind in ("one", "four") if k % 2 else ("four", "one"):
            names = SKINS if kind == "four" else SKINS[:1]
            found, lost, other = turn(names, pushes, args.seed + 10 * k)
            times[kind] += found
            missed[kind] += lost
            wrong[kind] += other
            loads.append(os.getloadavg()[0])
    quantiles = {kind: np.percentile(1e3 * np.array(t), (50, 99)) for kind, t in times.items()}
    for kind, (p50, p99) in quantiles.items():
        n = len(times[kind])
        said = f"missed {missed[kind]}, of another name {wrong[kind]}"
        print(f"{kind:5} p50 {p50:.2f} ms, p99 {p99:.2f} ms of {n} pushes; {said}")
    ratio = quantiles["four"] / quantiles["one"]
    print(f"four / one: p50 {ratio[0]:.2f}, p99 {ratio[1]:.2f} (goal {GOAL}); ", end="")
    print(f"load {np.median(loads):.1f} in the median of turns")
    return {"ms": quantiles, "ratio": ratio, "missed": missed, "wrong": wrong, "loads": loads}


if __name__ == "__main__":
    harness.run(main)
