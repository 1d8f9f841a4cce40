# SPDX-License-Identifier: Apache-2.0
"""The parameters of nodes on the bus, and as the things that the pure modules work with."""

from __future__ import annotations

import datetime
from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError, concerning
from ..fields import Leaf, members
from ..parameters import shared
from ..parameters.nodes import Compensation
from ..physics.adc import Adc
from ..physics.circuit import Circuit
from ..physics.creep import Creep
from ..physics.curve import PressureCurve
from ..physics.proof import Proof
from ..touch.geometry import Geometry, make_geometry
from .bus import Context, Node, Parameter
from .parameter_file import SHARED, ParameterFile, sources_of, unknown_parameter


class SkinConfig(tuple[Circuit, PressureCurve, Geometry]):
    """What a parameter file says of the skin itself: circuit, curve, geometry = read_skin(...).

    Attributes:
        adc: from the board's counts to the ratio that the solvers take: `adc.ratio(counts)`.
        creep: what a standing load gains.
        r_par_std: how well the circuit's r_par is known [ohm]; None: nobody has measured it.
        proof: what has shown that its newtons are right.
        threshold: readings up to which the board says nothing [ADC steps]; 0: it says all.
        board: the parameters circuit.*, as the file has them; given: those of compensation.
    """

    def __init__(self, parts: tuple[Circuit, PressureCurve, Geometry], given: Compensation):
        self.circuit, self.curve, self.geometry = parts
        self.given = given
        self.board, self.threshold = given.circuit, given.board_threshold
        self.adc, self.creep = adc_of(given.circuit, self.circuit), creep_of(given.curve)
        self.proof = proof_of(given.curve)
        self.r_par_std = given.circuit.r_par_std or None

    def __new__(cls, parts, given):
        return super().__new__(cls, parts)


def read_skin(path=None, node: str = "compensation") -> SkinConfig:
    """Read circuit, curve and geometry from a parameter file such as config/skin.yaml.

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
    file.check({node.rsplit("/", 1)[-1]: None})
    file.check_skin(f"/{node.strip('/')}")
    return _skin_of(file.overrides(f"/{node.strip('/')}"), str(path))


def skin_of(values: dict, where: str) -> SkinConfig:
    """Return circuit, curve and geometry from a node's parameters, name -> value.

    Raises:
        ValueError: as `read_skin`; the message begins with `where`.
    """
    return _skin_of([Parameter(name, value) for name, value in values.items()], where)


def _skin_of(given: list[Parameter], where: str) -> SkinConfig:
    overrides = [p for p in given if p.name.split(".")[0] in (*SHARED, "board_threshold")]
    reader = Node("compensation", context=Context(), parameter_overrides=overrides)
    try:
        has = declared(reader, Compensation)
        circuit = circuit_of(has.circuit)
        parts = circuit, curve_of(has.curve, circuit), geometry_of(has.geometry, circuit)
        skin = SkinConfig(parts, has)
        if unknown := reader.undeclared():
            words = unknown_parameter("", unknown[0], reader.parameter_names())
            raise ParameterError(words.removeprefix(": "), unknown[0])
    except ValueError as error:
        where = sources_of(overrides, error) or where
        raise type(error)(f"{where}: {error}" if where else str(error)) from error
    return skin


def declared(node: Node, kind: type, prefix: str = "") -> Any:
    """Declare all parameters of a dataclass on a node, and return it with the node's values.

    Raises:
        ParameterError: a value that is not allowed.
    """
    values: dict[str, Any] = {}
    single = []
    for name, member in members(kind):
        if isinstance(member, Leaf):
            single.append(prefix + name)
            values[name] = node.declare_parameter(prefix + name, member.default, member.about).value
        else:
            values[name] = declared(node, member, f"{prefix}{name}.")
    with concerning(*single):
        return kind(**values)


@concerning("circuit")
def circuit_of(given: shared.Circuit) -> Circuit:
    """Return the circuit that the parameters ``circuit.*`` describe.

    Raises:
        ValueError: values that do not go together.
    """
    if given.rows * given.cols == 1:
        raise ValueError(
            "circuit.rows = 1, circuit.cols = 1: must be two cells or more: of a single one "
            "nothing tells a broken wire from a cell that nothing touches"
        )
    named = {field.name: getattr(given, field.name) for field in fields(Circuit) if field.init}
    mask, shape = mask_of(given.mask), (given.rows, given.cols)
    if mask is not None and mask.shape == shape:
        mask = mask[_edges(mask, shape, 1), _edges(mask, shape, 0)]
        named["rows"], named["cols"] = mask.shape
    return Circuit(**named | {"mask": mask})


class Part(NamedTuple):
    """Where the skin's lines are in a board's frames.

    A smaller mat leaves lines at the edges open, and stripes may be wired in any order.

    Attributes:
        shape: of a frame.
        rows, cols: of it, in the order in which they lie on the skin.
    """

    shape: tuple[int, int]
    rows: tuple[int, ...]
    cols: tuple[int, ...]

    def of(self, frames: np.ndarray) -> np.ndarray:
        """Return the skin's part of frames (..., rows, cols); of another shape as they are."""
        if frames.shape[-2:] != self.shape:
            return frames
        for axis, lines in ((-2, self.rows), (-1, self.cols)):
            if lines != tuple(range(frames.shape[axis])):
                frames = frames.take(lines, axis)
        return frames

    def within(self, other: Part) -> Part:
        """Return the same of frames of which another part was taken; ValueError: it lacks lines."""
        rows, cols = (
            tuple(had.index(line) for line in wanted)
            for wanted, had in ((self.rows, other.rows), (self.cols, other.cols))
        )
        return Part((len(other.rows), len(other.cols)), rows, cols)


@concerning("circuit")
def part_of(given: shared.Circuit) -> Part:
    """Return where the skin is in a frame: by the order of its lines, and the edges of its mask."""
    shape = given.rows, given.cols
    rows = _order_of(given.row_order, given.rows, "row_order")
    cols = _order_of(given.column_order, given.cols, "column_order")
    mask = mask_of(given.mask)
    return Part(shape, rows[_edges(mask, shape, 1)], cols[_edges(mask, shape, 0)])


def _order_of(text: str, count: int, name: str) -> tuple[int, ...]:
    """Return the board's lines in the order in which they lie on the skin."""
    order = [int(word) if word.isdecimal() else -1 for word in text.split()] or range(count)
    if sorted(order) != list(range(count)):
        raise ValueError(f"circuit.{name} = {text!r}: must name each of 0 to {count - 1} once")
    return tuple(order)


def _edges(mask: np.ndarray | None, shape: tuple[int, int], axis: int) -> slice:
    """Return which lines are left without those at the edges in which ``mask`` has no cell."""
    if mask is None or mask.shape != shape or not mask.any():
        return slice(None)
    lines = np.flatnonzero(mask.any(axis))
    return slice(int(lines[0]), int(lines[-1]) + 1)


@concerning("circuit")
def adc_of(given: shared.Circuit, circuit: Circuit | None = None) -> Adc:
    """Return the converter that the parameters ``circuit.*`` describe.

    Args:
        circuit: which they describe; None: it is made.

    Raises:
        ValueError: values that do not go together.
    """
    mask, scanned = mask_of(given.mask), mask_of(given.scanned, "scanned")
    if scanned is not None and scanned.shape == (given.rows, given.cols):
        scanned = scanned[_edges(mask, scanned.shape, 1), _edges(mask, scanned.shape, 0)]
    return Adc(
        circuit or circuit_of(given),
        given.adc_offset,
        given.adc_full_scale,
        given.inverted,
        scanned,
        given.diode,
        given.supply,
        given.adc_table or None,
    )


def mask_of(text: str, name: str = "mask") -> np.ndarray | None:
    """Return "110 011" as (rows, cols) bool; None where it is empty: all of them."""
    words = text.split()
    if any(set(word) - {"0", "1"} or len(word) != len(words[0]) for word in words):
        raise ValueError(f"circuit.{name} = {text!r}: must be words of 0 and 1, one per row")
    return np.array([[c == "1" for c in word] for word in words]) if words else None


@concerning("curve")
def curve_of(given: shared.Curve, circuit: Circuit) -> PressureCurve:
    """Return the curve that the parameters ``curve.*`` describe, with the gain of each cell.

    Raises:
        ValueError: a table that is no curve, or gains of another number than the cells'.
    """
    gain, cells = np.array(given.gain), circuit.rows * circuit.cols
    if gain.size not in (1, cells):
        raise ValueError(f"curve.gain has {gain.size} numbers: must be 1 or rows * cols = {cells}")
    gain = gain.reshape(circuit.shape) if gain.size == cells else np.full(circuit.shape, gain[0])
    curve = PressureCurve(given.force, given.resistance)
    return curve.with_gain(gain if (gain != 1.0).any() else None)


@concerning("curve")
def creep_of(given: shared.Curve) -> Creep:
    """Return what a standing load gains by the parameters ``curve.creep`` and ``creep_time``."""
    return Creep(given.creep, given.creep_time)


@concerning("curve")
def proof_of(given: shared.Curve) -> Proof:
    """Return what proved the newtons by the parameters ``curve.proof*``.

    Raises:
        ValueError: a date that is no day.
    """
    try:
        date = datetime.date.fromisoformat(given.proof_date) if given.proof_date else None
    except ValueError:
        raise ValueError(
            f"curve.proof_date = {given.proof_date!r}: must be a day, as 2026-11-28"
        ) from None
    return Proof(given.proof, given.proof_error, date)


@concerning("geometry")
def geometry_of(given: shared.Geometry, circuit: Circuit) -> Geometry:
    """Return the geometry that the parameters ``geometry.*`` describe.

    Raises:
        ValueError: values that do not go together, or an invalid table of cells.
        OSError: the table cannot be read.
    """
    return make_geometry(
        **asdict(given), rows=circuit.rows, cols=circuit.cols, cells=circuit.populated
    )
