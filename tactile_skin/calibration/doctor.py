"""What is wrong with a board, from a recording of its ordinary use: which wire, which cell.

recorded.py   rest, noise and touches of the recording
readings.py   faults of single readings: bits, ceiling, noise, open and loose lines
order.py      lines that read alike, lines in the wrong order
wiring.py     damage of wires and cells that explains the rest

What the readings cannot tell is not guessed: two boards that read alike get the same finding, which
then names both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics.circuit import Circuit
from ..solvers.series import series_scale
from . import order, readings, wiring
from .identify import identify
from .recorded import Recorded, line_name, record
from .rest import Rest, resting_conductance

# Cells, in all touches together, that identify is asked about: it takes 0.1 s for 256. At least
# and at most so many touches, each looked for within so many frames of its peak.
_ASKED, _TOUCHES, _HELD = 20_000, (20, 60), 15
_SERIES = 0.05, 4.0  # share of r_par, and standard deviations, by which it must be off
_SHORT = 0.02  # of the usual cell's resistance: below, a crossing is no pressed cell but a short
_SHORTED = 0.5  # share of what a short of two lines takes from their readings at rest
_ONE_VOLTAGE = 4.0  # times the noise within which all readings are one voltage


@dataclass(frozen=True)
class Finding:
    """One fault.

    Attributes:
        kind: "short", "open", "broken", "lead", "doubled", "swapped", "shifted", "dead", "stuck",
            "noisy", "contact", "circuit", "bits", "saturation" or "no signal".
        where: for a person: "column 5", "row 2, column 7", "ADC".
        evidence: the numbers that show it.
        remedy: what to check.
        rows, cols: that it is about; one of each: their crossing.
    """

    kind: str
    where: str
    evidence: str
    remedy: str
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()

    def __str__(self):
        return f"{self.where}: {self.evidence}. {self.remedy}."


def diagnose(frames, circuit: Circuit, rest: Rest | None = None) -> list[Finding]:
    """What is wrong with a board.

    Args:
        frames: (n, rows, cols) ADC ratio of ordinary use, in order: a minute or so, untouched for a
            third of it, and with some twenty different touches, some hard. NaN where a crossing was
            not read.
        circuit: what is supposed.
        rest: `measure_rest` of the same board; None: from the frames in which nothing touches.

    Returns:
        The faults, an empty list for a sound board. A wrong bit hides all else.

    Raises:
        ValueError: another shape, values outside [0, 1], or fewer than 20 frames.
    """
    seen = record(frames, circuit, rest)
    if finding := _silent(seen):
        return [finding]
    if bits := readings.stuck_bits(seen):
        return [_bit(*bit) for bit in bits]
    found: list[Finding] = []
    if top := readings.ceiling(seen):
        found.append(_ceiling(seen, *top))
    unusable = set()  # (axis, line) whose readings say nothing of the fabric
    for axis, line, high, usual in readings.open_lines(seen):
        found.append(_open(seen, axis, line, high, usual))
        unusable.add((axis, line))
    for axis, line, share in readings.loose_lines(seen):
        if (axis, line) not in unusable:
            found.append(_contact(axis, line, share))
            unusable.add((axis, line))
    noisy_lines, noisy_cells = readings.noisy(seen, unusable)
    found += [_noisy_line(seen, *line) for line in noisy_lines]
    found += [_noisy_cell(seen, *cell) for cell in noisy_cells]
    wires, rho, known = _wires(seen, unusable)
    pairs = _joined(seen, wires, rho, known, order.equal_lines(seen, unusable), found)
    unusable |= pairs
    damages, cell = wiring.search(circuit, rho, known, wires)
    quiet = {(row, col) for row, col, _ in noisy_cells}
    for damage in damages:
        if damage.kind != "cell" or (damage.line, damage.at) not in quiet:
            found.append(_damage(circuit, damage, cell))
    broken = {(d.axis, d.line) for d in damages if d.kind != "cell"}
    moved = order.misplaced(seen, unusable | broken)
    found += [_misplaced(m) for m in moved]
    if not pairs and not wires.cut and not moved and not top:  # another network than the circuit's
        found += _series(seen, unusable, wires, cell)
    return found


def _line(axis: int, line: int) -> dict:
    return {("rows", "cols")[axis]: (line,)}


def _silent(seen: Recorded) -> Finding | None:
    cells = seen.read & seen.circuit.populated
    level = seen.base[cells]
    spread, moves = float(np.std(level)), float(np.ptp(seen.steps[:, cells], axis=0).max())
    if moves > 8.0 * seen.usual_noise + 4.0 or spread > _ONE_VOLTAGE * seen.usual_noise:
        return None
    return Finding(
        "no signal",
        "all readings",
        f"{level.mean():.1f} ADC steps throughout, within {moves:.1f}",
        "Is the matrix connected, supplied, and was it touched? Measure the ADC's input",
    )


def _bit(bit: int, kept: int, share: float) -> Finding:
    return Finding(
        "bits",
        f"ADC bit {bit}",
        f"always {kept}: readings with the other value are {share:.2f} times as frequent as those "
        "beside them",
        "Check how the two bytes of a sample are put together, the ADC's data line, and adc_bits",
    )


def _ceiling(seen: Recorded, height: float, n: int, cells: int) -> Finding:
    most = seen.circuit.ratio(0.0) * seen.circuit.full_scale
    return Finding(
        "saturation",
        "ADC",
        f"{n} readings of {cells} cells end at {height:.0f} ADC steps (a short circuit reads "
        f"{most:.0f})",
        "Measure the ADC's reference and the amplifier's supply; compare them with the matrix'",
    )


def _open(seen: Recorded, axis: int, line: int, high: float, usual: float) -> Finding:
    n = np.count_nonzero(seen.turned(axis, seen.read)[line])
    return Finding(
        "open",
        line_name(axis, line),
        f"open: none of its {n} readings exceeds {high:.0f} counts (an untouched cell reads "
        f"{usual:.0f})",
        "Check its lead: the resistance from the multiplexer's pin to the stripe must be some ohm",
        **_line(axis, line),
    )


def _contact(axis: int, line: int, share: float) -> Finding:
    return Finding(
        "contact",
        line_name(axis, line),
        f"comes and goes: all its readings drop together in {100 * share:.0f} % of the frames",
        "Move its lead while you measure its resistance; press the connector on",
        **_line(axis, line),
    )


def _noisy_line(seen: Recorded, axis: int, line: int, noise: float) -> Finding:
    return Finding(
        "noisy",
        line_name(axis, line),
        f"{noise:.1f} ADC steps RMS of noise on all its readings (usual: {seen.usual_noise:.1f})",
        "Check its lead's screen and ground, and what runs beside it",
        **_line(axis, line),
    )


def _noisy_cell(seen: Recorded, row: int, col: int, noise: float) -> Finding:
    return Finding(
        "noisy",
        f"row {row}, column {col}",
        f"{noise:.1f} ADC steps RMS of noise while nothing touches (usual: {seen.usual_noise:.1f})",
        "Check the contact between stripe and fabric there",
        (row,),
        (col,),
    )


def _wires(seen: Recorded, unusable) -> tuple[wiring.Wires, np.ndarray, np.ndarray]:
    """Sound wires, the resistance that is read at rest [ohm], and where it is known."""
    known = seen.read & (seen.base > 0.0)
    for axis, line in unusable:
        seen.turned(axis, known)[line] = False
    ratio = np.maximum(seen.base, 0.5) / seen.circuit.full_scale
    rho = np.maximum(seen.circuit.two_terminal(ratio), 1.0)
    return wiring.Wires.sound(seen.circuit), rho, known


def _joined(seen: Recorded, wires: wiring.Wires, rho, known, pairs, found: list) -> set:
    """Lines that read alike: a short, or one line read by two addresses. Both are noted in `wires`.

    Two stripes that touch conduct like one of twice the width; a stripe that is read twice does not.

    Returns:
        (axis, line) of one of each pair.
    """
    alone = wires.resistance()
    taken = set()
    level = np.median(np.log(rho / alone)[known]) if known.any() else 0.0
    doubled = {0: [], 1: []}
    for axis, a, b in pairs:
        touching = wiring.Wires(
            wires.cells, [(axis, a, b)], wires.reads, wires.cut, wires.lead
        ).resistance()
        lines = seen.turned(axis, known)[a]
        off = seen.turned(axis, np.log(rho / alone))[a, lines] - level
        short = seen.turned(axis, np.log(touching / alone))[a, lines]
        if np.median(off) < _SHORTED * np.median(short):
            wires.joined.append((axis, a, b))
            found.append(_short(seen, axis, a, b))
        else:
            doubled[axis].append((a, b))
        taken.add((axis, b))
        seen.turned(axis, known)[b] = False
    for axis in (0, 1):
        found += _doubled(seen, axis, doubled[axis])
    return taken


def _short(seen: Recorded, axis: int, a: int, b: int) -> Finding:
    name = ("rows", "columns")[axis]
    return Finding(
        "short",
        f"{name} {a} and {b}",
        "shorted: they read alike in all frames, and conduct at rest like one stripe of twice the "
        "width",
        "Measure between their leads with the board disconnected: look for a bridge of solder or "
        "conductive thread",
        **{("rows", "cols")[axis]: (a, b)},
    )


def _doubled(seen: Recorded, axis: int, pairs: list) -> list[Finding]:
    name, n = ("rows", "columns")[axis], seen.circuit.shape[axis]
    key = ("rows", "cols")[axis]
    for bit in range((n - 1).bit_length()):
        expected = {(k, k | 1 << bit) for k in range(n) if not k & 1 << bit and k | 1 << bit < n}
        if len(pairs) > 1 and expected <= set(pairs):
            return [
                Finding(
                    "doubled",
                    f"address bit {bit} of the {name}",
                    f"stuck: {name} {', '.join(f'{a} and {b}' for a, b in sorted(expected))} read "
                    "alike",
                    "Measure this address pin of the multiplexer while the board scans",
                    **{key: tuple(range(n))},
                )
            ]
    return [
        Finding(
            "doubled",
            f"{name} {a} and {b}",
            "one stripe is read by both: they read alike in all frames, but conduct at rest like "
            "a single one",
            "Check the addresses that the sketch selects, the multiplexer's clock or address pins, "
            "and the wiring behind line " + str(a),
            **{key: (a, b)},
        )
        for a, b in pairs
    ]


def _damage(circuit: Circuit, damage: wiring.Damage, cell: float) -> Finding:
    axis, line, at = damage.axis, damage.line, damage.at
    name, other = line_name(axis, line), ("column", "row")[axis]
    if damage.kind == "lead":
        return Finding(
            "lead",
            name,
            f"all its readings lack what {damage.size:.0f} ohm in series take from them",
            "Measure its lead: from the multiplexer's pin to the stripe must be some ohm",
            **_line(axis, line),
        )
    if damage.kind == "broken":
        return Finding(
            "broken",
            name,
            f"broken before {other} {at}: from there on it conducts through the fabric only",
            f"Measure along the stripe, between {other} {at - 1} and {other} {at}",
            **_line(axis, line),
        )
    where, ohm = f"row {line}, column {at}", cell / max(damage.size, 1e-9)
    if damage.size == 0.0:
        last = [
            f"{line_name(a, k)} may be cut before it"
            for a, k, end in ((0, line, circuit.cols - 1), (1, at, circuit.rows - 1))
            if (at, line)[a] == end
        ]
        return Finding(
            "dead",
            where,
            f"conducts nothing (an untouched cell has {cell:.0f} ohm)",
            "; ".join(["Check that stripes and fabric touch there", *last]),
            (line,),
            (at,),
        )
    if ohm < _SHORT * 1000.0:
        return Finding(
            "short",
            where,
            f"shorted: the crossing has {ohm:.0f} ohm while nothing touches (an untouched cell has "
            f"{cell:.0f})",
            "Look for a hole in the fabric, or a wire that touches both stripes",
            (line,),
            (at,),
        )
    return Finding(
        "stuck",
        where,
        f"the cell has {ohm:.0f} ohm while nothing touches (an untouched cell has {cell:.0f})",
        "Does something press there? Look at the seam, the cover and the fabric",
        (line,),
        (at,),
    )


def _misplaced(moved: order.Misplaced) -> Finding:
    name, key = (("rows", "rows"), ("columns", "cols"))[moved.axis]
    saved = f"{moved.touches} touches are {100 * moved.share:.0f} % smoother"
    if moved.lines == (-1, -1):
        return Finding(
            "shifted",
            "all samples",
            f"one place late: {saved} if each frame begins one sample later",
            "Check where the sketch, or the program that reads it, begins a frame",
        )
    a, b = moved.lines
    return Finding(
        "swapped",
        f"{name} {a} and {b}",
        f"{saved} if they are exchanged",
        f"Press along them: if the touch jumps, exchange the two leads, or `{name}` in the sketch",
        **{key: (a, b)},
    )


def _series(seen: Recorded, skip, wires: wiring.Wires, cell: float) -> list[Finding]:
    """What lies in series with all cells, by the touches."""
    circuit, full = seen.circuit, seen.circuit.full_scale
    if not len(seen.peaks):
        return []
    unknown = ~seen.read
    for axis, line in skip:
        seen.turned(axis, unknown)[line] = True
    lead = cell * (wires.lead[0][:, None] + wires.lead[1])  # ohm, of bad ones
    usual = circuit.ratio(wires.resistance() * cell - lead)
    touches = _without(lead, _touches(seen), circuit)
    adc = np.where(unknown, usual, _without(lead, seen.base / full, circuit))
    noise = max(seen.usual_noise, 0.3)
    quiet = int(np.count_nonzero(seen.quiet))
    try:
        rest = Rest(adc, noise, quiet, resting_conductance(adc, circuit, noise / quiet**0.5))
        found = identify(np.where(unknown, np.nan, touches), circuit, rest, soft=True)
    except ValueError:
        return []
    off = found.circuit.r_par - circuit.r_par
    limit = max(_SERIES[0] * series_scale(circuit), _SERIES[1] * found.std["r_par"])
    if abs(off) < limit:
        return []
    return [
        Finding(
            "circuit",
            "r_par, r_ref or supply",
            f"{found.frames} frames of touches fit r_par = {found.circuit.r_par:.0f} +- "
            f"{found.std['r_par']:.0f} ohm, not {circuit.r_par:g}. r_ref off by "
            f"{100 * (circuit.r_par / found.circuit.r_par - 1):+.0f} %, or a divider's supply that "
            "is not the ADC's reference, reads the same",
            "Measure the reference resistor, the supply and the ADC's reference; what is left is "
            "r_par",
        )
    ]


def _without(lead: np.ndarray, adc: np.ndarray, circuit: Circuit) -> np.ndarray:
    """The ADC ratio without what leads (rows, cols) [ohm] take from it."""
    return np.clip(circuit.r_ref / (circuit.r_ref / np.maximum(adc, 1e-4) - lead), 0.0, 1.0)


def _touches(seen: Recorded) -> np.ndarray:
    """(n, rows, cols) ADC ratio of touches, each where it moves least."""
    n = int(np.clip(_ASKED / np.count_nonzero(seen.circuit.populated), *_TOUCHES))
    hardest = np.argsort(-seen.steps[seen.peaks].max((1, 2)))
    picked = np.sort(seen.peaks[hardest[:n]])
    found = []
    for peak in picked:
        near = seen.steps[max(peak - _HELD, 0) : peak + _HELD + 1].astype(float)
        moved = np.abs(near[2:] - near[:-2]).sum((1, 2)) / np.abs(near[1:-1] - seen.base).sum((1, 2))
        k = int(moved.argmin())
        found.append(near[k : k + 3].mean(0))
    return np.clip(np.array(found) / seen.circuit.full_scale, 0.0, 1.0)
