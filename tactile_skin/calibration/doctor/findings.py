"""What was found, in words: each fault with its line or cell, its numbers and what to check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...physics.circuit import Circuit
from ...readings.processed import Processed
from . import order, wiring
from .advice import Change
from .recorded import Recorded, line_name

# Ohm of a crossing, below which it is no pressed cell but a short: one of 1 ohm seems to have up to
# 40 where r_ref or r_par is 10 % off.
_SHORT = 60.0


@dataclass(frozen=True)
class Finding:
    """One fault.

    Attributes:
        kind: "short", "open", "broken", "lead", "resistor", "doubled", "swapped", "shifted",
            "transposed", "dead", "stuck", "noisy", "contact", "circuit", "readout", "bits",
            "polarity", "saturation", "zeros" or "no signal".
        where: for a person: "column 5", "row 2, column 7", "ADC".
        evidence: the numbers that show it.
        remedy: what to check.
        rows, cols: that it is about; one of each: their crossing.
        change: what to enter, where the frames leave no other explanation; None: nothing.
    """

    kind: str
    where: str
    evidence: str
    remedy: str
    rows: tuple[int, ...] = ()
    cols: tuple[int, ...] = ()
    change: Change | None = None

    def __str__(self):
        return f"{self.where}: {self.evidence}. {self.remedy}."


def _line(axis: int, line: int) -> dict:
    return {("rows", "cols")[axis]: (line,)}


def processed(done: Processed) -> Finding:
    """Return that the readings are not what an ADC reads, by what was done to them."""
    return Finding(
        "zeros",
        "all readings",
        str(done),
        "Send what the ADC reads; until then nothing else is told by these readings",
    )


def at_an_end(end: float, share: float) -> Finding:
    """Return that so many readings stand at one end of the range [ADC steps]."""
    return Finding(
        "zeros",
        "all readings",
        f"{share:.0%} are exactly {end:.0f}: these are not what an ADC reads. The board, or what "
        "recorded it, takes off an offset or a threshold, or the untouched fabric conducts too "
        "little for r_ref",
        "Send what the ADC reads; until then nothing else is told by these readings",
    )


def bit(bit: int, kept: int, share: float) -> Finding:
    return _bit(
        bit,
        kept,
        f"readings with the other value are {share:.2f} times as frequent as those beside them",
    )


def leaping_bit(bit: int, kept: int, noise: float) -> Finding:
    return _bit(
        bit,
        kept,
        f"untouched cells have up to {noise:.1f} ADC steps RMS of noise, the more the further they "
        f"are from a multiple of {1 << bit}: their samples leap by as much",
    )


def _bit(bit: int, kept: int, evidence: str) -> Finding:
    return Finding(
        "bits",
        f"ADC bit {bit}",
        f"always {kept}: {evidence}",
        "Check how the two bytes of a sample are put together, the ADC's data line, and adc_bits",
    )


def ceiling(seen: Recorded, height: float, n: int, cells: int) -> Finding:
    most = seen.circuit.ratio(0.0) * seen.circuit.full_scale
    return Finding(
        "saturation",
        "ADC",
        f"{n} readings of {cells} cells end at {height:.0f} ADC steps (a short circuit reads "
        f"{most:.0f})",
        "Measure the ADC's reference and the amplifier's supply; compare them with the matrix'",
    )


def open_line(seen: Recorded, axis: int, line: int, high: float, usual: float) -> Finding:
    n = np.count_nonzero(seen.turned(axis, seen.read)[line])
    return Finding(
        "open",
        line_name(axis, line),
        f"open: none of its {n} readings exceeds {high:.0f} counts (an untouched cell reads "
        f"{usual:.0f})",
        "Check its lead: the resistance from the multiplexer's pin to the stripe must be some ohm",
        **_line(axis, line),
    )


def contact(axis: int, line: int, share: float) -> Finding:
    return Finding(
        "contact",
        line_name(axis, line),
        f"comes and goes: all its readings drop together in {100 * share:.0f} % of the frames",
        "Move its lead while you measure its resistance; press the connector on",
        **_line(axis, line),
    )


def noisy_line(seen: Recorded, axis: int, line: int, noise: float) -> Finding:
    return Finding(
        "noisy",
        line_name(axis, line),
        f"{noise:.1f} ADC steps RMS of noise on all its readings (usual: {seen.usual_noise:.1f})",
        "Check its lead's screen and ground, and what runs beside it",
        **_line(axis, line),
    )


def noisy_cell(seen: Recorded, row: int, col: int, noise: float) -> Finding:
    return Finding(
        "noisy",
        f"row {row}, column {col}",
        f"{noise:.1f} ADC steps RMS of noise while nothing touches (usual: {seen.usual_noise:.1f})",
        "Check the contact between stripe and fabric there",
        (row,),
        (col,),
    )


def short(seen: Recorded, axis: int, a: int, b: int) -> Finding:
    name = ("rows", "columns")[axis]
    return Finding(
        "short",
        f"{name} {a} and {b}",
        "shorted: they read alike in all frames, and conduct at rest like stripes that touch",
        "Measure between their leads with the board disconnected: look for a bridge of solder or "
        "conductive thread",
        **{("rows", "cols")[axis]: (a, b)},
    )


def doubled(seen: Recorded, axis: int, pairs: list) -> list[Finding]:
    name, n = ("rows", "columns")[axis], seen.circuit.shape[axis]
    key, found = ("rows", "cols")[axis], []
    for bit in range((n - 1).bit_length()):
        expected = {(k, k | 1 << bit) for k in range(n) if not k & 1 << bit and k | 1 << bit < n}
        if len(pairs) > 1 and expected <= set(pairs):
            found.append(
                Finding(
                    "doubled",
                    f"address bit {bit} of the {name}",
                    f"stuck: {name} {', '.join(f'{a} and {b}' for a, b in sorted(expected))} read "
                    "alike",
                    "Measure this address pin of the multiplexer while the board scans",
                    **{key: tuple(range(n))},
                )
            )
    if found:
        return found
    return [
        Finding(
            "doubled",
            f"{name} {a} and {b}",
            "one stripe is read by both: they read alike in all frames, but do not conduct at rest "
            "like two that touch",
            "Check the addresses that the sketch selects, the multiplexer's clock or address pins, "
            "and the wiring behind line " + str(a),
            **{key: (a, b)},
        )
        for a, b in pairs
    ]


def damage(circuit: Circuit, damage: wiring.Damage, cell: float, ends: bool = False) -> Finding:
    """Args:
    ends: whether the cell's reading is at the ceiling, so that it may conduct more.
    """
    axis, line, at = damage.axis, damage.line, damage.at
    name, other = line_name(axis, line), ("column", "row")[axis]
    if damage.kind == "lead":
        return Finding(
            "lead",
            name,
            f"all its readings lack what {damage.size:.0f} +- {damage.std:.0f} ohm in series take "
            "from them",
            "Measure its lead: from the multiplexer's pin to the stripe must be some ohm",
            **_line(axis, line),
        )
    if damage.kind == "resistor":
        missing = not np.isfinite(damage.size)
        seems = "is missing" if missing else f"has {damage.size:.0f} ohm, not {circuit.r_ref:g}"
        return Finding(
            "resistor",
            name,
            f"reads as if its reference resistor {seems}",
            "Measure between this line and ground, or the supply where it pulls up, with the "
            "matrix unplugged; solder the resistor anew",
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
    if ohm < _SHORT:
        return Finding(
            "short",
            where,
            f"shorted: the crossing has {ohm:.0f} ohm while nothing touches (an untouched cell has "
            f"{cell:.0f})",
            "Look for a hole in the fabric, or a wire that touches both stripes",
            (line,),
            (at,),
        )
    if ends:
        return Finding(
            "stuck",
            where,
            f"the cell has {ohm:.0f} ohm or less while nothing touches (an untouched cell has "
            f"{cell:.0f}): the readings end there",
            "It is shorted, or something presses there: look for a hole in the fabric, or a wire "
            "that touches both stripes, and at the seam and the cover",
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


def misplaced(moved: order.Misplaced) -> Finding:
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
