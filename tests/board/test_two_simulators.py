"""The firmware on simavr and on avr8js, which share no code: byte for byte the same."""

import shutil
import sys
from pathlib import Path

import pytest

from tactile_skin.board.protocol import BinaryParser

sys.path.insert(0, str(Path(__file__).parents[1] / "yardsticks"))
from firmware import AVR8JS, on_both

_TOOLS = "avr-gcc", "gcc", "node"
missing = [tool for tool in _TOOLS if shutil.which(tool) is None]
if not Path("/usr/include/simavr/sim_avr.h").exists():
    missing.append("libsimavr-dev")
if not (AVR8JS / "node_modules").is_dir():
    missing.append("avr8js: npm ci --prefix tests/avr8js")
pytestmark = pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def test_both_send_the_same_frames():
    """Three loads one after the other, 1 ADC step of noise."""
    one, other = on_both(2.0)
    frames = BinaryParser().feed(one)
    assert len(frames) in range(195, 201)
    assert abs(len(one) - len(other)) <= 1  # one may have stopped a cycle later
    n = min(len(one), len(other))
    assert one[:n] == other[:n]
