# SPDX-License-Identifier: Apache-2.0
"""Time from a board's last byte to a plain subscriber on real ROS.

prints how long a frame takes from the board's last byte to that subscriber's callback.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from support.ros_graph import (
    AHEAD,
    DECIDED,
    WARM_UP,
    Graph,
    Player,
    endless,
    plan_of,
    program,
    record,
)

from tactile_skin.board.protocol import BinaryParser
from tactile_skin.simulation import simulator

from .. import harness


def latencies(written: list[float], frames: list[bytes], heard: list[tuple]) -> dict:
    """Topic -> seconds from a frame's last byte to the subscriber; every frame has other bytes."""
    sent_at = {}
    for t, frame in zip(written, frames, strict=True):
        (parsed,) = BinaryParser().feed(frame)
        sent_at[parsed.samples.astype("<u2").tobytes()] = t
    adc = [(stamp, values[-1]) for topic, _, stamp, values in heard if topic == "skin/adc"]
    if adc:
        by_stamp = {stamp: sent_at[data] for stamp, data in adc if data in sent_at}
    else:
        by_stamp = in_order(written, heard)
    found: dict[str, dict[int, float]] = {}
    for topic, t, stamp, _ in heard:
        if stamp in by_stamp and topic in (*DECIDED, "skin/stop_status"):
            found.setdefault(topic, {}).setdefault(stamp, t - by_stamp[stamp])
    return {topic: np.array(list(values.values())) for topic, values in found.items()}


def in_order(written: list[float], heard: list[tuple]) -> dict[int, float]:
    """Stamp [ns] -> when its last byte was written [s], if all frames were decided on.

    Raises:
        RuntimeError: some were not.
    """
    begin = (written[0] - AHEAD) * 1e9
    stamps = sorted({stamp for _, _, stamp, _ in heard if stamp is not None and stamp >= begin})
    if len(stamps) != len(written):
        raise RuntimeError(
            f"{len(stamps)} of {len(written)} frames were heard of: which? hear skin/adc as well"
        )
    return dict(zip(stamps, written, strict=True))


def memory(pids: list[int]) -> float:
    """What the processes hold together, shared pages counted once [MB]."""
    lines = [
        line
        for pid in pids
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        if line.startswith("Pss:")
    ]
    return sum(int(line.split()[1]) for line in lines) * 1024 / 1e6


def measure(seconds: float, topics: list[str], seed: int = 0, separate: bool = False) -> dict:
    """Latencies of a run of `seconds`, as `latencies` gives them, the number of frames, and the
    memory of the skin's processes [MB]."""
    frames = record(round((seconds + WARM_UP) * simulator.FRAMES_PER_SECOND), seed=seed)
    player, skip = Player(), round(WARM_UP * simulator.FRAMES_PER_SECOND)
    with Graph() as graph:
        if separate:
            for action in plan_of(player.port).values():
                graph.start_node(action)
        else:
            graph.start("skin", program("skin", "-p", f"port:={player.port}"))
        pids = [process.pid for process in graph.processes.values()]
        name = graph.listen(*topics)
        with player.playing(endless("idle", seed + 1)):
            graph.wait_until_heard(name, *topics)
        time.sleep(1.0)
        player.play(frames[:skip])
        time.sleep(1.0 / player.rate)
        player.written.clear()
        player.play(frames[skip:])
        time.sleep(0.5)
        held = memory(pids)
        found = latencies(player.written, frames[skip:], graph.heard(name))
    player.close()
    return {"frames": len(frames) - skip, "latency": found, "memory": held, "programs": len(pids)}


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--separate", action="store_true", help="a process for each node")
    parser.add_argument(
        "topics", nargs="*", metavar="TOPIC", help="that the subscriber hears (default: all)"
    )
    args = parser.parse_args(arguments)
    found = measure(args.seconds, args.topics, args.seed, args.separate)
    print(f"{found['frames']} frames, board's last byte to a plain subscriber")
    print(f"{found['programs']} processes of the skin hold {found['memory']:.0f} MB")
    for topic, values in found["latency"].items():
        p50, p99, worst = np.percentile(values, (50, 99, 100)) * 1e3
        print(f"{topic:20} {len(values)}: p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {worst:.2f} ms")


if __name__ == "__main__":
    harness.run(main)
