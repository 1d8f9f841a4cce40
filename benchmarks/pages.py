"""Fills the pages that hold a run's figures: what to choose when, what fails unreported.

    python -m benchmarks.pages [--run docs/bench] [PAGE ...]

puts the lines of the run whose figures lie in a folder between comments that name them; a test says
when they are old.
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path

from tactile_skin.bench import speed, stability
from tactile_skin.simulation.scenes import FAMILIES

from . import harness

_DOCS = Path(__file__).parents[1] / "docs"
_PAGES = [_DOCS / "lab" / "accuracy.md", _DOCS / "lab" / "bench.md"]


def paper(figures: dict) -> list[str]:
    """A Markdown table of the paper's own families, by its readings (exact) and a noisy board's."""
    readouts = figures["readouts"]
    rows = []
    for method in speed.USES:
        (index,) = (k for k, p in enumerate(readouts["scan"]) if p["method"] == method)
        errors = [
            speed.grams(readouts[readout][index]["families"][family]["mean_g"])
            for readout in ("ideal", "scan")
            for family in FAMILIES
        ]
        rows.append(f"| `{method}` | {' | '.join(errors)} |")
    names = [f"{family}, {word}" for word in ("exact", "noisy") for family in FAMILIES]
    return [f"| method | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|", *rows]


def compared(figures: dict) -> list[str]:
    """A Markdown table of what single frames in trouble make of each method."""
    shares = sorted(figures["methods"].items(), key=lambda pair: pair[1]["silent"])
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
        "which method": "\n".join(speed.choice(read("speed"))),
        "paper's families": "\n".join(paper(read("speed"))),
        "silent failures": wrapped(stability.silent(read("stability"))),
        "methods in trouble": "\n".join(compared(read("stability"))),
    }


def fill(text: str, found: dict[str, str]) -> str:
    """The page with each block between <!-- NAME --> and <!-- end --> replaced."""
    for name, block in found.items():
        between = re.compile(f"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = between.sub(lambda match, block=block: f"{match[1]}{block}\n{match[2]}", text)
    return text


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--run", type=Path, default=_DOCS / "bench", help="folder of the figures")
    parser.add_argument("pages", nargs="*", type=Path, default=_PAGES, metavar="PAGE")
    given = parser.parse_args(arguments)
    for page in given.pages:
        page.write_text(fill(page.read_text(), blocks(given.run)))


if __name__ == "__main__":
    harness.run(main)
