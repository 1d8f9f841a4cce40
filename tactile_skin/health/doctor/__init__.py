"""What is wrong with a board, from a recording of its ordinary use: which wire, which cell.

circuits.py   findings of the circuit; damaged.py of wires and cells. Words: findings/words.csv
unrested.py   whether the recording shows the skin at rest
advice.py     what to enter, tried on the frames before it is proposed
recorded.py   rest, noise and touches of the recording
readout.py    another readout than the configured one
readings.py   faults of single readings: bits, ceiling, noise, open and loose lines
converter.py  an ADC that is not linear
series.py     r_par, r_line, r_drive by the touches
diode.py      diodes in the driven lines of a loaded matrix
order.py      lines that read alike, lines in the wrong order
wiring.py     damage of wires and cells that explains the rest

What the readings cannot tell is not guessed: two boards that read alike get the same finding, which
then names both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration.rest import REST_SPAN, Rest, usual_resistance
from ...findings.finding import Finding, Kind, lines
from ...physics.circuit import Circuit
from ...physics.readouts import DRIVEN
from ...readings.processed import Kind as Done
from ...readings.processed import processed
from . import circuits, converter, damaged, order, readings, readout, wiring
from .advice import Change, is_safe
from .diode import unknown_diode
from .recorded import Recorded, record
from .series import in_series, touches_of
from .unrested import unrested

_AGREEING = 24  # hardest touches that must agree where the lines may be driven through diodes
_USUAL = 22.5  # times r_ref that a cell has, where the readings tell none: the paper's
_READ = 12  # hardest touches that the readout is judged by,
_READ_SHORTLY = 4  # without `series`
_FELL = 0.5  # share of all change that is a fall from which on readings may be upside down
# Where no circuit tells, they are if so much of it is one, so little the other way round, and so
# many touches say so: on sound boards hardly any change is a fall.
_FALLS = 0.8
_RISES = 0.2
_FALLING = 3
_ONE_VOLTAGE = 4.0  # times the noise within which all readings are one voltage
_MOST_NOISE = 0.01  # of full scale: what moves more is no noise
# Share of the usual cell's readings that stand at one end of the range, from which on they are not
# what the ADC reads; ADC steps that are no other reading. Sound boards have no such usual cell.
_AT_END = 0.1
_HALF_STEP = 0.5
_DECIMALS = 2  # of ADC steps, which ratios of single precision keep


def diagnose(
    frames,
    circuit: Circuit,
    rest: Rest | None = None,
    *,
    series: bool = True,
    inverted: bool = False,
) -> list[Finding]:
    """What is wrong with a board.

    Args:
        frames: (n, rows, cols) ADC ratio of ordinary use, in order: a minute or so, untouched for a
            third of it, and with some twenty different touches, some hard. NaN where a crossing was
            not read.
        circuit: what is supposed.
        rest: `measure_rest` of the same board; None: from the frames in which nothing touches.
        series: whether to ask for r_par, r_ref and supply, which takes most of the time.
        inverted: whether the frames are 1 minus what the board reads, as it is configured.

    Returns:
        The faults, an empty list for a sound board. Readings upside down, another readout than the
        circuit's, a wrong bit, and rows and columns that are exchanged hide all else. Of frames
        that show no rest, without `rest`: that alone, of kind "too little seen".

    Raises:
        ValueError: another shape, values outside [0, 1], or fewer than 20 frames.
    """
    frames = np.asarray(frames)
    seen = record(frames, circuit, rest)
    if finding := _processed(seen):
        return [finding]
    judged = rest is not None or _at_an_end(seen) or readings.leaping_bit(seen)
    if not judged and (finding := unrested(seen)):
        turned = record(1.0 - frames, circuit, None)  # upside down, the calmest are the hardest
        return (not unrested(turned) and _upside_down(seen, turned, inverted)) or [finding]
    found = _diagnose(seen, series)
    sound = not found and len(seen.touches)
    if sound and (
        seen.fell < _FELL or readout.misses(circuit, _touched(seen, _READ_SHORTLY)) < readout.FITS
    ):
        return found
    return _upside_down(seen, record(1.0 - frames, circuit, None), inverted) or found


def _upside_down(seen: Recorded, turned: Recorded, inverted: bool) -> list[Finding]:
    """Whether nothing but another readout is wrong the other way round, or all that moves falls.

    Args:
        turned: of 1 minus the readings.
    """
    circuit, touched = seen.circuit, _touched(turned, _READ_SHORTLY)
    if not len(touched.touches):
        return []
    found = _diagnose(turned, series=False)
    of_other = [f for f in found[:1] if f.kind is Kind.READOUT and f.change]
    if not of_other and (found or readout.misses(circuit, touched) >= readout.FITS):
        falls = seen.fell > _FALLS or not len(seen.touches)
        if not (falls and turned.fell < _RISES and turned.returns >= _FALLING):
            return []
    change = Change(of_other[0].change.circuit if of_other else circuit, turned=True)
    if not is_safe(change, seen.ratio, turned.quiet, turned.usual_noise):
        return []
    usual = float(np.median(seen.steps[:, seen.read]))
    return [circuits.polarity(usual, Change(circuit, turned=True), inverted), *of_other]


def _diagnose(seen: Recorded, series: bool) -> list[Finding]:
    """The same of readings that are not upside down."""
    circuit = seen.circuit
    if finding := _silent(seen) or _at_an_end(seen):
        return [finding]
    touched = _touched(seen, _READ if series else _READ_SHORTLY)
    fitting = readout.other(circuit, touched)
    named = fitting and any(c.circuit.r_par == circuit.r_par for c in fitting.changes)
    if fitting and named and not fitting.of_own_cells:
        return [circuits.readout(circuit, fitting)]
    if bits := readings.stuck_bits(seen):
        names = "bit", "kept", "share"
        return [
            Finding(Kind.BITS, "gap", numbers=dict(zip(names, bit, strict=True))) for bit in bits
        ]
    if leaping := readings.leaping_bit(seen):
        bit, kept, noise = leaping
        numbers = {"bit": bit, "kept": kept, "noise": noise, "width": 1 << bit}
        return [Finding(Kind.BITS, "leaps", numbers=numbers)]
    votes = order.transposed(seen)
    if votes and (change := _other_way(seen, touched)):
        return [circuits.transposed(circuit, change, votes.touches, votes.share)]
    if fitting and named and not votes:  # touches that are torn add up to what no network reads
        return [circuits.readout(circuit, fitting)]
    found: list[Finding] = []
    if top := readings.ceiling(seen):
        height, count, of_cells = top
        most = circuit.ratio(0.0) * circuit.full_scale
        numbers = {"count": count, "cells": of_cells, "steps": height, "most": most}
        found.append(Finding(Kind.SATURATION, numbers=numbers))
    unusable: set[tuple[int, int]] = set()  # (axis, line) whose readings say nothing of the fabric
    for check in damaged.CHECKS:
        new = check(seen, unusable)
        found += new
        unusable |= {at for f in new if f.kind is not Kind.NOISY for at in damaged.whole_lines(f)}
    noisy = [f for f in found if f.kind is Kind.NOISY]
    wires, rho, known = _wires(seen, unusable, found)
    if not known.any():
        return found
    alike = order.equal_lines(seen, unusable)
    try:
        wires, pairs = _joined(seen, wires, rho, known, alike, found)
        damages, wires = wiring.search(circuit, rho, known, wires)
    except np.linalg.LinAlgError:  # whatever the cells, this circuit does not read so
        return found or _explained(circuit, fitting)
    unusable |= pairs
    quiet = {(f.rows[0], f.cols[0]) for f in noisy if f.rows and f.cols}
    for axis, a, b in wires.joined:  # a cell of lines that touch may be on either
        swap = {a: b, b: a}
        quiet |= {(swap.get(r, r), c) if axis == 0 else (r, swap.get(c, c)) for r, c in quiet}
    for damage in damages:
        if damage.kind != "cell" or (damage.line, damage.at) not in quiet:
            ends = top is not None and readings.at_ceiling(seen, top[0])[damage.line, damage.at]
            found.append(damaged.damage(circuit, damage, wires.cell, ends))
    odd = {(d.axis, d.line) for d in damages if d.kind != "cell"}
    pressed = {(d.line, d.at) for d in damages if d.kind == "cell" and d.size > 1.0}
    if top:  # beside such a cell, touches that end there are all alike
        odd |= {line for row, col in pressed for line in ((0, row), (1, col))}
    moved = order.misplaced(seen, unusable | odd, _cells(damages) | quiet, pressed)
    for m in moved:
        numbers = {"touches": m.touches, "share": m.share}
        late = m.lines == (-1, -1)
        of = {} if late else lines(m.axis, *m.lines)
        found.append(Finding(Kind.SHIFTED if late else Kind.SWAPPED, **of, numbers=numbers))
    # With stripes that are cut or are not read it is another network.
    unread = len(pairs) > len(wires.joined) or wires.cut
    unread = unread or (wires.joined and circuit.readout != "floating")
    beside = {(d.axis, d.line) for d in damages if d.kind in ("lead", "resistor")}
    if circuit.readout == "loaded":  # so with a sense line that leads to ground by other than r_ref
        unread = unread or any(axis != circuit.sense_axis for axis, _ in unusable | beside)
    if series and not found and circuit.readout == "loaded":
        touched = _touched(seen, _AGREEING)
        if share := unknown_diode(circuit, touched, int(np.count_nonzero(seen.quiet))):
            return [circuits.diode(share)]
    if series and not (unread or top or wires.cells.max() > REST_SPAN):
        skip = unusable | {at for f in noisy for at in damaged.whole_lines(f)}
        if circuit.readout != "floating":  # where a lead is not in series with each reading
            skip |= beside
        found += in_series(seen, skip, quiet, wires)
    if found or not series:
        return found
    if table := converter.other(circuit, touched):
        return [circuits.converter(table)]
    return _explained(circuit, fitting)


def _other_way(seen: Recorded, touched: readout.Touched) -> Change | None:
    """Rows and columns exchanged, and what is driven as the touches say; None: neither fits."""
    supposed = replace(seen.circuit, rows=seen.circuit.cols, cols=seen.circuit.rows)
    driven = DRIVEN[:1] if supposed.readout == "floating" else DRIVEN
    changes = [Change(supposed.read_as(supposed.readout, lines)) for lines in driven]
    tried = [(readout.misses(c.circuit, touched.after(c)), k, c) for k, c in enumerate(changes)]
    left, _, change = min(tried)
    fits = left < readout.FITS
    safe = fits and is_safe(change, seen.ratio, seen.quiet, seen.usual_noise)
    return change if safe else None


def _explained(circuit: Circuit, fitting: readout.Fitting | None) -> list[Finding]:
    """What the touches fit instead, where nothing else was found."""
    if fitting is None:
        return []
    tell = circuits.readout if fitting.changes else circuits.no_readout
    return [tell(circuit, fitting)]


def other_readout(circuit: Circuit, at_rest, noise: float, touches) -> Finding | None:
    """The finding that touches are those of another readout than the circuit's; None: they are not.

    Args:
        at_rest: (rows, cols) ADC ratio of the untouched skin, NaN: not read.
        noise: of a reading [ADC steps].
        touches: (n, rows, cols) ADC ratio, some of them hard; NaN: not read.
    """
    fitting = readout.other(circuit, readout.Touched(at_rest, noise, touches))
    wired = {(c.circuit.readout, c.circuit.driven) for c in (fitting.changes if fitting else ())}
    others = wired - {(circuit.readout, circuit.driven)}
    return circuits.readout(circuit, fitting) if fitting and others else None


def ignored_diode(circuit: Circuit, rest: Rest, touches) -> Finding | None:
    """The finding that a loaded matrix is driven through diodes that `circuit.diode` does not know.

    Args:
        touches: (n, rows, cols) ADC ratio; NaN: not read.
    """
    if circuit.readout != "loaded" or not len(touches):
        return None
    at_rest = rest.quiet(rest.adc[None])[0]
    share = unknown_diode(circuit, readout.Touched(at_rest, rest.noise, touches), rest.frames)
    return circuits.diode(share) if share else None


def _cells(damages: list[wiring.Damage]) -> set[tuple[int, int]]:
    return {(d.line, d.at) for d in damages if d.kind == "cell"}


def _touched(seen: Recorded, n: int) -> readout.Touched:
    """The untouched skin, and its n hardest touches."""
    at_rest = np.where(seen.read, seen.base / seen.circuit.full_scale, np.nan)
    touches = np.where(seen.read, touches_of(seen, n), np.nan)
    return readout.Touched(at_rest, seen.usual_noise, touches)


def _silent(seen: Recorded) -> Finding | None:
    cells = seen.read & seen.circuit.populated
    level, noise = seen.base[cells], min(seen.usual_noise, _MOST_NOISE * seen.circuit.full_scale)
    spread, moves = float(np.std(level)), float(np.ptp(seen.steps[:, cells], axis=0).max())
    if moves > 8.0 * noise + 4.0 or spread > _ONE_VOLTAGE * noise:
        return None
    numbers = {"steps": float(level.mean()), "moves": moves}
    return Finding(Kind.NO_SIGNAL, "throughout", numbers=numbers)


def _processed(seen: Recorded) -> Finding | None:
    """Of a stream that shows what was done to it, whatever polarity is configured."""
    cells = seen.steps[:, seen.read & seen.circuit.populated].astype(float)
    for steps in (cells, seen.circuit.full_scale - cells):
        done = processed(np.round(steps, _DECIMALS), seen.circuit.adc_bits)
        if done and done.kind is not Done.CEILING:
            return Finding(Kind.ZEROS, detail=str(done))
        # a threshold, below which a reading is what an offset makes of 0
        done = processed(np.round(steps - steps.min(), _DECIMALS), seen.circuit.adc_bits)
        if done and done.kind is Done.THRESHOLD:
            return Finding(Kind.ZEROS, detail=str(done))
    return None


def _at_an_end(seen: Recorded) -> Finding | None:
    """Of a stream that is not what an ADC reads: an offset or a threshold was taken off."""
    cells = seen.steps[:, seen.read & seen.circuit.populated]
    full = seen.circuit.full_scale
    for end in (0.0, full):
        at_end = np.abs(cells - end) < _HALF_STEP
        if np.median(at_end.mean(0)) > _AT_END:
            numbers = {"share": float(at_end.mean()), "steps": end}
            return Finding(Kind.ZEROS, "at an end", numbers=numbers)
    return None


def _wires(seen: Recorded, unusable, found) -> tuple[wiring.Wires, np.ndarray, np.ndarray]:
    """Wires without the open ones, the resistance that is read at rest [ohm], and where."""
    known = seen.read & (seen.base > 0.0)
    for axis, line in unusable:
        seen.turned(axis, known)[line] = False
    adc, cells = seen.base / seen.circuit.full_scale, known & seen.circuit.populated
    usual = usual_resistance(adc, cells, seen.circuit) if cells.any() else np.inf
    wires = wiring.Wires.sound(
        seen.circuit, usual if 0.0 < usual < np.inf else _USUAL * seen.circuit.r_ref
    )
    for finding in found:
        if finding.kind is Kind.OPEN:
            for axis, of in enumerate((finding.rows, finding.cols)):
                for line in of:
                    wires = wires.reading(axis, line, -1)
    return wires, wiring.measured_resistance(seen.circuit, adc), known


def _joined(seen: Recorded, wires: wiring.Wires, rho, known, pairs, found: list):
    """Lines that read alike: a short, or one line read by two addresses.

    Two stripes that touch, and one that is read twice, conduct otherwise at rest.

    Returns:
        The wires with them, and (axis, line) of one of each pair.
    """
    wires, alone, log = wires.fitted(rho, known)
    taken = set()
    doubled: dict[int, list[tuple[int, int]]] = {0: [], 1: []}
    for axis, a, b in pairs:
        touching = replace(wires, joined=[*wires.joined, (axis, a, b)])
        twice = wires.reading(axis, b, a)
        read = seen.turned(axis, known)[a]
        off, short, double = (
            seen.turned(axis, picture)[a, read]
            for picture in (
                log,
                np.log(touching.resistance() / alone),
                np.log(twice.resistance() / alone),
            )
        )
        if read.any() and abs(np.median(off - short)) < abs(np.median(off - double)):
            wires = touching
            found.append(Finding(Kind.SHORT, "lines", **lines(axis, a, b)))
        else:
            wires = twice
            doubled[axis].append((a, b))
        taken.add((axis, b))
        seen.turned(axis, known)[b] = False
    for axis in (0, 1):
        found += damaged.doubled(axis, seen.circuit.shape[axis], doubled[axis])
    return wires, taken
