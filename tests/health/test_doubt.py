# SPDX-License-Identifier: Apache-2.0
"""When doubt is a fault, and what proves it gone."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_skin import Circuit
from tactile_skin.findings.finding import Finding, Kind
from tactile_skin.health.check import Seen
from tactile_skin.health.doubt import Doubt
from tactile_skin.health.monitor import SkinMonitor
from tactile_skin.physics.adc import Adc

FRAME = 0.01  # s


class Skin:
    def __init__(self):
        self.doubt, self.t = Doubt(), 10.0

    def feel(self, seconds, suspect=False, touched=False) -> list[bool]:
        """Whether there was a fault, frame by frame."""
        faults = []
        for _ in range(round(seconds / FRAME)):
            self.t += FRAME
            faults.append(self.doubt.frame(self.t, suspect, touched))
        return faults


@pytest.fixture
def skin():
    """One that was sound for a while."""
    skin = Skin()
    skin.feel(0.3)
    return skin


def test_a_skin_in_doubt_from_its_first_frame_is_never_free():
    assert all(Skin().feel(0.5, suspect=True))


def test_a_sound_one_is_free_at_once():
    assert not any(Skin().feel(0.5))


def test_a_few_doubts_are_no_fault(skin):
    """A touch that comes and goes."""
    for _ in range(50):
        assert not any(skin.feel(0.05, suspect=True, touched=True))
        assert not any(skin.feel(0.3, touched=True))
        assert not any(skin.feel(0.3))


def test_half_of_the_last_frames_are(skin):
    assert skin.feel(0.5, suspect=True, touched=True).index(True) == 9


def test_a_fault_of_frames_in_turn_ends_below_a_quarter_of_them(skin):
    """Frames at rest of which each third is in doubt begin no fault, and end none."""
    assert not any(any(skin.feel(FRAME, suspect=k % 3 == 0)) for k in range(60))
    for k in range(40):
        skin.feel(FRAME, suspect=k % 2 == 0)
    assert skin.doubt.present
    assert all(skin.feel(FRAME, suspect=k % 3 == 0)[0] for k in range(60))
    for k in range(60):  # four of 20: too few
        skin.feel(FRAME, suspect=k % 5 == 0)
    assert not skin.doubt.present


@pytest.mark.parametrize(("seconds", "believed", "frames"), [(0.5, False, 100), (0.3, True, 50)])
def test_a_fault_under_a_touch_outlasts_it_until_the_skin_has_rested(
    skin, seconds, believed, frames
):
    """Or until a touch is believed: one doubt while it came stops no robot for its length."""
    skin.feel(seconds, suspect=True, touched=True)
    assert skin.feel(2.0, touched=believed).index(False) == pytest.approx(frames, abs=1)


def test_why_it_is_kept_is_said(skin):
    skin.feel(0.5, suspect=True, touched=True)
    skin.feel(0.5)
    assert "seen under the last touch: kept until 1 s of rest" in skin.doubt.kept
    skin.feel(1.0)
    assert skin.doubt.kept == ""


def test_a_fault_that_comes_back_with_the_touch_is_not_healed_by_rest(skin):
    """A multiplexer line that is stuck: nothing shows while nothing touches."""
    for _ in range(2):
        skin.feel(0.5, suspect=True, touched=True)
        skin.feel(1.5)
    assert all(skin.feel(600.0))
    assert "under each touch" in skin.doubt.kept
    assert skin.feel(1.0, touched=True)[-1] is False


def test_a_reset_forgets_it(skin):
    for _ in range(3):
        skin.feel(0.5, suspect=True, touched=True)
        skin.feel(1.5)
    skin.doubt.reset()
    assert not any(skin.feel(1.0))


def test_a_reset_forgets_nothing_that_is_still_there(skin):
    """While the last frames are in doubt the robot must not move, not even for ten of them."""
    skin.feel(0.5, suspect=True, touched=True)
    skin.doubt.reset()
    assert skin.doubt.present
    assert all(skin.feel(0.2, suspect=True, touched=True))
    skin.feel(0.3)
    skin.doubt.reset()
    assert not skin.doubt.present
    assert not any(skin.feel(1.0))


def test_touches_with_rest_between_them_count_once_each(skin):
    """One touch whose doubt comes and goes is one."""
    for _ in range(5):
        skin.feel(0.3, suspect=True, touched=True)
        skin.feel(0.3, touched=True)
    assert skin.feel(1.2)[-1] is False


def test_what_is_wrong_at_rest_stays_wrong_under_a_touch(skin):
    skin.feel(0.3, suspect=True)
    assert all(skin.feel(5.0, touched=True))
    assert not skin.feel(1.0)[-1]


def test_a_clock_that_is_set_back_keeps_a_fault_no_longer_than_its_rest(skin):
    skin.feel(0.5, suspect=True, touched=True)
    skin.t -= 3600.0
    assert skin.feel(1.2)[-1] is False


@pytest.mark.parametrize(("times", "stands", "stops"), [(8, True, 1), (4, True, 0), (20, False, 0)])
def test_one_frame_that_misses_a_standing_touch_by_much_is_a_fault(times, stands, stops):
    """A touch that moves is read row by row: it misses by less than it has changed."""
    circuit = Circuit(4, 4)
    monitor, residual = SkinMonitor(Adc(circuit), 0.0), 0.5 * times
    misfit = Finding(Kind.MISFIT, numbers={"residual": residual, "times": times})
    sound = {"status": "ok", "finding": None, "message": "", "residual": 0.5}
    wrong = {"status": "suspect", "finding": misfit, "message": "wrong", "residual": residual}
    for k in range(40):
        steps = np.full((4, 4), 100.0 if k < 39 or stands else 115.0)
        said = SimpleNamespace(**(wrong if k == 39 else sound), force=steps / 100.0, aside=None)
        samples, ratio = (64.0 * steps).astype(np.uint16), steps / circuit.full_scale
        given = {"stirs": True, "rest": None, "noise": 0.5 / circuit.full_scale}
        monitor.frame(Seen(0.01 * k, samples, samples, ratio, said, **given), judged=True)
        assert monitor.doubtful == (k == 39 and stops) or k < 20
