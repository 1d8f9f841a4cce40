# SPDX-License-Identifier: Apache-2.0
"""The learned inverses at work: weights on disk, and one pass through a network.

The paper's sees the ADC picture alone; one of the same size is fed with what the circuit's physics
says (`physics_inputs`). PyTorch trains them (training.py); here the pass is a handful of products
of matrices, which takes a third of PyTorch's time. A test holds the two equal.
"""

from __future__ import annotations

import io
import json
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..files import FileError, one_line, read_bytes
from ..physics import kernel
from ..physics.circuit import Circuit, circuit_from
from ..physics.curve import PressureCurve
from ..physics.laplacian import connected_rho
from .convolution import convolve, layer_of

SHIPPED = Path(__file__).parent / "weights"
DILATIONS = (1, 2, 3)  # of the parallel context convolutions (paper Fig. 7)
_FORMAT = 1
NETWORKS = ("paper", "physics")
PHYSICS_INPUTS = 5
FIXED_POINT = 3  # of the inputs: the force by the fixed point
_HEAD = (27, 9, 9, 9)  # channels between the plain convolutions
_OUTPUTS = {"paper": 1, "physics": 2}  # the force; what to make of the fixed point's
_MOST_BYTES = 1024 * 1024  # of a weights file: ours take 30 kB
_STEPS = 14  # of the fixed point; each costs 0.01 y
_RHO = 1.0, 1e12  # ohm: a short and an open line stay finite
_LEAST_SEEN = 1e-6  # of log10: a cell that hardly shows in its own reading


def physics_inputs(adc: np.ndarray, circuit: Circuit, curve: PressureCurve) -> np.ndarray:
    """Return what the circuit says of a reading, for the second network.

    Args:
        adc: (n, rows, cols) ADC ratio.

    Returns:
        (5, n, rows, cols) float32: log conductance as read and after 14 accelerated steps of the
        fixed point g <- g rho(g) / rho_measured between the curve's ends, from 0 at rest to 1 at
        its end; log of what is left of rho(g) / rho_measured; the force by that conductance, as a
        share of the curve's maximum; log10 of how strongly the cell shows in its own reading.
    """
    low, high, cells, bounds = _range_of(circuit, curve)
    scale = 1.0 / np.log(high / low)
    rho_measured = np.minimum(np.maximum(circuit.two_terminal(adc), _RHO[0]), _RHO[1])
    # Foster: the sum of g rho is lines - 1
    share = (sum(circuit.shape) - 1) / cells.size
    g = np.minimum(np.maximum(share / rho_measured, low), high) * circuit.populated
    rho = np.empty(g.shape)
    for k, measured in enumerate(rho_measured):
        g[k], _ = kernel.fixed_point(
            g[k],
            cells,
            measured.ravel()[cells],
            *bounds,
            r_ref=circuit.r_ref,
            r_par=circuit.r_par,
            goal=0.0,
            steps=_STEPS,
        )
        rho[k] = connected_rho(g[k])
    g = np.maximum(g, low)  # where there is no cell too
    out = np.empty((PHYSICS_INPUTS, *adc.shape), np.float32)
    out[0] = np.log(np.minimum(np.maximum(1.0 / rho_measured, low), high) / low) * scale
    out[1] = np.log(g / low) * scale
    out[2] = np.log(rho / rho_measured)
    out[FIXED_POINT] = curve.force(1.0 / g) / curve.max_force
    seen = g * np.square(circuit.ratio(rho) * rho)  # - R_ref d u / d log R
    out[4] = np.log10(np.maximum(seen, _LEAST_SEEN))
    return out


@lru_cache(maxsize=16)
def _range_of(circuit: Circuit, curve: PressureCurve):
    """Conductance [S] of a cell at rest and at the curve's end; flat cells, log bounds of each."""
    low, high = 1.0 / curve.rest_resistance, 1.0 / curve.least_resistance
    cells = np.flatnonzero(circuit.populated).astype(np.int32)
    return low, high, cells, (np.full(cells.size, np.log(low)), np.full(cells.size, np.log(high)))


def head(kind: str) -> list[tuple[int, int]]:
    """Return inputs and outputs of each of the plain convolutions of a network of `NETWORKS`."""
    return list(zip(_HEAD, (*_HEAD[1:], _OUTPUTS[kind]), strict=True))


def shapes(kind: str, rows: int, cols: int) -> dict[str, tuple[int, ...]]:
    """Return the arrays of a network of `NETWORKS` by PyTorch's names, and the shape of each."""
    inputs = 1 if kind == "paper" else PHYSICS_INPUTS
    found: dict[str, tuple[int, ...]] = dict.fromkeys(("input_mean", "input_std"), (inputs, 1, 1))
    if kind == "paper":
        found |= {"row.weight": (1, 1, 1, cols), "row.bias": (1,)}
        found |= {"col.weight": (1, 1, rows, 1), "col.bias": (1,)}
        inputs = 3  # with what the line kernels say
    layers = {f"context.{k}": (inputs, _HEAD[0] // len(DILATIONS)) for k in range(len(DILATIONS))}
    layers |= {f"head.{k}": sizes for k, sizes in enumerate(head(kind))}
    for name, (a, b) in layers.items():
        found |= {f"{name}.weight": (b, a, 3, 3), f"{name}.bias": (b,)}
    return found


class Weights:
    """A trained network, and what it was made for.

    Args:
        state: arrays by PyTorch's names, as `training.PaperNet` and `PhysicsNet` have them.
        meta: "circuit" and "curve" as their `describe()`, and what the training says of itself.
        path: where it came from, for messages.

    Raises:
        ValueError: an array is missing, unknown, of another shape or not finite, or the meta data
            are no circuit and curve; the message names it.
    """

    def __init__(self, state: dict[str, np.ndarray], meta: dict, path: Path):
        for key in ("circuit", "curve"):
            if not isinstance(meta, dict) or not isinstance(meta.get(key), dict):
                raise ValueError(f"meta: {key}: is missing, or no map of names to values")
        self._circuit = circuit_from(meta["circuit"])
        self._curve = PressureCurve(**meta["curve"])
        self.rows, self.cols = self._circuit.shape
        self.kind = "paper" if any(name[:4] in ("row.", "col.") for name in state) else "physics"
        state = _checked(state, shapes(self.kind, self.rows, self.cols))
        self.state, self.meta, self.path = state, meta, path
        self._mean, self._std = state["input_mean"], state["input_std"]  # (channels, 1, 1)
        self._lines = None
        if self.kind == "paper":
            self._lines = (
                (state["row.weight"].reshape(self.cols), state["row.bias"]),
                (state["col.weight"].reshape(self.rows), state["col.bias"]),
            )
        self._context, self._head = (
            [layer_of(*layer) for layer in _layers(state, name)] for name in ("context", "head")
        )
        self._fits: tuple[Circuit, PressureCurve] | None = None  # that were found to fit

    def check(self, circuit: Circuit, curve: PressureCurve) -> None:
        """Raise ValueError, naming each difference, unless the weights fit circuit and curve.

        The width of the ADC may differ: the network sees ratios.
        """
        if self._fits and circuit is self._fits[0] and curve is self._fits[1]:  # the next frame
            return
        made, here = self.meta["circuit"], circuit.describe()
        if not circuit.readout_class.two_terminal:
            raise ValueError(
                f"the networks know the floating readout only, not {circuit.readout!r}: use "
                "the method auto or map"
            )
        differs = [
            f"{key} = {made[key]} (yours: {here[key]})"
            for key in ("rows", "cols", "r_ref", "r_par", "mask")
            if made[key] != here[key]
        ]
        if self.meta["curve"] != curve.describe():
            differs.append("another pressure curve")
        if differs:
            raise ValueError(
                f"weights {self.path} were made for another skin: {', '.join(differs)}; "
                "make your own with `tactile-skin train`, or choose another method"
            )
        self._fits = circuit, curve

    def predict(self, adc) -> np.ndarray:
        """(..., rows, cols) ADC ratio -> force [N], same shape.

        Raises:
            ValueError: another number of rows or columns than the network was made for, or numbers
                that grow beyond all bounds on their way, as they do with senseless weights.
        """
        adc = np.asarray(adc)
        if adc.shape[-2:] != (self.rows, self.cols):
            raise ValueError(
                f"readings of shape {adc.shape}: the network wants (..., {self.rows}, {self.cols})"
            )
        frames = adc.reshape(-1, self.rows, self.cols)
        with np.errstate(over="ignore", invalid="ignore"):  # seen below
            out = np.array([self._pass(frame) for frame in frames]).reshape(adc.shape)
        if not np.isfinite(out.sum()):
            raise ValueError(f"weights {self.path}: the network's force is not finite")
        return out

    def _pass(self, adc: np.ndarray) -> np.ndarray:
        """(rows, cols) ADC ratio -> force [N]."""
        if self._lines is None:
            inputs = physics_inputs(adc[None], self._circuit, self._curve)[:, 0]
            h = (inputs - self._mean) / self._std
        else:
            (row, row_bias), (col, col_bias) = self._lines
            h = np.empty((3, *adc.shape), np.float32)
            h[0] = (adc - self._mean[0]) / self._std[0]
            h[1] = np.maximum(h[0] @ row + row_bias, 0.0)[:, None]
            h[2] = np.maximum(col @ h[0] + col_bias, 0.0)
        looked = [
            convolve(h, layer, dilation)
            for layer, dilation in zip(self._context, DILATIONS, strict=True)
        ]
        h = np.concatenate(looked)  # (27, rows, cols)
        for layer in self._head:
            h = convolve(np.maximum(h, 0.0, out=h), layer)
        force = h[0] if self._lines else h[0] + (1.0 + h[1]) * inputs[FIXED_POINT]
        return np.maximum(force, 0.0) * self._curve.max_force


def _checked(state: dict, wanted: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """Return the arrays as float32, in the order of `wanted`; ValueError for any others."""
    for what, names in (("missing", wanted.keys() - state), ("unknown", state.keys() - wanted)):
        if names:
            raise ValueError(f"array {min(names)!r} is {what}: must be {', '.join(wanted)}")
    checked = {}
    for name, shape in wanted.items():
        array = np.asarray(state[name])
        if array.shape != shape or array.dtype.kind != "f":
            raise ValueError(
                f"array {name!r} is {array.dtype} of shape {array.shape}: must be float of {shape}"
            )
        with np.errstate(over="ignore"):
            checked[name] = array.astype(np.float32)
        if not np.isfinite(checked[name]).all():
            raise ValueError(f"array {name!r}: must be finite")
    if not (checked["input_std"] > 0).all():
        raise ValueError("array 'input_std': must be above 0")
    return checked


def _layers(state: dict, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights (out, in, 3, 3) and biases (out,) of the numbered layers of one name, in order."""
    count = sum(key.startswith(name) and key.endswith("weight") for key in state)
    names = [f"{name}.{k}" for k in range(count)]
    return [(state[f"{key}.weight"], state[f"{key}.bias"]) for key in names]


def save(path, state: dict[str, np.ndarray], meta: dict) -> None:
    """Write weights with what they were made for: arrays, and a JSON text."""
    arrays: dict[str, Any] = {"meta": np.array(json.dumps({"format": _FORMAT} | meta))} | state
    np.savez(path, **arrays)  # Any: to NumPy's stub a name may also be one of its options


def load(path) -> Weights:
    """Read weights written by `save`.

    Raises:
        FileError: the file is not one of those; the message names it and what is wrong.
        OSError: it cannot be read.
    """
    try:
        data = read_bytes(path, _MOST_BYTES)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"weights {path}: no such file") from error
    except FileError as error:
        raise FileError(f"weights {error}") from error
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = dict(file)
        meta = json.loads(str(arrays.pop("meta", None)))
        if not isinstance(meta, dict) or meta.get("format") != _FORMAT:
            raise ValueError(f"meta: format: must be {_FORMAT}")
        return Weights(arrays, meta, Path(path))
    except Exception as error:  # whatever a foreign or damaged file raises in zip, JSON or arrays
        reason = one_line(error) if isinstance(error, ValueError) else repr(error)
        raise FileError(f"weights {path}: not a weights file of tactile_skin: {reason}") from error


@cache
def shipped(name: str) -> Weights:
    """Return the weights that come with the package, for the default circuit and curve."""
    return load(SHIPPED / f"{name}.npz")
