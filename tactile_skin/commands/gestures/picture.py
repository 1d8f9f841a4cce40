# SPDX-License-Identifier: Apache-2.0
"""The picture of an evaluation: what is taken for what, what is named falsely, and how soon."""

from __future__ import annotations

from pathlib import Path

import numpy as np

_DPI = 100
_CELL = 0.42  # inches of a class


def draw(path: Path, label: np.ndarray, named: np.ndarray, soon: list, false: str) -> None:
    """Write the picture of an evaluation.

    Args:
        label: (takes,) name of each gesture.
        named: (takes,) what it was taken for at its end.
        soon: rows of `study.Soon`.
        false: how many false gestures there are.

    Raises:
        ValueError: the file is of a type that matplotlib does not write.
    """
    from matplotlib import pyplot as plt

    from ...parameters.nodes import Gestures

    names = sorted({*label, *named})
    side = max(3.2, _CELL * len(names))
    figure, (matrix, times) = plt.subplots(
        1, 2, figsize=(side + 4.6, side + 0.8), layout="constrained", width_ratios=(side, 3.2)
    )
    row, col = (np.searchsorted(names, values) for values in (label, named))
    count = np.zeros((len(names), len(names)), int)
    np.add.at(count, (row, col), 1)
    share = count / np.maximum(count.sum(1, keepdims=True), 1)
    matrix.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    for r, c in zip(*count.nonzero(), strict=True):
        colour = "white" if share[r, c] > 0.5 else "black"
        matrix.text(c, r, count[r, c], ha="center", va="center", color=colour, fontsize=8)
    matrix.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=9)
    matrix.set_yticks(range(len(names)), names, fontsize=9)
    matrix.set_xlabel("taken for")
    matrix.set_ylabel("gesture")
    matrix.set_title(f"{np.mean(label == named):.1%} of {len(label)} takes are right", fontsize=9.5)
    figure.suptitle(false, fontsize=9.5)
    after = [entry.after for entry in soon]
    for name, colour, line in (("of_all", "#0072b2", "-"), ("right", "#d55e00", "--")):
        text = {"of_all": "of all named", "right": "of these right"}[name]
        values = [getattr(entry, name) for entry in soon]
        times.plot(after, values, line, marker="o", color=colour, label=text)
    times.set_xlabel("after the first touch [s]")
    times.set_ylabel("share")
    times.set_ylim(0.0, 1.02)
    times.set_title(f"sure to {Gestures.min_probability:g}", fontsize=9.5)
    times.grid(alpha=0.25, linewidth=0.6)
    times.legend(fontsize=8.5, frameon=False, loc="lower right")
    try:
        figure.savefig(path, dpi=_DPI)
    finally:
        plt.close(figure)
