# SPDX-License-Identifier: Apache-2.0
"""The parameters that several nodes must agree on; a file holds them under /**."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np

from ..board.protocol import MAX_LINES
from ..fields import group, parameter
from ..physics.adc import TABLES
from ..physics.circuit import Circuit as _Circuit
from ..physics.creep import LEAST_TIME, MAX_SHARE
from ..physics.curve import PressureCurve
from ..physics.proof import NOTHING, PROOFS
from ..physics.readouts import DRIVEN, READOUTS
from ..touch.geometry import CELL_AREA, PITCH, SHAPES, UNKNOWN

# Its default arguments; to make one takes an import of 0.2 s.
_CURVE = {
    name: np.array(argument.default, float).tolist()
    for name, argument in inspect.signature(PressureCurve).parameters.items()
}


@dataclasses.dataclass(frozen=True)
class Circuit:
    """The board: docs/boards.md shows what yours is."""

    rows: int = parameter(
        _Circuit.rows, "", "stripes in one direction; a frame is sent row by row", 1, MAX_LINES
    )
    cols: int = parameter(_Circuit.cols, "", "stripes in the other direction", 1, MAX_LINES)
    r_ref: float = parameter(
        _Circuit.r_ref, "ohm", "reference resistor of the voltage divider", 1.0, 1e7
    )
    r_par: float = parameter(
        _Circuit.r_par,
        "ohm",
        "in series with the cells; floating: both multiplexers, loaded: the driver, grounded: "
        "before r_ref",
        0.0,
        1e6,
    )
    r_par_std: float = parameter(
        0.0, "ohm", "how well r_par is known, by calibrate; 0: nobody has measured it", 0.0, 1e6
    )
    r_line: float = parameter(
        0.0, "ohm", "resistance of a stripe, from its lead to its far end", 0.0, 1e4
    )
    readout: str = parameter(
        _Circuit.readout, "", "docs/boards.md shows which one you have", choices=READOUTS
    )
    driven: str = parameter(
        _Circuit.driven, "", "the lines that are driven one by one; not if floating", choices=DRIVEN
    )
    r_drive: float = parameter(
        _Circuit.r_drive,
        "ohm",
        "grounded: resistance of what holds each driven line at its level",
        0.0,
        1e4,
    )
    adc_bits: int = parameter(
        _Circuit.adc_bits, "", "resolution of a reading; full scale is 2^adc_bits - 1", 4, 16
    )
    mask: str = parameter(
        "", "", "cells that exist: a word of 0 and 1 per row; edges may be empty; empty: all cells"
    )
    row_order: str = parameter(
        "",
        "",
        'the board\'s rows, in the order in which they lie on the skin: "0 2 1 3"; empty: as they '
        "are sent. mask and scanned are of the skin",
    )
    column_order: str = parameter("", "", "the same of the columns")
    scanned: str = parameter("", "", "crossings that the board reads, in the same form; empty: all")
    adc_offset: float = parameter(
        0.0, "ADC steps", "what the ADC reads too low; negative: too high", -65535.0, 65535.0
    )
    adc_full_scale: float = parameter(
        0.0, "ADC steps", "reading of the divider's supply; 0: 2^adc_bits - 1", 0.0, 1e6
    )
    adc_table: str = parameter(
        "",
        "",
        f"curve of an ADC that is not linear: {', '.join(TABLES)}, or a list (docs/boards.md); "
        "empty: linear",
        any_type=True,
    )
    inverted: bool = parameter(False, "", "readings fall with pressure")
    diode: float = parameter(
        0.0,
        "V",
        "forward voltage at 1 mA of a diode in each driven line; 0: none; not if grounded",
        0.0,
        5.0,
    )
    supply: float = parameter(
        5.0, "V", "voltage of the driven line; only a diode needs it", 1.0, 24.0
    )


@dataclasses.dataclass(frozen=True)
class Curve:
    """Force on one cell -> its resistance; measure your own fabric."""

    force: list[float] = parameter(
        _CURVE["force"], "N", "on one cell; 0, 5, 10, 20, 50, 100, 200, 500 and 1000 g of load"
    )
    resistance: list[float] = parameter(_CURVE["resistance"], "ohm", "of the cell at these forces")
    gain: list[float] = parameter(
        [1.0], "", "each cell's force over the curve's, row by row; one number: of all"
    )
    creep: float = parameter(
        0.0,
        "",
        "share that a standing load gains in a decade of time, by calibrate --creep; 0: not taken "
        "out",
        0.0,
        MAX_SHARE,
    )
    creep_time: float = parameter(
        1.0, "s", "after which creep begins, by calibrate --creep", LEAST_TIME, 10.0
    )
    proof: str = parameter(
        NOTHING,
        "",
        "what showed that newtons are right, by calibrate; none: the stop comes early",
        choices=PROOFS,
    )
    proof_error: float = parameter(
        0.1, "", "relative standard deviation of a contact force when it was proved", 0.0, 1.0
    )
    proof_date: str = parameter("", "", "the day of the proof, as 2026-11-28; empty: unknown")


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Where the cells are."""

    shape: str = parameter(
        UNKNOWN,
        "",
        "a cylinder stands upright, columns around it; unknown: pushes have no direction",
        choices=SHAPES,
    )
    pitch: float = parameter(
        PITCH, "m", "between neighbouring cells; 12 mm stripes, 6 mm gaps", 1e-4, 1.0
    )
    cell_area: float = parameter(CELL_AREA, "m^2", "sensing area of one cell", 1e-8, 1.0)
    radius: float = parameter(0.15, "m", "of the cylinder or sphere", 1e-3, 100.0)
    translation: list[float] = parameter(
        [0.0, 0.0, 0.0], "m", "of the skin frame in the base frame"
    )
    rpy: list[float] = parameter(
        [0.0, 0.0, 0.0], "rad", "roll, pitch, yaw of the skin frame in the base frame"
    )
    table: str = parameter(
        "", "", "for shape: table, a CSV file: row,col,x,y,z,nx,ny,nz[,area] (docs/touch.md)"
    )


@dataclasses.dataclass(frozen=True)
class Framed:
    """Nodes whose messages are in a frame."""

    frame_id: str = parameter(
        "base_link", "", "frame of all positions, directions, forces and velocities"
    )


@dataclasses.dataclass(frozen=True)
class SkinDescription:
    """What a skin is."""

    circuit: Circuit = group(Circuit)
    curve: Curve = group(Curve)
    geometry: Geometry = group(Geometry)


@dataclasses.dataclass(frozen=True)
class Shared(SkinDescription, Framed):
    """What several nodes must agree on."""
