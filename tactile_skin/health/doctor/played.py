# SPDX-License-Identifier: Apache-2.0
"""What a running skin says of recorded frames, so that no stop it gave is left without a word."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from ...findings.finding import Finding
from ...physics.adc import NOT_READ, Adc
from ..skin import Follower

_RATE = 50.0  # frames a second of a recording that has no times, as boards send
_ENOUGH = 50  # frames with one reason: those that nothing explains take longest


def stopped_by(
    skin: Follower, adc: Adc, frames: Iterable[np.ndarray], times=None
) -> tuple[Finding, float] | None:
    """Play frames through a skin, and return why it stopped the robot for longest.

    Args:
        skin: of which no frame was read.
        adc: its converter.
        frames: (rows, cols) ADC ratio each; NaN: not read.
        times: of each frame [s]; None: at 50 frames a second.

    Returns:
        The reason, and since when [s] of the recording; None: no stop, or one of waiting hands.
    """
    skin.use("auto")
    to_sample = 1 << 16 - adc.circuit.adc_bits
    said: Counter[Finding] = Counter()
    since: dict[Finding, float] = {}
    for k, ratio in enumerate(frames):
        steps = np.nan_to_num(adc.count(ratio)).clip(0.0)
        samples = np.minimum(np.rint(steps * to_sample), NOT_READ - 1)
        samples = np.where(np.isnan(ratio), NOT_READ, samples).astype(np.uint16)
        t = k / _RATE if times is None else float(times[k] - times[0])
        skin.frame(t, samples)
        found = skin.findings(past=False)
        if skin.waits or not (found and (skin.fault or skin.status == "failed")):
            continue
        said[found[0]] += 1
        since.setdefault(found[0], t)
        if said[found[0]] >= _ENOUGH:
            break
    return next(((reason, since[reason]) for reason, _ in said.most_common(1)), None)
