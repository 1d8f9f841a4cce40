# SPDX-License-Identifier: Apache-2.0
"""The firmware on simavr and on avr8js, which share no code: byte for byte the same."""

import pytest
from support.chips import needs_both
from support.firmware import on_both

from tactile_skin.board.protocol import BinaryParser


@pytest.mark.ci
@needs_both
def test_both_send_the_same_frames():
    """Three loads one after the other, 1 ADC step of noise."""
    one, other = on_both(2.0)
    frames = BinaryParser().feed(one)
    assert len(frames) in range(195, 201)
    assert abs(len(one) - len(other)) <= 1  # one may have stopped a cycle later
    n = min(len(one), len(other))
    assert one[:n] == other[:n]
