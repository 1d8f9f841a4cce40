# SPDX-License-Identifier: Apache-2.0
"""What lies in series with all cells of a recording, by its touches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration.identify import Identified, identify
from ...calibration.rest import Rest, resting_conductance
from ...calibration.tracker import POSSIBLE
from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from ...solvers.evidence import series_scale
from ...solvers.suspect import BEYOND
from . import wiring
from .advice import Change
from .recorded import FEW_TOUCHES, Recorded

_ASKED = 20_000  # cells, in all touches together, for identify: it takes 0.1 s for 256;
_LEAST_TOUCHES = 20  # and of large skins so many touches
_HELD = 15  # frames about its peak within which a touch is looked for
# Share by which r_par must be off, as what all touches share is not in their scatter: light ones
# make it seem larger by 0 to 5 % on 50 sound boards, where it is known to 1.5 % (seed 144000).
_SERIES = 0.075
_DRIVE = 5.0  # ohm by which r_drive must be off: 3.4 at most on 16 boards (seeds 94000 and 94100)
_DRIVE_KNOWN = 4.0  # ohm of standard deviation up to which a wrong one shows


def in_series(seen: Recorded, skip, noisy, wires: wiring.Wires) -> list[Finding]:
    """Return what lies in series with all cells, by the touches.

    Args:
        skip: (axis, line) of lines whose readings are not used, nor are those of
        noisy: (row, column) of cells.
    """
    circuit, unknown = seen.circuit, ~seen.without(seen.read, skip)
    for at in noisy:
        unknown[at] = True
    sound = replace(wires, lead=[np.zeros(n) for n in circuit.shape])
    found = identified(seen, unknown, circuit.ratio(sound.resistance()))
    if found is None or found.frames < FEW_TOUCHES:
        return []
    least = {"r_par": _SERIES * series_scale(circuit)}
    if circuit.readout_class.knows_r_drive:
        least["r_drive"] = _DRIVE
    off = {name: abs(getattr(found.circuit, name) - getattr(circuit, name)) for name in least}
    said = [name for name in least if off[name] > max(least[name], BEYOND * found.std[name])]
    return [_finding(name, circuit, found) for name in said]


def identified(seen: Recorded, unknown: np.ndarray, supposed: np.ndarray) -> Identified | None:
    """Return by the touches what lies in series; None: no touch, or no skin reads so.

    Args:
        unknown: (rows, cols) whether the readings there are not used.
        supposed: (rows, cols) ADC ratio that is taken for theirs at rest.
    """
    if not len(seen.peaks):
        return None
    circuit, noise, quiet = seen.circuit, seen.usual_noise, int(np.count_nonzero(seen.quiet))
    adc = np.where(unknown, supposed, seen.base / circuit.full_scale)
    try:
        rest = Rest(adc, noise, quiet, resting_conductance(adc, circuit, noise / quiet**0.5))
        return identify(np.where(unknown, np.nan, touches_of(seen)), circuit, rest, soft=True)
    except ValueError:
        return None


def shows(seen: Recorded, name: str) -> bool:
    """Whether touches, where nothing was found, would show a wrong r_par, or r_drive."""
    usual = np.full(seen.circuit.shape, np.median(seen.ratio[:, seen.cells]))
    found = identified(seen, ~seen.read, usual)
    if found is None or found.frames < FEW_TOUCHES:
        return False
    if name == "r_drive":
        return found.std[name] <= _DRIVE_KNOWN
    # One that is off by half must be `BEYOND`: where an r_ref that is 3 to 10 times too high was
    # not named the deviation is 1.7 times as much and more; on sound boards with enough touches it
    # is less (12 boards of 8 x 8 and 12 x 10 cells, 3 to 45 N).
    return BEYOND * found.std[name] <= 0.5 * series_scale(seen.circuit)


def _finding(name: str, supposed: Circuit, found: Identified) -> Finding:
    """Return the finding that touches fit another resistance in series."""
    value, given = getattr(found.circuit, name), getattr(supposed, name)
    numbers = {"frames": found.frames, name: value, "std": found.std[name], "supposed": given}
    if name == "r_drive":
        change = Change(replace(supposed, r_drive=value))
        return Finding(Kind.CIRCUIT, name, numbers=numbers, change=change)
    off = given / value - 1.0 if value > 0.0 else np.inf
    alike = f"r_ref off by {100.0 * off:+.0f} %, or a" if abs(off) < POSSIBLE["r_par"] else "A"
    return Finding(Kind.CIRCUIT, name, numbers=numbers, detail=alike)


def touches_of(seen: Recorded, n: int | None = None) -> np.ndarray:
    """Return (n, rows, cols) ADC ratio of the hardest touches, each where it moves least."""
    n = n or max(_ASKED // int(seen.circuit.populated.sum()), _LEAST_TOUCHES)
    hardest = np.argsort(-seen.steps[seen.peaks].max((1, 2)))
    found = []
    for peak in np.sort(seen.peaks[hardest[:n]]):
        near = seen.steps[max(peak - _HELD, 0) : peak + _HELD + 1].astype(float)
        moved = np.abs(near[2:] - near[:-2]).sum((1, 2))
        load = np.abs(near[1:-1] - seen.base).sum((1, 2))
        k = int((moved / np.maximum(load, 1.0)).argmin())  # a whole step at least
        found.append(near[k : k + 3].mean(0))
    ratio = np.array(found).reshape(-1, *seen.circuit.shape) / seen.circuit.full_scale
    return np.clip(ratio, 0.0, 1.0)
