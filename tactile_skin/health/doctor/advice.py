# SPDX-License-Identifier: Apache-2.0
"""Whether to give a piece of advice: the skin that obeys it is tried on the very frames.

Advice after which an untouched skin reads as none does, or after which a touch that the raw
readings show is no longer felt, makes a robot that is free under a hand: it is never given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...calibration.rest import REST_SPAN, UNLIKE, resting_conductance
from ...calibration.touched import AT_REST, TOUCHED
from ...physics.circuit import Circuit
from ...physics.curve import PressureCurve
from ...solvers import Estimate, compensate

_MAY_DIFFER = 0.34  # share of the cells that are unlike the usual one, as those of damaged lines
OFF_END = 2.0  # times the noise plus an ADC step, that usual readings at rest keep off either end
_SEEN = 0.3  # of the largest change of a reading, in a frame that shows a touch
_HARD = 0.8  # the same, of a hard touch
HARDEST = 12  # touches that a circuit is tried by; and as many at even steps of hardness
_STUCK = 0.9  # of the conductance at the curve's end: what conducts more at rest is stuck
_TIME = 0.2  # s for a frame that no cells explain
WIDTHS = (8, 10, 12, 14, 16)  # bits of ADCs


@dataclass(frozen=True)
class Change:
    """What a finding proposes to enter."""

    circuit: Circuit  # as it should be
    turned: bool = False  # whether readings are to be taken the other way round
    # factor of the readings, where the supply reads other than the configured full scale
    scale: float = 1.0

    def of(self, frames: np.ndarray) -> np.ndarray:
        """Return the frames (n, rows, cols) as they would be read with it [ADC ratio]."""
        frames = np.clip((1.0 - frames if self.turned else frames) * self.scale, 0.0, 1.0)
        return frames.reshape(len(frames), *self.circuit.shape)

    def settings(self, supposed: Circuit, inverted: bool = False) -> dict[str, object]:
        """Return parameter name -> value of all that differs from what is supposed."""
        now, then = supposed.describe(), self.circuit.describe()
        found = {f"circuit.{k}": v for k, v in then.items() if v != now[k] and k != "mask"}
        if {"circuit.readout", "circuit.driven"} & found.keys():
            found["circuit.readout"] = then["readout"]
            if then["readout"] != "floating":
                found["circuit.driven"] = then["driven"]
        for name in {"circuit.r_par", "circuit.r_drive"} & found.keys():
            found[name] = round(found[name], 1)
        if self.turned:
            found["circuit.inverted"] = not inverted
        if self.scale != 1.0:
            full = round(supposed.full_scale / self.scale)
            bits = (full + 1).bit_length() - 1
            known = full == 2**bits - 1
            name, value = ("adc_bits", bits) if known else ("adc_full_scale", full)
            found[f"circuit.{name}"] = value
        return found


def felt(touch: np.ndarray, circuit: Circuit, curve: PressureCurve, noise: float) -> Estimate:
    """Return what a skin feels that reads (rows, cols) [ADC ratio]; NaN: not read."""
    return compensate(touch, circuit, curve, "map", noise=noise, missing=True, time_limit=_TIME)


def _rests(at_rest: np.ndarray, rest: np.ndarray, circuit: Circuit, noise: float) -> bool:
    """Whether (rows, cols) readings, and what conducts [S], are those of an untouched skin."""
    cells = circuit.populated & np.isfinite(at_rest)
    usual, end = float(np.median(at_rest[cells])), float(circuit.ratio(0.0))
    margin = OFF_END * (noise + 1.0) / circuit.full_scale
    share = rest[cells] / np.median(rest[cells])
    differs = (share > UNLIKE) | (share < 1.0 / UNLIKE)
    return margin < usual < end - margin and differs.mean() <= _MAY_DIFFER


def is_safe(change: Change, frames: np.ndarray, quiet: np.ndarray, noise: float) -> bool:
    """Return whether the skin that obeys is at rest when nothing touches, and feels what touches.

    Args:
        frames: (n, rows, cols) ADC ratio as it is configured; NaN where a crossing was not read.
        quiet: (n,) bool, frames in which nothing touches.
        noise: of a reading [ADC steps], of rounding at least.
    """
    circuit = change.circuit
    frames = np.where(np.isnan(frames).any(0), np.nan, frames)  # a crossing is read, or is not
    moves = np.nanmax(np.abs(frames - frames[quiet].mean(0)), axis=(1, 2))
    then = change.of(frames)
    at_rest = then[quiet].mean(0)
    try:
        rest = resting_conductance(at_rest, circuit, noise)
    except ValueError:
        return False
    if not _rests(at_rest, rest, circuit, noise):
        return False
    usual = 1.0 / float(np.median(rest[circuit.populated]))
    force, ohms = np.array(PressureCurve().points).T
    curve = PressureCurve(force, ohms * usual / ohms[0])
    most = _STUCK / curve.least_resistance  # S
    curve = curve.resting_at(1.0 / np.clip(rest, 1.0 / (usual * REST_SPAN), most))
    order = np.argsort(-moves)
    seen = order[moves[order] > _SEEN * moves.max()]
    tried = np.unique(np.r_[seen[:HARDEST], seen[:: max(1, len(seen) // HARDEST)]])
    least = np.where(moves > _HARD * moves.max(), TOUCHED, AT_REST)  # N
    return all(felt(then[k], circuit, curve, noise).force.max() >= least[k] for k in tried)


def of_other_scale(circuit: Circuit) -> list[Change]:
    """Return the changes to ADCs of fewer bits: with more, any touch would be too light to tell."""
    full = circuit.full_scale
    return [Change(circuit, scale=full / (2**b - 1)) for b in WIDTHS if 2**b - 1 < full]
