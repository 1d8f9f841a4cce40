# SPDX-License-Identifier: Apache-2.0
"""How fast a recording is replayed.

It makes a recording of the simulated board at 100 frames/s (16 x 16, noise of 1 step, seed 1): most
of the time nothing touches it; in every fourth minute the demo is played, which touches it 60 % of
the time; all topics of the skin are in it. Then it replays it with `auto` through compensation,
features and stop, and says what an hour of it would take. `--touched` plays the demo all the time.
"""

import collections
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from tactile_skin import Circuit, PressureCurve
from tactile_skin.board.formats import make_parser
from tactile_skin.msg import Header, Time, image
from tactile_skin.recording import Recording, cdr
from tactile_skin.recording.writer import Writer
from tactile_skin.replay.replay import Replay
from tactile_skin.replay.results import STATUS, Job, collect
from tactile_skin.simulation import scenes, simulator

from .. import harness

RATE = 100  # frames a second
START = 1_700_000_000_000_000_000  # ns since 1970


def make(path: Path, seconds: float, touched: bool) -> None:
    circuit = Circuit()
    demo = scenes.script("demo", *circuit.shape)
    idle = np.zeros(circuit.shape)

    def scene(t):
        return demo(t) if touched or t // 60 % 4 == 1 else idle

    board = simulator.Board(circuit, PressureCurve(), scene, frames_per_second=RATE, seed=1)
    parser = make_parser("binary", *circuit.shape, circuit.adc_bits)
    writer, n = Writer(path, {}, START), 0
    while n < seconds * RATE:
        for frame in parser.feed(board.scan()):
            t = START + frame.device_time_us * 1000
            message = image(frame.samples, "16UC1", Header(Time(*divmod(t, 10**9)), "base_link"))
            writer.write("/skin/adc", type(message), t, cdr.encode(message))
            n += 1
    writer.close()


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--touched", action="store_true")
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made.mcap"
        make(path.with_name("adc.mcap"), 60.0 * args.minutes, args.touched)
        first = Replay(Recording(path.with_name("adc.mcap")), "auto")
        first.record(path)
        collections.deque(first, maxlen=0)
        begun, used = time.monotonic(), sum(os.times()[:4])  # s, its processes' too
        found = collect(Job(str(path), method="auto"), args.jobs)
        wall, cpu = time.monotonic() - begun, sum(os.times()[:4]) - used
        megabytes = path.stat().st_size / 1e6
    n, hour = len(found.stamps), 60.0 / args.minutes
    touched = float(np.mean(found.peak > 0.2))
    print(f"{n} readings, {100 * touched:.0f} % with a cell above 0.2 N; {args.jobs} processes")
    print(f"{megabytes * hour:.0f} MB an hour")
    print(f"{wall:.1f} s, of processor time {cpu:.1f} s: {1e3 * cpu / n:.2f} ms each")
    print(f"an hour: {wall * hour:.0f} s, of processor time {cpu * hour:.0f} s")
    p50, p99 = 1e3 * np.percentile(found.seconds, (50, 99))
    print(f"nodes alone: p50 {p50:.2f} ms, p99 {p99:.2f} ms")
    counts = {name: int(np.sum(found.status == k)) for k, name in enumerate(STATUS)}
    print(f"status {counts}, stops {len(found.stop_begins)}")


if __name__ == "__main__":
    harness.run(main)
