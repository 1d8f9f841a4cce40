"""Time and error of each method from 8 x 8 to 64 x 64 cells, with fitted exponents."""

from __future__ import annotations

import sys

import numpy as np

from tactile_skin.bench import chart
from tactile_skin.bench.measure import NOISE, Clock, errors, frames
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.solvers import METHODS, compensate

from .. import harness

SIZES = (8, 12, 16, 24, 32, 48, 64)


def measure(n: int, seed: int, track=lambda items: items, sizes=SIZES) -> dict:
    """Each method on about n `scan` readings of blobs and rects at 16 x 16, fewer on larger skins.

    A method that refuses a size, as a network does that was trained for another, has no point.

    Returns:
        the figure "growth" as plain data: per method sizes, p50_ms, p50_y and mean_g, and the
        exponent of the time in the number of cells, fitted from 16 x 16 on (null for one point).
    """
    curve = PressureCurve()
    keys = ("sizes", "p50_ms", "p50_y", "mean_g")
    seen = {method: {key: [] for key in keys} for method in METHODS}
    noise = NOISE["scan"]
    for size in track(list(sizes)):
        circuit = Circuit(size, size)
        rng = np.random.default_rng([seed, size])
        share = max(2, round(n / 2 * min(1.0, (16 / size) ** 2)))
        pairs = [frames(f, "scan", share, rng, circuit, curve) for f in ("blobs", "rects")]
        force, adc = (np.concatenate(part) for part in zip(*pairs, strict=True))
        for method in METHODS:
            try:
                compensate(adc[0], circuit, curve, method, noise=noise)
            except ValueError:
                continue
            clock = Clock()
            found = [
                clock(compensate, frame, circuit, curve, method, noise=noise).force for frame in adc
            ]
            p50 = clock.quantile(0.5)
            values = (size, p50 * clock.y * 1e3, p50, errors(np.array(found), force)["mean_g"])
            for key, value in zip(keys, values, strict=True):
                seen[method][key].append(value)
    for entry in seen.values():
        entry["exponent"] = exponent(entry["sizes"], entry["p50_y"])
    return {"growth": {"frames_at_16": n, "methods": seen}}


def exponent(sizes, times, least: int = 16) -> float | None:
    """Of the time in the number of cells: slope of the logarithms, over sizes from `least` on."""
    kept = [(size**2, time) for size, time in zip(sizes, times, strict=True) if size >= least]
    if len(kept) < 2:
        return None
    cells, time = np.log(kept).T
    return float(np.polyfit(cells, time, 1)[0])


# --- picture -------------------------------------------------------------------------------------


def draw(data: dict):
    from matplotlib import pyplot as plt

    figure, (times, error) = plt.subplots(1, 2, figsize=(9.0, 4.4), layout="constrained")
    for method, entry in data["methods"].items():
        label = method
        if entry["exponent"] is not None:
            label += f": cells$^{{{entry['exponent']:.1f}}}$"
        times.plot(entry["sizes"], entry["p50_ms"], **chart.style(method), label=label)
        error.plot(entry["sizes"], entry["mean_g"], **chart.style(method))
    sizes = max((entry["sizes"] for entry in data["methods"].values()), key=len)
    for axis, label in ((times, "p50 of a frame [ms]"), (error, "mean error [g a cell]")):
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xticks(sizes, [f"{s}x{s}" for s in sizes], fontsize=9)
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_ylabel(label, fontsize=10.5)
        axis.grid(alpha=0.25, linewidth=0.6)
    times.axhline(10.0, color="black", linewidth=0.8, linestyle=(0, (2, 3)))
    times.text(sizes[0], 11.0, "100 frames/s", fontsize=8.5)
    figure.legend(
        *times.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        fontsize=10,
        frameon=False,
    )
    return figure


DRAW = {"growth": draw}


FULL = {"n": 60}
QUICK = {"n": 4}


def main(arguments=None) -> None:
    given = harness.picture_parser(__doc__, __spec__).parse_args(arguments)
    harness.draw(sys.modules[__name__], QUICK if given.quick else FULL, given)


if __name__ == "__main__":
    harness.run(main)
