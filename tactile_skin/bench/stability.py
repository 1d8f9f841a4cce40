"""Where each method fails: error and detection over the strength of each trouble.

Readings come from `textile`, a model richer than any solver's; the solver is given the nominal
circuit and curve. A frame *fails* when its mean error exceeds 30 g a cell and a fifth of its mean
load. It fails *loudly* when the method calls it suspect or failed or refuses it, else *silently*.
"""

from __future__ import annotations

import numpy as np

from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve
from ..solvers import METHODS, compensate
from . import chart
from .faults import TROUBLES, Trouble
from .textile import read

FAILS = 30.0  # g a cell, mean of the frame
FAILS_SHARE = 0.2  # of the frame's mean load
HOLDS = 0.05  # share of failing frames up to which a method holds
DOUBTS = 0.2  # share of doubted frames from which a method that holds is of little use
LOUD = 0.9  # share of the failing frames that must be reported for a failure to count as loud


def measure(n: int, seed: int, track=lambda items: items) -> dict:
    """n frames for each strength of each trouble, the same ones for every method.

    Returns:
        the figures "stability_error", "stability_detection" and "stability" as plain data.
    """
    curve = PressureCurve()
    cases = [(t, k) for t, trouble in enumerate(TROUBLES) for k in range(len(trouble.strengths))]
    seen = {}
    for t, k in track(cases):
        trouble, strength = TROUBLES[t], TROUBLES[t].strengths[k]
        # the same scenes, damage and noise throughout: a curve shows the strength alone
        rng = np.random.default_rng(seed)
        circuit = Circuit(adc_bits=trouble.bits(strength))
        force = trouble.scene(n, strength, circuit, rng)
        skin = trouble.textile(strength)
        rngs = rng.spawn(n)
        adc = [read(skin, circuit, curve, *pair) for pair in zip(force, rngs, strict=True)]
        for method in METHODS:
            seen[t, k, method] = judged(adc, force, circuit, curve, method)
    error, detection, fate = [], [], []
    for t, trouble in enumerate(TROUBLES):
        strengths = [float(s) for s in trouble.strengths]
        about = {"trouble": trouble.name, "unit": trouble.unit, "strengths": strengths}
        runs = {m: [seen[t, k, m] for k in range(len(strengths))] for m in METHODS}
        means = {m: [float(r["error"].mean()) for r in run] for m, run in runs.items()}
        reported = {m: [float(r["reported"].mean()) for r in run] for m, run in runs.items()}
        error.append(about | {"mean_g": means})
        detection.append(about | {"reported": reported})
        fate.append(about | {"methods": {m: verdict(trouble, run) for m, run in runs.items()}})
    return {
        "stability": {"frames": n, "troubles": fate},
        "stability_error": {"frames": n, "troubles": error},
        "stability_detection": {"frames": n, "troubles": detection},
    }


def judged(adc, force, circuit: Circuit, curve: PressureCurve, method: str) -> dict:
    """Per frame: mean error [g a cell], whether it fails, whether the method says so.

    A refused frame has no estimate: its error is that of saying nothing at all, zero force.
    """
    error, reported = np.empty(len(adc)), np.zeros(len(adc), bool)
    for k, frame in enumerate(adc):
        try:
            estimate = compensate(frame, circuit, curve, method)
            found, reported[k] = estimate.force, estimate.status != "ok"
        except ValueError:
            found, reported[k] = np.zeros(circuit.shape), True
        error[k] = np.abs(found - force[k]).mean() / GRAM
    mean_load = force.mean((1, 2)) / GRAM
    fails = error > np.maximum(FAILS, FAILS_SHARE * mean_load)
    return {"error": error, "reported": reported, "fails": fails}


def verdict(trouble: Trouble, runs: list[dict]) -> dict:
    """How a method fares under a trouble: `runs` are `judged` for each of its strengths.

    Returns:
        fails, reported and silent, shares of the frames in trouble; fate: "holds", "doubts" (it
        holds and does not believe it), "loud" or "silent"; by_strength, shares for each strength;
        false_alarms, the share of frames reported without failing where there is no trouble (null
        without such a strength).
    """
    fails = np.concatenate([r["fails"] for r in _in_trouble(trouble, runs)])
    reported = np.concatenate([r["reported"] for r in _in_trouble(trouble, runs)])
    silent = fails & ~reported
    if fails.mean() <= HOLDS:
        fate = "holds" if reported.mean() <= DOUBTS else "doubts"
    else:
        fate = "loud" if silent.sum() <= (1.0 - LOUD) * fails.sum() else "silent"
    false_alarms = None
    if trouble.sound is not None:
        sound = runs[trouble.strengths.index(trouble.sound)]
        false_alarms = float((sound["reported"] & ~sound["fails"]).mean())
    return {
        "fate": fate,
        "fails": float(fails.mean()),
        "reported": float(reported.mean()),
        "silent": float(silent.mean()),
        "by_strength": {
            "fails": [float(r["fails"].mean()) for r in runs],
            "reported": [float(r["reported"].mean()) for r in runs],
            "silent": [float((r["fails"] & ~r["reported"]).mean()) for r in runs],
        },
        "false_alarms": false_alarms,
    }


def _in_trouble(trouble: Trouble, runs: list[dict]) -> list[dict]:
    return [r for s, r in zip(trouble.strengths, runs, strict=True) if s != trouble.sound]


# --- pictures ------------------------------------------------------------------------------------


def _panels(data: dict, key: str, label: str, log: bool):
    """One panel a trouble, one line a method."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(6, 3, figsize=(9.0, 11.4), sharey=True, layout="constrained")
    for axis, trouble in zip(axes.flat, data["troubles"], strict=False):
        # strengths are drawn evenly spaced: most rise by factors, and some start at 0
        place = range(len(trouble["strengths"]))
        for method, values in trouble[key].items():
            axis.plot(place, values, **chart.style(method, size=5.0), label=method)
        axis.set_xticks(place, [f"{s:g}" for s in trouble["strengths"]], fontsize=9)
        axis.set_title(f"{trouble['trouble']} [{trouble['unit']}]", fontsize=10.5, pad=3)
        axis.grid(alpha=0.25, linewidth=0.6)
        if log:
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter("{x:g}")
    spare = axes.flat[len(data["troubles"])]
    spare.set_axis_off()
    spare.legend(*axes.flat[0].get_legend_handles_labels(), loc="center", ncols=2, fontsize=10.5)
    figure.supylabel(label, fontsize=11)
    return figure


def draw_error(data: dict):
    return _panels(data, "mean_g", "mean error [g a cell]", log=True)


def draw_detection(data: dict):
    return _panels(data, "reported", "share of frames that the method itself doubts", log=False)


_FATES = {  # shade, what the number says, and the legend's text
    "holds": ("#f4f4f0", None, "holds"),
    "doubts": ("#cfe3ee", "reported", "holds, but doubts so many frames"),
    "loud": ("#f2b84b", "fails", "fails so often, and says so"),
    "silent": ("#8c2d3c", "silent", "fails so often unreported"),
}


def draw_map(data: dict):
    """Method times trouble: where it holds, fails loudly, fails silently."""
    from matplotlib import pyplot as plt

    methods = list(data["troubles"][0]["methods"])
    figure, axis = plt.subplots(figsize=(9.0, 6.6), layout="constrained")
    for y, trouble in enumerate(data["troubles"]):
        for x, method in enumerate(methods):
            cell = trouble["methods"][method]
            fate = cell["fate"]
            shade, key, _ = _FATES[fate]
            axis.add_patch(plt.Rectangle((x, y), 1, 1, facecolor=shade, edgecolor="white"))
            text = f"{fate} {100 * cell[key]:.0f} %" if key else fate
            colour = "white" if fate == "silent" else "black"
            axis.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=9.5, color=colour)
    axis.set_xlim(0, len(methods))
    axis.set_ylim(len(data["troubles"]), 0)
    axis.set_xticks(np.arange(len(methods)) + 0.5, methods, fontsize=10.5)
    names = [f"{t['trouble']}, {_span(t)} {t['unit']}" for t in data["troubles"]]
    axis.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=9.5)
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    for spine in axis.spines.values():
        spine.set_visible(False)
    handles = [
        plt.Rectangle((0, 0), 1, 1, facecolor=shade, edgecolor="#999999", linewidth=0.5)
        for shade, _, _ in _FATES.values()
    ]
    labels = [label for _, _, label in _FATES.values()]
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9.5, frameon=False)
    return figure


def _span(trouble: dict) -> str:
    return f"{trouble['strengths'][0]:g} to {trouble['strengths'][-1]:g}"


DRAW = {
    "stability": draw_map,
    "stability_error": draw_error,
    "stability_detection": draw_detection,
}
