"""Speed against accuracy: every method as a point, a panel for each readout."""

from __future__ import annotations

import numpy as np

from ..learning import scenes
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..solvers import METHODS, compensate
from . import chart
from .measure import NOISE, Clock, day, errors, frames

TOUCHES = ("blobs", "rects")  # whose errors a point means; `random` loads the whole skin
PAPER = {"cnn_ms": 2.2, "cnn_g": 11.0, "naive_g": 150.0}  # its sections V and VI
FRAME_MS = 10.0  # at 100 frames a second


def measure(n: int, day_frames: int, seed: int, track=lambda items: items) -> dict:
    """All methods on n fresh frames of each family and readout, and `auto` on a day's stream.

    Returns:
        the figure "speed" as plain data: for each readout a list of points {method, p50_ms,
        p99_ms, p50_y, p99_y, mean_g, families}, times and mean_g over blobs and rects; `front`,
        the methods on its Pareto front; `day`; `forward`.
    """
    circuit, curve = Circuit(), PressureCurve()
    clocks = {(r, m): Clock() for r in scenes.READOUTS for m in METHODS}
    families = {key: {} for key in clocks}
    cases = [(r, f) for r in scenes.READOUTS for f in scenes.FAMILIES]
    for readout, family in track(cases):
        rng = np.random.default_rng([seed, cases.index((readout, family))])
        force, adc = frames(family, readout, n, rng, circuit, curve)
        for method in METHODS:
            noise = NOISE[readout]
            compensate(adc[0], circuit, curve, method, noise=noise)  # loads what is loaded once
            clock = Clock()
            found = [
                clock(compensate, frame, circuit, curve, method, noise=noise).force for frame in adc
            ]
            times = {"p50_y": clock.quantile(0.5), "p99_y": clock.quantile(0.99)}
            families[readout, method][family] = errors(np.array(found), force) | times
            if family in TOUCHES:
                clocks[readout, method].calls += clock.calls
                clocks[readout, method].solves += clock.solves
    readouts, front = {}, {}
    for readout in scenes.READOUTS:
        points = [
            point(method, clocks[readout, method], families[readout, method]) for method in METHODS
        ]
        readouts[readout] = points
        on = pareto([(p["p50_ms"], p["mean_g"]) for p in points])
        front[readout] = [points[k]["method"] for k in on]
    rng = np.random.default_rng([seed, len(cases)])
    resistance = curve.resistance(scenes.sample("blobs", 1, *circuit.shape, rng)[0])
    clock = Clock()
    for _ in range(500):
        clock(forward, circuit, resistance)
    return {
        "speed": {
            "frames": n,
            "readouts": readouts,
            "front": front,
            "day": stream(day_frames, rng, circuit, curve),
            "paper": PAPER,
            "frame_ms": FRAME_MS,
            # the paper's way solves 256 systems of 257 equations for the same readings
            "forward": {
                "p50_y": clock.quantile(0.5),
                "literal_over_forward": 256 / clock.quantile(0.5),
            },
        }
    }


def point(method: str, clock: Clock, families: dict) -> dict:
    p50, p99 = clock.quantile(0.5), clock.quantile(0.99)
    ms = clock.y * 1e3
    return {
        "method": method,
        "p50_ms": p50 * ms,
        "p99_ms": p99 * ms,
        "p50_y": p50,
        "p99_y": p99,
        "mean_g": float(np.mean([families[family]["mean_g"] for family in TOUCHES])),
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


def pareto(points) -> list[int]:
    """Indices of the points that no other beats in both coordinates, by the first one."""
    order = sorted(range(len(points)), key=lambda k: points[k])
    front, best = [], np.inf
    for k in order:
        if points[k][1] < best:
            front.append(k)
            best = points[k][1]
    return front


def table(data: dict) -> str:
    """The figures of all families as text."""
    lines = [
        f"{data['frames']} frames a family and readout, times in y",
        f"forward model: {data['forward']['p50_y']:.3f} y for all readings, the literal equations "
        f"{data['forward']['literal_over_forward']:.0f} times that",
        f"auto over a day: mean {data['day']['mean_y']:.2f} y, {data['day']['mean_g']:.2f} g",
        "",
        "method       readout  family   mean g  p95 g   sum err  ghosts   p50 y   p99 y",
    ]
    for method in METHODS:
        for readout, points in data["readouts"].items():
            (families,) = (p["families"] for p in points if p["method"] == method)
            for family, r in families.items():
                lines.append(
                    f"{method:<12} {readout:<8} {family:<7} {r['mean_g']:7.2f} {r['p95_g']:7.1f} "
                    f"{100 * r['sum_error']:7.1f} % {r['ghosts']:6.2f} {r['p50_y']:7.2f} "
                    f"{r['p99_y']:7.2f}"
                )
    return "\n".join(lines)


# --- picture -------------------------------------------------------------------------------------

_FLOOR = 0.02  # g; what errs less is drawn there, with an arrow
_TITLES = {
    "ideal": "ideal: exact readings",
    "adc10": "adc10: 10 bits",
    "scan": "scan: 10 bits, noise, mean of 4",
}


def draw(data: dict):
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        1, 3, figsize=(9.0, 4.3), sharex=True, sharey=True, layout="constrained"
    )
    for axis, (readout, points) in zip(axes, data["readouts"].items(), strict=True):
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_title(_TITLES[readout], fontsize=10.5)
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.axvline(data["frame_ms"], color="black", linewidth=0.8, linestyle=(0, (2, 3)))
        axis.axhline(data["paper"]["naive_g"], color="#8a8a8a", linewidth=0.8, linestyle=":")
        by_name = {p["method"]: p for p in points}
        front = [by_name[name] for name in data["front"][readout]]
        axis.plot(
            [p["p50_ms"] for p in front],
            [_shown(p["mean_g"]) for p in front],
            drawstyle="steps-post",
            color="#b0b0b0",
            linewidth=4,
            alpha=0.6,
            zorder=1,
            label="Pareto front",
        )
        for p in points:
            look = chart.style(p["method"]) | {"linestyle": "none"}
            y = _shown(p["mean_g"])
            axis.plot(
                [p["p50_ms"], p["p99_ms"]], [y, y], color=look["color"], linewidth=1.2, zorder=2
            )
            axis.plot(p["p50_ms"], y, **look, zorder=3, label=p["method"])
        below = [p for p in points if p["mean_g"] < _FLOOR]
        for p in below:
            axis.annotate(
                "",
                (p["p50_ms"], 0.4 * _FLOOR),
                (p["p50_ms"], 0.85 * _FLOOR),
                arrowprops={"arrowstyle": "->", "color": chart.STYLES[p["method"]][0]},
            )
        if below:
            axis.text(
                np.mean([p["p50_ms"] for p in below]),
                0.22 * _FLOOR,
                f"{' and '.join(p['method'] for p in below)}:\n"
                f"below {max(p['mean_g'] for p in below):.0e} g",
                ha="center",
                va="center",
                fontsize=8.5,
            )
        paper = data["paper"]
        axis.plot(
            paper["cnn_ms"],
            paper["cnn_g"],
            marker="o",
            markersize=8,
            markerfacecolor="none",
            markeredgecolor="#d55e00",
            linestyle="none",
            label="the paper's CNN",
        )
        axis.set_xlabel("time of a frame [ms]: p50, line to p99", fontsize=9.5)
    day = data["day"]
    axes[2].plot(
        [day["p50_ms"], day["p99_ms"]],
        [_shown(day["touched_mean_g"])] * 2,
        color="#111111",
        linewidth=1.2,
    )
    axes[2].plot(
        day["mean_ms"],
        _shown(day["touched_mean_g"]),
        marker="*",
        markersize=12,
        markerfacecolor="white",
        markeredgecolor="#111111",
        linestyle="none",
        label="auto over a day: mean time, error while touched",
    )
    axes[0].set_ylabel("mean error on blobs and rectangles [g a cell]", fontsize=9.5)
    axes[0].set_ylim(bottom=_FLOOR * 0.1)
    axes[1].text(data["frame_ms"] * 1.1, 0.3 * _FLOOR, "100 frames/s", rotation=90, fontsize=8.5)
    axes[1].text(
        0.98,
        data["paper"]["naive_g"] * 0.72,
        "paper's naive",
        fontsize=8.5,
        ha="right",
        transform=axes[1].get_yaxis_transform(),
    )
    handles, labels = axes[2].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=9.5, frameon=False)
    return figure


def _shown(mean_g: float) -> float:
    return max(mean_g, _FLOOR)


DRAW = {"speed": draw}
