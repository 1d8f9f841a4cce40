# SPDX-License-Identifier: Apache-2.0
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
_PAGES = [_DOCS / "lab" / f"{name}.md" for name in ("accuracy", "bench", "gestures")]


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


def gestures(figures: dict) -> list[str]:
    """A Markdown table of how many recorded gestures are named right by each method's pictures."""
    kinds = dict.fromkeys(name.rsplit(", ", 1)[0] for name in figures)
    methods = dict.fromkeys(name.rsplit(", ", 1)[1] for name in figures)
    rows = [f"| | {' | '.join(f'`{m}`' for m in methods)} |", "|---" * (len(methods) + 1) + "|"]
    for kind in kinds:
        found = (figures.get(f"{kind}, {method}") for method in methods)
        cells = (f"{f[0]:.3f} ± {f[1]:.3f}" if f else "" for f in found)
        rows.append(f"| {kind} | {' | '.join(cells)} |")
    return rows


def decided(figures: dict) -> list[str]:
    """A Markdown list of how soon gestures are named, and of what is named wrongly."""
    return [
        f"- {part}{', ' + kind if kind else ''}: "
        + ", ".join(f"{name} {value:.3g}" for name, value in found.items())
        for part, parts in figures.items()
        for kind, found in (parts.items() if _nested(parts) else [("", parts)])
        if found
    ]


def _nested(parts: dict) -> bool:
    return any(isinstance(value, dict) for value in parts.values())


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
        "gesture study": "\n".join(gestures(read("gestures")["figures"])),
        "gesture decisions": wrapped(decided(read("gesture_decisions")["figures"])),
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
