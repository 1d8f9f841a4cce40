"""A running skin, and what is wrong with it: from evidence to findings.

skin.py     rest, circuit and picture       monitor.py    all checks, each frame
sent.py     is it what an ADC reads?        ceiling.py    does the input saturate?
doubt.py    when doubt is a fault           untouched.py  the rest, beside what it was
odd_cells.py  a cell that no touch moves so
rest_picture.py  is a matrix read at all?
"""
