# SPDX-License-Identifier: Apache-2.0
"""What compensation does when it is behind, and what it says of a matrix wired wrong."""

from dataclasses import replace

import numpy as np
import pytest
from support.bench import Bench
from support.marks import ci

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    Trigger,
    image,
    image_array,
)
from tactile_skin.nodes.compensation import LATCHED, Compensation
from tactile_skin.simulation import scenes

CIRCUIT = Circuit(8, 8)
FRAME = 0.01  # s


class Skin(Bench):
    """A compensation node, and a board whose cells rest 3 % apart.

    Attributes:
        published: stamps of skin/pressure [s].
        force: the last one's sum [N].
        status: the last word on diagnostics.
    """

    def __init__(self, **given):
        super().__init__()
        shape = {"circuit.rows": 8, "circuit.cols": 8}
        self.compensation = Compensation(self.node("compensation", shape | given))
        self.published, self.status, self.levels = [], None, set()
        self.observer = observer = self.node("observer")
        observer.create_subscription(Image, "skin/pressure", self._on_pressure, 100)
        observer.create_subscription(DiagnosticArray, "skin/diagnostics", self._on_status, 100)
        self._adc = observer.create_publisher(Image, "skin/adc", 100)
        self.rng = np.random.default_rng(6)
        self.rest = 40000.0 * np.exp(0.03 * self.rng.standard_normal((8, 8)))
        self.steps = forward(CIRCUIT, self.rest) * CIRCUIT.full_scale

    def press(self):
        """A finger of 20 N."""
        resistance = PressureCurve().resistance(scenes.finger(8, 8, 3.3, 4.1, 20.0, 1.2))
        self.steps = forward(CIRCUIT, resistance * self.rest / 40000.0) * CIRCUIT.full_scale

    def ask(self, name):
        """The answer of its service."""
        client = self.observer.create_client(Trigger, f"/compensation/{name}")
        future = client.call_async(Trigger.Request())
        self.executor.spin_some()
        return future.result(0)

    def _on_pressure(self, message):
        self.published.append(message.header.stamp)
        self.force = float(image_array(message).sum()) * self.compensation.cell_area

    def _on_status(self, message):
        self.status = message.status[0]
        self.levels.add(self.status.level)

    def frame(self, age=0.0):
        """A frame that was taken `age` [s] ago."""
        stamp = self.clock.now().nanoseconds - round(age * 1e9)
        steps = self.steps + 0.5 * self.rng.standard_normal((8, 8))
        header = Header(type(self.clock.now())(stamp).to_msg(), "base_link")
        self._adc.publish(image(np.rint(64 * steps).astype(np.uint16), "16UC1", header))
        self.executor.spin_some()
        self.clock.advance(FRAME)

    def play(self, seconds):
        for _ in range(round(seconds / FRAME)):
            self.frame()


@pytest.fixture
def skin():
    return Skin()


def test_one_that_keeps_up_takes_each_frame(skin):
    skin.play(0.5)
    assert len(skin.published) == 50 and skin.compensation.skipped == 0


def test_the_spread_of_each_picture_is_published_for_who_asks(skin):
    """Of 20 N on 8 x 8 cells the true force is within it."""
    spreads = []
    skin.play(2.0)
    skin.observer.create_subscription(Image, "skin/pressure_std", spreads.append, 100)
    skin.press()
    skin.play(0.5)
    assert [m.header.stamp for m in spreads] == skin.published[-50:]
    std = image_array(spreads[-1]) * skin.compensation.cell_area
    assert std.shape == (8, 8) and (std > 0.0).all()
    assert 0.005 < std.max() < 2.0
    assert skin.force == pytest.approx(20.0, abs=3.0 * np.sqrt(np.square(std).sum()))


def test_one_that_is_behind_skips_old_frames_and_counts_them(skin):
    """But not all: the stop must know that there are readings, though they be old."""
    for _ in range(40):
        skin.frame(age=0.08)
    assert 15 <= len(skin.published) <= 21
    assert skin.compensation.skipped == 40 - len(skin.published)
    skin.compensation.report()
    skin.executor.spin_some()
    values = {pair.key: pair.value for pair in skin.status.values}
    assert int(values["skipped"]) == skin.compensation.skipped


def test_a_reading_a_little_old_is_taken_by_the_fast_method(skin):
    skin.press()
    skin.frame()
    right = skin.force
    for _ in range(40):
        skin.frame(age=0.04)
    assert len(skin.published) == 41
    assert skin.compensation.skin.taken["fixed_point"] >= 35
    assert skin.compensation.skin.taken.total() == 41
    assert skin.force == pytest.approx(right, rel=0.1)


def test_a_board_that_leaves_cells_unread_has_no_fast_method():
    """Nor has one whose user asked for another than auto."""
    for given in ({"board_threshold": 3.0}, {"method": "map"}):
        skin = Skin(**given)
        skin.press()
        for _ in range(5):
            skin.frame(age=0.04)
        assert len(skin.published) == 5 and "fixed_point" not in skin.compensation.skin.taken


def test_the_fast_method_does_not_speak_for_the_circuit(skin):
    """A fault that only a fit finds holds while nothing is fitted."""
    skin.play(2.5)
    skin.press()
    skin.steps *= 0.8
    skin.play(0.5)
    assert skin.status.level == DiagnosticStatus.ERROR
    for _ in range(100):
        skin.frame(age=0.04)
        assert skin.status.level == DiagnosticStatus.ERROR


@pytest.mark.parametrize("late", [0, ci(200)])
def test_a_fault_is_told_though_all_readings_are_late(skin, late):
    """From the start, and one that begins after so many late frames."""
    skin.play(2.5)
    skin.press()
    sound = skin.steps
    for _ in range(late):
        skin.frame(age=0.015)
    assert not late or skin.status.level == DiagnosticStatus.OK
    skin.steps = 0.8 * sound
    for _ in range(150):
        skin.frame(age=0.015)
    assert skin.status.level == DiagnosticStatus.ERROR


def test_a_tare_does_not_clear_a_fault_that_is_kept(skin):
    skin.play(2.5)
    rest = skin.steps
    for _ in range(2):
        skin.press()
        skin.steps *= 0.8
        skin.play(0.6)
        skin.steps = rest
        skin.play(0.05)
        assert not skin.ask("tare").success, "the last frames are still in doubt"
        skin.play(1.5)
    assert "kept until a valid touch or a reset" in skin.status.message
    answer = skin.ask("tare")
    assert not answer.success and "reset first" in answer.message


@pytest.mark.parametrize("off", [0.0, 7.0])
def test_a_matrix_that_is_read_no_more_stops(skin, off):
    """At the height of the rest, too, where a picture of one frame is that of a bare skin."""
    skin.play(2.5)
    skin.levels.clear()
    skin.play(2.0)
    assert skin.levels == {DiagnosticStatus.OK}
    skin.steps = np.full((8, 8), skin.steps.mean() + off)
    skin.play(0.25)
    assert skin.status.level == DiagnosticStatus.ERROR
    assert "one voltage" in skin.status.message or "residual" in skin.status.message


def test_a_line_that_is_read_twice_is_a_warning_that_names_it(skin):
    skin.steps[6] = skin.steps[2]
    skin.play(3.5)
    assert skin.status.level == DiagnosticStatus.WARN
    assert skin.status.message.startswith("rows 2 and 6: read the same, cell for cell")


def test_a_stuck_address_bit_stops(skin):
    skin.steps = skin.steps[np.arange(8) & ~2]
    skin.play(3.5)
    assert skin.status.level == DiagnosticStatus.ERROR
    assert "address bit 1 of the rows: stuck" in skin.status.message


def test_lines_that_are_exchanged_while_it_runs_stop_until_they_are_put_right(skin):
    skin.play(2.0)
    sound = skin.steps
    skin.steps = sound[:, [0, 1, 5, 3, 4, 2, 6, 7]]
    skin.play(0.5)
    assert skin.status.level == DiagnosticStatus.ERROR
    assert "reads at rest as column" in skin.status.message
    skin.play(5.0)
    assert skin.status.level == DiagnosticStatus.ERROR, "what is measured meanwhile is no rest"
    skin.steps = sound
    skin.play(3.0)
    assert skin.status.level != DiagnosticStatus.ERROR


def test_an_r_par_that_changes_is_a_warning_that_a_tare_ends(skin):
    skin.play(2.0)
    other = replace(CIRCUIT, r_par=1.3 * CIRCUIT.r_par)
    skin.steps = forward(other, skin.rest) * CIRCUIT.full_scale
    skin.play(1.5)
    assert skin.status.level == DiagnosticStatus.WARN
    assert "all cells conduct -" in skin.status.message
    answer = skin.ask("tare")
    assert answer.success and "hands off" in answer.message
    skin.play(3.0)
    assert skin.status.level == DiagnosticStatus.OK


@pytest.mark.ci
def test_creep_is_taken_out_of_what_is_published():
    """And of nothing else: what the skin knows of itself comes from the forces that were found."""
    totals = []
    for given in ({}, {"curve.creep": 0.05}):
        skin = Skin(**given)
        skin.play(1.5)
        touched = np.full((8, 8), 40000.0)
        touched[3:5, 3:5] = 800.0
        skin.steps = forward(CIRCUIT, touched) * CIRCUIT.full_scale
        skin.play(3.0)
        totals.append(skin.force)
        assert (skin.compensation.skin._standing is None) == (not given)
    assert totals[1] / totals[0] == pytest.approx(1.0 / (1.0 + 0.05 * np.log10(4.0)), abs=0.01)


def test_what_cells_have_at_rest_is_published_once_it_was_measured(skin):
    found = []
    skin.node("second").create_subscription(Image, "skin/rest", found.append, LATCHED)
    skin.play(0.5)
    assert not found
    skin.play(2.0)
    rest = image_array(found[-1])
    np.testing.assert_allclose(rest, skin.rest, rtol=0.02)
