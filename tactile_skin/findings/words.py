# SPDX-License-Identifier: Apache-2.0
"""Says findings by words.csv, whose lines stand in the order in which findings are said."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .finding import Finding

_NAMED = 4  # lines, or cells, that are named one by one


class Words(NamedTuple):
    """How a finding is worded.

    Templates: {at} is the lines or cells, {line} "row" or "column", {detail} and the numbers are
    the finding's.
    """

    where: str
    evidence: str
    remedy: str


def _load() -> dict[tuple[str, str], Words]:
    text = Path(__file__).with_name("words.csv").read_text(encoding="utf-8")
    _, *lines = csv.reader(text.splitlines())
    return {(kind, form): Words(*words) for kind, form, *words in lines}


WORDS = _load()  # (kind, form): words


def _key(finding: Finding) -> tuple[str, str]:
    return finding.kind.value, finding.form


def of(finding: Finding) -> Words:
    """Return the words of a finding's kind and form; KeyError: there are none."""
    return WORDS[_key(finding)]


def rank(finding: Finding) -> int:
    """Return its place in the order in which findings are said."""
    return list(WORDS).index(_key(finding))


def fill(finding: Finding, template: str) -> str:
    """Return a template with a finding's place, numbers and detail."""
    rows, cols = finding.rows, finding.cols
    return template.format(
        at=place(rows, cols),
        line="row" if rows else "column",
        across="column" if rows else "row",
        bits=_bits(rows or cols),
        detail=finding.detail,
        **finding.numbers,
    )


def place(rows: tuple[int, ...], cols: tuple[int, ...]) -> str:
    """Return the name of lines, or of cells if there are as many rows as columns."""
    if rows and cols:
        return _list([f"row {r}, column {c}" for r, c in zip(rows, cols, strict=True)])
    name, lines = ("row", rows) if rows else ("column", cols)
    if len(lines) == 1:
        return f"{name} {lines[0]}"
    return f"{name}s {_list([str(k) for k in lines])}"


def _list(names: list[str]) -> str:
    if len(names) > _NAMED:
        names = [*names[: _NAMED - 1], f"{len(names) - _NAMED + 1} more"]
    return " and ".join(names)


def _bits(lines: tuple[int, ...]) -> str:
    """Return which address bits: lines that differ in one of them only are the first and 2^bit."""
    bits = [str(k.bit_length() - 1) for k in lines[1:]]
    return f"bit{'s' if bits[1:] else ''} {_list(bits)}"
