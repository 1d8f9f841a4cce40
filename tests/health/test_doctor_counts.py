# SPDX-License-Identifier: Apache-2.0
"""While it listens to a board, the doctor says how long that takes."""

from types import SimpleNamespace

import numpy as np

from tactile_skin.commands import doctor


def test_the_seconds_that_are_left_are_said(monkeypatch, capsys):
    asked = []

    class Board:
        def __init__(self, config, given):
            self.driver = SimpleNamespace(counters=SimpleNamespace(corrupt=0, lost=0), reconnects=0)

        def __call__(self, seconds):
            asked.append(seconds)
            return np.zeros((max(1, round(seconds)), 4, 4))

        def close(self):
            pass

    monkeypatch.setattr(doctor, "Live", Board)
    frames, times, findings = doctor._listen({"seconds": 25.0}, {})
    assert asked == [0.0, 10.0, 10.0, 5.0] and len(frames) == len(times) == 25 and findings == []
    said = capsys.readouterr().out
    assert said.index("15 s left") < said.index("5 s left", said.index("15 s left") + 5)
