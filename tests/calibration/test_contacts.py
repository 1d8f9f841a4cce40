"""A reading that is set aside again and again is told; one that a touch sets aside is not."""

import numpy as np

from tactile_skin.calibration.watch.contacts import Contacts

FRAMES = 100  # a second


def aside(row=2, col=5):
    cells = np.zeros((4, 8), bool)
    cells[row, col] = True
    return cells


def run(contacts, frames, ends=True) -> str:
    for cells in frames:
        contacts.frame(cells)
    if ends:
        contacts.end_second()
    return contacts.message


def test_one_of_half_of_the_last_frames_is_told_at_once():
    contacts = Contacts()
    assert not run(contacts, [aside(), None] * 9, ends=False)
    assert run(contacts, [aside(), None], ends=False).startswith("row 2, column 5: reads less")
    assert run(contacts, [aside()] * 30), "it stays while it lasts"
    assert not run(contacts, [None] * FRAMES), "and goes with it"


def test_one_of_a_few_frames_is_told_in_the_second_second():
    contacts, few = Contacts(), [aside(), *[None] * 24] * 4
    assert not run(contacts, few) and "row 2, column 5: 4 times" in contacts.summary
    assert "row 2, column 5" in run(contacts, few)


def test_what_a_touch_sets_aside_as_it_comes_is_not():
    contacts = Contacts()
    for col in range(8):  # each touch elsewhere
        assert not run(contacts, [aside(col=col)] * 6 + [None] * (FRAMES - 6))


def test_several_at_once_are_not_added_up():
    contacts = Contacts()
    assert not run(contacts, [aside(k % 4, k % 8) for k in range(FRAMES)])
