# SPDX-License-Identifier: Apache-2.0
"""How every figure looks, and how it gets into its file with the numbers that it shows."""

from __future__ import annotations

import json
import re
from pathlib import Path

from ..extras import load

# Colour, marker and line of each method; apart by marker and dashes also in grey.
STYLES = {
    "naive": ("#8a8a8a", "X", (0, (1, 1.2))),
    "fixed_point": ("#56b4e9", "v", (0, (4, 1.5, 1, 1.5))),
    "newton": ("#009e73", "s", (0, (6, 2))),
    "map": ("#0072b2", "D", "-"),
    "cnn": ("#d55e00", "o", (0, (3, 1))),
    "physics": ("#cc79a7", "P", (0, (5, 1, 1, 1, 1, 1))),
    "auto": ("#111111", "*", "-"),
}
# fixed_point and newton, map and auto often coincide: the first is hollow or larger beneath
_HOLLOW = ("newton", "map")
_SIZES = {"fixed_point": 1.5, "newton": 0.8, "map": 1.6, "auto": 1.3}
_DPI = 100  # 9 inches wide: 900 pixels, as README shows it


def style(method: str, size: float = 7.0) -> dict:
    """Keyword arguments of `plot` for a method's line."""
    colour, marker, dashes = STYLES[method]
    hollow = method in _HOLLOW
    return {
        "color": colour,
        "marker": marker,
        "linestyle": dashes,
        "linewidth": 1.3,
        "markersize": size * _SIZES.get(method, 1.0),
        "markerfacecolor": "white" if hollow else colour,
        "markeredgecolor": colour if hollow else "white",
        "markeredgewidth": 1.3 if hollow else 0.5,
    }


def prepare() -> None:
    """Import matplotlib, for files only.

    Raises:
        ModuleNotFoundError: it is not installed; the message names the extra.
    """
    matplotlib = load("matplotlib", "charts are drawn by matplotlib", "charts")
    matplotlib.use("Agg")
    matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})


def write(out: Path, name: str, data: dict, draw) -> None:
    """NAME.json, then NAME.png drawn from what stands in that file: they cannot differ."""
    from matplotlib import pyplot as plt

    path = out / f"{name}.json"
    path.write_text(_as_text(data))
    figure = draw(json.loads(path.read_text()))
    machine = data["machine"]
    line = 0.14 / figure.get_figheight()  # of the page, kept free for the text
    figure.get_layout_engine().set(rect=(0.0, line, 1.0, 1.0 - line))
    figure.text(
        0.995,
        0.2 * line,
        f"seed {data['seed']}, {machine['processor']}, {machine['cores']} cores, "
        f"numpy {machine['numpy']}, scipy {machine['scipy']}, kernel {machine['kernel']}"
        f"{', quick' * data['quick']}",
        ha="right",
        fontsize=6.5,
        color="#777777",
    )
    figure.savefig(out / f"{name}.png", dpi=_DPI)
    plt.close(figure)


def _as_text(data: dict) -> str:
    """JSON with each innermost list of numbers on one line."""
    text = json.dumps(data, indent=1)
    return re.sub(r"\[[^][{}\"]*\]", lambda m: " ".join(m[0].split()), text) + "\n"
