"""What lies in series with all cells of a recording, by its touches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration.identify import identify
from ...calibration.rest import Rest, resting_conductance
from ...findings.finding import Finding
from ...physics.circuit import Circuit
from ...solvers.evidence import series_scale
from . import circuits, wiring
from .recorded import Recorded

_ASKED = 20_000  # cells, in all touches together, for identify: it takes 0.1 s for 256
_LEAST_TOUCHES = 20
_MOST_TOUCHES = 60
_HELD = 15  # frames about its peak within which a touch is looked for
# Share by which light touches make r_par seem larger: 0 to 5 % on 50 sound boards, where it is
# known to 1.5 % (seed 144000).
_LIGHT = 0.025
# Share besides, and standard deviations (what all touches share is not in their scatter), by which
# it must be off; touches that must say so.
_SERIES = 0.05
_SERIES_STD = 5.0
_SAYING = 20
# Share beyond which none of this reaches, and touches that suffice: where r_par is far off, the
# hardest ones are explained by no cells, and say nothing.
_FAR = 0.25
_FAR_SAYING = 5
# Ohm by which r_drive must be off: 3.4 at most on 16 boards (seeds 94000 and 94100). Light touches
# lower it no more than others, so fewer suffice.
_DRIVE = 5.0
_DRIVE_SAYING = 8


def in_series(seen: Recorded, skip, noisy, wires: wiring.Wires) -> list[Finding]:
    """What lies in series with all cells, by the touches.

    Args:
        skip: (axis, line) of lines whose readings are not used, nor are those of
        noisy: (row, column) of cells.
    """
    circuit, full = seen.circuit, seen.circuit.full_scale
    if not len(seen.peaks):
        return []
    unknown = ~seen.read
    for axis, line in skip:
        seen.turned(axis, unknown)[line] = True
    for at in noisy:
        unknown[at] = True
    if circuit.readout != "floating":  # only readings that are skipped miss what a bad lead takes
        wires = replace(wires, lead=[np.zeros(n) for n in circuit.shape])
    lead = wires.lead[0][:, None] + wires.lead[1]  # ohm, of bad ones
    usual = circuit.ratio(wires.resistance() - lead)
    touches = _without(lead, touches_of(seen), circuit)
    adc = np.where(unknown, usual, _without(lead, seen.base / full, circuit))
    unknown, touches, adc = (_as_one(wires.joined, p) for p in (unknown, touches, adc))
    circuit = _circuit_as_one(wires.joined, circuit)
    noise = max(seen.usual_noise, 0.3)
    quiet = int(np.count_nonzero(seen.quiet))
    try:
        rest = Rest(adc, noise, quiet, resting_conductance(adc, circuit, noise / quiet**0.5))
        found = identify(np.where(unknown, np.nan, touches), circuit, rest, soft=True)
    except ValueError:
        return []
    scale = series_scale(circuit)
    off = found.circuit.r_par - circuit.r_par
    limit = max(_SERIES * scale, _SERIES_STD * found.std["r_par"])
    limit += _LIGHT * scale if off > 0.0 else 0.0
    said = []
    enough = _FAR_SAYING if abs(off) >= _FAR * scale else _SAYING
    if found.frames >= enough and abs(off) >= limit:
        said.append(circuits.circuit(circuit, found))
    if circuit.readout == "grounded" and found.frames >= _DRIVE_SAYING:
        off = abs(found.circuit.r_drive - circuit.r_drive)
        if off > max(_DRIVE, _SERIES_STD * found.std["r_drive"]):
            said.append(circuits.drivers(circuit, found))
    return said


def _as_one(joined: list, picture: np.ndarray) -> np.ndarray:
    """(..., rows, cols) without the second of two lines that touch: they read as one."""
    for axis in (0, 1):
        picture = np.delete(picture, [b for k, _, b in joined if k == axis], axis - 2)
    return picture


def _circuit_as_one(joined: list, circuit: Circuit) -> Circuit:
    """In which two lines that touch are one, of the cells of both."""
    mask, r_line = circuit.populated.copy(), circuit.r_line
    for axis, a, b in joined:
        lines = mask if axis == 0 else mask.T
        lines[a] |= lines[b]
    mask = _as_one(joined, mask)
    if np.ndim(r_line):
        r_line = np.delete(r_line, [b + axis * circuit.rows for axis, _, b in joined])
    return replace(circuit, rows=len(mask), cols=mask.shape[1], mask=mask, r_line=r_line)


def _without(lead: np.ndarray, adc: np.ndarray, circuit: Circuit) -> np.ndarray:
    """The ADC ratio without what leads (rows, cols) [ohm] take from it."""
    return np.clip(circuit.r_ref / (circuit.r_ref / np.maximum(adc, 1e-4) - lead), 0.0, 1.0)


def touches_of(seen: Recorded, n: int | None = None) -> np.ndarray:
    """(n, rows, cols) ADC ratio of the hardest touches, each where it moves least."""
    n = n or int(
        np.clip(_ASKED / np.count_nonzero(seen.circuit.populated), _LEAST_TOUCHES, _MOST_TOUCHES)
    )
    hardest = np.argsort(-seen.steps[seen.peaks].max((1, 2)))
    picked = np.sort(seen.peaks[hardest[:n]])
    found = []
    for peak in picked:
        near = seen.steps[max(peak - _HELD, 0) : peak + _HELD + 1].astype(float)
        moved = np.abs(near[2:] - near[:-2]).sum((1, 2))
        load = np.abs(near[1:-1] - seen.base).sum((1, 2))
        k = int((moved / np.maximum(load, 1.0)).argmin())  # a whole step at least
        found.append(near[k : k + 3].mean(0))
    return np.clip(
        np.array(found).reshape(-1, *seen.circuit.shape) / seen.circuit.full_scale, 0.0, 1.0
    )
