"""A skin that nobody has to build: what touches it, its matrix, and the board that reads it.

scenes.py, bodies.py  pictures of forces        touches.py    a day's touches, one after the other
network.py   Kirchhoff's laws for any wiring    fabric.py     cells that scatter, leak and stick
matrix.py    both, in one circuit               converter.py  noise, rounding, a bad ADC
textile.py   a matrix by the strength of its    unknown.py    boards whose circuit, curve and creep
             effects                                          are drawn
board.py     a board in time, and its link      damage.py     what may happen to it
simulator.py the board of `tactile-skin sim`    people/       hands that make gestures

Imports physics and, for the bytes, board. The oracles of the tests share no code with it.
"""
