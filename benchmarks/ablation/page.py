# SPDX-License-Identifier: Apache-2.0
"""The page that `benchmarks.ablation` makes of what it measured."""

from __future__ import annotations

from collections import Counter

from support.lab.board import KNOTS

from .mechanisms import ALL_ON, MECHANISMS, numbers_of, variants
from .streams import DESCRIPTION, FAULT, SOUND_BOARD

_HEAD = """# What each mechanism that doubts readings is worth

Written by `python -m benchmarks.ablation`. Each frame and each stream is played with all mechanisms
on and with one off at a time: every number is *off minus on* of the same data. A mechanism stays if
its row pays for its lines, on sound boards too.
"""
_STREAMS = """
## Streams of bytes through the complete chain

*lines*: of code that is there for it. *spoke*: streams in which it said anything. *silent*: frames
whose picture is wrong while no stage doubts it. *missed*: pushes during which the robot was free.
*let go*: streams that must stop and were not stopped throughout. *stopped*: time stopped for a
fault. Of sound boards *warnings* and *needless*: time with a report, and stopped for a push that is
none; *refused*: frames in doubt. What is positive under *silent* or *missed* the mechanism finds;
what is negative in the columns of sound boards it costs.
"""
_FRAMES = """
## Single frames through `compensate()`

Shares of the frames in points, pooled over families of loads, and over the rest measured or not.
*refused*: in doubt. *silent*: not in doubt, and wrong by 30 g a cell on average. *error*: mean
change [g a cell]. The first line is everything on, in absolute numbers.
"""


def render(data: dict) -> str:
    """Return the page [Markdown] of measured rows; a part without rows is left out."""
    parts = [_HEAD]
    if data["streams"]:
        parts += [_STREAMS, _of_streams(data["streams"])]
    rows = [row for row in data["frames"] if "results" in row]
    if rows:
        parts += [_FRAMES, _of_frames(rows)]
    return "\n".join(parts)


def _table(head: list[str], rows: list[list]) -> str:
    align = ["---"] + ["---:"] * (len(head) - 1)
    lines = [head, align, *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


def _lines_of(variant: str) -> int:
    members = variants(False)[variant]
    return sum(m.lines for m in MECHANISMS if m.name in members)


def _totals(rows: list[dict], variant: str, kinds: tuple[str, ...]) -> Counter:
    """Return the sums of a variant's numbers over streams of these kinds."""
    totals: Counter = Counter()
    for row in rows:
        if row["kind"] in kinds:
            totals.update(numbers_of(row, variant))
    return totals


def _of_streams(rows: list[dict]) -> str:
    damaged, sound = (FAULT, DESCRIPTION), (SOUND_BOARD,)
    on, on_sound = (_totals(rows, ALL_ON, kinds) for kinds in (damaged, sound))
    seconds = on_sound["frames"] / KNOTS
    text = (
        f"Damaged and wrongly described boards: {on['frames']} frames, {on['failing']} wrong, "
        f"{on['silent']} of them silent; {on['missed']} of {on['pushes']} pushes missed; "
        f"{on['lost']} of {sum(row['must_stop'] for row in rows)} streams let go. Sound boards: "
        f"{seconds / 60.0:.0f} minutes, {on_sound['false_stops']} false stops, "
        f"{on_sound['warned'] / KNOTS:.0f} s of warnings, {on_sound['needless'] / KNOTS:.0f} s of "
        f"needless pushes, {on_sound['refused']} of {on_sound['solved']} frames refused.\n\n"
    )
    head = ["off", "lines", "spoke", "silent", "missed", "let go", "stopped [s]",
            "sound: warnings [s]", "false stops", "needless [s]", "refused"]  # fmt: skip
    table = []
    for variant, members in variants(False).items():
        off, off_sound = (_totals(rows, variant, kinds) for kinds in (damaged, sound))
        spoke = sum(bool(members & set(row["spoke"])) for row in rows)

        def change(key, off=off):
            return off[key] - on[key]

        def change_sound(key, off=off_sound):
            return off[key] - on_sound[key]

        changes = [change(key) for key in ("silent", "missed", "lost")]
        changes += [change("stopped") / KNOTS, change_sound("warned") / KNOTS]
        changes += [change_sound("false_stops"), change_sound("needless") / KNOTS]
        changes += [change_sound("refused")]
        table.append([variant, _lines_of(variant), spoke, *changes])
    table.sort(key=lambda line: -line[3])
    return text + _table(head, [line[:3] + [_signed(v) for v in line[3:]] for line in table])


def _signed(value: float) -> str:
    """Return a change, to a tenth; a dot where there is none."""
    if abs(value) < 0.05:
        return "·"
    return f"{value:+d}" if isinstance(value, int) else f"{value:+.1f}"


def _of_frames(rows: list[dict]) -> str:
    cases = list(dict.fromkeys(row["case"] for row in rows))
    head = ["off", "lines", *cases]
    table = [["(all on)", "", *(_cell(rows, ALL_ON, case) for case in cases)]]
    table += [
        [variant, _lines_of(variant), *(_cell(rows, variant, case) for case in cases)]
        for variant in variants(True)
    ]
    text = "A field is *refused / silent / error*.\n\n"
    return text + _table(head, table)


def _cell(rows: list[dict], variant: str, case: str) -> str:
    mine = [row for row in rows if row["case"] == case]
    n = sum(row["n"] for row in mine)
    results = [numbers_of(row, variant) for row in mine]
    base = [row["results"][ALL_ON] for row in mine]

    def points(key):
        first = 0 if variant == ALL_ON else sum(b[key][0] for b in base)
        return 100.0 * (sum(r[key][0] for r in results) - first) / n

    if variant == ALL_ON:
        error = sum(r["median_g"] * row["n"] for r, row in zip(results, mine, strict=True)) / n
        return f"{points('suspect'):.1f} / {points('silent'):.1f} / {error:.1f}"
    error = sum(r["change_g"] * row["n"] for r, row in zip(results, mine, strict=True)) / n
    shares = points("suspect"), points("silent"), error
    if not any(abs(share) >= 0.05 for share in shares):
        return "·"
    return "{:+.1f} / {:+.1f} / {:+.1f}".format(*shares)
