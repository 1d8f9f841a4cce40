# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy: every method as a point, for each readout, and on exact readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..physics.readouts import PASSIVE
from ..simulation import scenes
from ..solvers import METHODS, compensate
from . import chart
from .measure import NOISE, Clock, Skin, day, errors, frames, usable

TOUCHES = "bodies"  # the family whose times and errors a point shows: no solver was made for it
FAMILIES = (*scenes.FAMILIES, "bodies", "pictures")
WIRED = tuple(m for m in METHODS if m not in ("cnn", "physics"))  # networks know floating ones only
USES = {  # what to take when, in lines; the first is for a robot
    "auto": "a robot: as accurate as the frame allows,\nand reports what it does not trust",
    "map": "single frames, missing readings, prior knowledge;\na standard deviation for each cell",
    "newton": "exact readings, from a simulation\nor a laboratory meter",
    "physics": "a fast picture, not a stop:\nneeds weights for your board",
    "fixed_point": "comparison: the literature's iteration",
    "cnn": "comparison: the paper's network",
    "naive": "comparison: no compensation",
}


def measure(
    n: int, day_frames: int, seed: int, track=lambda items: items, *, skin: Skin | None = None
) -> dict:
    """All methods on n fresh frames of each family and readout, and `auto` on a day's stream.

    With a skin: as `measure_own`.

    Returns:
        the figure "speed" as plain data: for each readout a list of points {method, p50_ms,
        p99_ms, p50_y, p99_y, mean_g, families}, times and mean_g of bodies; `wirings`, the same
        of noisy boards wired otherwise than the paper's, of the same bodies; `day`.
    """
    if skin is not None:
        return measure_own(n, seed, track, skin)
    circuit, curve = Circuit(), PressureCurve()
    clocks, families = {}, {(r, m): {} for r in scenes.READOUTS for m in METHODS}
    cases = [(r, f) for r in scenes.READOUTS for f in FAMILIES]
    for readout, family in track(cases):
        scene = seed, cases.index((readout, family))
        for method, clock, found in timed(METHODS, family, readout, n, scene, circuit, curve):
            families[readout, method][family] = found
            if family == TOUCHES:
                clocks[readout, method] = clock
    readouts = {
        readout: [point(m, clocks[readout, m], families[readout, m]) for m in METHODS]
        for readout in scenes.READOUTS
    }
    scene = seed, cases.index(("scan", TOUCHES))
    wirings = {
        wiring: [
            point(method, clock, {TOUCHES: found})
            for method, clock, found in timed(
                WIRED, TOUCHES, "scan", n, scene, replace(circuit, readout=wiring), curve
            )
        ]
        for wiring in PASSIVE[1:]
    }
    rng = np.random.default_rng([seed, len(cases)])
    return {
        "speed": {
            "frames": n,
            "readouts": readouts,
            "wirings": wirings,
            "day": stream(day_frames, rng, circuit, curve),
        }
    }


def measure_own(n: int, seed: int, track, skin: Skin) -> dict:
    """All methods that know a skin, on bodies and on what `map` feels in its recording, if any."""
    (circuit, curve, forces), rng, panels = skin, np.random.default_rng(seed), {}
    cases = {"your circuit, simulated bodies": frames(TOUCHES, "scan", n, rng, circuit, curve)}
    if forces is not None:
        adc = scenes.read_out(circuit, forward(circuit, curve.resistance(forces)), "scan", rng)
        cases["your circuit, touches of your recording"] = forces, adc
    for title, given in track(cases.items()):
        runs = timed_on(usable(circuit, curve), *given, "scan", circuit, curve)
        panels[title] = [point(m, clock, {TOUCHES: found}) for m, clock, found in runs]
    return {"speed": {"frames": n, "panels": panels}}


def timed(methods, family: str, readout: str, n: int, scene, circuit: Circuit, curve):
    """Each method on the same n frames of a seed: its name, its clock, its `errors` and times."""
    given = frames(family, readout, n, np.random.default_rng(scene), circuit, curve)
    return timed_on(methods, *given, readout, circuit, curve)


def timed_on(methods, force, adc, readout: str, circuit: Circuit, curve: PressureCurve):
    """Yield the same on frames (n, rows, cols) whose forces [N] are known."""
    noise = NOISE[readout]
    for method in methods:
        compensate(adc[0], circuit, curve, method, noise=noise)  # loads what is loaded once
        clock = Clock()
        found = [
            clock(compensate, frame, circuit, curve, method, noise=noise).force for frame in adc
        ]
        times = {"p50_y": clock.quantile(0.5), "p99_y": clock.quantile(0.99)}
        yield method, clock, errors(np.array(found), force) | times


def point(method: str, clock: Clock, families: dict) -> dict:
    p50, p99 = clock.quantile(0.5), clock.quantile(0.99)
    ms = clock.y * 1e3
    return {
        "method": method,
        "p50_ms": p50 * ms,
        "p99_ms": p99 * ms,
        "p50_y": p50,
        "p99_y": p99,
        "mean_g": families[TOUCHES]["mean_g"],
        "families": families,
    }


def stream(n: int, rng, circuit: Circuit, curve: PressureCurve) -> dict:
    """`auto` frame by frame over a day-like stream, each from the last."""
    force, adc = day(n, rng, circuit, curve)
    clock, last, found, taken = Clock(), None, np.empty_like(force), {}
    for k, frame in enumerate(adc):
        last = clock(compensate, frame, circuit, curve, "auto", start=last, noise=NOISE["scan"])
        found[k] = last.force
        taken[last.method] = taken.get(last.method, 0) + 1
    touched = force.any((1, 2))
    ms = clock.y * 1e3
    return {
        "frames": len(force),
        "mean_ms": clock.mean * ms,
        "mean_y": clock.mean,
        "p50_ms": clock.quantile(0.5) * ms,
        "p99_ms": clock.quantile(0.99) * ms,
        "mean_g": errors(found, force)["mean_g"],
        "touched_mean_g": errors(found[touched], force[touched])["mean_g"],
        "methods": taken,
    }


def choice(data: dict) -> list[str]:
    """Return a Markdown table of a run: what to take, `scan` readings."""
    if "panels" in data:
        heads = "| of | method | error [g a cell] | p50 [ms] | p99 [ms] |", "|---|---|---|---|---|"
        own = [(title, p) for title, points in data["panels"].items() for p in points]
        row = "| {} | `{method}` | {mean_g:.1f} | {p50_ms:.1f} | {p99_ms:.1f} |".format
        return [*heads, *(row(title, **p) for title, p in own)]
    noisy, exact = ({p["method"]: p for p in data["readouts"][r]} for r in ("scan", "ideal"))
    rows = []
    day = f". Over a simulated day a frame takes {data['day']['mean_ms']:.1f} ms on average"
    for method, use in USES.items():
        p = noisy[method]
        what = use.replace("\n", " ") + day * (method == "auto")
        errors = p["mean_g"], p["families"]["pictures"]["mean_g"], exact[method]["mean_g"]
        rows.append(
            f"| `{method}` | {what} | {' | '.join(map(grams, errors))} "
            f"| {p['p50_ms']:.1f} | {p['p99_ms']:.1f} |"
        )
    return [
        "| method | use it for | error on bodies [g a cell] | on recorded pictures "
        "| on exact readings of bodies | p50 [ms] | p99 [ms] |",
        "|---|---|---|---|---|---|---|",
        *rows,
    ]


def grams(mean_g: float) -> str:
    return f"{mean_g:.{0 if mean_g >= 100 else 1}f}"


# --- picture -------------------------------------------------------------------------------------

_FLOOR = 0.02  # g; what errs less is drawn there
_BEST = "auto"  # what a robot takes
_APART = 15.0  # points between two names
_FRAME_MS = 10.0  # at 100 frames a second
_PANELS = {  # the first three have one scale of errors
    ("readouts", "scan"): "floating, as the paper's: a noisy board",
    ("wirings", "loaded"): "loaded lines: a noisy board",
    ("wirings", "grounded"): "grounded lines: a noisy board",
    ("readouts", "ideal"): "floating: exact readings, of a simulation say",
}


def draw(data: dict):
    """Each method's error on bodies against its time, p50 to p99: a panel for each readout."""
    from matplotlib import pyplot as plt

    panels = data.get("panels") or {title: data[k][name] for (k, name), title in _PANELS.items()}
    high, wide = -(-len(panels) // 2), min(len(panels), 2)  # one, two or four
    figure, axes = plt.subplots(
        high, wide, figsize=(4.5 * wide, 4.1 * high), layout="constrained", squeeze=False
    )
    shown = [p["mean_g"] for points in list(panels.values())[:3] for p in points]
    last = max(p["p99_ms"] for points in panels.values() for p in points)
    for axis, (title, points) in zip(axes.flat, panels.items(), strict=True):
        points.sort(key=lambda p: (p["mean_g"], p["p99_ms"]))
        error = {p["method"]: max(p["mean_g"], _FLOOR) for p in points}
        ends = error.values() if title == _PANELS["readouts", "ideal"] else shown
        axis.set(xscale="log", yscale="log", xlim=(0.03, 1.2 * max(last, _FRAME_MS)))
        axis.axvline(_FRAME_MS, color="black", linewidth=0.8, linestyle=(0, (2, 3)))
        axis.set_ylim(0.75 * min(ends), 1.4 * max(ends))
        figure.draw_without_rendering()  # where a value lies is known from here on
        below = -np.inf  # the last name's height [points]
        for p in points:
            look, y = chart.style(p["method"]), error[p["method"]]
            look |= {"linestyle": "none", "markersize": 13.0 if p["method"] == _BEST else 8.0}
            axis.plot([p["p50_ms"], p["p99_ms"]], [y] * 2, color=look["color"], linewidth=2.0)
            axis.plot(p["p99_ms"], y, "|", color=look["color"], markersize=9)
            axis.plot(p["p50_ms"], y, zorder=4 if p["method"] == _BEST else 3, **look)
            place = axis.transAxes.inverted().transform(axis.transData.transform((1.0, y)))[1]
            height = axis.bbox.height * 72.0 / figure.dpi  # points
            below = max(place * height, below + _APART)
            axis.annotate(
                f"{p['method']}  {grams(p['mean_g'])} g",
                (p["p99_ms"], y),
                (1.03, below / height),
                textcoords="axes fraction",
                annotation_clip=False,
                va="center",
                fontsize=10.5 if p["method"] == _BEST else 9,
                fontweight="bold" if p["method"] == _BEST else None,
                arrowprops={"arrowstyle": "-", "color": look["color"], "lw": 0.6, "alpha": 0.6},
            )
        axis.text(0.92 * _FRAME_MS, 1.05 * max(ends), "100 frames/s", ha="right", fontsize=8)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("time of a frame [ms]: mark p50, bar to p99")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("")
        axis.grid(alpha=0.25, linewidth=0.6)
    for axis in axes[:, 0]:
        axis.set_ylabel("mean error on free bodies [g a cell]")
    return figure


DRAW = {"speed": draw}
