# SPDX-License-Identifier: Apache-2.0
"""Replay recorded frames through the solver, each started from the last: faster than real time.

The file holds an array (n, rows, cols) of readings as ratios of full scale: record_frames.py.

    python examples/replay_frames.py frames.npy
"""

import sys
import time

import numpy as np

from tactile_skin import compensate
from tactile_skin.launch import read_skin

frames = np.load(sys.argv[1])  # (n, rows, cols)
circuit, curve, _ = read_skin()  # of the shipped configuration; yours: read_skin("mine.yaml")

estimate, sums, times, doubted = None, [], [], 0
for adc in frames:
    start = time.perf_counter()
    estimate = compensate(adc, circuit, curve, start=estimate)
    times.append(time.perf_counter() - start)
    sums.append(estimate.force.sum())
    doubted += estimate.status != "ok"

p50, p99 = np.percentile(times, [50, 99]) * 1e3
print(f"{len(frames)} frames, {doubted} in doubt, sum of force {np.median(sums):.1f} N (median)")
print(f"time of a frame: p50 {p50:.2f} ms, p99 {p99:.2f} ms")
