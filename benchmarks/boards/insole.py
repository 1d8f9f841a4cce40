# SPDX-License-Identifier: Apache-2.0
"""Real frames of a floating 32 x 10 insole: does the fit explain them, and what does it show?

FRAMES.npz holds `counts` (n, 32, 10) int16, -1 where there is no sensor, `recording` (n,), which
foot of which person a frame is of, and `row`, `col` (33, 15), the line numbers from 0 of each cell
of the insole's picture, -1 where there is none. tests/data/insole_floating.npz is such a file;
tests/data/insole_floating.txt names its source. The constants are from
docs/lab/insole.md.
"""

from __future__ import annotations

import json

import numpy as np
from support.insole import (
    ADC_OFFSET,
    AREA,
    R_REF,
    circuit,
    controls,
    curve,
    fit,
    ratio,
    summary,
    touched,
)

from .. import harness


def draw(frame: np.ndarray, row: np.ndarray, col: np.ndarray, path) -> None:
    """One frame in the insole's geometry: as read, and after the fit."""
    from matplotlib import pyplot as plt

    mask = frame >= 0
    cells = curve()
    skin = circuit(mask)
    estimate, _ = fit(frame, skin, cells)
    naive = cells.force(skin.two_terminal(ratio(np.maximum(frame, 1))))
    naive = np.where(frame > 0, naive, 0.0)
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 6), layout="constrained")
    for axis, force, title in (
        (axes[0], naive, "each reading taken for its own cell"),
        (axes[1], estimate.force, "after map"),
    ):
        pressure = force / AREA / 1e3  # kPa
        image = np.where(row >= 0, pressure[row, col], np.nan)
        shown = axis.imshow(image, vmin=0.0, vmax=float(np.nanquantile(image, 0.95)))
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
        figure.colorbar(shown, ax=axis, shrink=0.6, label="pressure [kPa]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("frames")
    parser.add_argument("--picture", help="also draw one frame before and after, to this file")
    parser.add_argument("--controls", type=int, default=40, help="frames for the controls")
    parser.add_argument("--offset", type=float, default=ADC_OFFSET, help="counts, of the ADC")
    parser.add_argument("--r-ref", type=float, default=R_REF, help="ohm, of the divider")
    args = parser.parse_args(arguments)
    with np.load(args.frames) as data:
        frames, row, col, recording = (data[n] for n in ("counts", "row", "col", "recording"))
    keep = touched(frames)
    frames, recording = frames[keep], recording[keep]
    skin = circuit(frames[0] >= 0, args.r_ref)
    if args.picture:
        draw(frames[(frames > 0).sum((1, 2)).argsort()[len(frames) // 2]], row, col, args.picture)
    for name in np.unique(recording):
        found = summary(frames[recording == name], skin, args.offset)
        print("recording", name, json.dumps(found), flush=True)
    if args.controls:
        some = frames[:: max(len(frames) // args.controls, 1)]
        for name, result in controls(some, row, col).items():
            print(name, json.dumps(result), flush=True)


if __name__ == "__main__":
    harness.run(main)
