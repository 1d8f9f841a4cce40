"""A run in words, with its numbers: what to choose when, and what fails unreported.

README and docs/bench.md hold these lines for the run whose pictures they show:

    python -m tactile_skin.bench.choose docs/bench README.md docs/bench.md

puts them there, between comments that name them; a test says when they are old.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from pathlib import Path

from .stability import SILENT


def lines(speed: dict) -> list[str]:
    """A Markdown table from a run's figure "speed": `scan` readings, blobs and rects."""
    at = {p["method"]: p for p in speed["readouts"]["scan"]}
    exact = {p["method"]: p for p in speed["readouts"]["ideal"]}
    day = speed["day"]

    def row(method: str, use: str, point: dict | None = None) -> str:
        p = point or at[method]
        error = f"{p['mean_g']:.{0 if p['mean_g'] >= 100 else 1}f}"
        return f"| `{method}` | {use} | {error} | {p['p50_ms']:.1f} | {p['p99_ms']:.1f} |"

    return [
        "| method | use it for | mean error [g a cell] | p50 [ms] | p99 [ms] |",
        "|---|---|---|---|---|",
        row(
            "auto",
            "a robot: reports readings that it does not trust. Times are of frames with a touch; "
            f"over a simulated day a frame takes {day['mean_ms']:.1f} ms on average",
        ),
        row(
            "map",
            "single frames, missing readings, prior knowledge of your own; gives a standard "
            "deviation for each cell",
        ),
        row("newton", "exact readings, from a simulation or a laboratory meter", exact["newton"]),
        row("newton", "the same on a noisy board"),
        row(
            "physics",
            "a fast picture, not a stop: needs weights for your board, and detects "
            "only lines that read what no skin can",
        ),
        *(row(method, "comparison") for method in ("cnn", "fixed_point", "naive")),
    ]


def silent(stability: dict) -> list[str]:
    """A line of Markdown for each trouble that a running skin is silent about, worst first."""
    found = []
    for trouble in stability["troubles"]:
        shares = trouble["running"]["silent"]
        at = [k for k, share in enumerate(shares) if share > SILENT]
        if at:
            where = ", ".join(f"{trouble['strengths'][k]:g} ({100 * shares[k]:.0f} %)" for k in at)
            name = f"{trouble['trouble']} [{trouble['unit']}]"
            found.append((max(shares), f"- {name}: {where}: {trouble['reason']}"))
    return [line for _, line in sorted(found, key=lambda pair: -pair[0])]


def compared(stability: dict) -> list[str]:
    """A Markdown table of what single frames in trouble make of each method."""
    shares = sorted(stability["methods"].items(), key=lambda pair: pair[1]["silent"])
    return [
        "| method | mean error [g a cell] | frames that fail | of all frames silent |",
        "|---|---|---|---|",
        *(
            f"| `{method}` | {of['mean_g']:.0f} | {of['fails']:.0%} | {of['silent']:.0%} |"
            for method, of in shares
        ),
    ]


def blocks(run: Path) -> dict[str, str]:
    """Name -> Markdown of what a page may hold of the run whose figures lie in a folder."""

    def read(name: str) -> dict:
        return json.loads((run / f"{name}.json").read_text())

    def wrapped(items: list[str]) -> str:
        wrap = textwrap.TextWrapper(
            100, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False
        )
        return "\n".join(wrap.fill(item) for item in items)

    return {
        "which method": "\n".join(lines(read("speed"))),
        "silent failures": wrapped(silent(read("stability"))),
        "methods in trouble": "\n".join(compared(read("stability"))),
    }


def fill(text: str, found: dict[str, str]) -> str:
    """The page with each block between <!-- NAME --> and <!-- end --> replaced."""
    for name, block in found.items():
        between = re.compile(f"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = between.sub(lambda match, block=block: f"{match[1]}{block}\n{match[2]}", text)
    return text


def main(run: str, *pages: str) -> None:
    for page in map(Path, pages):
        page.write_text(fill(page.read_text(), blocks(Path(run))))


if __name__ == "__main__":
    main(*sys.argv[1:])
