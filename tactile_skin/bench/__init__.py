# SPDX-License-Identifier: Apache-2.0
"""Measurements with production code only: `tactile-skin bench`, one file per part.

speed.py      speed against accuracy           run.py      a part: measure, write, draw
stability.py  where each method fails          troubles.py what goes wrong there, and how badly
measure.py    time and error, for all parts    chart.py    style of the figures, and their JSON

What no user runs is in benchmarks/, which is not installed.
"""
