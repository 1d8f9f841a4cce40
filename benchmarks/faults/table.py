# SPDX-License-Identifier: Apache-2.0
"""What `reliability` counted, as tables and as a picture."""

from __future__ import annotations

import numpy as np
from support.lab.board import KNOTS

_COLUMNS = ("failing", "silent", "pushes", "missed", "let go", "free", "to stop [s]", "held")


def table(data: dict) -> str:
    """A Markdown table for each shape, and one of the sound boards.

    failing, silent: % of the frames; missed, let go: pushes; free: % of the frames from 0.3 s after
    the fault's begin on; to stop: median and longest time to a stop that no push asked for, and how
    many streams had none; held: streams in which dead data held the robot stopped throughout.
    """
    lines = []
    for shape in dict.fromkeys(row["shape"] for row in data["faults"]):
        rows = [row for row in data["faults"] if row["shape"] == shape]
        lines += [f"### {shape}", "", _line("fault", *_COLUMNS), "|---" + "|---:" * 8 + "|"]
        lines += [_line(_name(row), *cells(row)) for row in rows]
        lines += [_line("together", *cells(_together(rows))), ""]
    if data["sound"]:
        lines += ["### sound boards", "", _line(*_SOUND_COLUMNS), "|---|---" + "|---:" * 8 + "|"]
        lines += [_line(row["shape"], _board(row), *_sound_cells(row)) for row in data["sound"]]
        given = _sum([row for row in data["sound"] if row["noise_given"]])
        lines += [_line("together", "noise given", *_sound_cells(given)), ""]
    return "\n".join(lines)


def _line(*words) -> str:
    return f"| {' | '.join(str(word) for word in words)} |"


def _name(row: dict) -> str:
    return row["fault"] + " (text)" * (row["protocol"] == "text")


def cells(row: dict) -> list[str]:
    """The numbers of one row, as text, in the order of the columns."""
    times = [t for t in row["to_stop"] if t is not None]
    never = len(row["to_stop"]) - len(times)
    to_stop = f"{np.median(times):.1f}, {max(times):.1f}" if times else "-"
    frames = max(1, row["frames"])
    return [
        f"{100 * row['failing'] / frames:.1f}",
        f"{100 * row['silent'] / frames:.1f}",
        str(row["pushes"]),
        str(row["missed"]),
        str(row["let_go"]),
        f"{100 * row['free'] / frames:.0f}",
        to_stop + (f"; never {never}" if never else ""),
        f"{sum(row['held'])} of {len(row['held'])}" if row.get("must_stop", True) else "",
    ]


def _sum(rows: list[dict]) -> dict:
    """The sums of what can be summed up."""
    keys = [key for key, value in rows[0].items() if type(value) in (int, list)]
    return {key: sum((row[key] for row in rows), type(rows[0][key])()) for key in keys}


def _together(rows: list[dict]) -> dict:
    dead = [row for row in rows if row["must_stop"]]
    return _sum(rows) | {
        "must_stop": bool(dead),
        "held": [held for row in dead for held in row["held"]],
    }


_SOUND_COLUMNS = (
    "shape",
    "board",
    "minutes",
    "touches",
    "false stops",
    "an hour",
    "stopped %",
    "failing %",
    "silent %",
    "missed",
)


def _board(row: dict) -> str:
    given = "" if row["noise_given"] else ", noise not given"
    return f"{row['protocol']}, {row['readout']}, {row['noise']:g} steps{given}"


def _sound_cells(row: dict) -> list[str]:
    frames = max(1, row["frames"])
    hours = frames / KNOTS / 3600.0
    return [
        f"{60 * hours:.1f}",
        str(row["touches"]),
        str(row["false_stops"]),
        f"{row['false_stops'] / hours:.0f}",
        f"{100 * row['stopped'] / frames:.2f}",
        f"{100 * row['failing'] / frames:.2f}",
        f"{100 * row['silent'] / frames:.2f}",
        f"{row['missed']} of {row['pushes']}",
    ]


def draw(data: dict):
    """Fault times shape: the share of frames that fail silently, and the pushes missed."""
    from matplotlib import pyplot as plt

    shapes = list(dict.fromkeys(row["shape"] for row in data["faults"]))
    names = list(dict.fromkeys(_name(row) for row in data["faults"]))
    figure, axis = plt.subplots(figsize=(9.0, 2.0 + 0.17 * len(names)), layout="constrained")
    for row in data["faults"]:
        x, y = shapes.index(row["shape"]), names.index(_name(row))
        silent = row["silent"] / max(1, row["frames"])
        missed = row["missed"] > 0
        shade = _MISSED if missed else plt.get_cmap("YlOrBr")(min(1.0, 4.0 * silent))
        axis.add_patch(plt.Rectangle((x, y), 1, 1, facecolor=shade, edgecolor="white"))
        words = f"{100 * silent:.1f} %" if silent >= 0.0005 else ""
        words += f"  {row['missed']} of {row['pushes']}" if missed else ""
        axis.text(x + 0.5, y + 0.5, words, ha="center", va="center", fontsize=6.5,
                  color="white" if missed or silent > 0.15 else "black")  # fmt: skip
    axis.set_xlim(0, len(shapes))
    axis.set_ylim(len(names), 0)
    axis.set_xticks(np.arange(len(shapes)) + 0.5, shapes, fontsize=9)
    axis.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=7)
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    for spine in axis.spines.values():
        spine.set_visible(False)
    figure.suptitle("frames that fail unreported; red: pushes missed, of how many", fontsize=9)
    return figure


_MISSED = "#8c2d3c"
