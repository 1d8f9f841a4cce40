# SPDX-License-Identifier: Apache-2.0
"""What a person who asked the doctor has to know besides what was found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibration.identify import how_to_press
from ..calibration.rest import Rest
from ..findings.finding import Finding
from ..health.doctor.recorded import FEW_TOUCHES, Recorded, record
from ..health.doctor.series import shows, touches_of
from ..physics.circuit import Circuit

# Share of what a short circuit reads that hard presses exceed on every board that was seen: of one
# with 10 bits that is configured as 12 they read 0.25 at most.
_LOW = 0.3


def notes(
    found: Sequence[Finding], frames: np.ndarray, circuit: Circuit, rest: Rest | None = None
) -> list[str]:
    """Return what the frames (n, rows, cols) [ADC ratio; NaN: not read] cannot show, or do not."""
    seen = record(frames, circuit, rest)
    said = [] if found else [f"nothing found. {_unseen(seen)}"]
    if (touches := len(seen.touches)) < FEW_TOUCHES:
        said.append(
            f"{touches} touches were seen. Most faults need twenty, and a skin left alone for a "
            "third of the time: take your hands off for 5 s, then press everywhere."
        )
    most, full = float(np.nanmax(frames)), circuit.full_scale
    # Readings that are all too small by one factor are those of another fabric behind another r_par
    if most < _LOW * float(circuit.ratio(0.0)):
        said.append(
            f"no reading exceeds {most * full:.0f} of {full} ADC steps ({most:.0%}). If some "
            f"presses were hard, check circuit.adc_bits = {circuit.adc_bits}, adc_full_scale and "
            "serial_driver.format.full_scale: with a wrong one all forces are too small, and "
            "frames do not show it."
        )
    elif (ended := int((frames >= 1.0).any((1, 2)).sum())) and not circuit.has_cross_talk:
        said.append(
            f"in {ended} of {len(frames)} frames readings are at the end of the range: more force "
            "there is not felt, and such a touch may stop the robot. A smaller r_ref leaves room."
        )
    return said


def _unseen(seen: Recorded) -> str:
    """Return what might be wrong though nothing was found."""
    readout = seen.circuit.readout_class
    series = "r_drive" if readout.knows_r_drive else "r_par"
    words = ["two lines that are exchanged with all their neighbours"]
    if seen.circuit.readout == "virtual_ground":
        words.append("a wrong readout, r_par or scale: each reading is of its own cell alone")
    elif not shows(seen, series):
        words.append(
            f"a wrong {series}, r_ref or supply: these touches say too little of it, "
            f"{how_to_press(touches_of(seen), seen.circuit)}"
        )
    if not readout.two_terminal:
        words.append("a wrong r_ref, which reads like another fabric")
    return "Frames do not show " + "; ".join(words) + "."
