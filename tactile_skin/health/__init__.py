# SPDX-License-Identifier: Apache-2.0
"""A running skin, and what is wrong with it: from evidence to findings.

skin.py     rest, circuit and picture       monitor.py    all checks, each frame
check.py    what a check is, and sees       ceiling.py    does the input saturate?
sent.py     is it what an ADC reads?        untouched.py  the rest, compared with what it was
doubt.py    when doubt is a fault           odd_cells.py  a cell that no touch moves so
rest_picture.py  is a matrix read at all?   loose_lines.py  a line that opens again
bits.py      is a bit of the ADC stuck?       standing.py  what stands without moving
"""
