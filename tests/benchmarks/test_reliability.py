# SPDX-License-Identifier: Apache-2.0
"""The fault harness counts right, and the chain that it drives is the real one."""

import json

import numpy as np
import pytest
from support.chain import Chain
from support.lab import touches
from support.lab.board import KNOTS, FaultBoard

from benchmarks.faults import __main__ as faults
from benchmarks.faults import reliability, table
from benchmarks.faults.data import DATA
from benchmarks.faults.reliability import FAULTS, Record, configured, count, play
from tactile_skin import Circuit, PressureCurve

CURVE = PressureCurve()
END = CURVE.max_force

# --- the touches ---


def test_touches_of_a_day_are_as_heavy_as_their_kind_says():
    mask = np.hypot(*(np.indices((16, 16)) - 7.5)) < 8.2
    scene = touches.everyday(mask, 120.0, np.random.default_rng(1), END, hard=False)
    assert len(scene.touches) > 40 and scene.force.max() <= END
    assert not scene.force[:, ~mask].any() and not scene.force[: round(1.5 * KNOTS)].any()
    for touch in scene.touches:
        total = scene.force[round(touch.start * KNOTS) : round(touch.end * KNOTS)].sum((1, 2))
        assert total.max() < 95.0
    pushes = scene.pushes()
    assert 5 < len(pushes) < 40
    for first, last in pushes:
        assert last - first >= 0.3 * KNOTS
        assert scene.force[first:last].sum((1, 2)).max() > 33.0


def test_a_push_is_one_only_if_it_is_clear_and_lasts():
    force = np.zeros((300, 2, 2))
    force[20:50], force[100:120], force[200:240] = 10.0, 10.0, 7.6  # 40, 40 and 30.4 N
    assert touches.Scene(force, []).pushes() == [(20, 50)]
    assert len(touches.Scene(force, []).pushes(margin=1.0)) == 2


# --- what is counted ---


class Stub:
    """A chain that says what it is told to."""

    def __init__(self, force, stop=lambda t: False, reason="push"):
        self.force, self._stop, self._reason = force, stop, reason
        self.doubts, self.t = False, 0.0

    stop = property(lambda self: self._stop(self.t))
    reason = property(lambda self: self._reason if self.stop else "")
    for_push_alone = property(lambda self: self.reason == "push")

    def feed(self, t, data):
        self.t = t

    def until(self, t):
        self.t = t


def push(n=400, start=100, end=200, shape=(4, 4)):
    force = np.zeros((n, *shape))
    force[start:end] = 3.0  # 48 N
    return force


def counted(stub, force, **more):
    record = play(stub, [], force)
    pushes = touches.Scene(force, []).pushes()
    return count(record, pushes, 0, 0.0, END, 0) | more


def test_a_chain_that_stays_free_misses_the_push_in_silence():
    force = push()
    found = counted(Stub(np.zeros((4, 4))), force)
    assert (found["pushes"], found["missed"], found["let_go"]) == (1, 1, 1)
    assert found["failing"] == found["silent"] == found["silent_free"] == 100
    assert found["to_stop"] == [None] and found["free"] == 370


def test_a_late_stop_is_no_miss_and_one_that_ends_early_lets_go():
    force = push()
    assert counted(Stub(force[0], lambda t: t > 1.2), force)["let_go"] == 0
    late = counted(Stub(force[0], lambda t: t > 1.6), force)
    assert (late["missed"], late["let_go"]) == (0, 1)


def test_a_stop_with_a_reason_is_not_silent():
    force = push()
    found = counted(Stub(force[0], lambda t: t > 1.5, "push + fault: x"), force)
    assert found["failing"] == 100 and found["silent"] == 50
    assert found["to_stop"] == [1.5]
    stub = Stub(force[0])
    stub.doubts = True
    assert counted(stub, force)["silent"] == 0


def wrong(found, truth, lag=0.0):
    never = np.zeros(len(truth), bool)
    return reliability.fails(Record(truth, found, never, never, never, []), lag, END)


def test_a_picture_is_wrong_by_cells_or_by_its_total():
    truth = np.full((1, 8, 8), 0.0)
    truth[0, 2:4, 2:4] = 2.0
    assert not wrong(truth, truth)[0]
    assert not wrong(1.15 * truth, truth)[0]
    assert wrong(1.3 * truth, truth)[0], "a fifth of the load on each touched cell"
    assert wrong(0.0 * truth, truth)[0]
    ghost = truth.copy()
    ghost[0, 6, 6] = 4.0
    assert wrong(ghost, truth)[0]
    even = np.full((1, 8, 8), 0.15)  # less than 20 g a cell, 9.6 N in all
    assert wrong(even, 0.0 * even)[0]
    hard = truth.copy()
    hard[0, 2, 2] = 15.0
    assert not wrong(np.minimum(hard, END), hard)[0], "beyond the curve's end"


def test_a_picture_may_lie_behind_and_between():
    truth = push()
    behind = np.concatenate([truth[:3], truth[:-3]])
    behind[101] = 0.5 * truth[150]
    assert wrong(behind, truth).sum() == 6
    assert not wrong(behind, truth, 0.03).any()
    assert wrong(2.0 * behind, truth, 0.03).sum() > 90


# --- the chain ---


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_bytes_of_a_sound_board_become_a_stop_and_a_release(kind):
    readout = "low-pass" if kind == "binary" else "mean of 4"
    circuit = Circuit(8, 8)
    board = FaultBoard(circuit, CURVE, np.random.default_rng(3), 1.0, kind, readout)
    force = np.zeros((round(3.2 * KNOTS), 8, 8))
    force[200:260] = touches._blob((8, 8), (3.4, 4.2), 1.5)[None]
    force *= 45.0 / max(force[220].sum(), 1.0)
    chain = Chain(circuit, kind, configured(kind, readout, 1.0))
    record = play(chain, board.advance(force), force)
    chain.close()
    assert chain.errors == 0 and not record.stopped[170:199].any()
    assert record.stopped[206:260].all() and not record.stopped[-1]
    assert record.found[240].sum() == pytest.approx(45.0, rel=0.1)
    assert not reliability.fails(record, 0.05, END)[160:].any()


def test_silence_of_the_link_is_told():
    chain = Chain(Circuit(4, 4))
    board = FaultBoard(Circuit(4, 4), CURVE, np.random.default_rng(0))
    force = np.zeros((200, 4, 4))
    record = play(chain, [pair for pair in board.advance(force) if pair[0] < 1.6], force)
    assert not record.stopped[150] and record.faulted[175:].all()
    assert record.reasons[-1] == "stale: readings no longer arrive"


# --- runs ---


@pytest.mark.ci
def test_a_small_run_has_its_rows():
    faults = reliability.named(["open row"])
    found = reliability.measure(("4x4",), faults, 1, 3.0, 0.0, seed=2, jobs=1)["faults"]
    assert json.loads(json.dumps(found)) == found
    assert [(row["fault"], row["protocol"]) for row in found["faults"]] == [
        ("open row", "binary"),
        ("open row", "text"),
    ]
    assert all(len(row["held"]) == 2 and row["frames"] > 300 for row in found["faults"])
    text = table.table(found)
    assert "| open row (text) |" in text and "| together |" in text


@pytest.mark.ci
def test_a_stream_is_the_same_again():
    first, again = (
        reliability.run_fault("4x4", "backlog, fast", "binary", True, 5.0, [1]) for _ in range(2)
    )
    assert first == again and first["frames"] == 340


@pytest.mark.ci
def test_a_sound_run_counts_minutes_and_touches():
    found = reliability.run_sound("4x4", "binary", "low-pass", 1.0, True, 6.0, 5)
    assert found["touches"] >= 1 and found["frames"] == 440 and found["errors"] == 0
    assert found["stopped"] >= found["false_stops"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--shapes", "9x9"), "invalid choice: '9x9'"),
        (("--faults", "rust"), "fault 'rust': must be one of dead, electrical, frozen scan"),
        (("--jobs", "0"), "--jobs = 0: must be 1 or more"),
    ],
)
def test_wrong_options_are_named(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        faults.main(words)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_faults_are_chosen_by_name_or_class():
    assert reliability.named(["electrical", "dead"]) == FAULTS
    assert [f.name for f in reliability.named(["open row", "frozen scan"])] == [
        "frozen scan",
        "open row",
    ]


def test_dead_data_are_of_their_class():
    assert all(fault in DATA for fault in FAULTS if fault.must_stop or fault.stalls)
