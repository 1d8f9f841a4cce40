"""What counts as touched: three levels of the force on a cell, defined here and nowhere else."""

from __future__ import annotations

from ..physics.curve import GRAM

AT_REST = 2.0 * GRAM  # N: what conducts more is no rest, and is not taken for one
TOUCHED = 15.0 * GRAM  # N: a touch; lines that are shorted at rest read as 13 g
# N on so many cells: a touch that begins, not noise
STIRRED = 1.0 * GRAM
STIRRED_CELLS = 3
