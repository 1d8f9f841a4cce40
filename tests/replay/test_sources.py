# SPDX-License-Identifier: Apache-2.0
"""A board's frames for calibrate and the doctor."""

import contextlib

import numpy as np
import pytest
from support.strangers.pty_board import PtyBoard

from tactile_skin.board.serial_port import LONGEST_BOOT
from tactile_skin.board.text import line
from tactile_skin.replay import sources


@pytest.mark.parametrize("boots", [True, False])
def test_a_board_that_was_reset_has_its_time_for_the_first_frame(boots, monkeypatch):
    """Calibrate gave up after 10 s, in which the driver had reset the board twice."""
    monkeypatch.setattr(sources, "_PATIENCE", 0.1)
    monkeypatch.setattr(sources.SerialDriver, "longest_start", LONGEST_BOOT if boots else 0.1)
    frame = line(np.full((2, 2), 40))
    with PtyBoard(lambda k: frame if k > 10 and boots else b"", 20.0) as board:
        given = {"port": board.port, "protocol": "text", "circuit.rows": 2, "circuit.cols": 2}
        with contextlib.closing(sources.Live(None, given)) as live:
            if boots:
                assert live(0.1).shape[1:] == (2, 2)
                assert live.driver._reader.watchdog == LONGEST_BOOT
            else:
                with pytest.raises(ValueError, match=r"no frame for 0\.2 s"):
                    live(0.0)
