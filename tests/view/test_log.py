# SPDX-License-Identifier: Apache-2.0
"""The page's log: stops, findings and moments, on a driven clock."""

import numpy as np
import pytest

from tactile_skin.view.log import ENTRIES, Log
from tactile_skin.view.snapshot import CONTACT, NodeStatus, Snapshot

FORCE, PEAK = CONTACT.index("force"), CONTACT.index("peak")


def snapshot(t, force=0.0, causes=(), nodes=None):
    contacts = np.zeros((1, len(CONTACT)), np.float32)
    contacts[0, FORCE], contacts[0, PEAK] = force, force / 8
    return Snapshot(
        stamp=t,
        adc=np.zeros((2, 2), np.uint16),
        contacts=contacts,
        stop=bool(causes),
        reason=" + ".join(causes),
        causes=tuple(causes),
        force=force,
        limit=30.0,
        cell_limit=9.0,
        nodes=nodes or {},
    )


def told(log, snapshots):
    for number, each in enumerate(snapshots, 1):
        log.take(each.stamp, number, each)


def test_a_push_has_its_time_its_hardest_force_and_where_that_was():
    log = Log(lambda s: {"row": s.force, "col": 0, "direction": [0, -1, 0]})
    forces = [0, 10, 35, 53, 40, 10, 0, 0]
    told(log, [snapshot(100 + k, f, ["push"] * (2 <= k < 6)) for k, f in enumerate(forces)])
    (stop,) = log.entries()
    assert (stop["kind"], stop["begin"], stop["end"]) == ("stop", 102, 106)
    assert (stop["force"], stop["limit"], stop["stamp"]) == (53, 30, 103)
    assert (stop["peak"], stop["cell_limit"]) == (53 / 8, 9)
    assert stop["push"]["row"] == 53
    number, shown = log.moment(stop["stamp"])
    assert (number, shown.force) == (4, 53)


def test_a_push_that_joins_a_fault_is_in_the_same_stop():
    log = Log(lambda s: {"row": 0, "col": 0, "direction": [1, 0, 0]})
    told(log, [snapshot(1, causes=["stale"]), snapshot(2, 40, ["push", "stale"]), snapshot(3)])
    (stop,) = log.entries()
    assert stop["causes"] == ["push", "stale"] and (stop["begin"], stop["end"]) == (1, 3)


def test_a_finding_lasts_while_its_lines_are_reported_and_what_is_waited_for_is_none():
    def said(message, level=1, **values):
        return {"compensation": NodeStatus(level, message, values)}

    log = Log(lambda s: None)
    told(
        log,
        [
            snapshot(1, nodes=said("measuring rest", waiting="true")),
            snapshot(2, nodes=said("column 5 is open", cols="5")),
            snapshot(3, nodes=said("column 5 is open: 3.1 counts", cols="5")),
            snapshot(4, nodes=said("row 2 is open", 2, rows="2")),
            snapshot(5, nodes=said("ok", 0)),
        ],
    )
    second, first = log.entries()
    assert (first["cols"], first["begin"], first["end"]) == ((5,), 2, 4)
    assert (second["rows"], second["begin"], second["end"]) == ((2,), 4, 5)
    assert first["causes"] == ["compensation"]


def test_moments_of_the_last_minute_and_of_each_entry_are_kept():
    log = Log(lambda s: None)
    told(log, [snapshot(0.05 * k, k, ["fault"] if k == 10 else ()) for k in range(4000)])
    assert log.moment(0.5)[1].stamp == 0.5, "of the entry, three minutes ago"
    assert log.moment(150.0)[1].stamp == pytest.approx(150.0, abs=0.11)
    assert log.moment(20.0)[1].stamp > 130.0, "what is not kept: the nearest that is"
    assert len(log._ring) <= 610


def test_the_force_of_ten_minutes_is_kept_by_its_peaks():
    log = Log(lambda s: None)
    told(log, [snapshot(0.02 * k, k % 7) for k in range(40000)])
    history = log.history()
    assert 590.0 < history["times"][-1] - history["times"][0] <= 600.1
    assert len(history["times"]) <= 6001 and min(history["force"]) >= 4


def test_it_is_bounded_and_says_when_it_changed():
    log = Log(lambda s: None)
    for k in range(500):
        before = log.version
        log.take(k, k, snapshot(k, causes=["fault"] * (k % 2)))
        assert log.version > before or k == 0
    before = log.version
    log.take(500.0, 500, snapshot(500.0, causes=["fault"]))
    log.take(500.5, 501, snapshot(500.5, causes=["fault"]))
    assert len(log.entries()) == ENTRIES and len(log._moments) <= ENTRIES
    assert log.version == before, "the stop that lasts is no news"
