"""A run in words, with its numbers: what to choose when, and what fails without a word.

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


def lines(speed: dict) -> list[str]:
    """Five lines of Markdown from a run's figure "speed": `scan` readings, blobs and rects."""
    at = {p["method"]: p for p in speed["readouts"]["scan"]}
    exact = {p["method"]: p for p in speed["readouts"]["ideal"]}

    def of(method: str) -> str:
        return f"{at[method]['mean_g']:.1f} g a cell in {at[method]['p50_ms']:.1f} ms"

    day = speed["day"]
    return [
        f"- `auto` for a robot: {of('auto')} where something touches, {day['mean_ms']:.1f} ms on "
        "average over a day, and it says when it does not believe a reading.",
        f"- `map` for single frames, missing readings or knowledge of your own: {of('map')}, with "
        "a standard deviation for each cell.",
        f"- `newton` for exact readings, from a simulation or a laboratory's meter: the truth in "
        f"{exact['newton']['p50_ms']:.1f} ms; on a noisy board {at['newton']['mean_g']:.0f} g.",
        f"- `physics` where a millisecond counts: {of('physics')}; it needs weights for your "
        "board, and notices only lines that read what no skin can: for a picture, not for a stop.",
        f"- `cnn` ({of('cnn')}), `fixed_point` ({of('fixed_point')}) and `naive` "
        f"({at['naive']['mean_g']:.0f} g) to compare with.",
    ]


def silent(stability: dict, method: str = "auto") -> list[str]:
    """A line of Markdown for each trouble under which the method fails silently, worst first."""
    found = []
    for trouble in stability["troubles"]:
        shares = trouble["methods"][method]["by_strength"]["silent"]
        worst = max(range(len(shares)), key=shares.__getitem__)
        if shares[worst] > 0.0:
            where = f"{trouble['trouble']}, {trouble['strengths'][worst]:g} {trouble['unit']}"
            found.append((shares[worst], f"- {where}: {100 * shares[worst]:.0f} % of the frames"))
    return [line for _, line in sorted(found, key=lambda pair: -pair[0])]


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
        "which method": wrapped(lines(read("speed"))),
        "silent failures": wrapped(silent(read("stability"))),
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
