"""Findings that propose another circuit or converter, in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...physics.circuit import Circuit
from ..identify import Identified
from .advice import Change
from .converter import Converter
from .findings import Finding
from .readout import Fitting

# Percent up to which an r_ref that is off is worth a word: parts are sold at 1 to 20.
_PARTS_OFF = 50.0


def polarity(level: float, change: Change, inverted: bool) -> Finding:
    """Return that readings are upside down.

    Args:
        level: usual reading [ADC steps].
        inverted: whether they are configured as falling with pressure.
    """
    return Finding(
        "polarity",
        "all readings",
        f"usually {level:.0f} of {change.circuit.full_scale} ADC steps, and touches lower them",
        f"Set {entered(change.settings(change.circuit, inverted))}: what the board prints "
        f"{'rises' if inverted else 'falls'} with pressure",
        change=change,
    )


def transposed(supposed: Circuit, change: Change, touches: int, share: float) -> Finding:
    return Finding(
        "transposed",
        "rows and columns",
        f"{touches} touches are {100 * share:.0f} % smoother if they are exchanged",
        f"Set {entered(change.settings(supposed))}; or let the sketch send row by row, not "
        "column by column",
        change=change,
    )


def _wired(circuit: Circuit) -> str:
    """A matrix as it is read, in words."""
    if circuit.readout == "floating":
        return "a floating matrix"
    return f"a {circuit.readout} matrix with driven {circuit.driven}"


def readout(supposed: Circuit, fitting: Fitting) -> Finding:
    """Return what explains the touches instead of the supposed circuit.

    Args:
        fitting: with one change or more.
    """
    changes, only = fitting.changes, len(fitting.changes) == 1
    if fitting.of_own_cells and supposed.readout != "virtual_ground":
        return _virtual_ground(fitting)
    missed = (
        f"and {_wired(supposed)}, r_par = {supposed.r_par:g} ohm, as configured, to "
        f"{fitting.supposed:.1f} times"
    )
    if only and changes[0].circuit.r_par != supposed.r_par:
        kind, only = "circuit", False
        most = changes[0].circuit.r_par
        remedy = f"r_par is {most:.0f} ohm or less: `tactile-skin calibrate` finds it by touches"
    elif only:
        kind = "bits" if changes[0].scale != 1.0 else "readout"
        settings = changes[0].settings(supposed)
        remedy = f"Set {entered(settings)}; docs/boards.md shows how to tell by the wires"
    else:
        kind, remedy = "circuit", "Compare with the board: docs/boards.md shows how to tell each"
    read = " or ".join(_read(supposed, change) for change in changes)
    return Finding(
        kind,
        "wiring of the board",
        f"the touches fit {read} to {fitting.left:.1f} times the noise, {missed}",
        remedy,
        change=changes[0] if only else None,
    )


def _virtual_ground(fitting: Fitting) -> Finding:
    return Finding(
        "readout",
        "wiring of the board",
        f"the readings along a line add up to {fitting.left:.1f} times full scale while others "
        "on it stay as they are, which no network of resistors reads: each is of its own cell",
        "If an amplifier holds each sense line at 0 V, set circuit.readout: virtual_ground and "
        "circuit.r_ref to its feedback resistor; docs/boards.md shows it",
    )


def entered(settings: dict) -> str:
    """Return settings as an owner enters them."""
    written = {name: str(value).lower() for name, value in settings.items()}
    return ", ".join(f"{name}: {value}" for name, value in written.items())


def _read(supposed: Circuit, change: Change) -> str:
    """A change, in words."""
    if change.scale != 1.0:
        (full,) = change.settings(supposed).items()
        return f"an ADC of another width ({full[0].removeprefix('circuit.')} {full[1]})"
    if change.circuit.r_par != supposed.r_par:
        return f"r_par up to {change.circuit.r_par:.0f} ohm"
    return _wired(change.circuit)


def converter(found: Converter) -> Finding:
    board, setting = found.name.upper(), f"circuit.adc_table: {found.name}"
    remedy = f"If the board is an {board}, set {setting}"
    if not found.alone:
        remedy = (
            f"Is the board an {board} ({setting}), or is the divider's supply above the ADC's "
            "reference (circuit.adc_full_scale)?"
        )
    return Finding(
        "circuit",
        "ADC",
        f"a linear ADC misses the touches by {found.supposed:.1f} times the noise, one with an "
        f"{board}'s table by {found.left:.1f}",
        f"{remedy}. docs/boards.md says which r_ref keeps readings in its straight part",
    )


def no_readout(supposed: Circuit, fitting: Fitting) -> Finding:
    read = f"the untouched readings do not fit {_wired(supposed)}"
    if np.isfinite(fitting.supposed):
        read = f"the touches miss {_wired(supposed)} by {fitting.supposed:.0f} times the noise"
    return Finding(
        "circuit",
        "wiring of the board",
        f"no readout explains the readings: with r_par = {supposed.r_par:g} ohm {read}, and no "
        "other readout comes near",
        "Check circuit.r_par, r_ref, readout and driven, adc_bits, adc_full_scale, inverted, "
        "serial_driver.format.full_scale, and whether the lines are driven through diodes "
        "(circuit.diode): docs/boards.md shows how to find each",
    )


def circuit(supposed: Circuit, found: Identified) -> Finding:
    r_par = found.circuit.r_par
    off = 100.0 * (supposed.r_par / r_par - 1.0) if r_par > 0.0 else np.inf
    alike = "A"
    if abs(off) < _PARTS_OFF:
        alike = f"r_ref off by {off:+.0f} %, or a"
    return Finding(
        "circuit",
        "r_par, r_ref or supply",
        f"{found.frames} frames of touches fit r_par = {r_par:.0f} +- "
        f"{found.std['r_par']:.1f} ohm, not {supposed.r_par:g}. {alike} divider's supply that is "
        "not the ADC's reference reads the same",
        "Measure the reference resistor, the supply and the ADC's reference; what is left is r_par",
    )


def diode(share: float) -> Finding:
    """Args:
    share: of the supply, that it takes.
    """
    return Finding(
        "circuit",
        "diode",
        f"with a diode in each driven line that takes {share:.1%} of the supply ({5.0 * share:.2f} "
        f"of 5 V, {3.3 * share:.2f} of 3.3 V) the touches agree; without it each asks for another "
        "r_par",
        "Look for diodes in the driven lines; enter circuit.diode, the forward voltage at 1 mA of "
        "their data sheet, and circuit.supply",
    )


def drivers(supposed: Circuit, found: Identified) -> Finding:
    r_drive = found.circuit.r_drive
    return Finding(
        "circuit",
        "r_drive",
        f"{found.frames} frames of touches fit r_drive = {r_drive:.1f} +- "
        f"{found.std['r_drive']:.1f} ohm, not {supposed.r_drive:g}",
        f"Set circuit.r_drive: {r_drive:.1f}. The drivers have so much; with a wrong value hard "
        "touches are felt too weak or too strong",
        change=Change(replace(supposed, r_drive=r_drive)),
    )
