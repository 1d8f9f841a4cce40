"""Findings that propose another circuit or converter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...calibration.identify import Identified
from ...findings.finding import Finding, Kind
from ...physics.circuit import Circuit
from .advice import Change
from .converter import Converter
from .readout import Fitting

# Percent up to which an r_ref that is off is worth a word: parts are sold at 1 to 20.
_PARTS_OFF = 50.0
_NONE = 5.0  # ohm: touches that ask for less than any driver has may be read on another scale


def polarity(level: float, change: Change, inverted: bool) -> Finding:
    """Return that readings are upside down.

    Args:
        level: usual reading [ADC steps].
        inverted: whether they are configured as falling with pressure.
    """
    entry = entered(change.settings(change.circuit, inverted))
    detail = f"{entry}: what the board prints {'rises' if inverted else 'falls'}"
    numbers = {"steps": level, "full": change.circuit.full_scale}
    return Finding(Kind.POLARITY, numbers=numbers, detail=detail, change=change)


def transposed(supposed: Circuit, change: Change, touches: int, share: float) -> Finding:
    """Return that rows and columns are exchanged."""
    numbers = {"touches": touches, "share": share}
    detail = entered(change.settings(supposed))
    return Finding(Kind.TRANSPOSED, numbers=numbers, detail=detail, change=change)


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
        return Finding(Kind.READOUT, "virtual ground", numbers={"left": fitting.left})
    numbers: dict[str, float | str] = {"supposed": fitting.supposed}
    kind, form = Kind.CIRCUIT, "one of"
    if only and changes[0].circuit.r_par != supposed.r_par:
        most, only = changes[0].circuit.r_par, False
        form = "r_par at most" if most > _NONE else "r_par 0 or scale"
        numbers["r_par"] = most
    elif only:
        scaled = changes[0].scale != 1.0
        kind, form = (Kind.BITS, "width") if scaled else (Kind.READOUT, "")
        numbers["settings"] = entered(changes[0].settings(supposed))
    read = " or ".join(_read(supposed, change) for change in changes)
    detail = (
        f"the touches fit {read} to {fitting.left:.1f} times the noise, and {_wired(supposed)}, "
        f"r_par = {supposed.r_par:g} ohm"
    )
    change = changes[0] if only else None
    return Finding(kind, form, numbers=numbers, detail=detail, change=change)


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
    """Return that the touches are those of an ADC whose table is known."""
    numbers = {"supposed": found.supposed, "left": found.left}
    form = "adc" if found.alone else "adc or supply"
    return Finding(Kind.CIRCUIT, form, numbers=numbers, detail=found.name)


def no_readout(supposed: Circuit, fitting: Fitting) -> Finding:
    """Return that no readout explains the touches."""
    read = f"the untouched readings do not fit {_wired(supposed)}"
    if np.isfinite(fitting.supposed):
        read = f"the touches miss {_wired(supposed)} by {fitting.supposed:.0f} times the noise"
    return Finding(Kind.CIRCUIT, "none fits", numbers={"r_par": supposed.r_par}, detail=read)


def circuit(supposed: Circuit, found: Identified) -> Finding:
    """Return that touches fit another r_par, or what reads the same."""
    r_par = found.circuit.r_par
    off = 100.0 * (supposed.r_par / r_par - 1.0) if r_par > 0.0 else np.inf
    alike = f"r_ref off by {off:+.0f} %, or a" if abs(off) < _PARTS_OFF else "A"
    numbers = {
        "frames": found.frames,
        "r_par": r_par,
        "std": found.std["r_par"],
        "supposed": supposed.r_par,
    }
    return Finding(Kind.CIRCUIT, "r_par", numbers=numbers, detail=alike)


def diode(share: float) -> Finding:
    """Return that lines are driven through diodes that take this share of the supply."""
    numbers = {"share": share, "of_5": 5.0 * share, "of_3": 3.3 * share}
    return Finding(Kind.CIRCUIT, "diode", numbers=numbers)


def drivers(supposed: Circuit, found: Identified) -> Finding:
    """Return that the drivers have another resistance."""
    r_drive = found.circuit.r_drive
    numbers = {
        "frames": found.frames,
        "r_drive": r_drive,
        "std": found.std["r_drive"],
        "supposed": supposed.r_drive,
    }
    change = Change(replace(supposed, r_drive=r_drive))
    return Finding(Kind.CIRCUIT, "r_drive", numbers=numbers, change=change)
