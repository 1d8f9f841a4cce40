# SPDX-License-Identifier: Apache-2.0
"""What a person who asked the doctor has to know besides what was found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..calibration.rest import Rest
from ..findings.finding import Finding
from ..health.doctor.recorded import FEW_TOUCHES, Recorded, record
from ..health.doctor.series import shows
from ..physics.circuit import Circuit

# Share of what a short circuit reads that hard presses exceed on every board that was seen: of one
# with 10 bits that is configured as 12 they read 0.25 at most.
_LOW = 0.3


def notes(
    found: Sequence[Finding], frames: np.ndarray, circuit: Circuit, rest: Rest | None = None
) -> list[str]:
    """Return what the frames cannot show, or do not.

    Args:
        found: what was found.
        frames: (n, rows, cols) ADC ratio, NaN where a crossing was not read.
    """
    nothing = "" if found else f"nothing found. {_unseen(record(frames, circuit, rest))}"
    scale = _scale_note(frames, circuit) or _end_note(frames, circuit)
    said = nothing, touches_note(frames, circuit, rest), scale
    return [note for note in said if note]


def _unseen(seen: Recorded) -> str:
    """Return what might be wrong though nothing was found."""
    readout = seen.circuit.readout_class
    series = "r_drive" if readout.knows_r_drive else "r_par"
    words = ["two lines that are exchanged with all their neighbours"]
    if seen.circuit.readout == "virtual_ground":
        words.append("a wrong readout, r_par or scale: each reading is of its own cell alone")
    elif not shows(seen, series):
        words.append(
            f"a wrong {series}, r_ref or supply: these touches say too little of it, press hard in "
            "more places, with more than a fingertip"
        )
    if not readout.two_terminal:
        words.append("a wrong r_ref, which reads like another fabric")
    return "Frames do not show " + "; ".join(words) + "."


def touches_note(frames: np.ndarray, circuit: Circuit, rest: Rest | None) -> str:
    """Return what to record instead if hardly a touch was seen; empty if some were.

    Args:
        frames: (n, rows, cols) ADC ratio, NaN where a crossing was not read.
    """
    touches = len(record(frames, circuit, rest).touches)
    if touches >= FEW_TOUCHES:
        return ""
    return (
        f"{touches} touches were seen. Most faults need twenty, and a skin left alone for a "
        "third of the time: take your hands off for 5 s, then press everywhere."
    )


def _scale_note(frames: np.ndarray, circuit: Circuit) -> str:
    """Return what to check if hard presses read little; empty if they do not.

    Readings that are all too small by one factor are those of another fabric behind another r_par:
    no frame shows it, and the forces found are far too small.

    Args:
        frames: (n, rows, cols) ADC ratio, NaN where a crossing was not read.
    """
    most = float(np.nanmax(frames))
    if not most < _LOW * float(circuit.ratio(0.0)):
        return ""
    full = circuit.full_scale
    return (
        f"no reading exceeds {most * full:.0f} of {full} ADC steps ({most:.0%}). If some presses "
        f"were hard, check circuit.adc_bits = {circuit.adc_bits}, adc_full_scale and "
        "serial_driver.format.full_scale: with a wrong one all forces are too small, and frames do "
        "not show it."
    )


def _end_note(frames: np.ndarray, circuit: Circuit) -> str:
    """Return that the converter ended under touches; empty where none did, or others say as much.

    Args:
        frames: (n, rows, cols) ADC ratio, NaN where a crossing was not read.
    """
    ended = int((frames >= 1.0).any((1, 2)).sum())
    if circuit.has_cross_talk or not ended:
        return ""
    return (
        f"in {ended} of {len(frames)} frames readings are at the end of the range: more force "
        "there is not felt, and such a touch stops the robot. A smaller r_ref leaves room."
    )
