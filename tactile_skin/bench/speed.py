"""Speed against accuracy: every method as a point, on a noisy board and on exact readings."""

from __future__ import annotations

import numpy as np

from ..learning import scenes
from ..physics.circuit import Circuit, forward
from ..physics.curve import PressureCurve
from ..solvers import METHODS, compensate
from . import chart
from .measure import NOISE, Clock, day, errors, frames

TOUCHES = "bodies"  # the family whose times and errors a point shows: no solver was made for it
FAMILIES = (*scenes.FAMILIES, "bodies", "pictures")
PAPER = {"cnn_g": 11.0, "naive_g": 150.0}  # its sections V and VI
FRAME_MS = 10.0  # at 100 frames a second
USES = {  # what to take when, in lines; the first is for a robot
    "auto": "a robot: as accurate as the frame allows,\nand reports what it does not trust",
    "map": "single frames, missing readings, prior knowledge;\na standard deviation for each cell",
    "newton": "exact readings, from a simulation\nor a laboratory meter",
    "physics": "a fast picture, not a stop:\nneeds weights for your board",
    "fixed_point": "comparison: the literature's iteration",
    "cnn": "comparison: the paper's network",
    "naive": "comparison: no compensation",
}


def measure(n: int, day_frames: int, seed: int, track=lambda items: items) -> dict:
    """All methods on n fresh frames of each family and readout, and `auto` on a day's stream.

    Returns:
        the figure "speed" as plain data: for each readout a list of points {method, p50_ms,
        p99_ms, p50_y, p99_y, mean_g, families}, times and mean_g of bodies; `day`; `forward`.
    """
    circuit, curve = Circuit(), PressureCurve()
    clocks, families = {}, {(r, m): {} for r in scenes.READOUTS for m in METHODS}
    cases = [(r, f) for r in scenes.READOUTS for f in FAMILIES]
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
            if family == TOUCHES:
                clocks[readout, method] = clock
    readouts = {
        readout: [point(m, clocks[readout, m], families[readout, m]) for m in METHODS]
        for readout in scenes.READOUTS
    }
    rng = np.random.default_rng([seed, len(cases)])
    resistance = curve.resistance(scenes.sample("blobs", 1, *circuit.shape, rng)[0])
    clock = Clock()
    for _ in range(500):
        clock(forward, circuit, resistance)
    return {
        "speed": {
            "frames": n,
            "readouts": readouts,
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

_FLOOR = 0.02  # g; what errs less is drawn there
_BEST = "#e8f1e4"  # behind the row of a robot's method
_SMALL = 8.5


def draw(data: dict):
    """A row a method: what for, its error on a noisy board and on exact readings, its time."""
    from matplotlib import pyplot as plt

    figure, (errors, times) = plt.subplots(
        1, 2, figsize=(9.0, 4.8), sharey=True, width_ratios=(3, 2), layout="constrained"
    )
    noisy, exact = ({p["method"]: p for p in data["readouts"][r]} for r in ("scan", "ideal"))
    for row, method in enumerate(USES):
        look = chart.style(method) | {"linestyle": "none", "markersize": 8.0}
        look["markeredgecolor"] = colour = look["color"]
        p = noisy[method]
        for mean_g, face, above in ((exact[method]["mean_g"], "white", False),
                                    (p["mean_g"], colour, True)):  # fmt: skip
            errors.plot(max(mean_g, _FLOOR), row, **look | {"markerfacecolor": face})
            _beside(errors, max(mean_g, _FLOOR), row, _grams(mean_g), above)
        times.plot([p["p50_ms"], p["p99_ms"]], [row, row], color=colour, linewidth=2.5)
        times.plot(p["p50_ms"], row, **look | {"markerfacecolor": colour})
        times.plot(p["p99_ms"], row, "|", color=colour, markersize=11, markeredgewidth=2)
        _beside(times, p["p50_ms"], row, f"{p['p50_ms']:.1f} to {p['p99_ms']:.1f}", True, "left")
        errors.text(-0.02, row - 0.33, method, ha="right", va="center", fontsize=10,
                    fontweight="bold", transform=errors.get_yaxis_transform())  # fmt: skip
    errors.set_yticks(range(len(USES)), USES.values(), fontsize=_SMALL)
    errors.set(xscale="log", xlim=(0.2 * _FLOOR, 400.0), ylim=(len(USES) - 0.45, -0.65))
    errors.xaxis.set_major_formatter("{x:g}")
    errors.set_xlabel("mean error on free bodies [g a cell]:\nfilled: a noisy board; hollow: exact")
    times.set_xlim(left=0.0)
    times.set_xlabel("time, noisy board [ms]:\nmark: p50; end of the bar: p99")
    for axis in (errors, times):
        axis.tick_params(axis="y", length=0)
        axis.grid(axis="x", alpha=0.25, linewidth=0.6)
        axis.axhspan(-0.65, 0.48, color=_BEST, zorder=0)
    return figure


def _beside(axis, x: float, row: int, text: str, above: bool, ha: str = "center") -> None:
    """A mark's number, above or below it."""
    axis.annotate(
        text,
        (x, row),
        (0, 6 if above else -7),
        textcoords="offset points",
        ha=ha,
        va="bottom" if above else "top",
        fontsize=_SMALL,
    )


def _grams(mean_g: float) -> str:
    if mean_g < _FLOOR:
        return f"below {_FLOOR:g}"
    return f"{mean_g:.{0 if mean_g >= 20.0 else 1}f}"


DRAW = {"speed": draw}
