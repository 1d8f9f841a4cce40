# SPDX-License-Identifier: Apache-2.0
"""A line that opens again and again stops the robot; one that opens once or twice does not."""

import numpy as np
import pytest
from health.test_skin import CIRCUIT, PUSH, Board

NOTHING = np.zeros(CIRCUIT.shape)
ROW, OTHER = 3, 5


@pytest.fixture
def board():
    """One that has rested; it is a skin that knows its rest."""
    board = Board()
    board.feel(NOTHING, 200)
    return board


def opens(board, row=ROW, frames=6, force=NOTHING):
    """Feel a row without a lead for too few frames to be a fault, and then one that is sound."""
    board.feel(force, frames, broken=row)
    assert board.skin.findings() and not board.skin.fault
    board.feel(force, 100)


def test_the_third_time_is_a_fault_until_it_has_not_come_back_for_10_s(board):
    opens(board)
    opens(board)
    assert not board.skin.fault
    board.feel(NOTHING, 6, broken=ROW)
    board.feel(NOTHING, 100)
    assert board.skin.fault
    (found,) = (str(f) for f in board.skin.findings() if f.stops)
    assert found.startswith(f"row {ROW}: opened 3 times within 10 s. Press the connector on")
    board.feel(PUSH, 100)
    assert board.skin.fault
    board.feel(NOTHING, 900)
    assert not board.skin.fault


def test_a_person_who_checked_it_ends_it(board):
    for _ in range(3):
        board.feel(NOTHING, 6, broken=ROW)
        board.feel(NOTHING, 50)
    assert board.skin.fault
    board.skin.reset()
    assert not board.skin.fault


def test_once_each_of_three_lines_is_no_loose_lead(board):
    for row in (1, ROW, OTHER):
        opens(board, row)
    assert not board.skin.fault


@pytest.mark.parametrize(("closed", "counts"), [(8, False), (11, True)])
def test_a_tenth_of_a_second_apart_they_are_two_times(board, closed, counts):
    """Closed for 80 ms between two times it only chatters; for 110 ms it has come back."""
    for _ in range(4):
        board.feel(NOTHING, 1, broken=ROW)
        board.feel(NOTHING, closed)
    assert board.skin.fault == counts


def test_a_contact_that_chatters_for_a_moment_opens_once(board):
    for _ in range(4):
        board.feel(NOTHING, 1, broken=ROW)
        board.feel(NOTHING, 1)
    assert not board.skin.fault
