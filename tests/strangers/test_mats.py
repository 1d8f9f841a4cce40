# SPDX-License-Identifier: Apache-2.0
"""Frames with names: those of several boards that print in turn, and those that change anyhow."""

import json

import numpy as np
import pytest
from support.strangers import boards
from test_formats import BITS, SHAPE, pictures

from tactile_skin.board.formats import make_parser
from tactile_skin.board.recognise import explain, recognise


def _joined(a) -> str:
    return ",".join(map(str, a.ravel()))


def _rows(a) -> str:
    return "".join(f"{_joined(row)}\n" for row in a)


def _row_names(a, name) -> str:
    return "".join(f"{name}{r}: {_joined(row)}\n" for r, row in enumerate(a)) + "\n"


MATS = {  # what is printed of a mat of this name, and the names that are said
    "names": (lambda a, name: f"{name}: {_joined(a)}\n", "L and R"),
    "objects": (lambda a, name: json.dumps({name: a.ravel().tolist()}) + "\n", "L and R"),
    "a name of one": (lambda a, name: f"{name}: "[: 3 * (name > "L")] + f"{_joined(a)}\n", "R"),
    "numbers": (lambda a, name: f"Mat {ord(name) % 5}: {_joined(a)}\n", "Mat 1 and Mat 2"),
    "headings": (lambda a, name: f"{name}\n{_joined(a)}\n", "L and R"),
    "headings of rows": (lambda a, name: f"{name} mat:\n{_rows(a)}\n", "L mat and R mat"),
    "names of rows": (_row_names, "L7 and R7"),
}


@pytest.mark.parametrize("lost", [0.0, 0.02])
@pytest.mark.parametrize("kind", MATS)
def test_two_mats_that_print_in_turn_are_never_read_as_one(kind, lost):
    """Also once the port was opened again, and until one of them is silent."""
    make, said = MATS[kind]
    right, rng = pictures(60, (8, 8)), np.random.default_rng(1)

    def printed(names) -> bytes:
        text = "".join(make(a // (1 + (n == "R")), n) for a in right for n in names)
        return "".join(x for x in text.splitlines(True) if rng.random() >= lost).encode()

    parser = make_parser("text", 8, 8, BITS)
    parser.feed(printed("LR"))
    assert parser.counters.frames < 12
    assert said in explain(parser) and "several mats" in explain(parser)
    again = make_parser("text", 8, 8, BITS)
    again.counters = parser.counters
    assert again.feed(printed("LR")) == []
    assert not recognise(printed("LR"), (8, 8)).sure
    again.feed(printed("R") * 4)
    assert len(again.feed(printed("R"))) > 30


NAMED = {  # names that change for another reason
    "a counter": lambda k, rng: f"Frame {k}: ",
    "a counter of a digit": lambda k, rng: f"Frame {k % 10}: ",
    "a rare word": lambda k, rng: "ok: " * (rng.random() < 0.1),
    "a word now and then": lambda k, rng: f"{rng.choice(['ok', 'slow'])}: ",
    "a word in each fifth line": lambda k, rng: "d: " if k % 5 else "slow: ",
    "a state": lambda k, rng: f"{['open', 'closed'][k // 7 % 2]}: ",
    "a status in each second line": lambda k, rng: "fps: 20\n" * (k % 2),
}


@pytest.mark.parametrize("kind", NAMED)
def test_names_that_change_for_another_reason_cost_no_frames(kind):
    rng = np.random.default_rng(2)
    parser = make_parser("text", *SHAPE, BITS)
    right = np.tile(pictures(), (10, 1, 1))
    parser.feed(boards.sent(lambda a, k: f"{NAMED[kind](k, rng)}{_joined(a)}\n", right))
    assert parser.counters.frames > len(right) - 8
    assert not parser.counters.boards


@pytest.mark.parametrize("front", ["{},", "Mat {}: ", "M{}:"])
@pytest.mark.parametrize("known", [None, SHAPE])
def test_the_numbers_of_two_mats_are_never_surely_those_of_rows_or_frames(front, known):
    def two(a, k) -> str:
        return f"{front.format(0)}{_joined(a)}\n{front.format(1)}{_joined(a[::-1] // 2)}\n"

    assert not recognise(boards.sent(two, pictures()), known).sure
