# SPDX-License-Identifier: Apache-2.0
"""Lines that name the row, the column or the reading that they hold, as strangers print them."""

import json

import numpy as np
import pytest
from support.strangers import boards
from test_formats import SHAPE, pictures, read

from tactile_skin.board.recognise import recognise


def joined(a) -> str:
    return ",".join(map(str, a.ravel()))


def _each_row(write):
    return lambda a, k: "".join(write(r, row.tolist(), k) for r, row in enumerate(a))


def _each_cell(write):
    return lambda a, k: "".join(write(*at, int(a[at])) for at in np.ndindex(a.shape))


PLACED = {  # rows and readings with their places, as objects or in words
    "objects": _each_row(lambda r, row, k: json.dumps({"row": r, "v": row}) + "\n"),
    "objects with a time": _each_row(
        lambda r, row, k: json.dumps({"t": 50 * k, "r": r + 1, "v": row}) + "\n"
    ),
    "objects of a cell": _each_cell(lambda r, c, v: json.dumps({"r": r, "c": c, "v": v}) + "\n"),
    "words": _each_cell(lambda r, c, v: f"Row: {r} Col: {c} Value: {v}\r\n"),
    "names": _each_cell(lambda r, c, v: f"row={r}, col={c}, value={v}\n"),
    "a pair": _each_cell(lambda r, c, v: f"({r}, {c}): {v}\n"),
    "columns": lambda a, k: "".join(f"C{c}: {joined(col)}\n" for c, col in enumerate(a.T)),
    "letters": lambda a, k: (
        "".join(f"{n}: {joined(r)}\n" for n, r in zip("ABCDEF", a, strict=True)) + "\n"
    ),
}


@pytest.mark.parametrize("kind", PLACED)
def test_places_that_have_names_are_read(kind):
    right = pictures()
    data = boards.sent(PLACED[kind], right)[11:]
    seen = recognise(data, SHAPE)
    assert seen.sure and seen.shape == SHAPE, seen
    np.testing.assert_array_equal(read(data, seen), right[1:])
    assert kind in ("columns", "letters") or recognise(data).sure


def test_lines_of_two_mats_are_never_sure_to_be_rows():
    right = pictures()
    data = boards.sent(lambda a, k: f"L: {joined(a)}\nR: {joined(a[::-1])}\n", right)
    for known in (None, SHAPE):
        seen = recognise(data, known)
        assert not seen.sure and "L: R: may begin" in seen.about
    assert seen.format.line == "R: {values}"
