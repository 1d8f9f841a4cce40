# SPDX-License-Identifier: Apache-2.0
"""Dead data look like frames: each fault does what it says."""

import numpy as np
import pytest
from support import faulty
from support.faulty import SHAPE, board_of, frames, pressed
from support.lab.board import KNOTS
from support.lab.damage import ELECTRICAL

from benchmarks.faults.data import DATA
from benchmarks.faults.reliability import FAULTS


def fault_of(name: str):
    return faulty.named(FAULTS, name)


def samples(name: str, seconds=0.5, **kinds) -> np.ndarray:
    return faulty.samples(fault_of(name), seconds, **kinds)


def test_names_are_unique_and_each_fault_says_what_it_is():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 60
    assert all(fault.about for fault in FAULTS)


def test_dead_samples_stand_still():
    assert np.ptp(samples("frozen scan"), 0).max() == 0.0
    assert np.ptp(samples("frozen scan", protocol="text"), 0).max() == 0.0
    assert np.ptp(samples("ADC stuck at 40 %")[20:]) == 0.0
    rows = np.ptp(samples("one row frozen"), 0).max(1) == 0.0
    assert rows.sum() == 1
    assert (np.ptp(samples("half of the rows frozen"), 0).max(1) == 0.0).sum() == 2
    thawed = samples("frozen for 2 s", 2.5)
    assert np.ptp(thawed[:190], 0).max() == 0.0 and np.ptp(thawed[205:], 0).max() > 0.0


def test_a_ring_repeats_itself():
    ring = samples("ring of 5")
    np.testing.assert_array_equal(ring[5:], ring[:-5])
    assert np.ptp(ring, 0).max() > 0.0
    board = board_of()
    board.advance(np.zeros((KNOTS, *SHAPE)))
    fault_of("ring of 20, whole").damage(board)
    numbers = [frame.sequence for _, frame in frames(board, pressed(0.5))]
    assert numbers[20:] == numbers[:-20] and len(set(numbers)) == 20


def test_numbers_and_times_go_where_the_fault_says():
    def after(name):
        board = board_of()
        board.advance(np.zeros((2 * KNOTS, *SHAPE)))
        fault_of(name).damage(board)
        found = [frame for _, frame in frames(board, pressed(1.5))]
        return (np.array([getattr(f, key) for f in found]).astype(np.int64) for key in
                ("sequence", "device_time_us"))  # fmt: skip

    number, time = after("number backward")
    assert (np.diff(number) % 65536 == 65535).all() and (np.diff(time) > 0).all()
    number, time = after("both backward")
    assert (np.diff(number) % 65536 == 65535).all() and (np.diff(time) < 0).all()
    number, time = after("time stands still")
    assert (np.diff(number) == 1).all() and (np.diff(time) == 0).all()
    _, time = after("time at half pace")
    assert np.diff(time).mean() == pytest.approx(5000, rel=0.02)
    number, time = after("restart every 0.5 s")
    assert (number == 0).sum() == 3 and time.max() < 520_000


def test_the_link_loses_damages_and_delays():
    def share(name, **kinds):
        return len(samples(name, 2.0, **kinds)) / 200

    assert share("60 % lost") == pytest.approx(0.4, abs=0.1)
    assert share("every 8th frame") == pytest.approx(0.125, abs=0.02)
    assert share("50 % corrupt") == pytest.approx(0.5, abs=0.1)
    assert share("50 % corrupt", protocol="text") == pytest.approx(0.5, abs=0.1)
    board = board_of()
    board.pushes = [(1.0, 4.0)]
    fault_of("backlog, fast").damage(board)
    times = np.array([t for t, _ in frames(board, pressed(4.0))])
    gap = np.diff(times).argmax()
    assert len(times) >= 399 and (np.diff(times) > 0).all()
    assert 0.3 <= np.diff(times)[gap] <= 2.6 and np.diff(times)[gap + 1] < 1e-3


@pytest.mark.parametrize("fault", [*ELECTRICAL, *DATA], ids=lambda fault: fault.name)
def test_every_fault_happens_on_the_smallest_skins(fault):
    for shape in ((2, 2), (1, 8)):
        for kind in fault.protocols:
            board = board_of(shape, protocol=kind)
            force = np.full((20, *shape), 1.0)
            board.advance(force)
            fault.damage(board)
            assert all(isinstance(data, bytes) for _, data in board.advance(force))
