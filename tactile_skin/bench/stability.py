# SPDX-License-Identifier: Apache-2.0
"""What to worry about: each trouble at each strength, and what becomes of the picture.

Readings come from `textile`, a model richer than any solver's. A frame is judged by what a running
skin has measured of its board before, its rest without a touch and its circuit from 30 earlier
frames (`measure_rest` and `identify`). The methods are compared on frames alone: by the configured
circuit and the shipped curve.

A frame *fails* when its mean error on the cells that are touched, or said to be, exceeds 30 g and a
fifth of their load. It is *reported* if the method calls it suspect or failed or refuses it, or if
the rest of its board is refused: the robot stops. What fails and is not reported is *silent*.
"""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import textwrap
from typing import NamedTuple

import numpy as np

from ..calibration.identify import identify
from ..calibration.rest import measure_rest, supposing
from ..calibration.tare import Tare
from ..middleware.threads import one_thread
from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve
from ..simulation import scenes
from ..simulation.textile import Sample
from ..solvers import METHODS, compensate
from ..solvers.reading import ROUNDING_NOISE
from .measure import GHOST
from .troubles import TROUBLES, Trouble

FAILS = 30.0  # g a cell
FAILS_SHARE = 0.2  # of the cells' load
SILENT = 0.02  # share of the frames beyond which silent failures are listed
METHOD = "auto"  # that a robot uses
_RATE = 100.0  # frames a second
_AT_REST = 125  # frames without a touch that a running skin has seen,
_LEARNT = 30  # and of touches
_COMPARED = 5  # frames of each board that all methods are compared by


def measure(n: int, boards: int, seed: int, track=lambda x: x, learnt: int = _LEARNT) -> dict:
    """n frames of each strength of each trouble, on so many boards: the same ones throughout."""
    tasks = [
        (t, k, b)
        for t, trouble in enumerate(TROUBLES)
        for k in range(len(trouble.strengths))
        for b in range(boards)
    ]
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count(), spawn) as pool:
        given = max(n // boards, 1), seed, learnt
        running = [pool.submit(_task, *task, *given) for task in tasks]
        results = dict(zip(tasks, (one.result() for one in track(running)), strict=True))
    troubled = [t for t in tasks if TROUBLES[t[0]].strengths[t[1]] != TROUBLES[t[0]].sound]
    return {
        "stability": {
            "frames": max(n // boards, 1) * boards,
            "boards": boards,
            "scenes": "bodies",
            "method": METHOD,
            "troubles": [
                _summary(
                    trouble,
                    [
                        _shares([results[t, k, b][0] for b in range(boards)])
                        for k in range(len(trouble.strengths))
                    ],
                )
                for t, trouble in enumerate(TROUBLES)
            ],
            "methods": {
                method: _shares([results[task][1][method] for task in troubled])
                for method in METHODS
            },
        }
    }


def _task(t: int, k: int, board: int, n: int, seed: int, learnt: int) -> tuple[Outcome, dict]:
    with one_thread():
        return _on_board(TROUBLES[t], TROUBLES[t].strengths[k], n, [seed, board], learnt)


class Outcome(NamedTuple):
    """Of n frames: (n,) mean error over all cells [g], and whether it fails, and is reported."""

    error: np.ndarray
    fails: np.ndarray
    reported: np.ndarray


def _on_board(trouble: Trouble, strength: float, n: int, seed, learnt: int) -> tuple[Outcome, dict]:
    """n frames on a running skin, and those of all methods that each judges alone."""
    rng = np.random.default_rng([*seed, 1])
    circuit, curve = Circuit(adc_bits=trouble.bits(strength)), PressureCurve()
    board = Sample(trouble.textile(strength), circuit, curve, [*seed, 0])
    touches = board.expose(scenes.sample("bodies", learnt, *circuit.shape, rng))
    force = trouble.scene(n, strength, circuit, rng)
    adc = board.sample(board.expose(force), rng)
    idle = board.at_rest(_AT_REST, rng)
    known = learn(idle, board.sample(touches, rng), circuit, curve)
    running = judge(adc, force, known.circuit, known.curve, METHOD, noise=known.noise)
    if known.refused:
        running = running._replace(reported=np.full(n, True))
    compared = {
        method: judge(adc[:_COMPARED], force[:_COMPARED], circuit, curve, method)
        for method in METHODS
    }
    return running, compared


class Learnt(NamedTuple):
    """What a running skin knows of its board: `refused` says why its rest was not accepted."""

    circuit: Circuit
    curve: PressureCurve
    noise: float | None
    refused: str


def learn(idle, touches, circuit: Circuit, curve: PressureCurve) -> Learnt:
    """Measure the rest on (n, rows, cols) idle frames, and find the circuit on touches."""
    tare = Tare(circuit, curve)
    for k, frame in enumerate(idle):
        tare.update(k / _RATE, frame, np.zeros(circuit.shape))
    if not tare.measured:
        return Learnt(circuit, curve, None, str(tare.found or ""))
    try:
        rest = measure_rest(idle, circuit)
    except ValueError as error:
        return Learnt(circuit, curve, None, str(error))
    noise = max(rest.noise, ROUNDING_NOISE)
    try:
        found = identify(touches, circuit, rest).circuit
        curve = curve.resting_at(1.0 / supposing(rest, found).conductance)
        return Learnt(found, curve, noise, "")
    except ValueError:  # no skin rests so: the configured circuit stays
        return Learnt(circuit, tare.curve, noise, "")


def judge(adc, force, circuit: Circuit, curve: PressureCurve, method: str, **given) -> Outcome:
    """Frames (n, rows, cols) under forces [N]; a refused one errs like zero force."""
    found, reported = np.zeros(np.shape(force)), np.zeros(len(force), bool)
    for k, frame in enumerate(adc):
        try:
            estimate = compensate(frame, circuit, curve, method, **given)
            found[k], reported[k] = estimate.force, estimate.status != "ok"
        except ValueError:
            reported[k] = True
    error = np.abs(found - force) / GRAM
    touched = np.maximum(found, force) > GHOST * GRAM
    cells = np.maximum(touched.sum((1, 2)), 1)
    load = (force * touched).sum((1, 2)) / cells / GRAM
    fails = (error * touched).sum((1, 2)) / cells > np.maximum(FAILS, FAILS_SHARE * load)
    return Outcome(error.mean((1, 2)), fails, reported)


def _shares(outcomes: list[Outcome]) -> dict:
    """Of all frames: mean error, and the shares that fail, are reported, and fail silently."""
    error, fails, reported = (np.concatenate(part) for part in zip(*outcomes, strict=True))
    return {
        "mean_g": float(error.mean()),
        "fails": float(fails.mean()),
        "reported": float(reported.mean()),
        "silent": float((fails & ~reported).mean()),
    }


def _summary(trouble: Trouble, shares: list[dict]) -> dict:
    """One trouble: a list for each share, an entry for each strength."""
    running = {key: [share[key] for share in shares] for key in shares[0]}
    return {
        "trouble": trouble.name,
        "unit": trouble.unit,
        "strengths": [float(s) for s in trouble.strengths],
        "sound": trouble.sound,
        "running": running,
        "reason": trouble.reason,
        "verdict": verdict(trouble, running),
    }


def verdict(trouble: Trouble, running: dict) -> str:
    """Return what becomes of a trouble, whose shares are `running`, on a running skin in words."""
    at = [k for k, strength in enumerate(trouble.strengths) if strength != trouble.sound]
    if max(running["silent"][k] for k in at) > SILENT:
        return trouble.reason
    reported = [running["reported"][k] for k in at]
    if min(reported) > 0.5:
        return "told: the robot stops"
    return "right, or told" if max(reported) > 0.1 else "compensated"


def silent(data: dict) -> list[str]:
    """Return a Markdown line for each trouble that a running skin is silent about, worst first."""
    found = []
    for trouble in data["troubles"]:
        shares = trouble["running"]["silent"]
        at = [k for k, share in enumerate(shares) if share > SILENT]
        if at:
            where = ", ".join(f"{trouble['strengths'][k]:g} ({100 * shares[k]:.0f} %)" for k in at)
            name = f"{trouble['trouble']} [{trouble['unit']}]"
            found.append((max(shares), f"- {name}: {where}: {trouble['reason']}"))
    return [line for _, line in sorted(found, key=lambda pair: -pair[0])]


# --- the picture ---------------------------------------------------------------------------------

_SHADES = {"right": "#dbe7d6", "told": "#f3c566", "silent": "#e0857c"}
_SECTIONS = {  # of troubles, by what becomes of them on a running skin
    "silent": "Worry about these: beyond some strength the picture is wrong, and nothing says so",
    "told": "The robot stops, with the reason",
    "right": "Compensated",
}
_STRIP = 4.6  # inches, width of a row's bars
_BAR = 0.62  # rows, height of a bar


def draw(data: dict):
    """Draw a row a trouble, in sections by what becomes of it on a skin, a bar a strength."""
    from matplotlib import pyplot as plt

    sections = {name: [] for name in _SECTIONS}
    for trouble in sorted(data["troubles"], key=lambda t: -max(t["running"]["silent"])):
        sections[_section(trouble)].append(trouble)
    count = len(data["troubles"]) + len(_SECTIONS)
    figure, axis = plt.subplots(figsize=(9.0, 0.42 * count + 0.7), layout="constrained")
    y = 0.0
    for name, troubles in sections.items():
        axis.text(-1.85, y + 0.72, _SECTIONS[name], fontsize=11, fontweight="bold")
        y += 1.0
        for trouble in troubles:
            _strip(axis, y, trouble)
            label = f"{trouble['trouble']} [{trouble['unit']}]"
            axis.text(-0.1, y + 0.5, label, va="center", ha="right", fontsize=9)
            if name == "silent":
                reason = textwrap.fill(trouble["reason"], 34)
                axis.text(_STRIP + 0.1, y + 0.5, reason, va="center", fontsize=8.5)
            y += 1.0
    axis.set_xlim(-1.9, _STRIP + 2.4)
    axis.set_ylim(y, 0.0)
    axis.set_axis_off()
    handles = [plt.Rectangle((0, 0), 1, 1, facecolor=shade) for shade in _SHADES.values()]
    labels = ["right", "reported: the robot stops", "silently wrong"]
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure


def _section(trouble: dict) -> str:
    """Which of _SECTIONS a trouble belongs to, as `verdict` says it."""
    if trouble["verdict"] == trouble["reason"]:
        return "silent"
    return "right" if trouble["verdict"] == "compensated" else "told"


def _strip(axis, y: float, trouble: dict) -> None:
    """Draw the bars of one trouble, split into what is right, reported and silent, by strength."""
    shares, strengths = trouble["running"], trouble["strengths"]
    width = _STRIP / len(strengths)
    for k, strength in enumerate(strengths):
        left = k * width
        silent, told = shares["silent"][k], shares["reported"][k]
        split = {"right": 1.0 - silent - told, "told": told, "silent": silent}
        for name, share in split.items():
            length = 0.94 * width * share
            axis.barh(y + 0.5, length, _BAR, left, color=_SHADES[name], zorder=2)
            left += length
        usual = strength == trouble["sound"]
        text = f"{strength:g}" + (f": {100 * silent:.0f} %" if silent > SILENT else "")
        axis.text(
            (k + 0.06) * width, y + 0.5, text, va="center", fontsize=8, zorder=3,
            color="#777777" if usual else "black", fontweight="bold" if ":" in text else "normal",
        )  # fmt: skip


DRAW = {"stability": draw}
