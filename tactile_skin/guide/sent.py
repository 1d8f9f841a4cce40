# SPDX-License-Identifier: Apache-2.0
"""Whether a board sends what its ADC reads: asked before a person begins to calibrate it."""

from __future__ import annotations

import numpy as np

from ..calibration.rest import check_all_is_sent
from ..health.doctor.usable import DECIMALS
from ..middleware.config import SkinConfig
from ..readings.processed import Kind, processed

GLANCE = 0.5  # s of frames that show it
_UNRESOLVED = 0.5  # ADC steps: below, a reading says nothing of what the cell conducts


def check_sent(skin: SkinConfig, rest: np.ndarray, touches: np.ndarray | None = None) -> None:
    """Refuse a board whose untouched cells read nothing, or whose frames are no ADC's readings.

    Args:
        skin: its configuration.
        rest: (n, rows, cols) ADC ratio of the untouched skin; NaN: not read.
        touches: the same of a skin that is touched, if there are.

    Raises:
        ValueError: what was done to the readings.
    """
    threshold, circuit = skin.adc.threshold(skin.threshold), skin.circuit
    check_all_is_sent(rest, circuit, threshold, skin.threshold)
    steps = np.round((rest if touches is None else touches) * circuit.full_scale, DECIMALS)
    done = processed(np.where(circuit.populated, steps, np.nan), circuit.adc_bits, skin.threshold)
    if done and done.kind is not Kind.CEILING:
        raise ValueError(f"{done}. Send what the ADC reads")
    usual = np.nanmedian(np.nanmean(rest, axis=0)[circuit.populated]) * circuit.full_scale
    if usual < _UNRESOLVED:
        raise ValueError(
            f"untouched cells read {usual:.2g} ADC steps: an offset or a threshold is taken off, "
            "or r_ref is too small for this fabric. Send what the ADC reads"
        )
