# SPDX-License-Identifier: Apache-2.0
"""Time and error of each method from 8 x 8 to 96 x 96 cells, and time by how much is touched."""

from __future__ import annotations

import sys

import numpy as np

from tactile_skin.bench import chart
from tactile_skin.bench.measure import NOISE, Clock, errors, frames, moving_touch
from tactile_skin.physics.circuit import Circuit, forward
from tactile_skin.physics.curve import GRAM, PressureCurve
from tactile_skin.simulation import scenes
from tactile_skin.solvers import METHODS, compensate

from .. import harness

SIZES = (8, 12, 16, 24, 32, 48, 64, 96)
SHARES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # of the cells, under one round load
SHARE_SIZES = (16, 32, 64)
_LOAD = 400.0  # g a cell in that load's middle
_STREAMED = "auto, a moving touch"  # each frame begins with the last one's answer


def measure(n: int, seed: int, track=lambda items: items, sizes=SIZES, shares=SHARES) -> dict:
    """Each method on about n `scan` readings of bodies at 16 x 16, fewer on larger skins.

    A method that refuses a size, as a network does that was trained for another, has no point.

    Returns:
        the figure "growth" as plain data: per method sizes, p50_ms, p50_y and mean_g, and the
        exponent of the time in the number of cells, fitted from 16 x 16 on (null for one point);
        and for each of SHARE_SIZES the p50_y of auto under a round load on a share of the cells.
    """
    keys = ("sizes", "p50_ms", "p50_y", "mean_g")
    seen = {method: {key: [] for key in keys} for method in (*METHODS, _STREAMED)}
    curve = PressureCurve()
    for size in track(list(sizes)):
        circuit = Circuit(size, size)
        rng = np.random.default_rng([seed, size])
        count = max(4, round(n * min(1.0, (16 / size) ** 2)))
        force, adc = frames("bodies", "scan", count, rng, circuit, curve)
        for method, entry in seen.items():
            if method == _STREAMED:
                force = moving_touch(count, rng, circuit.shape)
                adc = forward(circuit, curve.resistance(force))
                adc = scenes.read_out(circuit, adc, "scan", rng)
            try:
                clock, found = timed(adc, circuit, curve, method.split(",")[0], "," in method)
            except ValueError:
                continue
            p50 = clock.quantile(0.5)
            values = (size, p50 * clock.y * 1e3, p50, errors(found, force)["mean_g"])
            for key, value in zip(keys, values, strict=True):
                entry[key].append(value)
    for entry in seen.values():
        entry["exponent"] = exponent(entry["sizes"], entry["p50_y"])
    touched = {str(size): by_share(size, shares, n, seed) for size in SHARE_SIZES if size in sizes}
    return {"growth": {"frames_at_16": n, "methods": seen, "shares": shares, "touched": touched}}


def timed(adc, circuit, curve, method: str, streamed=False) -> tuple[Clock, np.ndarray]:
    """Return the times of (n, rows, cols) frames, one after the other, and the forces [N]."""
    noise, clock, found, start = NOISE["scan"], Clock(), [], {}
    compensate(adc[0], circuit, curve, method, noise=noise)
    for frame in adc:
        found.append(clock(compensate, frame, circuit, curve, method, noise=noise, **start))
        start = {"start": found[-1]} if streamed else {}
    return clock, np.array([estimate.force for estimate in found])


def by_share(size: int, shares, n: int, seed: int) -> list[float]:
    """Return the p50 of auto [y] under one round load on each share of a square skin's cells."""
    circuit, curve, times = Circuit(size, size), PressureCurve(), []
    y, x = np.mgrid[:size, :size]
    for share in shares:
        rng = np.random.default_rng([seed, size, round(1e4 * share)])
        middle = rng.uniform(0.3 * size, 0.7 * size, (max(4, n // 8), 2, 1, 1))
        distance = np.hypot(y - middle[:, 0], x - middle[:, 1])
        count = max(1, round(share * size**2))
        radius = np.partition(distance.reshape(len(middle), -1), count - 1, 1)[:, count - 1]
        inside = distance <= radius[:, None, None]
        force = inside * _LOAD * GRAM * (1.0 + 0.2 * rng.standard_normal(inside.shape))
        adc = forward(circuit, curve.resistance(np.maximum(force, 0.0)))
        adc = scenes.read_out(circuit, adc, "scan", rng)
        times.append(timed(adc, circuit, curve, "auto")[0].quantile(0.5))
    return times


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

    figure, (times, error, shares) = plt.subplots(1, 3, figsize=(11.0, 4.6), layout="constrained")
    for method, entry in data["methods"].items():
        look = chart.style(method.split(",")[0])
        if method == _STREAMED:
            look |= {"linestyle": ":", "marker": ""}
        label = method
        if entry["exponent"] is not None:
            label += f": cells$^{{{entry['exponent']:.1f}}}$"
        times.plot(entry["sizes"], entry["p50_ms"], **look, label=label)
        if method != _STREAMED:
            error.plot(entry["sizes"], entry["mean_g"], **look)
    for size, y in data["touched"].items():
        shares.plot(np.multiply(data["shares"], 100), y, marker="o", markersize=4)
        shares.annotate(f"{size}x{size}", (30, y[-2]), (0, 7), textcoords="offset points")
    sizes = max((entry["sizes"] for entry in data["methods"].values()), key=len)
    for axis, label in ((times, "p50 of a frame [ms]"), (error, "mean error [g a cell]")):
        axis.set_xlabel("rows = columns")
        axis.set_ylabel(label, fontsize=10.5)
    shares.set_xlabel("cells touched [%]")
    shares.set_ylabel("p50 of auto [y]", fontsize=10.5)
    for axis in (times, error, shares):
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(alpha=0.25, linewidth=0.6)
    shares.margins(y=0.1)  # room for the topmost name
    for axis in (times, error):
        axis.set_xticks(sizes, [str(s) for s in sizes], fontsize=9)
    shares.set_xticks([0.3, 1, 3, 10, 30, 100], ["0.3", "1", "3", "10", "30", "100"])
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
QUICK = {"n": 4, "sizes": (8, 16)}


def main(arguments=None) -> None:
    given = harness.picture_parser(__doc__, __spec__).parse_args(arguments)
    harness.draw(sys.modules[__name__], QUICK if given.quick else FULL, given)


if __name__ == "__main__":
    harness.run(main)
