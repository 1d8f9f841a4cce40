# SPDX-License-Identifier: Apache-2.0
"""What the tests of the firmware need: the tools, or the reason to skip them."""

import shutil
from pathlib import Path

import pytest

AVR8JS = Path(__file__).parents[1] / "avr8js"  # a simulated chip that is not simavr


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
