# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a board, from a recording of its ordinary use: which wire, which cell.

recorded.py   rest, noise and touches of the recording
usable.py     whether it can be judged: what an ADC reads, of a matrix, and its rest
played.py     what a running skin says of the frames
readout.py    another readout than the configured one
readings.py   faults of single readings: bits, ceiling, noise, open and loose lines
order.py      lines that read alike, lines in the wrong order
wiring.py     damage of wires and cells that explains the rest
series.py     r_par, r_line, r_drive by the touches
advice.py     what to enter, tried on the frames before it is proposed

What the readings cannot tell is not guessed: two boards that read alike get the same finding, which
then names both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration.at_rest import LEAST_STEPS, open_up_to
from ...calibration.rest import REST_SPAN, Rest, usual_resistance
from ...findings.finding import Finding, Kind, lines, whole_lines
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...physics.readouts import DRIVEN
from ...solvers.reading import ROUNDING_NOISE
from . import order, readings, readout, usable, wiring
from .advice import HARDEST, Change, is_safe
from .recorded import FEW_TOUCHES, Recorded, record
from .series import in_series, touches_of

# Where no circuit decides, readings are upside down if so much of all change is a fall, and hardly
# any the other way round.
_FALLS = 0.8
_FEW = 4  # hardest touches that decide without `series`, and on the polarity: they take the time


def diagnose(
    frames,
    circuit: Circuit,
    rest: Rest | None = None,
    *,
    series: bool = True,
    inverted: bool = False,
    curve: PressureCurve | None = None,
) -> list[Finding]:
    """Find what is wrong with a board.

    Args:
        frames: (n, rows, cols) ADC ratio of ordinary use, in order: a minute or so, untouched for a
            third of it, and with some twenty different touches, some hard. NaN where a crossing was
            not read.
        circuit: what is supposed.
        rest: `measure_rest` of the same board; None: from the frames in which nothing touches.
        series: whether to ask for r_par, r_ref and supply, which takes most of the time.
        inverted: whether the frames are 1 minus what the board reads, as it is configured.
        curve: of the fabric, which says whether untouched cells conduct; None: they do.

    Returns:
        The faults, an empty list for a sound board. Readings upside down, another readout than the
        circuit's, a wrong bit, and rows and columns that are exchanged hide all else. Of frames
        that show no rest, without `rest`: that alone, of kind "too little seen".

    Raises:
        ValueError: another shape, values outside [0, 1], or fewer than 20 frames.
    """
    frames = np.asarray(frames)
    seen = record(frames, circuit, rest)
    opens = open_up_to(circuit, curve) * circuit.full_scale if curve else 0.0
    if finding := usable.processed(seen, opens):
        return [finding]
    calm = np.quantile(seen.steps[:, seen.cells], usable.AT_END, axis=0)
    if opens and np.median(calm) < LEAST_STEPS:
        top = readings.ceiling(seen)
        return readings.wrong_bits(seen, top) or list(top[1:] if top else ())
    finding = usable.unrested(seen) if rest is None else None
    wrong = usable.at_an_end(seen) or readings.wrong_bits(seen, readings.ceiling(seen))
    if finding and not wrong:
        turned = record(1.0 - frames, circuit, None)  # upside down, the calmest are the hardest
        upside_down = [] if usable.unrested(turned) else _upside_down(seen, turned, inverted)
        fitting = readout.other(circuit, _touched(seen, _FEW))  # where another one is untouched
        return upside_down or _network(circuit, fitting) or [finding]
    found = _diagnose(seen, series)
    sound = not found and len(seen.touches)
    if sound and (seen.fell < usable.HARDLY_FALLS or _fits(circuit, seen)):
        return found
    return _upside_down(seen, record(1.0 - frames, circuit, None), inverted) or found


def _fits(circuit: Circuit, seen: Recorded) -> bool:
    return readout.misses(circuit, _touched(seen, _FEW)) < readout.FITS


def _upside_down(seen: Recorded, turned: Recorded, inverted: bool) -> list[Finding]:
    """Whether nothing but another readout is wrong the other way round, or all that moves falls."""
    circuit = seen.circuit
    if not len(turned.peaks):
        return []
    found = _diagnose(turned, series=False)
    of_other = [f for f in found[:1] if f.kind is Kind.READOUT and f.change]
    if not of_other and (found or not _fits(circuit, turned)):
        falls = seen.fell > _FALLS or not len(seen.touches)
        if not (falls and turned.fell < usable.HARDLY_FALLS and len(turned.touches) >= FEW_TOUCHES):
            return []
    change = Change(circuit, turned=True)
    obeyed = replace(change, circuit=of_other[0].change.circuit) if of_other else change
    if not is_safe(obeyed, seen.ratio, turned.quiet, turned.usual_noise):
        return []
    entry = readout.entered(change.settings(circuit, inverted))
    detail = f"{entry}: what the board prints {'rises' if inverted else 'falls'}"
    usual = float(np.median(seen.steps[:, seen.read]))
    numbers = {"steps": usual, "full": circuit.full_scale}
    return [Finding(Kind.POLARITY, numbers=numbers, detail=detail, change=change), *of_other]


def _diagnose(seen: Recorded, series: bool) -> list[Finding]:
    """Judge readings that are not upside down."""
    circuit = seen.circuit
    if finding := usable.one_voltage(seen) or usable.at_an_end(seen):
        return [finding]
    touched = _touched(seen, HARDEST if series else _FEW)
    fitting = readout.other(circuit, touched)
    if other := _network(circuit, fitting):
        return other
    top = readings.ceiling(seen)
    if bits := readings.wrong_bits(seen, top):
        return bits
    votes = order.transposed(seen)
    if votes and (change := _other_way(seen, touched)):
        detail = readout.entered(change.settings(circuit))
        numbers = votes._asdict()
        return [Finding(Kind.TRANSPOSED, numbers=numbers, detail=detail, change=change)]
    if fitting and _named(circuit, fitting) and not votes:  # torn ones add up to what none reads
        return [fitting.finding(circuit)]
    unexplained = [fitting.finding(circuit)] if fitting else []
    height, *found = top or (np.inf,)
    unusable: set[tuple[int, int]] = set()  # (axis, line) whose readings say nothing of the fabric
    for check in readings.CHECKS:
        new = check(seen, unusable)
        found += new
        unusable |= {at for f in new if f.kind is not Kind.NOISY for at in whole_lines(f)}
    noisy = [f for f in found if f.kind is Kind.NOISY]
    wires, rho, known = _wires(seen, unusable, found)
    if not known.any():
        return found
    try:
        alike = order.equal_lines(seen, unusable)
        wires, known = _joined(seen, wires, rho, known, alike, found)
        pairs = {(axis, b) for axis, _, b in alike}
        damages, wires = wiring.search(circuit, rho, known, wires)
    except np.linalg.LinAlgError:  # whatever the cells, this circuit does not read so
        return found or unexplained
    unusable |= pairs
    quiet = {(f.rows[0], f.cols[0]) for f in noisy if f.rows and f.cols}
    for axis, a, b in wires.joined:  # a cell of lines that touch may be on either
        swap = {a: b, b: a}
        quiet |= {(swap.get(r, r), c) if axis == 0 else (r, swap.get(c, c)) for r, c in quiet}
    ends = seen.base > height - seen.width
    cells = {(d.line, d.at) for d in damages if d.kind == "cell"}
    for d in damages:
        cell = (d.line, d.at) if d.kind == "cell" else None
        if cell not in quiet:
            found.append(wiring.finding_of(circuit, d, wires.cell, bool(cell and ends[cell])))
    odd = {(d.axis, d.line) for d in damages if d.kind != "cell"}
    pressed = {(d.line, d.at) for d in damages if d.kind == "cell" and d.size > 1.0}
    if np.isfinite(height):  # beside such a cell, touches that end there are all alike
        odd |= {line for row, col in pressed for line in ((0, row), (1, col))}
    found += order.misplaced(seen, unusable | odd, cells | quiet, pressed)
    if not series:
        return found
    # With stripes that are cut, touch or are not read it is another network.
    unread = bool(pairs or wires.cut)
    beside = {(d.axis, d.line) for d in damages if d.kind in ("lead", "resistor")}
    if circuit.readout == "loaded":  # so with a sense line that leads to ground by other than r_ref
        unread = unread or any(axis != circuit.sense_axis for axis, _ in unusable | beside)
    if not (unread or np.isfinite(height) or wires.cells.max() > REST_SPAN):
        skip = unusable | beside | {at for f in noisy for at in whole_lines(f)}
        found += in_series(seen, skip, quiet, wires)
    return found or unexplained


def _other_way(seen: Recorded, touched: readout.Touched) -> Change | None:
    """Rows and columns exchanged, and what is driven as the touches say; None: neither fits."""
    supposed = replace(seen.circuit, rows=seen.circuit.cols, cols=seen.circuit.rows)
    driven = DRIVEN[:1] if supposed.readout_class.two_terminal else DRIVEN
    changes = [Change(supposed.read_as(supposed.readout, lines)) for lines in driven]
    tried = [(readout.misses(c.circuit, touched.after(c)), k, c) for k, c in enumerate(changes)]
    left, _, change = min(tried)
    safe = left < readout.FITS and is_safe(change, seen.ratio, seen.quiet, seen.usual_noise)
    return change if safe else None


def other_readout(circuit: Circuit, at_rest, noise: float, touches) -> Finding | None:
    """Return the finding that touches are those of another readout; None: they are not.

    Args:
        at_rest: (rows, cols) ADC ratio of the untouched skin, NaN: not read.
        noise: of a reading [ADC steps].
        touches: (n, rows, cols) ADC ratio, some of them hard; NaN: not read.
    """
    fitting = readout.other(circuit, readout.Touched(at_rest, max(noise, ROUNDING_NOISE), touches))
    wired = {(c.circuit.readout, c.circuit.driven) for c in (fitting.changes if fitting else ())}
    others = wired - {(circuit.readout, circuit.driven)}
    return fitting.finding(circuit) if fitting and others else None


def _network(circuit: Circuit, fitting: readout.Fitting | None) -> list[Finding]:
    """Return the finding that another network of resistors reads so, where that is what fits."""
    if fitting and _named(circuit, fitting) and not fitting.of_own_cells:
        return [fitting.finding(circuit)]
    return []


def _named(circuit: Circuit, fitting: readout.Fitting) -> bool:
    """Whether a circuit with the same r_par is among what fits."""
    return any(change.circuit.r_par == circuit.r_par for change in fitting.changes)


def _touched(seen: Recorded, n: int) -> readout.Touched:
    """Return the untouched skin, and its n hardest touches, without lines that come and go."""
    loose = [of for f in readings.loose_lines(seen, set()) for of in whole_lines(f)]
    read = seen.without(seen.read, loose)
    at_rest = np.where(read, seen.base / seen.circuit.full_scale, np.nan)
    touches = np.where(read, touches_of(seen, n), np.nan)
    return readout.Touched(at_rest, seen.usual_noise, touches)


def _wires(seen: Recorded, unusable, found) -> tuple[wiring.Wires, np.ndarray, np.ndarray]:
    """Wires without the open ones, the resistance that is read at rest [ohm], and where."""
    known = seen.without(seen.read & (seen.base > 0.0), unusable)
    adc, cells = seen.base / seen.circuit.full_scale, known & seen.circuit.populated
    usual = usual_resistance(adc, cells, seen.circuit) if cells.any() else np.inf
    if not 0.0 < usual < np.inf:  # nothing conducts, or all of it as a wire
        known = np.zeros_like(known)
    wires = wiring.Wires.sound(seen.circuit, usual)
    for f in found:
        for axis, line in whole_lines(f) if f.kind is Kind.OPEN else ():
            wires = wires.reading(axis, line, -1)
    return wires, wiring.measured_resistance(seen.circuit, adc), known


def _joined(seen: Recorded, wires: wiring.Wires, rho, known, pairs, found: list):
    """Return the wires with lines that read alike, and where one of each pair is left.

    Two stripes that touch, and one that is read by two addresses, conduct otherwise at rest.
    """
    wires, alone, log = wires.fitted(rho, known)
    doubled: dict[int, list[tuple[int, int]]] = {0: [], 1: []}
    for axis, a, b in pairs:
        read = seen.turned(axis, known)[a]
        off = seen.turned(axis, log)[a, read]
        touching = replace(wires, joined=[*wires.joined, (axis, a, b)])
        twice = wires.reading(axis, b, a)

        def misfit(supposed: wiring.Wires, axis=axis, a=a, read=read, off=off, alone=alone):
            more = seen.turned(axis, supposed.resistance() / alone)[a, read]
            return abs(np.median(off - np.log(more)))

        if read.any() and misfit(touching) < misfit(twice):
            wires = touching
            found.append(Finding(Kind.SHORT, "lines", **lines(axis, a, b)))
        else:
            wires = twice
            doubled[axis].append((a, b))
        known = seen.without(known, [(axis, b)])
    for axis in (0, 1):
        found += wiring.doubled(axis, seen.circuit.shape[axis], doubled[axis])
    return wires, known
