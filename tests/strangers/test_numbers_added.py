# SPDX-License-Identifier: Apache-2.0
"""Numbers that sketches print next to readings, before anybody says how many those are."""

import pytest
from support.strangers import boards
from test_formats import SHAPE, pictures

from tactile_skin.board.recognise import recognise


def _joined(a) -> str:
    return ",".join(map(str, a.ravel()))


ADDED = {  # to a frame's readings
    "their number": lambda a, k: f"{a.size},{_joined(a)}",
    "a constant behind": lambda a, k: f"{_joined(a)},255",
    "the largest": lambda a, k: f"{_joined(a)},{a.max()}",
    "the largest in front": lambda a, k: f"{a.max()},{_joined(a)}",
    "the mean": lambda a, k: f"{_joined(a)},{int(a.mean())}",
    "the sum in front": lambda a, k: f"{a.sum()},{_joined(a)}",
    "the largest, the sum": lambda a, k: f"{_joined(a)},{a.max()},{a.sum()}",
    "a checksum": lambda a, k: f"{_joined(a)},{a.sum() % 256}",
    "a toggle": lambda a, k: f"{k % 2},{_joined(a)}",
    "a toggle in an object": lambda a, k: f'{{"n":{k % 2},"d":[{_joined(a)}]}}',
}


@pytest.mark.parametrize("shape", [SHAPE, (4, 4), (8, 8)])
@pytest.mark.parametrize("kind", ADDED)
def test_a_number_that_no_cell_reads_is_never_surely_one(kind, shape):
    for n, seed in ((12, 0), (12, 1), (40, 2)):
        right = pictures(n, shape, seed)
        seen = recognise(boards.sent(lambda a, k: ADDED[kind](a, k) + "\n", right))
        assert not seen.sure or seen.cells == right[0].size, seen
        assert recognise(boards.sent(boards.frame_a_line, right)).sure


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("shape", [SHAPE, (4, 4)])
def test_a_number_behind_a_numbered_row_is_never_surely_a_column(shape, known):
    for behind in (sum, max, len):
        data = boards.sent(
            lambda a, k, of=behind: "".join(
                f"{r},{_joined(row)},{of(row)}\n" for r, row in enumerate(a)
            ),
            pictures(30, shape),
        )
        assert not recognise(data, shape if known else None).sure
