# SPDX-License-Identifier: Apache-2.0
"""What the skin says of touches, against the truth: force, centre, direction, number, ids.

Prints each figure beside its bound, and ends with 1 if one is missed. Simulated readings, `auto`,
the features and the tracker that the nodes run. The truth does not know the cells: a pad's pressure
is drawn at 12 x 12 points a cell; its force, centre and direction come from those points, and each
cell feels the sum of its own.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_skin.bench import chart
from tactile_skin.bench.measure import machine

from .. import harness
from .truth import (
    SPREAD,
    corner_frames,
    corner_stream,
    neighbours,
    passing_ids,
    sensed_cells,
    single_touches,
    stroke_ids,
)

# --- the command ---------------------------------------------------------------------------------

FULL = {"singles": 2000, "neighbours": 1000, "corners": 2000, "streams": 40, "strokes": 60}
QUICK = {"singles": 150, "neighbours": 60, "corners": 100, "streams": 3, "strokes": 3}
LEAKS = (0.0, 0.02, 0.05)


def measure(sizes: dict[str, int], seed: int, track=lambda items, what: items) -> dict:
    """All figures as plain data; `track(items, what)` shows progress."""
    rng = np.random.default_rng(seed)
    n = sizes["singles"]
    data: dict = {
        "singles": single_touches(n, rng, track=lambda i: track(i, "single touches")),
        "gaps": single_touches(n // 4, rng, sensed_cells),
        "spread": single_touches(n // 4, rng, spread=SPREAD),
        "neighbours": {
            leak: neighbours(sizes["neighbours"], rng, leak, track=lambda i: track(i, "neighbours"))
            for leak in LEAKS
        },
        "neighbours_spread": neighbours((sizes["neighbours"] + 1) // 2, rng, spread=SPREAD),
        "corners": corner_frames(sizes["corners"], rng, lambda i: track(i, "corners")),
        "stream": corner_stream(sizes["streams"], rng, lambda i: track(i, "corners, moving")),
    }
    strokes = [stroke_ids(rng) for _ in track(range(sizes["strokes"]), "strokes")]
    passes = [passing_ids(rng) for _ in track(range(sizes["strokes"]), "passes")]
    kept = [all(len(own) == 1 for own in ids) and ids[0] != ids[1] for ids, _ in passes]
    return data | {
        "strokes": float(np.mean([len(told) == 1 for told in strokes])),
        "passes": float(np.mean(kept)),
        "joined": float(np.mean([joined for _, joined in passes])),
        "sizes": sizes,
    }


class Line(NamedTuple):
    """A figure and what it must be."""

    what: str
    value: float
    bound: float | None  # None: for comparison only
    unit: str
    at_most: bool = True

    @property
    def met(self) -> bool:
        if self.bound is None:
            return True
        return self.value <= self.bound if self.at_most else self.value >= self.bound

    def __str__(self) -> str:
        text = f"{self.what:<66}{self.value:8.4g} {self.unit}"
        if self.bound is None:
            return text
        sign = "<=" if self.at_most else ">="
        return f"{text:<80} {sign} {self.bound:g}" + ("" if self.met else "   MISSED")


_ERRORS = (  # name, what, factor, unit, bounds of the median and of the 95th percentile
    ("force_error", "force", 100.0, "%", 4.0, 12.0),
    ("direction_deg", "direction", 1.0, "deg", 4.0, 12.0),
    ("centre_mm", "centre", 1.0, "mm", 1.0, 4.0),
)


def lines(data: dict) -> list[Line]:
    """What `measure` found, beside the bounds."""
    found = []
    for name, what, factor, unit, median, p95 in _ERRORS:
        errors = factor * np.array(data["singles"][name])
        for part, value, bound in (("median", 50, median), ("p95", 95, p95)):
            text = f"{what} of one touch of 2 to 80 N, {part} error"
            found.append(Line(text, float(np.percentile(errors, value)), bound, unit))
    found.append(Line("one touch is one contact", 100.0 * data["singles"]["one"], None, "%"))
    for key, trouble in (
        ("gaps", "6 mm gaps that feel nothing"),
        ("spread", "cells 10 % apart"),
    ):
        for name, what, factor, unit, *_ in _ERRORS:
            p50, p95 = factor * np.percentile(data[key][name], (50, 95))
            found.append(Line(f"  {trouble}: {what}, median error", float(p50), None, unit))
            found.append(Line(f"  {trouble}: {what}, p95 error", float(p95), None, unit))
    for leak, share in data["neighbours"].items():
        text = f"two touches, {100 * leak:g} % of each cell leaks to the next: two contacts"
        if not leak:
            text = "two touches with one free row between are two contacts"
        found.append(Line(text, 100.0 * share, 98.0, "%", at_most=False))
    share = 100.0 * data["neighbours_spread"]
    found.append(Line("  cells 10 % apart: two contacts", share, None, "%"))
    corners, stream = data["corners"], data["stream"]
    frames = data["sizes"]["corners"]
    found += [
        Line(f"fingers at corners, {frames} frames: ghost contacts", corners["ghosts"], 0.0, ""),
        Line("  naive: ghost contacts", corners["naive_ghosts"], None, ""),
        Line("  cells 10 % apart: ghost contacts", corners["spread_ghosts"], None, ""),
        Line("  as many contacts as fingers", 100.0 * corners["right"], None, "%"),
        Line(f"  coming and going, {stream['frames']} frames", stream["ghosts"], 0.0, ""),
        Line(
            "strokes across the skin that keep their id", 100.0 * data["strokes"], 100.0, "%", False
        ),
        Line(
            "passes at 3 cells' distance where both keep their ids",
            100.0 * data["passes"],
            100.0,
            "%",
            at_most=False,
        ),
        Line(
            "  of the frames of these, both are one contact in", 100.0 * data["joined"], None, "%"
        ),
    ]
    return found


def draw(data: dict):
    """Each single touch's errors over its force."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.2), layout="constrained")
    for axis, (name, what, factor, unit, median, p95) in zip(axes, _ERRORS, strict=True):
        errors = factor * np.array(data["singles"][name])
        axis.plot(data["singles"]["force"], errors, ".", markersize=2.5, color="#0072b2", alpha=0.4)
        for bound, value, text in ((median, 50, "median"), (p95, 95, "95 %")):
            axis.axhline(bound, color="#d55e00", linewidth=1.0, linestyle=(0, (4, 2)))
            axis.text(80, bound * 1.08, f"{text} at most", fontsize=8, color="#d55e00", ha="right")
            axis.axhline(np.percentile(errors, value), color="#111111", linewidth=1.0)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xticks([2, 5, 10, 20, 40, 80], ["2", "5", "10", "20", "40", "80"])
        axis.minorticks_off()
        axis.set_ylim(bottom=np.percentile(errors, 1), top=2.5 * p95)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_title(f"error of {what} [{unit}]", fontsize=11)
    figure.supxlabel("force of the touch [N]", fontsize=10.5)
    return figure


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--seed", type=int, default=1, help="of touches and noise (default 1)")
    parser.add_argument("--quick", action="store_true", help="few touches: a quarter of a minute")
    parser.add_argument("--out", type=Path, help="folder for touch.json and touch.png")
    args = parser.parse_args(arguments)
    if args.seed < 0:
        parser.error(f"--seed = {args.seed}: must be 0 or more")
    if args.out:
        chart.prepare()
        args.out.mkdir(parents=True, exist_ok=True)

    def track(items, what):
        for k, item in enumerate(items):
            if sys.stderr.isatty():
                print(f"\r\x1b[2K{what} {k}", end="", file=sys.stderr, flush=True)
            yield item
        if sys.stderr.isatty():
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)

    data = measure(QUICK if args.quick else FULL, args.seed, track)
    found = lines(data)
    print(*found, sep="\n")
    if args.out:
        about = {"seed": args.seed, "quick": args.quick, "machine": machine()}
        chart.write(args.out, "touch", about | data, draw)
    return 0 if all(line.met for line in found) else 1


if __name__ == "__main__":
    harness.run(main)
