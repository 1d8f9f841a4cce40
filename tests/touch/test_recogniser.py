# SPDX-License-Identifier: Apache-2.0
"""Which touches are one gesture, and when it is named."""

import numpy as np
import pytest

from tactile_skin.touch.episode import FEATURES, SILENCE
from tactile_skin.touch.recogniser import (
    COMMON_PITCH,
    DECIDED,
    ENDED,
    PERIOD,
    STILL,
    Cells,
    Gathering,
    Named,
    Recogniser,
)

PITCH, RATE, SHAPE = 0.018, 100.0, (16, 16)


class Walks:
    """Stands for a model: a touch whose centre goes far is a stroke."""

    classes = ("press", "stroke")

    def __init__(self, sure: float = 0.95):
        self.sure = sure

    def probabilities(self, features) -> np.ndarray:
        far = np.exp(features[FEATURES.index("net_path")]) > 0.05
        return np.array([1.0 - self.sure, self.sure] if far else [self.sure, 1.0 - self.sure])


def spot(row, col, force=2.0) -> np.ndarray:
    rows, cols = np.indices(SHAPE)
    cap = np.maximum(1.0 - ((rows - row) ** 2 + (cols - col) ** 2) / 1.5**2, 0.0)
    return force * cap / cap.sum()


def played(frames, recogniser=None, std=0.0) -> list[Named]:
    recogniser = recogniser or Recogniser(Walks(), PITCH)
    named = []
    for k, frame in enumerate(frames):
        named += recogniser.update(k / RATE, frame, std)
    return named


def nothing(seconds: float) -> list[np.ndarray]:
    return [np.zeros(SHAPE)] * round(seconds * RATE)


def lying(seconds: float, row=3.0, col=3.0, force=20.0) -> list[np.ndarray]:
    return [spot(row, col, force)] * round(seconds * RATE)


def resting(seconds: float, row=3.0, col=3.0, force=20.0) -> list[np.ndarray]:
    """Return what a hand presses, whose force is never quite steady."""
    wave = 1.0 + 0.03 * np.sin(2 * np.pi * 1.5 * np.arange(round(seconds * RATE)) / RATE)
    return [spot(row, col, force * share) for share in wave]


def stroke(seconds: float = 0.5, row=10.0, force=2.0) -> list[np.ndarray]:
    return [spot(row, col, force) for col in np.linspace(2.0, 13.0, round(seconds * RATE))]


def decisions(named: list[Named]) -> list[tuple[int, str]]:
    return [(gesture.id, gesture.label) for gesture in named if gesture.decided]


def test_a_gesture_is_named_when_the_model_is_sure_and_ends_after_a_silence():
    named = played([*stroke(1.5), *nothing(1.0)])
    assert decisions(named) == [(1, "press"), (1, "stroke")]  # it changes its mind
    assert [g.state for g in named].count(DECIDED) == 2
    last = named[-1]
    assert last.state == ENDED and last.label == "stroke"
    assert last.duration == pytest.approx(1.5 + SILENCE, abs=0.1)


def test_one_that_the_model_is_never_sure_of_is_other():
    named = played([*stroke(), *nothing(1.0)], Recogniser(Walks(sure=0.6), PITCH))
    assert decisions(named) == [(1, "other")]
    assert named[-1].state == ENDED


def test_taps_in_one_place_are_one_gesture_and_two_hands_are_two():
    tap = [spot(8.0, 8.0)] * 10
    one = played([*tap, *nothing(0.2), *tap, *nothing(0.2), *tap, *nothing(1.0)])
    assert {g.id for g in one} == {1}
    apart = [a + b for a, b in zip(stroke(row=3.0), resting(0.5, 12.0, 13.0, 2.0), strict=True)]
    two = played([*apart, *nothing(1.0)])
    assert {g.id: g.label for g in two if g.state == ENDED} == {1: "press", 2: "stroke"} or {
        g.id: g.label for g in two if g.state == ENDED
    } == {1: "stroke", 2: "press"}


def test_fingers_of_one_hand_are_one_gesture():
    hand = [spot(8.0, 4.0) + spot(8.0, 7.0) + spot(8.0, 10.0)] * 50
    assert {g.id for g in played([*hand, *nothing(1.0)])} == {1}


def test_what_lies_as_still_as_no_hand_is_no_gesture():
    ended = {g.id: g.label for g in played([*lying(1.5), *nothing(1.0)]) if g.state == ENDED}
    assert ended == {1: "other"}
    # a blow is over before it could be said to lie
    assert decisions(played([*lying(0.2), *nothing(1.0)])) == [(1, "press")]


def test_what_stands_still_becomes_background_beside_which_others_are_named():
    frames = [
        *resting(STILL + 0.5),
        *(still + moving for still, moving in zip(resting(0.5), stroke(), strict=True)),
        *resting(1.0),
    ]
    ended = {g.id: g.label for g in played(frames) if g.state == ENDED}
    assert ended == {1: "press", 2: "stroke"}


@pytest.mark.parametrize(("rows_pressed", "label"), [(4, "stroke"), (14, "other")])
def test_next_to_a_body_nothing_is_a_gesture(rows_pressed, label):
    """On a mat of 40 x 40 cells of 20 mm: 0.03 m^2, an arm, and 0.11 m^2, who sits on it."""
    body = np.zeros((40, 40))
    body[:rows_pressed, :20] = 1.0
    frames = []
    for k in range(300):
        breathes = body * (1.0 + 0.03 * np.sin(2 * np.pi * 1.5 * k / RATE))
        if 240 <= k < 290:
            breathes[24:, 24:] += stroke()[k - 240]
        frames.append(breathes)
    recogniser = Recogniser(Walks(), 0.02)
    named = played([*frames, *[frames[240] * (body > 0.0)] * 60], recogniser)
    assert {g.id: g.label for g in named if g.state == ENDED}[2] == label


@pytest.mark.parametrize(("left", "pressed"), [(20.0, 60.0), (2.0, 8.0)])
def test_background_that_is_pressed_harder_is_a_gesture_again(left, pressed):
    """Harder than what is left of it, where most of it has gone."""
    steps = [*resting(0.5, force=left), *resting(0.5, force=pressed)]
    named = played([*resting(STILL + 0.5), *steps, *nothing(1.0)])
    assert {g.id for g in named} == {1, 2}


def test_a_noisy_skin_sees_less():
    frames = [*stroke(force=1.0), *nothing(1.0)]
    assert decisions(played(frames)) and not played(frames, std=1.0)


@pytest.mark.parametrize("later", [9.0, -9.0])
def test_a_pause_of_frames_or_a_clock_that_jumps_ends_what_went_on(later):
    recogniser = Recogniser(Walks(), PITCH)
    before = played(stroke(), recogniser)[-1]
    assert before.state != ENDED
    named = []
    for k in range(8):
        named += recogniser.update(later + k / RATE, spot(8, 8))
    lost = named[0]
    assert (lost.id, lost.state, lost.force) == (before.id, ENDED, 0.0)
    assert (lost.label, lost.duration) == ("stroke", before.duration)
    assert {g.id for g in named[1:]} == {before.id + 1}


def test_background_ends_in_a_pause_without_a_word_since_it_has_ended_before():
    recogniser = Recogniser(Walks(), PITCH)
    assert played(resting(STILL + 0.5), recogniser)[-1].state == ENDED
    named = []
    for k in range(8):
        named += recogniser.update(9.0 + k / RATE, spot(3, 3, 20.0))
    assert {g.id for g in named} == {2}


def test_what_is_left_of_a_background_as_it_leaves_is_no_gesture():
    force = [20.0 * share for share in np.linspace(1.0, 0.02, 40)]
    leaving = [spot(3.0, 3.0, newtons) for newtons in force]
    frames = [*resting(STILL + 0.5), *leaving, *nothing(0.3), *resting(0.5), *nothing(1.0)]
    assert {g.id: g.label for g in played(frames) if g.state == ENDED} == {1: "press", 2: "press"}


@pytest.mark.parametrize("rate", [8.0, 12.0, 25.0, 100.0, 390.0])
def test_slow_and_fast_boards_name_the_same(rate):
    recogniser, named = Recogniser(Walks(), PITCH), []
    steps = round(1.0 * rate)
    frames = [spot(10.0, col) for col in np.linspace(2.0, 13.0, steps)]
    frames += [np.zeros(SHAPE)] * round(1.0 * rate)
    for k, frame in enumerate(frames):
        named += recogniser.update(k / rate, frame)
    assert [g.label for g in named if g.state == ENDED] == ["stroke"]
    assert named[-1].duration == pytest.approx(1.0 + SILENCE, abs=0.3)


def test_a_fine_mat_is_read_on_cells_as_large_as_those_of_others():
    rng = np.random.default_rng(1)
    force, std = rng.uniform(0.0, 2.0, (19, 24)), rng.uniform(0.01, 0.1, (19, 24))
    coarse = Cells(0.016)
    assert coarse.pitch == 0.016 and coarse.of(force, std)[0] is force
    fine = Cells(0.008)
    assert fine.pitch == COMMON_PITCH
    put, spread = fine.of(force, std)
    assert put.shape == (8, 10)  # 152 and 192 mm on cells of 20 mm
    assert put.sum() == pytest.approx(force.sum())
    # each of 2.5 x 2.5 cells: two of them and a half along each axis
    share = np.outer([1.0, 1.0, 0.5], [1.0, 1.0, 0.5])
    assert put[0, 0] == pytest.approx((share * force[:3, :3]).sum())
    assert spread[0, 0] == pytest.approx(np.sqrt((share**2 * std[:3, :3] ** 2).sum()))


def test_a_gesture_on_a_fine_mat_has_its_place_on_the_mat():
    for row, col in ((0, 0), (9, 13), (18, 23)):
        gathering = Gathering(0.008)
        force = np.zeros((19, 24))
        force[row, col] = 3.0
        (gesture,) = [g for k in range(4) for g in gathering.update(k * PERIOD, force)][-1:]
        at = np.array(gathering.cells.place(*gesture.place))
        assert np.abs(at - (row, col)).max() < 1.5 and (at >= 0).all() and (at <= (18, 23)).all()
