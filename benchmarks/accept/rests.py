# SPDX-License-Identifier: Apache-2.0
"""Sound boards whose readings at rest are unlike those of an even fabric of some kiloohm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support.lab.board import KNOTS, TEXT

from tactile_skin import PressureCurve, forward

from .boards import Case, draw, pressed
from .presses import PALM, PUSH, Scene, course, held

KINDS = "open at rest", "below a step", "signed", "uneven", "shaking cover"
LIVE = 2.0  # s after which it must be free
_STEPS = 0.2, 0.9  # that a usual cell reads at rest [ADC steps]
_SIGNED = 3  # ADC steps that a signed converter is off, at most
_UNEVEN = 0.1, 1.0  # log of a cell's resistance at rest, RMS
_COVER = 5.0  # N, at most, on all cells
_COVER_UNEVEN = 0.3  # RMS, as of a cover that was sewn by hand
_SHAKES = 0.3, 3.0  # N, at most 60 % of the cover's weight
_HERTZ = 3.0, 30.0
_OPEN = 1e-9  # S
_REST = 1e7  # ohm, where the curve of such a sheet begins
_DRIVES = 8.0  # s, the last of which before a palm shake


def board(kind: str, wired: str, k: int, seed) -> tuple[Case, np.ndarray, float]:
    """Return a right board of this kind, its cover (rows, cols) [N], and what of it shakes [N]."""
    case = draw(wired, k, seed, "weight", creep=False)
    rng, fabric = case.rng, case.board.matrix.fabric
    cover, shakes = np.zeros(case.entered.shape), 0.0
    if kind == "open at rest":
        _begin(case, _REST)
        fabric.rest = np.full(case.entered.shape, _OPEN)
    elif kind == "below a step":
        _begin(case, _below(case, rng.uniform(*_STEPS)))
    elif kind == "signed":
        case.board.protocol, case.board.fraction_bits = TEXT, 0
        case.given.setdefault("serial_driver", {})["protocol"] = TEXT
        _begin(case, _below(case, rng.uniform(*_STEPS)))
        off = rng.uniform(-_SIGNED, _SIGNED, case.entered.shape)

        def signed(sent):
            noise = 0.6 * rng.standard_normal(off.shape)
            return replace(sent, samples=np.rint(sent.samples + off + noise).astype(np.int64))

        case.board.tamper = signed
    elif kind == "uneven":
        fabric.rest = fabric.rest * np.exp(rng.uniform(*_UNEVEN) * rng.standard_normal(cover.shape))
    else:
        weight = rng.uniform(0.0, _COVER)
        shakes = min(float(np.exp(rng.uniform(*np.log(_SHAKES)))), 0.6 * weight)
        cover = np.exp(_COVER_UNEVEN * rng.standard_normal(cover.shape))
        cover *= weight / cover.sum()
    return case, cover, shakes


def _begin(case: Case, ohm: float) -> None:
    """Let cells rest at `ohm`, by the curve that is true, and that is entered."""
    force, resistance = np.array(case.board.curve.points).T
    points = list(force), [ohm, *np.minimum(resistance[1:], ohm / 2.0)]
    fabric = case.board.matrix.fabric
    scatter = fabric.rest * case.board.curve.rest_resistance
    fabric.curve = case.board.curve = PressureCurve(*points)
    fabric.rest = scatter / ohm
    for node in ("compensation", "gesture_feature", "stop_on_push"):
        of = {"curve.force": list(map(float, points[0])), "curve.resistance": points[1]}
        if "curve.force" in case.given[node]:
            case.given[node] |= {name: list(map(float, values)) for name, values in of.items()}


def _below(case: Case, steps: float) -> float:
    """Return the resistance [ohm] at which a usual cell reads so many ADC steps."""
    circuit, low, high = case.entered, 1e3, 1e9
    for _ in range(60):
        ohm = (low * high) ** 0.5
        read = np.median(forward(circuit, np.full(circuit.shape, ohm))) * circuit.full_scale
        low, high = (ohm, high) if read > steps else (low, ohm)
    return high


def run(kind: str, wired: str, k: int, seed) -> dict:
    """Two palms of 45 N, and light touches, on such a board."""
    case, cover, shakes = board(kind, wired, k, seed)
    rng, scene = case.rng, Scene(case)
    scene.wait(LIVE + 1.0)
    scene.touched()
    for _ in range(2):
        scene.wait(_DRIVES)
        scene.add(PALM * pressed("palm", scene.shape, rng), course(0.2, 2.0, rng))
    scene.wait(1.0)
    t = np.arange(len(scene.true)) / KNOTS
    phase = rng.uniform(0.0, 2.0 * np.pi, 2) @ (np.indices(scene.shape) / 8.0).reshape(2, -1)
    wave = np.sin(2.0 * np.pi * rng.uniform(*_HERTZ) * t[:, None] + phase[None])
    wave = wave.reshape(len(t), *scene.shape) * (t > LIVE + 1.0)[:, None, None]
    total = max(cover.sum(), 1e-9)
    scene.conducts = scene.conducts + cover * (1.0 + shakes / total * wave)
    record, said = scene.play()
    found = held(record, scene)
    idle = (t >= LIVE) & (record.truth.sum((1, 2)) < PUSH / 2.0)
    ratios = []
    for begin, end in scene.spans:
        stands = begin + np.flatnonzero(record.truth[begin:end].sum((1, 2)) >= 0.999 * PALM)
        stands = stands[len(stands) // 2 :]
        ratios.append(float((record.found[stands].sum((1, 2)) / PALM).mean()))
    near = [abs(ratio - 1.0) <= 0.05 for ratio in ratios]
    live = bool((~record.stopped[idle]).any())
    at_once = bool((~record.stopped[(t >= LIVE) & (t < LIVE + 0.5)]).any())
    return (
        {"boards": 1, "live": live, "at once": at_once, f"live, {kind}": live, f"of {kind}": 1}
        | {"idle": int(idle.sum()), "fault": int((record.faulted & idle).sum())}
        | {f"fault, {kind}": int((record.faulted & idle).sum()), f"idle, {kind}": int(idle.sum())}
        | {
            "near": sum(near),
            "ratios": ratios,
            "reasons": sorted(set(record.reasons)),
            "said": said,
        }
        | found
    )
