# SPDX-License-Identifier: Apache-2.0
"""Frames that a body of many skins misses, and its time from a frame's last byte to the decision.

One process plays the boards on pseudo-terminals, as `benchmarks.running.way` does: each skin is
touched a fifth of the time, in turn. Another runs them all by launch/body.launch.yaml. A frame is
missed if the stop of its skin has decided nothing on it.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from .. import harness
from ..running.way import play

_WARM_UP = 10.0  # s, not counted: each skin has measured its rest then
_PATIENCE = 60.0  # s, for the boards
_QUEUE = 1000  # decisions that may wait to be counted
_SPAWN = multiprocessing.get_context("spawn")  # a fork would copy this process's threads half


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--skins", type=int, default=8)
    parser.add_argument("--rate", type=int, default=100, help="frames a second (default 100)")
    parser.add_argument("--seconds", type=float, default=60.0, help="counted (default 60)")
    parser.add_argument("--seed", type=int, default=1, help="of the frames")
    args = parser.parse_args(arguments)
    ports, end = _SPAWN.Pipe(duplex=False)
    board = _SPAWN.Process(target=play, args=(end, args.skins, args.rate, args.seed), daemon=True)
    board.start()
    try:
        if not ports.poll(_PATIENCE):
            raise RuntimeError("the simulated boards did not start")
        taken = run(ports.recv(), args.seconds)
    finally:
        board.terminate()
        board.join()
    counted = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = np.concatenate([list(skin.values()) for skin in taken]) * 1e3
    p50, p99, most = np.percentile(took, (50, 99, 100))
    decided = [len(skin) for skin in taken]
    # a skin's first and last frames of the time that is counted lie a period off at most
    due = [round((max(skin) - min(skin)) / 1e9 * args.rate) + 1 for skin in taken]
    missed = sum(max(0, a - b) for a, b in zip(due, decided, strict=True))
    print(
        f"{args.skins} skins at {args.rate} frames/s on {os.cpu_count()} cores: {sum(decided)} "
        f"frames, missed {missed}; last byte to decision p50 {p50:.1f}, p99 {p99:.1f}, max "
        f"{most:.0f} ms; load {os.getloadavg()[0]:.1f}"
    )
    return {"missed": missed, "frames": decided, "ms": [p50, p99, most], "s": counted.ru_utime}


def run(ports: list[str], seconds: float) -> list[dict[int, float]]:
    """Run a body on these ports; of each skin the stamp [ns] of each frame -> time it took [s]."""
    from tactile_skin.launch import launch
    from tactile_skin.middleware.bus import Time
    from tactile_skin.msg import DiagnosticArray
    from tactile_skin.nodes.stop_on_push import STATUS_TOPIC

    taken: list[dict[int, float]] = [{} for _ in ports]
    skins = {
        f"skin_{k}": {
            "port": port,
            "geometry": {"shape": "plane", "translation": [float(k), 0.0, 0.0]},
        }
        for k, port in enumerate(ports)
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(json.dumps({"skins": skins}))
        with launch("body.launch.yaml", config=str(path), monitor="false") as body:
            now = body.node.get_clock().now

            def listen(name: str, kept: dict[int, float]) -> None:
                def note(msg) -> None:
                    stamp = Time.from_msg(msg.header.stamp).nanoseconds
                    kept.setdefault(stamp, (now().nanoseconds - stamp) / 1e9)

                topic = f"{name}/{STATUS_TOPIC}"
                body.node.create_subscription(DiagnosticArray, topic, note, _QUEUE)

            body.spin(_WARM_UP)
            for name, kept in zip(skins, taken, strict=True):
                listen(name, kept)
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                body.spin(min(1.0, until - time.monotonic()))
            return [dict(sorted(kept.items())[1:]) for kept in taken]


if __name__ == "__main__":
    harness.run(main)
