# SPDX-License-Identifier: Apache-2.0
"""Single frames through `compensate`, by families of loads and faults of the circuit."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tactile_skin.bench.measure import GHOST
from tactile_skin.bench.stability import FAILS, FAILS_SHARE
from tactile_skin.calibration.rest import resting_conductance
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import GRAM, PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.simulation.network import Wiring, voltage_ratio
from tactile_skin.solvers import compensate
from tactile_skin.solvers.reading import SCAN_NOISE

from .mechanisms import ALL_ON, changes, sweep, variants
from .switchboard import Switchboard

METHOD = "map"
FAMILIES = "blobs", "rects", "bodies", "random"
_R_PAR = 0.1  # share by which r_par is off
_LOADED, _GROUNDED = {"readout": "loaded"}, {"readout": "grounded"}
CASES = {  # what the board is beside the supposed circuit, and the supposed readout
    "sound": ({}, {}),
    "sound, loaded": (_LOADED, _LOADED),
    "sound, grounded": (_GROUNDED, _GROUNDED),
    "r_par +10 %": ({"r_par": 1.0 + _R_PAR}, {}),
    "r_par -10 %": ({"r_par": 1.0 - _R_PAR}, {}),
    "short": ({}, {}),
    "saturated": ({}, {}),
    "loaded as floating": (_LOADED, {}),
    "grounded as floating": (_GROUNDED, {}),
}
_PER_BOARD = 10  # frames of one fabric, and of one short
_SHORT = 1.0  # S between two stripes that touch
_SATURATED = 0.6  # ADC ratio at which the input ends; a short circuit reads 0.85
_REST_SCATTER = 0.03  # RMS of log resistance of a good fabric's cells at rest
_REST_NOISE = 0.1  # ADC steps that a measurement of the rest leaves
# The rest of the cells: measured on the board as it is, with the supposed circuit; known from
# before the fault; the curve's.
TARED, BEFORE, UNKNOWN = "tared", "before", "unknown"
_CHANGES = "r_par +10 %", "r_par -10 %", "short"  # cases that may begin after the rest was measured


class Row(NamedTuple):
    """Attributes:
    case: of CASES.
    family: of FAMILIES.
    rest: TARED, BEFORE or UNKNOWN.
    noise_given: whether the noise of a reading is given, or measured in the frame.
    """

    case: str
    family: str
    rest: str
    noise_given: bool


def rows() -> list[Row]:
    """Return all rows, those with a rest first."""
    return [
        Row(case, family, rest, noise_given)
        for rest, noise_given in itertools.product((TARED, BEFORE, UNKNOWN), (True, False))
        for case in (_CHANGES if rest == BEFORE else CASES)
        for family in FAMILIES
    ]


def draw(row: Row, n: int, seed, shape=(16, 16)):
    """Draw n frames of a row.

    Returns:
        supposed circuit; (force [N], ADC ratio, curve with its rest) of each frame.

    Raises:
        ValueError: no skin rests so with the supposed circuit.
    """
    rng, curve = np.random.default_rng(seed), PressureCurve()
    true, supposed = (dict(parts) for parts in CASES[row.case])
    circuit = Circuit(*shape, **supposed)
    board = replace(circuit, **true | {"r_par": true.get("r_par", 1.0) * circuit.r_par})
    pairs = np.delete(np.arange(sum(shape) - 1), shape[0] - 1)  # a line, and the next of its kind
    frames = []
    while len(frames) < n:
        scatter = np.exp(_REST_SCATTER * rng.standard_normal(shape))
        fabric = curve.resting_at(curve.rest_resistance * scatter)
        force = np.minimum(scenes.sample(row.family, _PER_BOARD, *shape, rng), curve.max_force)
        force = np.concatenate([np.zeros((1, *shape)), force])
        if row.case == "short":
            wiring, first = Wiring.ideal(board), int(rng.choice(pairs, 1)[0])
            axis, first = (0, first) if first < shape[0] else (1, first - shape[0])
            wiring.ties.append((axis, first, axis, first + 1, _SHORT))
            ratio = voltage_ratio(1.0 / fabric.resistance(force), wiring, board)
        else:
            ratio = forward(board, fabric.resistance(force))
        given = {BEFORE: fabric, UNKNOWN: curve}.get(row.rest)
        if given is None:
            at_rest = resting_conductance(ratio[0], circuit, _REST_NOISE)
            given = curve.resting_at(1.0 / at_rest)
        if row.case == "saturated":
            ratio = np.minimum(ratio, _SATURATED)
        read = scenes.read_out(board, ratio[1:], "scan", rng)
        frames += [(f, adc, given) for f, adc in zip(force[1:], read, strict=True)]
    return circuit, frames[:n]


def judge(force: np.ndarray, found) -> tuple[bool, bool, bool, float]:
    """Return whether an estimate is suspect; whether it is not, and errs by more than 30 g on
    average of all cells; the same of cells that are touched, or said to be, and by a fifth of
    their load; its mean error [g a cell]."""
    error, load = np.abs(found.force - force) / GRAM, force / GRAM
    touched = np.maximum(load, found.force / GRAM) > GHOST
    cells, suspect = max(np.count_nonzero(touched), 1), found.status != "ok"
    limit = max(FAILS, FAILS_SHARE * (load * touched).sum() / cells)
    wrong = bool((error * touched).sum() / cells > limit)
    mean = float(error.mean())
    return suspect, mean > FAILS and not suspect, wrong and not suspect, mean


def measure(board: Switchboard, row: Row, n: int, seed) -> dict:
    """Return a row with the numbers of its n frames by variant, or why there is no rest."""
    try:
        circuit, frames = draw(row, n, seed)
    except ValueError as error:
        return row._asdict() | {"no_rest": str(error)}
    swept = []
    for force, adc, curve in frames:

        def play(force=force, adc=adc, curve=curve):
            noise = SCAN_NOISE if row.noise_given else None
            return judge(force, compensate(adc, circuit, curve, METHOD, noise=noise))

        swept.append(sweep(board, play, True)[0])
    base = np.array([one[ALL_ON] for one in swept], float)
    results = {ALL_ON: _numbers(base, base)}
    for variant in variants(True):
        found = np.array([one.get(variant, one[ALL_ON]) for one in swept], float)
        results[variant] = _numbers(found, base)
    return row._asdict() | {"n": n, "results": changes(results)}


_SHARES = "suspect", "silent", "silent_touched"


def _numbers(found: np.ndarray, base: np.ndarray) -> dict:
    """Counts of (n, 4) verdicts, and of those that changed beside all mechanisms on."""
    more, less = (found > base).sum(0), (found < base).sum(0)
    numbers = {
        key: [int(found[:, k].sum()), int(more[k]), int(less[k])] for k, key in enumerate(_SHARES)
    }
    change = found[:, 3] - base[:, 3]
    return numbers | {
        "median_g": round(float(np.median(found[:, 3])), 3),
        "change_g": round(float(change.mean()), 4),
        "change_g_se": round(float(change.std(ddof=1) / len(change) ** 0.5), 4),
    }
