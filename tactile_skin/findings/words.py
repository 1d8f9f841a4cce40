"""All words: what each kind of finding says, and what to do about it. docs/troubleshooting.md is
made of them.
"""

from __future__ import annotations

from typing import NamedTuple

from .finding import Finding, Kind

_NAMED = 3  # lines, or cells, that are named one by one


class Words(NamedTuple):
    """Templates of one kind: {at} is where, {detail} and the numbers are the finding's."""

    seen: str
    remedy: str


WORDS = {
    Kind.PROCESSED: Words("{detail}", "Send what the ADC reads"),
    Kind.NO_SIGNAL: Words(
        "all readings are one voltage, {steps:.0f} ADC steps, but for noise",
        "Is the matrix connected?",
    ),
    Kind.NO_SIGNAL_OR_OFFSET: Words(
        "all readings are one voltage, {steps:.1f} ADC steps, but for noise",
        "Is an offset or a threshold taken off, or is no matrix connected?",
    ),
    Kind.STUCK_BIT: Words(
        "all cells read {steps:+.0f} ADC steps beside their rest, to the noise",
        "Is a bit of the ADC stuck?",
    ),
    Kind.SATURATED: Words(
        "readings end at {steps:.0f} ADC steps and stay there while others change",
        "Is the input saturated, or does an amplifier or the sketch limit them?",
    ),
    Kind.AT_END: Words(
        "{count:.0f} readings at the end of the ADC's range: more force there is not felt",
        "A smaller r_ref leaves room",
    ),
    Kind.LOADED_AT_START: Words(
        "the skin has been loaded since the start, most at {at}",
        "Unload it, so that its rest can be measured",
    ),
    Kind.RISEN: Words(
        "{count:.0f} readings have risen since the start, most at {at}: no rest is measured",
        "Does something press there? If nothing does, tare",
    ),
    Kind.UNSTEADY: Words(
        "the readings wander from second to second: no rest is measured",
        "Does something touch the skin, or is the supply unsteady?",
    ),
    Kind.ZERO_AT_REST: Words(
        "{count:.0f} untouched cells read 0: no rest is measured",
        "Does the sketch subtract an offset or a threshold, or is r_ref too small for the ADC? "
        "Send what the ADC reads",
    ),
    Kind.NO_REST: Words("{detail}: no rest is measured", "Is it wired, or read, as configured?"),
    Kind.OTHER_FABRIC: Words(
        "a cell has {ohm:.0f} ohm at rest, where the curve begins with {expected:.0f}: no rest is "
        "measured",
        "Is it loaded, another fabric, or wired otherwise?",
    ),
    Kind.PRESSED_AT_REST: Words(
        "{at} conducts {times:.2g} times as much as the median cell: no rest is measured",
        "Does something press there?",
    ),
    Kind.OPEN_AT_REST: Words(
        "{at} conducts {times:.2g} times as much as the median cell: no rest is measured",
        "Is it connected?",
    ),
    Kind.WEAK_LINE: Words(
        "{at} conducts {share:+.0%} at rest, compared with the others: no rest is measured",
        "Is its lead bad?",
    ),
    Kind.FADING_LINE: Words(
        "{at} conducts {share:+.0%} compared with the start", "Is its lead breaking?"
    ),
    Kind.ALL_CELLS: Words(
        "all cells conduct {share:+.1%} at once",
        "Did the supply, the reference or r_par change, or does something lie on all of the skin, "
        "or was it taken off?",
    ),
    Kind.EXCHANGED: Words(
        "{at} reads at rest as {name} {other:.0f} did, cell for cell",
        "Does the multiplexer select another line, or were leads exchanged?",
    ),
    Kind.ADDRESS_BIT: Words(
        "address {bits} stuck, or not connected: {at} read the same, cell for cell, and so do all "
        "such lines",
        "Measure the multiplexer's address pins while the board scans",
    ),
    Kind.ONE_LINE: Words(
        "{at} read the same, cell for cell",
        "Does the multiplexer select one line twice, or are they shorted?",
    ),
    Kind.NO_PICTURE: Words("{detail}", ""),
    Kind.MISFIT: Words("{detail}", ""),
    Kind.MISFIT_KEPT: Words("{detail}", ""),
    Kind.SERIES: Words("{detail}", ""),
    Kind.NOISY: Words("{at}: much noisier than the other cells", "Is a contact loose?"),
    Kind.JUMPS: Words("{at} jumps between high and low force", "Is its contact loose?"),
    Kind.CONSTANT: Words(
        "{at} alone has read a constant {force:.1f} N for {seconds:.0f} s or longer",
        "Does something lie there, or is the cell stuck?",
    ),
    Kind.CONTACT: Words(
        "{at} reads less than the others allow, again and again", "Is its contact bad?"
    ),
}


def place(rows: tuple[int, ...], cols: tuple[int, ...]) -> str:
    """Return the name of lines, or of cells if there are as many rows as columns."""
    if rows and cols:
        return _list([f"row {r}, column {c}" for r, c in zip(rows, cols, strict=True)])
    name, lines = ("row", rows) if rows else ("column", cols)
    if len(lines) == 1:
        return f"{name} {lines[0]}"
    return f"{name}s {_list([str(k) for k in lines])}"


def _list(names: list[str]) -> str:
    if len(names) > _NAMED:
        names = [*names[:_NAMED], f"{len(names) - _NAMED} more"]
    return " and ".join(names)


def _bits(finding: Finding) -> str:
    """Return which address bits: lines that differ in one of them only are the first and 2^bit."""
    bits = [str(k.bit_length() - 1) for k in (finding.rows or finding.cols)[1:]]
    of = f"of the {'row' if finding.rows else 'column'}s' multiplexer"
    return f"bit {bits[0]} {of} is" if len(bits) == 1 else f"bits {_list(bits)} {of} are"


def say(finding: Finding) -> str:
    """Return a finding in words."""
    seen, remedy = WORDS[finding.kind]
    text = seen.format(
        at=place(finding.rows, finding.cols),
        name="row" if finding.rows else "column",
        bits=_bits(finding),
        detail=finding.detail,
        **finding.numbers,
    )
    return f"{text}. {remedy}" if remedy else text
