"""Parameters of the nodes as the things that the pure modules work with, and ROS 2 YAML files."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import ParameterError
from ..physics.adc import TABLES, Adc
from ..physics.circuit import Circuit
from ..physics.creep import MAX_SHARE, Creep
from ..physics.curve import PressureCurve
from ..physics.readouts import DRIVEN, READOUTS
from ..touch.geometry import CELL_AREA, PITCH, SHAPES, UNKNOWN, Geometry, make_geometry
from .bus import (
    Context,
    FloatingPointRange,
    IntegerRange,
    Node,
    Parameter,
    ParameterDescriptor,
)
from .parameter_file import SHARED, ParameterFile, unknown_parameter


class _Skin(NamedTuple):
    circuit: Circuit
    curve: PressureCurve
    geometry: Geometry


class SkinConfig(_Skin):
    """What a parameter file says of the skin itself: circuit, curve, geometry = read_skin(...).

    Attributes:
        adc: from the board's counts to the ratio that the solvers take: `adc.ratio(counts)`.
        creep: what a standing load gains.
        r_par_std: how well the circuit's r_par is known [ohm]; None: nobody has measured it.
        threshold: readings up to which the board says nothing [ADC steps]; 0: it says all.
    """

    threshold: float
    adc: Adc
    creep: Creep
    r_par_std: float | None


def read_skin(path=None, node: str = "compensation") -> SkinConfig:
    """Circuit, curve and geometry of a parameter file such as config/skin.yaml.

    Args:
        path: ROS 2 parameter file; None: the defaults of all parameters.
        node: name, with its namespace, of the node whose parameters are read: "left/compensation".

    Raises:
        FileError: not a parameter file; the message names the file and the key.
        ValueError: a value that is out of range, or an unknown name under circuit, curve or
            geometry; the message names the file.
        OSError: the file, or the table of cells that it names, cannot be read.
    """
    if path is None:
        return skin_of({}, "")
    file = ParameterFile(path)
    file.check([node.rsplit("/", 1)[-1]])
    return skin_of({p.name: p.value for p in file.overrides(f"/{node.strip('/')}")}, str(path))


def skin_of(values: dict, where: str) -> SkinConfig:
    """Circuit, curve and geometry of a node's parameters, name -> value.

    Raises:
        ValueError: as `read_skin`; the message begins with `where`.
    """
    overrides = [Parameter(name, value) for name, value in values.items()]
    reader = Node("compensation", context=Context(), parameter_overrides=overrides)
    try:
        circuit = circuit_of(reader)
        curve = curve_of(reader, circuit)
        skin = SkinConfig(circuit, curve, geometry_of(reader, circuit))
        skin.adc, skin.creep = adc_of(reader, circuit), creep_of(reader)
        skin.r_par_std, skin.threshold = r_par_std_of(reader), threshold_of(reader)
    except ValueError as error:
        raise type(error)(f"{where}: {error}") from error
    unknown = [name for name in reader.undeclared() if name.split(".")[0] in SHARED]
    if unknown:
        raise ParameterError(unknown_parameter(where, unknown[0], reader.parameter_names()))
    return skin


def describe(
    text: str, low=None, high=None, read_only: bool = True, any_type: bool = False
) -> ParameterDescriptor:
    """A parameter's description, and its range where it has one."""
    if low is None:
        bounds = {}
    elif isinstance(low, int):
        bounds = {"integer_range": [IntegerRange(low, high)]}
    else:
        bounds = {"floating_point_range": [FloatingPointRange(low, high)]}
    return ParameterDescriptor(text, read_only=read_only, dynamic_typing=any_type, **bounds)


def circuit_of(node: Node) -> Circuit:
    """The circuit from the node's parameters ``circuit.*``."""

    def value(name, default, *bounds):
        return node.declare_parameter(f"circuit.{name}", default, describe(*bounds)).value

    rows = value("rows", 16, "row stripes", 1, 64)
    cols = value("cols", 16, "column stripes", 1, 64)
    r_ref = value("r_ref", 1780.0, "reference resistor [ohm]", 1.0, 1e7)
    r_par = value("r_par", 326.0, "series resistance of the multiplexers [ohm]", 0.0, 1e6)
    adc_bits = value("adc_bits", 10, "width of the ADC", 4, 16)
    mask = value("mask", "", "cells that exist: a word of 0 and 1 per row; empty: all")
    r_line = value("r_line", 0.0, "of a stripe, from its lead to its far end [ohm]", 0.0, 1e4)
    readout = value("readout", "floating", f"one of {', '.join(READOUTS)}")
    driven = value("driven", "rows", f"which lines are driven: {' or '.join(DRIVEN)}")
    r_drive = value("r_drive", 0.0, "of a grounded matrix: of what holds each line [ohm]", 0.0, 1e4)
    mask = mask_of(mask)
    if rows * cols == 1:
        raise ParameterError(
            "circuit.rows = 1, circuit.cols = 1: must be two cells or more: of a single one "
            "nothing tells a broken wire from a cell that nothing touches"
        )
    return Circuit(rows, cols, r_ref, r_par, adc_bits, mask, r_line, readout, driven, r_drive)


def r_par_std_of(node: Node) -> float | None:
    """How well the circuit's r_par is known [ohm]; None: nobody has measured it."""
    text = "standard deviation of r_par [ohm]; 0: nobody has measured it"
    return node.declare_parameter("circuit.r_par_std", 0.0, describe(text, 0.0, 1e6)).value or None


_TABLE = (
    f"of an ADC that is not linear: {', '.join(TABLES)}, or a list: reading [ADC steps], share of "
    "the supply, reading, ...; empty: linear"
)


def threshold_of(node: Node) -> float:
    """Return the readings up to which the board says nothing [ADC steps]; 0: it says all."""
    text = "ADC steps up to which the board sends 0 or no reading"
    return node.declare_parameter("threshold", 0.0, describe(text, 0.0, 65535.0)).value


def adc_of(node: Node, circuit: Circuit) -> Adc:
    """How its board's ADC reads it, from the node's parameters ``circuit.*`` of the ADC."""

    def value(name, default, *bounds):
        return node.declare_parameter(f"circuit.{name}", default, describe(*bounds)).value

    return Adc(
        circuit,
        value("adc_offset", 0.0, "what the ADC reads too low [ADC steps]", -65535.0, 65535.0),
        value(
            "adc_full_scale",
            0.0,
            "what the divider's supply would read [ADC steps]; 0: 2^adc_bits - 1",
            0.0,
            1e6,
        ),
        value("inverted", False, "readings fall with pressure"),
        mask_of(
            value("scanned", "", "crossings that are read: a word of 0 and 1 per row; empty: all"),
            "scanned",
        ),
        value("diode", 0.0, "of each driven line: forward voltage at 1 mA [V]; 0: none", 0.0, 5.0),
        value("supply", 5.0, "of the divider [V]; only a diode needs it", 1.0, 24.0),
        node.declare_parameter("circuit.adc_table", "", describe(_TABLE, any_type=True)).value
        or None,
    )


def mask_of(text: str, name: str = "mask") -> np.ndarray | None:
    """ "110 011" -> (rows, cols) bool; empty: None, all of them."""
    words = text.split()
    if any(set(word) - {"0", "1"} or len(word) != len(words[0]) for word in words):
        raise ValueError(f"circuit.{name} = {text!r}: must be words of 0 and 1, one per row")
    return np.array([[c == "1" for c in word] for word in words]) if words else None


def curve_of(node: Node, circuit: Circuit) -> PressureCurve:
    """The curve from the node's parameters ``curve.force`` [N] and ``curve.resistance`` [ohm], with
    the cells' ``curve.gain``."""
    default = PressureCurve().describe()
    force = node.declare_parameter("curve.force", default["force"], describe("[N] per cell"))
    ohms = describe("[ohm] of one cell")
    resistance = node.declare_parameter("curve.resistance", default["resistance"], ohms)
    each = describe("of each cell's force over the curve's, row by row; one number: of all")
    gain = np.array(node.declare_parameter("curve.gain", [1.0], each).value)
    cells = circuit.rows * circuit.cols
    if gain.size not in (1, cells):
        raise ValueError(f"curve.gain has {gain.size} numbers: must be 1 or rows * cols = {cells}")
    gain = gain.reshape(circuit.shape) if gain.size == cells else np.full(circuit.shape, gain[0])
    curve = PressureCurve(force.value, resistance.value)
    return curve.with_gain(gain if (gain != 1.0).any() else None)


def creep_of(node: Node) -> Creep:
    """What a standing load gains, from the node's parameters ``curve.creep`` and ``creep_time``."""
    share = node.declare_parameter(
        "curve.creep",
        0.0,
        describe("share that a standing load gains in a decade of time; 0: none", 0.0, MAX_SHARE),
    )
    time = node.declare_parameter(
        "curve.creep_time", 1.0, describe("after which it begins [s]", 0.1, 10.0)
    )
    return Creep(share.value, time.value)


def geometry_of(node: Node, circuit: Circuit) -> Geometry:
    """The geometry from the node's parameters ``geometry.*``."""

    def value(name, default, *bounds):
        return node.declare_parameter(f"geometry.{name}", default, describe(*bounds)).value

    return make_geometry(
        value("shape", UNKNOWN, f"one of {', '.join(SHAPES)}"),
        circuit.rows,
        circuit.cols,
        value("pitch", PITCH, "between neighbouring cells [m]", 1e-4, 1.0),
        value("cell_area", CELL_AREA, "that senses, of one cell [m^2]", 1e-8, 1.0),
        value("radius", 0.15, "of the cylinder or sphere [m]", 1e-3, 100.0),
        value("translation", [0.0, 0.0, 0.0], "of the skin in the base frame [m]"),
        value("rpy", [0.0, 0.0, 0.0], "of the skin in the base frame [rad]"),
        value("table", "", "CSV file of the cells' positions and normals, of shape: table"),
        circuit.populated,
    )
