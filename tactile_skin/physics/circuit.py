# SPDX-License-Identifier: Apache-2.0
"""The resistor matrix and its read-out: what the ADC sees for given cell resistances.

A skin of ``rows x cols`` cells is a bipartite resistor network: one node per stripe, one resistor
(the taxel) where a row stripe crosses a column stripe. The paper's read-out connects one row and
one column and lets every other line float, so it sees the *two-terminal resistance* between the two
stripes, not the taxel alone: that is the cross-talk. readouts/ has this and the others.

All readings of a frame follow from one small inverse (laplacian.py, docs/derivation.md). The
paper (section IV-B) solves one system of ``rows*cols + 1`` equations per reading instead; it stands
in the tests as the oracle.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from . import readouts
from .arrays import Bools, Floats, Value, frozen
from .laplacian import connected


@dataclass(frozen=True, eq=False)
class Circuit:
    """The read-out circuit of one skin (paper section III-B); the defaults are the paper's.

    Args:
        rows, cols: number of row and column stripes.
        r_ref: reference resistor of the voltage divider [ohm].
        r_par: parasitic series resistance of the multiplexers [ohm].
        adc_bits: width of the ADC; full scale reads ``2**adc_bits - 1``.
        mask: (rows, cols) bool, which crossings carry a cell; None: all of them.
        r_line: resistance of a stripe from its lead to its far end [ohm]: one for all, or rows +
            cols of them, the rows' first. Rows are led out beside column 0, columns above row 0.
            Of the floating readout only.
        readout: "floating" (one row is driven, one column read, all others are open), "loaded"
            (each column has its own r_ref, the other rows are open; r_par is that of the driver) or
            "grounded" (the same, the other rows are at 0 V; r_par lies before r_ref), or
            "virtual_ground" (an amplifier holds each column at 0 V; r_ref is its feedback resistor,
            r_par lies in series with each cell).
        driven: "rows", or "columns" where these are driven and the rows are read.
        r_drive: resistance of what holds each driven line at its level [ohm]. Of the grounded
            readout only.

    Raises:
        ValueError: a size, resistance or width outside its range, a mask of another shape, or one
            that falls into parts with no cell between them (their cells could not be told apart);
            an unknown readout, or one with an r_line or r_drive that it does not model.
    """

    rows: int = 16
    cols: int = 16
    r_ref: float = 1780.0
    r_par: float = 326.0
    adc_bits: int = 10
    mask: Bools | None = field(default=None, repr=False)
    r_line: float | Floats = 0.0
    readout: str = "floating"
    driven: str = "rows"
    r_drive: float = 0.0

    def __post_init__(self) -> None:
        for choice, allowed in (("readout", readouts.READOUTS), ("driven", readouts.DRIVEN)):
            if getattr(self, choice) not in allowed:
                raise ValueError(
                    f"{choice} = {getattr(self, choice)!r}: must be one of {', '.join(allowed)}"
                )
        for name, low, high in (("rows", 1, 255), ("cols", 1, 255), ("adc_bits", 1, 16)):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or not low <= value <= high:
                raise ValueError(f"{name} = {value!r}: must be a whole number from {low} to {high}")
        for name, least in (("r_ref", "above 0"), ("r_par", "0 or more"), ("r_drive", "0 or more")):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0 or (value == 0 and name == "r_ref"):
                raise ValueError(f"{name} = {value!r} ohm: must be finite and {least}")
            object.__setattr__(self, name, float(value))
        object.__setattr__(self, "r_line", self._checked_r_line())
        if not self.readout_class.knows_r_drive and self.r_drive:
            raise ValueError(
                f"r_drive = {self.r_drive!r} ohm: must be 0 for readout = {self.readout!r}, where "
                "the driver's resistance is part of r_par"
            )
        if self.mask is not None:
            object.__setattr__(self, "mask", self._checked_mask(self.mask))

    def _checked_r_line(self) -> float | Floats:
        """Return r_line [ohm] as a float or read-only (rows + cols,); ValueError if it is bad."""
        r_line = np.array(self.r_line, dtype=float)
        if r_line.shape not in ((), (self.rows + self.cols,)):
            raise ValueError(
                f"r_line has shape {r_line.shape}: must be a number or rows + cols = "
                f"{self.rows + self.cols} of them"
            )
        if not (np.isfinite(r_line) & (r_line >= 0.0)).all():
            raise ValueError(f"r_line = {self.r_line!r} ohm: must be finite and 0 or more")
        if not self.readout_class.knows_r_line and r_line.any():
            raise ValueError(
                f"r_line = {self.r_line!r} ohm: must be 0 for readout = {self.readout!r}, whose "
                "stripes are taken as ideal"
            )
        return frozen(r_line) if r_line.ndim else float(r_line)

    def _checked_mask(self, given: Bools) -> Bools | None:
        """Return the mask (rows, cols), read-only, None if it is full; ValueError if it is bad."""
        mask = np.array(given, dtype=bool)
        if mask.shape != self.shape:
            raise ValueError(f"mask has shape {mask.shape}: the circuit is {self.shape}")
        if not connected(mask[None])[0]:
            raise ValueError("mask: the cells must connect all rows and columns to one another")
        mask.setflags(write=False)
        return None if mask.all() else mask

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.cols

    @cached_property
    def populated(self) -> np.ndarray:
        """(rows, cols) bool, which crossings carry a cell; read-only."""
        if self.mask is not None:
            return self.mask
        return frozen(np.ones(self.shape, bool))

    @cached_property
    def stripes(self) -> tuple[Floats, Floats] | None:
        """(rows,) and (cols,) resistance of the stripes [ohm]; None: they have none."""
        if not np.any(self.r_line):
            return None
        r_line = np.broadcast_to(self.r_line, self.rows + self.cols)
        return r_line[: self.rows], r_line[self.rows :]

    @property
    def readout_class(self) -> type[readouts.Readout]:
        """What the readout is: all that differs between readouts."""
        return readouts.BY_NAME[self.readout]

    @property
    def sense_axis(self) -> int:
        """Axis of (rows, cols) along which the cells of one sense line lie."""
        return 0 if self.driven == "rows" else 1

    @property
    def has_ideal_drivers(self) -> bool:
        """Whether it is grounded so that each sense line's cells follow from its own readings."""
        return self.readout_class.knows_r_drive and not self.r_drive

    @property
    def has_cross_talk(self) -> bool:
        """Whether a reading depends on other cells than its own."""
        return self.readout_class.has_cross_talk

    def read_as(self, readout: str, driven: str) -> Circuit:
        """Return the same without what that readout does not model."""
        r_drive = self.r_drive if readouts.BY_NAME[readout].knows_r_drive else 0.0
        return replace(self, readout=readout, driven=driven, r_line=0.0, r_drive=r_drive)

    @property
    def full_scale(self) -> int:
        """Reading of the ADC at its reference voltage, in ADC steps."""
        return (1 << self.adc_bits) - 1

    def ratio(self, rho: Value) -> Value:
        """Two-terminal resistance [ohm] -> ADC ratio in [0, 1] (voltage divider, or amplifier)."""
        return self.readout_class.ratio(self, rho)

    @property
    def near_short(self) -> float:
        """ADC ratio a step below that of a short circuit: what reads more may bear any force."""
        return float(self.ratio(0.0)) - 1.0 / self.full_scale

    def two_terminal(self, adc: Floats) -> Floats:
        """ADC ratio -> two-terminal resistance [ohm], the inverse of `ratio`; never negative."""
        with np.errstate(divide="ignore"):
            return np.maximum(self.r_ref / adc - self.readout_class.in_series(self), 0.0)

    def describe(self) -> dict[str, Any]:
        """Return the circuit as plain numbers and strings, as it is kept beside trained weights."""
        mask = None if self.mask is None else ["".join("01"[int(c)] for c in r) for r in self.mask]
        return {
            "rows": int(self.rows),
            "cols": int(self.cols),
            "r_ref": self.r_ref,
            "r_par": self.r_par,
            "adc_bits": int(self.adc_bits),
            "mask": mask,
            "r_line": np.asarray(self.r_line).tolist(),
            "readout": self.readout,
            "driven": self.driven,
            "r_drive": self.r_drive,
        }

    @cached_property
    def _key(self) -> str:  # compared for each frame, by what is kept of a circuit
        return repr(self.describe())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Circuit) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def circuit_from(description: dict[str, Any]) -> Circuit:
    """Return the circuit of a `Circuit.describe()`; ValueError: a wrong key, or as `Circuit`."""
    # weights of old have none of these
    of_old: dict[str, Any] = {"r_line": 0.0, "readout": "floating", "driven": "rows"}
    description = of_old | {"r_drive": 0.0} | description
    if (wanted := Circuit().describe().keys()) != description.keys():
        raise ValueError(f"circuit has {', '.join(description)}: must be {', '.join(wanted)}")
    mask = description["mask"]
    cells = None if mask is None else np.array([[c == "1" for c in row] for row in mask])
    return Circuit(**description | {"mask": cells})


def forward(circuit: Circuit, resistance: npt.ArrayLike) -> Floats:
    """Return what the board reads, not quantised.

    Args:
        resistance: (..., rows, cols) resistance of each cell [ohm], above 0; infinity is an open
            cell. Where the circuit's mask says that there is no cell, the value is ignored.

    Returns:
        (..., rows, cols) ADC ratio in [0, 1]; where r_ref pulls up, 1 minus what the ADC reads. A
        crossing with no cell is read like any other, through its neighbours; 0 where no path
        connects the two lines.

    Raises:
        ValueError: wrong shape, NaN, or a resistance that is not above 0.
    """
    ohm = np.asarray(resistance, dtype=float)
    if ohm.shape[-2:] != circuit.shape:
        raise ValueError(
            f"resistance has shape {ohm.shape}: it must end in {circuit.shape} (rows, cols)"
        )
    if circuit.mask is not None:
        ohm = np.where(circuit.mask, ohm, np.inf)
    if not (ohm > 0).all():
        bad = ohm[~(ohm > 0)].flat[0]
        raise ValueError(f"resistance of {bad} ohm: every cell's must be above 0")
    frames = (1.0 / ohm).reshape(-1, *circuit.shape)
    return circuit.readout_class.read(circuit, frames).reshape(ohm.shape)
