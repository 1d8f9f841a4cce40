"""What the tests of the firmware need: the tools, or the reason to skip them."""

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "yardsticks"))
from firmware import AVR8JS


def _needs(*tools: str, simavr: bool = True, avr8js: bool = False):
    missing = [tool for tool in tools if shutil.which(tool) is None]
    if simavr and not Path("/usr/include/simavr/sim_avr.h").exists():
        missing.append("libsimavr-dev")
    if avr8js and not (AVR8JS / "node_modules").is_dir():
        missing.append("avr8js (npm ci --prefix tests/avr8js)")
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


needs_chip = _needs("avr-gcc", "gcc")
needs_both = _needs("avr-gcc", "gcc", "node", avr8js=True)
needs_avrdude = _needs("avr-gcc", "avrdude", simavr=False)
