# SPDX-License-Identifier: Apache-2.0
"""A mat that is smaller than its board: the mask leaves out lines at the edges of each frame."""

import numpy as np
import pytest

from tactile_skin.board.frame import Frame
from tactile_skin.middleware.config import adc_of, circuit_of, part_of
from tactile_skin.parameters.shared import Circuit

EDGES = "0000 0110 0111 0000"


def test_lines_without_a_cell_are_no_part_of_the_circuit():
    given = Circuit(rows=4, cols=4, mask=EDGES, scanned=EDGES)
    circuit = circuit_of(given)
    assert circuit.shape == (2, 3)
    assert circuit.populated.tolist() == [[True, True, False], [True, True, True]]
    assert adc_of(given).circuit.shape == (2, 3)


def test_a_frame_is_cut_to_it():
    part = part_of(Circuit(rows=4, cols=4, mask=EDGES))
    samples = np.arange(16, dtype=np.uint16).reshape(4, 4)
    frame = Frame(samples, 10, 0, None, samples > 9).only(part.of)
    assert frame.samples.tolist() == [[5, 6, 7], [9, 10, 11]]
    assert frame.unread.tolist() == [[False] * 3, [False, True, True]]


@pytest.mark.parametrize("mask", ["", "11 11", "1 1 1"])
def test_of_another_mask_it_is_all_of_it(mask):
    part = part_of(Circuit(rows=2, cols=2, mask=mask))
    assert part == ((2, 2), (0, 1), (0, 1))


def test_lines_are_put_in_the_order_of_the_skin_and_the_mask_is_of_the_skin():
    given = Circuit(rows=2, cols=4, column_order="1 3 2 0", mask="1110 1110")
    part, frames = part_of(given), np.arange(16).reshape(2, 2, 4)
    assert part.of(frames).tolist() == [[[1, 3, 2], [5, 7, 6]], [[9, 11, 10], [13, 15, 14]]]
    recorded = part.of(frames)  # in this order already
    assert part.within(part).of(recorded).tolist() == recorded.tolist()
    again = part_of(Circuit(rows=2, cols=4, column_order="3 1 2 0", mask="1110 1110"))
    assert again.within(part).of(recorded)[0].tolist() == [[3, 1, 2], [7, 5, 6]]


@pytest.mark.parametrize("order", ["0 1", "0 1 2 2", "0 1 2 x", "1 2 3 4"])
def test_an_order_names_each_line_once(order):
    with pytest.raises(ValueError, match=r"circuit.row_order = .*: must name each of 0 to 3 once"):
        part_of(Circuit(rows=4, cols=4, row_order=order))


def test_lines_between_must_have_cells():
    with pytest.raises(ValueError, match="must connect all rows and columns"):
        circuit_of(Circuit(rows=3, cols=2, mask="11 00 11"))
