# SPDX-License-Identifier: Apache-2.0
"""Replay recorded frames through the solver, each started from the last: faster than real time.

The file is any that tactile-skin replay takes: .mcap, or the frames of record_frames.py.

    python examples/replay_frames.py frames.npy [mine.yaml]
"""

import sys
import time

import numpy as np

from tactile_skin import compensate
from tactile_skin.middleware.config import part_of
from tactile_skin.recording.frames import read_frames, recorded_skin

path = sys.argv[1]
try:
    skin = recorded_skin(*sys.argv[1:])  # without a parameter file: as recorded, or the shipped one
    frames = read_frames(path, skin.circuit, part=part_of(skin.board)).ratio(skin.adc)
except (ValueError, OSError) as error:
    sys.exit(str(error))

estimate, sums, times, doubted = None, [], [], 0
for adc in frames:  # (rows, cols) ratios; NaN: a crossing that was not read
    start = time.perf_counter()
    estimate = compensate(adc, skin.circuit, skin.curve, start=estimate, missing=True)
    times.append(time.perf_counter() - start)
    sums.append(estimate.force.sum())
    doubted += estimate.status != "ok"

p50, p99 = np.percentile(times, [50, 99]) * 1e3
print(f"{len(frames)} frames, {doubted} in doubt, sum of force {np.median(sums):.1f} N (median)")
print(f"time of a frame: p50 {p50:.2f} ms, p99 {p99:.2f} ms")
