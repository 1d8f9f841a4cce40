# SPDX-License-Identifier: Apache-2.0
"""Whether a board sends what its ADC reads: asked before a person begins to calibrate it."""

from __future__ import annotations

import numpy as np

from ..calibration.at_rest import open_up_to
from ..calibration.rest import HALF_STEP, Rest, check_all_is_sent
from ..health.doctor import other_readout
from ..health.doctor.advice import HARDEST
from ..health.doctor.usable import DECIMALS
from ..middleware.config import SkinConfig
from ..physics.circuit import Circuit
from ..readings.processed import Done, processed

GLANCE = 0.5  # s of frames that show it


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
    steps = np.where(circuit.populated, steps, np.nan)
    opens = open_up_to(circuit, skin.curve) * circuit.full_scale
    done = processed(steps, circuit.adc_bits, skin.threshold, opens=opens)
    if done and done.kind is not Done.CEILING:
        raise ValueError(f"{done}. Send what the ADC reads")
    usual = np.nanmedian(np.nanmean(rest, axis=0)[circuit.populated]) * circuit.full_scale
    if usual < HALF_STEP and not opens:
        raise ValueError(
            f"untouched cells read {usual:.2g} ADC steps: an offset or a threshold is taken off, "
            "r_ref is too small for this fabric, or it is open until it is touched. Send what the "
            "ADC reads; of a sheet that is open, begin its curve so: curve.resistance: "
            "[10000000.0, ...]"
        )


def check_readout(circuit: Circuit, rest: Rest, touches: np.ndarray) -> str:
    """Return what explains touches (n, rows, cols) as well as the readout, or better; "": nothing.

    Raises:
        ValueError: they are those of another readout than the configured one.
    """
    hardest = np.array(sorted(touches, key=lambda touch: -np.nanmax(touch))[:HARDEST])
    found = other_readout(circuit, rest.quiet(rest.adc[None])[0], rest.noise, hardest)
    if found and found.change:
        raise ValueError(str(found))
    return str(found) if found else ""
