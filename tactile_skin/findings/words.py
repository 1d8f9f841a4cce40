"""All words: where each finding is, what shows it and what to do. Their order is the one in which
findings are said; docs/troubleshooting.md is made of them.
"""

from __future__ import annotations

from typing import NamedTuple


class Words(NamedTuple):
    """Templates: {at} is the lines or cells, {line} "row" or "column", {detail} and the numbers are
    the finding's.
    """

    where: str
    evidence: str
    remedy: str


_MEASURE_LEAD = "from the multiplexer's pin to the stripe must be some ohm"
_SEND = "Send what the ADC reads; until then nothing else is told by these readings"
_NO_REST = "no rest is measured"

WORDS = {  # (kind, form): words
    # --- what the board sends ---
    ("no picture", ""): Words("", "{detail}", ""),
    ("zeros", ""): Words("all readings", "{detail}", _SEND),
    ("zeros", "at an end"): Words(
        "all readings",
        "{share:.0%} are exactly {steps:.0f}: these are not what an ADC reads. The board, or what "
        "recorded it, takes off an offset or a threshold, or the untouched fabric conducts too "
        "little for r_ref",
        _SEND,
    ),
    ("zeros", "cells"): Words(
        "",
        f"{{count:.0f}} untouched cells read 0: {_NO_REST}",
        "Does the sketch subtract an offset or a threshold, or is r_ref too small for the ADC? "
        "Send what the ADC reads",
    ),
    ("loaded", "since the start"): Words(
        "",
        "the skin has been loaded since the start, most at {at}",
        "Unload it, so that its rest can be measured",
    ),
    ("loaded", "risen"): Words(
        "",
        f"{{count:.0f}} readings have risen since the start, most at {{at}}: {_NO_REST}",
        "Does something press there? If nothing does, tare",
    ),
    ("no signal", ""): Words(
        "all readings",
        "one voltage, {steps:.0f} ADC steps, but for noise",
        "Is the matrix connected?",
    ),
    ("no signal", "offset"): Words(
        "all readings",
        "one voltage, {steps:.1f} ADC steps, but for noise",
        "Is an offset or a threshold taken off, or is no matrix connected?",
    ),
    ("no signal", "throughout"): Words(
        "all readings",
        "{steps:.1f} ADC steps throughout, within {moves:.1f}",
        "Is the matrix connected, supplied, and was it touched? Measure the ADC's input",
    ),
    ("polarity", ""): Words(
        "all readings",
        "usually {steps:.0f} of {full:.0f} ADC steps, and touches lower them",
        "Set {detail} with pressure",
    ),
    ("bits", "shift"): Words(
        "all readings",
        "{steps:+.0f} ADC steps beside their rest, to the noise",
        "Is a bit of the ADC stuck?",
    ),
    ("bits", "gap"): Words(
        "ADC bit {bit:.0f}",
        "always {kept:.0f}: readings with the other value are {share:.2f} times as frequent as "
        "those beside them",
        "Check how the two bytes of a sample are put together, the ADC's data line, and adc_bits",
    ),
    ("bits", "leaps"): Words(
        "ADC bit {bit:.0f}",
        "always {kept:.0f}: untouched cells have up to {noise:.1f} ADC steps RMS of noise, the "
        "more the further they are from a multiple of {width:.0f}: their samples leap by as much",
        "Check how the two bytes of a sample are put together, the ADC's data line, and adc_bits",
    ),
    ("saturation", "live"): Words(
        "",
        "readings end at {steps:.0f} ADC steps and stay there while others change",
        "Is the input saturated, or does an amplifier or the sketch limit them?",
    ),
    ("saturation", ""): Words(
        "ADC",
        "{count:.0f} readings of {cells:.0f} cells end at {steps:.0f} ADC steps (a short circuit "
        "reads {most:.0f})",
        "Measure the ADC's reference and the amplifier's supply; compare them with the matrix'",
    ),
    # --- lines in another's place ---
    ("swapped", "live"): Words(
        "{at}",
        "reads at rest as {line} {other:.0f} did, cell for cell",
        "Does the multiplexer select another line, or were leads exchanged?",
    ),
    ("doubled", "address bits"): Words(
        "address {bits} of the {line}s",
        "stuck, or not connected: {at} read the same, cell for cell, and so do all such lines",
        "Measure these address pins of the multiplexer while the board scans",
    ),
    ("transposed", ""): Words(
        "rows and columns",
        "{touches:.0f} touches are {share:.0%} smoother if they are exchanged",
        "Set {detail}; or let the sketch send row by row, not column by column",
    ),
    ("shifted", ""): Words(
        "all samples",
        "one place late: {touches:.0f} touches are {share:.0%} smoother if each frame begins one "
        "sample later",
        "Check where the sketch, or the program that reads it, begins a frame",
    ),
    ("swapped", ""): Words(
        "{at}",
        "{touches:.0f} touches are {share:.0%} smoother if they are exchanged",
        "Press along them: if the touch jumps, exchange the two leads, or `{line}s` in the sketch",
    ),
    # --- the circuit ---
    ("misfit", ""): Words("", "{detail}", ""),
    ("misfit", "kept"): Words("", "{detail}", ""),
    ("all cells", ""): Words(
        "",
        "all cells conduct {share:+.1%} at once",
        "Did the supply, the reference or r_par change, or does something lie on all of the skin, "
        "or was it taken off?",
    ),
    ("circuit", "live"): Words("", "{detail}", ""),
    ("saturation", "range"): Words(
        "",
        "{count:.0f} readings at the end of the ADC's range: more force there is not felt",
        "A smaller r_ref leaves room",
    ),
    ("readout", ""): Words(
        "wiring of the board",
        "{detail}, as configured, to {supposed:.1f} times",
        "Set {settings}; docs/boards.md shows how to tell by the wires",
    ),
    ("bits", "width"): Words(
        "wiring of the board",
        "{detail}, as configured, to {supposed:.1f} times",
        "Set {settings}; docs/boards.md shows how to tell by the wires",
    ),
    ("circuit", "one of"): Words(
        "wiring of the board",
        "{detail}, as configured, to {supposed:.1f} times",
        "Compare with the board: docs/boards.md shows how to tell each",
    ),
    ("circuit", "r_par at most"): Words(
        "wiring of the board",
        "{detail}, as configured, to {supposed:.1f} times",
        "r_par is {r_par:.0f} ohm or less: `tactile-skin calibrate` finds it by touches",
    ),
    ("readout", "virtual ground"): Words(
        "wiring of the board",
        "the readings along a line add up to {left:.1f} times full scale while others on it stay "
        "as they are, which no network of resistors reads: each is of its own cell",
        "If an amplifier holds each sense line at 0 V, set circuit.readout: virtual_ground and "
        "circuit.r_ref to its feedback resistor; docs/boards.md shows it",
    ),
    ("circuit", "none fits"): Words(
        "wiring of the board",
        "no readout explains the readings: with r_par = {r_par:g} ohm {detail}, and no other "
        "readout comes near",
        "Check circuit.r_par, r_ref, readout and driven, adc_bits, adc_full_scale, inverted, "
        "serial_driver.format.full_scale, and whether the lines are driven through diodes "
        "(circuit.diode): docs/boards.md shows how to find each",
    ),
    ("circuit", "adc"): Words(
        "ADC",
        "a linear ADC misses the touches by {supposed:.1f} times the noise, one with the table "
        "{detail} by {left:.1f}",
        "If the board has that ADC, set circuit.adc_table: {detail}. docs/boards.md says which "
        "r_ref keeps readings in its straight part",
    ),
    ("circuit", "adc or supply"): Words(
        "ADC",
        "a linear ADC misses the touches by {supposed:.1f} times the noise, one with the table "
        "{detail} by {left:.1f}",
        "Has the board that ADC (circuit.adc_table: {detail}), or is the divider's supply above "
        "the ADC's reference (circuit.adc_full_scale)? docs/boards.md says which r_ref keeps "
        "readings in its straight part",
    ),
    ("circuit", "r_par"): Words(
        "r_par, r_ref or supply",
        "{frames:.0f} frames of touches fit r_par = {r_par:.0f} +- {std:.1f} ohm, not "
        "{supposed:g}. {detail} divider's supply that is not the ADC's reference reads the same",
        "Measure the reference resistor, the supply and the ADC's reference; what is left is r_par",
    ),
    ("circuit", "r_drive"): Words(
        "r_drive",
        "{frames:.0f} frames of touches fit r_drive = {r_drive:.1f} +- {std:.1f} ohm, not "
        "{supposed:g}",
        "Set circuit.r_drive: {r_drive:.1f}. The drivers have so much; with a wrong value hard "
        "touches are felt too weak or too strong",
    ),
    ("circuit", "diode"): Words(
        "diode",
        "with a diode in each driven line that takes {share:.1%} of the supply ({of_5:.2f} of 5 V, "
        "{of_3:.2f} of 3.3 V) the touches agree; without it each asks for another r_par",
        "Look for diodes in the driven lines; enter circuit.diode, the forward voltage at 1 mA of "
        "their data sheet, and circuit.supply",
    ),
    # --- the rest ---
    ("unsteady", ""): Words(
        "",
        f"the readings wander from second to second: {_NO_REST}",
        "Does something touch the skin, or is the supply unsteady?",
    ),
    ("fabric", "none"): Words(
        "", f"{{detail}}: {_NO_REST}", "Is it wired, or read, as it is configured?"
    ),
    ("fabric", ""): Words(
        "",
        f"a cell has {{ohm:.0f}} ohm at rest, where the curve begins with {{expected:.0f}}: "
        f"{_NO_REST}",
        "Is it loaded, another fabric, or wired otherwise?",
    ),
    ("stuck", "rest"): Words(
        "{at}",
        f"conducts {{times:.2g}} times as much as the median cell: {_NO_REST}",
        "Does something press there?",
    ),
    ("dead", "rest"): Words(
        "{at}",
        f"conducts {{times:.2g}} times as much as the median cell: {_NO_REST}",
        "Is it connected?",
    ),
    ("lead", "rest"): Words(
        "{at}",
        f"conducts {{share:+.0%}} at rest, compared with the others: {_NO_REST}",
        "Is its lead bad?",
    ),
    ("lead", "fading"): Words(
        "{at}", "conducts {share:+.0%} compared with the start", "Is its lead breaking?"
    ),
    ("too little seen", "moves"): Words(
        "rest",
        "{count:.0f} of {cells:.0f} cells move while least touches the skin: it was never left "
        "alone",
        "Nothing else is judged without a rest: leave the skin alone for a third of the time and "
        "press everywhere between, or give rest:=FILE of the untouched skin",
    ),
    ("too little seen", "lies"): Words(
        "rest",
        "something lies on {count:.0f} cells in all frames, about {at}",
        "Nothing else is judged without a rest: take off what lies there, leave the skin alone "
        "for a third of the time and press everywhere between, or give rest:=FILE of the untouched "
        "skin",
    ),
    # --- lines ---
    ("open", ""): Words(
        "{at}",
        "open: none of its {count:.0f} readings exceeds {most:.0f} counts (an untouched cell reads "
        "{usual:.0f})",
        f"Check its lead: the resistance {_MEASURE_LEAD}",
    ),
    ("contact", "line"): Words(
        "{at}",
        "comes and goes: all its readings drop together in {share:.0%} of the frames",
        "Move its lead while you measure its resistance; press the connector on",
    ),
    ("noisy", "line"): Words(
        "{at}",
        "{noise:.1f} ADC steps RMS of noise on all its readings (usual: {usual:.1f})",
        "Check its lead's screen and ground, and what runs beside it",
    ),
    ("noisy", "cell"): Words(
        "{at}",
        "{noise:.1f} ADC steps RMS of noise while nothing touches (usual: {usual:.1f})",
        "Check the contact between stripe and fabric there",
    ),
    ("short", "lines"): Words(
        "{at}",
        "shorted: they read alike in all frames, and conduct at rest like stripes that touch",
        "Measure between their leads with the board disconnected: look for a bridge of solder or "
        "conductive thread",
    ),
    ("doubled", "address bit"): Words(
        "address bit {bit:.0f} of the {line}s",
        "stuck: {detail} read alike",
        "Measure this address pin of the multiplexer while the board scans",
    ),
    ("doubled", ""): Words(
        "{at}",
        "one stripe is read by both: they read alike in all frames, but do not conduct at rest "
        "like two that touch",
        "Check the addresses that the sketch selects, the multiplexer's clock or address pins, and "
        "the wiring behind the first of them",
    ),
    ("doubled", "live"): Words(
        "{at}",
        "read the same, cell for cell",
        "Does the multiplexer select one line twice, or are they shorted?",
    ),
    ("lead", ""): Words(
        "{at}",
        "all its readings lack what {ohm:.0f} +- {std:.0f} ohm in series take from them",
        f"Measure its lead: {_MEASURE_LEAD}",
    ),
    ("resistor", ""): Words(
        "{at}",
        "reads as if its reference resistor has {ohm:.0f} ohm, not {supposed:g}",
        "Measure between this line and ground, or the supply where it pulls up, with the matrix "
        "unplugged; solder the resistor anew",
    ),
    ("resistor", "missing"): Words(
        "{at}",
        "reads as if its reference resistor is missing",
        "Measure between this line and ground, or the supply where it pulls up, with the matrix "
        "unplugged; solder the resistor anew",
    ),
    ("broken", ""): Words(
        "{at}",
        "broken before {across} {before:.0f}: from there on it conducts through the fabric only",
        "Measure along the stripe, between {across} {last:.0f} and {across} {before:.0f}",
    ),
    # --- cells ---
    ("dead", ""): Words(
        "{at}",
        "conducts nothing (an untouched cell has {usual:.0f} ohm)",
        "Check that stripes and fabric touch there{detail}",
    ),
    ("short", "cell"): Words(
        "{at}",
        "shorted: the crossing has {ohm:.0f} ohm while nothing touches (an untouched cell has "
        "{usual:.0f})",
        "Look for a hole in the fabric, or a wire that touches both stripes",
    ),
    ("stuck", "at the end"): Words(
        "{at}",
        "the cell has {ohm:.0f} ohm or less while nothing touches (an untouched cell has "
        "{usual:.0f}): the readings end there",
        "It is shorted, or something presses there: look for a hole in the fabric, or a wire that "
        "touches both stripes, and at the seam and the cover",
    ),
    ("stuck", ""): Words(
        "{at}",
        "the cell has {ohm:.0f} ohm while nothing touches (an untouched cell has {usual:.0f})",
        "Does something press there? Look at the seam, the cover and the fabric",
    ),
    ("noisy", "live"): Words("{at}", "much noisier than the other cells", "Is a contact loose?"),
    ("contact", "jumps"): Words(
        "{at}", "jumps between high and low force", "Is its contact loose?"
    ),
    ("stuck", "constant"): Words(
        "{at}",
        "alone has read a constant {force:.1f} N for {seconds:.0f} s or longer",
        "Does something lie there, or is the cell stuck?",
    ),
    ("contact", "set aside"): Words(
        "{at}", "reads less than the others allow, again and again", "Is its contact bad?"
    ),
}
