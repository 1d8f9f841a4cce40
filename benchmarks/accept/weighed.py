# SPDX-License-Identifier: Apache-2.0
"""Boards with one wrong entry, calibrated with known weights: is what is proved then right?"""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import yaml
from support.weights import bodies, objects

from tactile_skin import Circuit
from tactile_skin.commands import calibrate
from tactile_skin.parameters.nodes import all_names
from tactile_skin.physics.curve import GRAM

from .. import harness
from .boards import WRONG, Case, draw
from .presses import PALMS, Scene, held, palm

KINDS = (
    "r_par 0 for 326",
    "supply 40 % low",
    "r_ref twice the true",
    "r_ref ten times the true",
    "full scale 2000 for 1023",
    "another fabric",
)
RATE = 10  # frames a second of a file
FRAMES = 40  # of rest, and of an object
HELD = 8  # of a touch, and of the pause after it
TOUCHES = 40
OBJECTS = 8
OFF = 0.25  # of a palm's newtons that is a wrong scale: a proof speaks of 5 to 10 %
NODES = "serial_driver", "compensation", "gesture_feature", "stop_on_push"


def run(wired: str, k: int, seed) -> dict:
    """Calibrate with weights, launch with the file that is written, and let palms press."""
    wrong_entry, on = WRONG[KINDS[k % len(KINDS)]]
    case = draw(wired, 0, seed, creep=False)
    if wired in on:  # else a right one
        wrong_entry(case)
    with tempfile.TemporaryDirectory() as folder:
        written = _calibrated(case, Path(folder))
    proof = written.get("curve.proof", "none")
    names = {field.name for field in dataclasses.fields(Circuit)} - {"mask"}
    of_circuit = {n: written[f"circuit.{n}"] for n in names if f"circuit.{n}" in written}
    case.entered = dataclasses.replace(case.entered, **of_circuit)
    for node in NODES:
        known = {n: v for n, v in written.items() if n in all_names(node)}
        case.given[node] = case.given.get(node, {}) | known
    scene = Scene(case)
    scene.wait(3.0)
    for _ in range(PALMS):
        palm(scene)
    record, _ = scene.play()
    felt = [record.found[(a + b) // 2].sum() / record.truth[(a + b) // 2].sum()
            for a, b in scene.spans]  # fmt: skip
    wrong = abs(np.median(felt) - 1.0) > OFF
    proved = proof != "none"
    return {
        "boards": 1,
        "proved": proved,
        "wrong": bool(wrong),
        "wrongly proved": bool(proved and wrong),
    } | held(record, scene)


def _calibrated(case: Case, folder: Path) -> dict:
    """Return the parameters of the file that calibrate writes; none: it wrote none."""
    rng, shape = case.rng, case.entered.shape

    def file(name: str, force: np.ndarray, lasts: int) -> str:
        """Record loads (n, rows, cols) [N], each for so many frames."""
        frames = [
            case.board.converter.frame(ratio, rng)
            for ratio in case.board.matrix.ratio(force)
            for _ in range(lasts)
        ]
        path, full = folder / f"{name}.csv", case.board.circuit.full_scale
        np.savetxt(path, np.reshape(frames, (len(frames), -1)) * full, "%.0f", ",")
        return f"{name}:={path}"

    nothing = np.zeros((1, *shape))
    laid, weights = objects(OBJECTS, shape, rng)
    touches = np.zeros((2 * TOUCHES, *shape))
    touches[1::2] = bodies(TOUCHES, shape, rng)
    words = [f"rate:={RATE}", file("rest", nothing, FRAMES), file("touches", touches, HELD)]
    for force, weight in zip(laid, weights, strict=True):
        words.append(file(f"{weight / GRAM:.0f}g", force[None], FRAMES))
    config, out = folder / "mine.yaml", folder / "calibrated.yaml"
    circuit = case.entered.describe() | {
        n.removeprefix("circuit."): v
        for n, v in case.given.get("compensation", {}).items()
        if n.startswith("circuit.")
    }
    circuit = {n: v for n, v in circuit.items() if n != "mask"}
    config.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": circuit}}}))
    with contextlib.suppress(ValueError):
        harness.command(calibrate, *words, "--out", out, "--config", config)
    if not out.exists():
        return {}
    found = yaml.safe_load(out.read_text())["/**"]["ros__parameters"]
    return {f"{of}.{n}": v for of in ("circuit", "curve") for n, v in found.get(of, {}).items()}
