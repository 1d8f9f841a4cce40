"""A run in words, with its numbers: what to choose when, and what fails unreported.

docs/lab/accuracy.md and docs/lab/bench.md hold these lines for the run whose pictures they show:

    python -m tactile_skin.bench.choose docs/bench docs/lab/accuracy.md docs/lab/bench.md

puts them there, between comments that name them; a test says when they are old.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from pathlib import Path

from ..learning.scenes import FAMILIES
from .speed import USES
from .stability import SILENT


def lines(speed: dict) -> list[str]:
    """A Markdown table from a run's figure "speed": what to take, `scan` readings."""
    noisy, exact = ({p["method"]: p for p in speed["readouts"][r]} for r in ("scan", "ideal"))
    rows = []
    day = f". Over a simulated day a frame takes {speed['day']['mean_ms']:.1f} ms on average"
    for method, use in USES.items():
        p = noisy[method]
        what = use.replace("\n", " ") + day * (method == "auto")
        errors = p["mean_g"], p["families"]["pictures"]["mean_g"], exact[method]["mean_g"]
        rows.append(
            f"| `{method}` | {what} | {' | '.join(map(_grams, errors))} "
            f"| {p['p50_ms']:.1f} | {p['p99_ms']:.1f} |"
        )
    return [
        "| method | use it for | error on bodies [g a cell] | on recorded pictures "
        "| on exact readings of bodies | p50 [ms] | p99 [ms] |",
        "|---|---|---|---|---|---|---|",
        *rows,
    ]


def paper(speed: dict) -> list[str]:
    """A Markdown table of the paper's own families, by its readings (exact) and a noisy board's."""
    readouts = speed["readouts"]
    rows = []
    for method in USES:
        (index,) = (k for k, p in enumerate(readouts["scan"]) if p["method"] == method)
        errors = [
            _grams(readouts[readout][index]["families"][family]["mean_g"])
            for readout in ("ideal", "scan")
            for family in FAMILIES
        ]
        rows.append(f"| `{method}` | {' | '.join(errors)} |")
    names = [f"{family}, {word}" for word in ("exact", "noisy") for family in FAMILIES]
    return [f"| method | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|", *rows]


def _grams(mean_g: float) -> str:
    return f"{mean_g:.{0 if mean_g >= 100 else 1}f}"


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
        "paper's families": "\n".join(paper(read("speed"))),
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
