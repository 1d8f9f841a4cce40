# SPDX-License-Identifier: Apache-2.0
"""Findings are equal by their cause, and have words."""

import string

import pytest

from tactile_skin.findings.finding import WORDS, Finding, Kind, Severity, at, lines, place

GIVEN = {"at", "line", "across", "bits", "detail"}  # by the finding itself


def example(kind: str, form: str) -> Finding:
    """A finding with a number for each that its words mention."""
    fields = {name for text in WORDS[kind, form] for _, name, *_ in string.Formatter().parse(text)}
    numbers = dict.fromkeys(fields - GIVEN - {None, "settings"}, 3.0) | {"settings": "a: 1"}
    return Finding(Kind(kind), form, rows=(2,), numbers=numbers, detail="why")


@pytest.mark.parametrize(("kind", "form"), WORDS)
def test_each_kind_is_said_with_its_numbers(kind, form):
    text = str(example(kind, form))
    assert "{" not in text
    assert ".." not in text
    assert text.endswith((".", "?")) or not WORDS[kind, form].remedy


def test_every_kind_has_words_and_others_are_refused():
    assert {kind for kind, _ in WORDS} == {kind.value for kind in Kind}
    with pytest.raises(KeyError):
        Finding(Kind.STUCK, "nowhere")


def test_findings_are_equal_whatever_their_numbers_are():
    one, later = (Finding(Kind.ALL_CELLS, "", numbers={"share": n}) for n in (3.0, 4.0))
    assert one == later and str(one) != str(later)
    assert one != Finding(Kind.ALL_CELLS, "", severity=Severity.FAULT, numbers={"share": 3.0})


def test_faults_come_first_and_then_what_the_board_sends():
    found = [
        Finding(Kind.STUCK, "constant", **at((2, 5)), numbers={"force": 1.0, "seconds": 1.0}),
        Finding(Kind.ZEROS, detail="zeros"),
        Finding(Kind.SWAPPED, "live", severity=Severity.FAULT, **lines(0, 1), numbers={"other": 2}),
    ]
    kinds = [f.kind for f in sorted(found, key=lambda f: f.rank)]
    assert kinds == [Kind.SWAPPED, Kind.ZEROS, Kind.STUCK]


@pytest.mark.parametrize(
    ("rows", "cols", "said"),
    [
        ((3,), (), "row 3"),
        ((), (1, 4), "columns 1 and 4"),
        ((2, 5), (7, 3), "row 2, column 7 and row 5, column 3"),
        ((), tuple(range(9)), "columns 0 and 1 and 2 and 6 more"),
    ],
)
def test_places_have_names(rows, cols, said):
    assert place(rows, cols) == said
