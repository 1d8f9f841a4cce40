# SPDX-License-Identifier: Apache-2.0
"""Replay recorded frames through the solver, each started from the last: faster than real time.

The file holds an array (n, rows, cols) of readings as ratios of full scale: record_frames.py.

    python examples/replay_frames.py frames.npy [mine.yaml]
"""

import sys
import time

import numpy as np

from tactile_skin import compensate
from tactile_skin.launch import read_skin

frames = np.load(sys.argv[1])  # (n, rows, cols)
circuit, curve, _ = read_skin(*sys.argv[2:])  # without a file: of the shipped configuration
if frames.shape[1:] != circuit.shape or not (0.0 <= frames.min() <= frames.max() <= 1.0):
    sys.exit(
        f"{sys.argv[1]}: {frames.shape} numbers from {frames.min():g} to {frames.max():g}: must be "
        f"(n, {circuit.rows}, {circuit.cols}) ratios from 0 to 1; another skin: give its file"
    )

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
