# SPDX-License-Identifier: Apache-2.0
"""Readers of public recordings of a single sensor under a force sensor.

Velostat: github.com/Lupasic/tactile-sensor-velostat, one cell of about 15 x 15 mm under a load
cell, pressed by a robot at 16 places with 1 to 50 N, twice, by two tips. FSR:
github.com/patrickruiz1/FSR_AppliedMedical, 15 series of 30 presses of one force-sensing resistor,
pressed by hand, and calibrations on the same day and three days before.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_skin import Circuit

TIPS = {"small": "pike1", "wide": "pike5"}
FORCES = "", "_force_1", "_force_5", "_force_10", "_force_20", "_force_30", "_force_40"
# Its low resistances differ by 0.606 ohm: r_ref over the steps of a 12 bit converter.
VELOSTAT = Circuit(1, 1, r_ref=2482.0, r_par=0.0, adc_bits=12, readout="grounded")
# An ohmmeter has no r_ref: one in the middle of its readings, of 1 kohm to 1 Mohm, and 16 bits.
FSR = Circuit(1, 1, r_ref=10e3, r_par=0.0, adc_bits=16, readout="grounded")
NEWTON = 4.4482216  # of a pound-force
_TOUCHES = 0.35  # N above its zero from which the load cell is pressed
_RELEASES = 0.5  # s for which it is not, between two presses
_BEFORE, _AFTER = 1.0, 2.0  # s of a press that are kept besides


class Press(NamedTuple):
    """One press: readings of the sensor, and the force at the same times."""

    times: np.ndarray  # (n,) [s]
    adc: np.ndarray  # (n, 1, 1) ADC ratio
    force: np.ndarray  # (n,) [N], 0 where nothing touches
    since: np.ndarray  # (n,) since the contact [s]; below 0 before, NaN after it


def velostat(folder: Path, tip: str, run: int) -> list[list[Press]]:
    """Return the presses at each of 16 places, one of each force."""
    name = TIPS[tip]
    places: list[list[Press]] = [[] for _ in range(16)]
    for force in FORCES:
        file = f"{name}{force}/exp_{name}{force}_sensor1_exp{run}.txt"
        felt = np.loadtxt(folder / "futek_data" / file)
        read = np.loadtxt(folder / "velostat_data" / file)
        found = presses(read[:, 1], read[:, 0], felt[:, 1], felt[:, 0], VELOSTAT)
        if len(found) == len(places):  # otherwise nobody knows which is where
            for place, press in zip(places, found, strict=True):
                place.append(press)
    return places


def fsr(path: Path) -> list[Press]:
    """Return the presses of one file of lines `sensor, time, value`."""
    times: dict[str, list[float]] = {"LoadCell": [], "DMM": []}
    values: dict[str, list[float]] = {"LoadCell": [], "DMM": []}
    for line in path.read_text().splitlines()[1:]:
        name, at, value = (word.strip() for word in line.split(","))
        if name in times and value != "None":
            times[name].append(datetime.datetime.fromisoformat(at).timestamp())
            values[name].append(float(value))
    force = NEWTON * np.array(values["LoadCell"])
    ohm = np.array(values["DMM"])
    return presses(np.array(times["DMM"]), ohm, np.array(times["LoadCell"]), force, FSR)


def presses(times, ohm, at, force, circuit: Circuit) -> list[Press]:
    """Return the presses of a stream, each with what comes before and after it."""
    times, unique = np.unique(times, return_index=True)
    adc = (circuit.r_ref / (circuit.r_ref + ohm[unique]))[:, None, None]
    force = np.interp(times, at, force)
    force = force - np.median(force[force < force.min() + _TOUCHES])
    edges = np.flatnonzero(np.diff(np.r_[0, force > _TOUCHES, 0]))
    begin, end = times[edges[::2]], times[edges[1::2] - 1]
    apart = np.r_[True, begin[1:] - end[:-1] > _RELEASES]
    begin, end = begin[apart], end[np.r_[apart[1:], True]]
    found = []
    for k, (first, last) in enumerate(zip(begin, end, strict=True)):
        until = begin[k + 1] if k + 1 < len(begin) else np.inf
        kept = times > max(first - _BEFORE, end[k - 1] if k else -np.inf)
        kept &= times < min(last + _AFTER, until)
        since = np.where(times <= last, times - first, np.nan)
        if np.max(force[kept]) > 2.0 * _TOUCHES:
            found.append(Press(times[kept], adc[kept], np.maximum(force[kept], 0.0), since[kept]))
    return found


def joined(found: list[Press]) -> Press:
    """Return presses one after the other, a second between two of them."""
    times, late = [], 0.0
    for press in found:
        times.append(press.times - press.times[0] + late)
        late = times[-1][-1] + 1.0
    rest = (np.concatenate(values) for values in list(zip(*found, strict=True))[1:])
    return Press(np.concatenate(times), *rest)
