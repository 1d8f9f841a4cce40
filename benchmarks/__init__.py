# SPDX-License-Identifier: Apache-2.0
"""Measurements of the whole skin, not installed: `python -m benchmarks.THEME.SCRIPT --help`.

They share simulated boards and real parts with the tests (tests/support); nothing in the package
imports them. harness.py is what each script begins and ends with.
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before any script imports NumPy
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
