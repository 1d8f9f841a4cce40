# SPDX-License-Identifier: Apache-2.0
from support import machine


def test_a_test_is_run_again_only_if_the_host_took_the_processor(monkeypatch):
    taken = [0.0]
    monkeypatch.setattr(machine, "_stolen", lambda: taken[0])
    monkeypatch.setattr(machine, "_LOOKS", 0.0)
    monkeypatch.setattr(machine, "_began", (0.0, 0.0))
    machine.begin()
    assert not machine.stood_still()
    taken[0] = 10.0
    assert machine.stood_still()  # and it is calm now
    machine.begin()
    assert not machine.stood_still()
