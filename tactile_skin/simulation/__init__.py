# SPDX-License-Identifier: Apache-2.0
"""A skin that nobody has to build: what touches it, its matrix, and the board that reads it.

scenes.py, bodies.py  pictures of forces        network.py    Kirchhoff's laws for any wiring
matrix.py    fabric, wiring, circuit, ADC       textile.py    a matrix by how strong its effects are
simulator.py the board of `tactile-skin sim`    people/       hands that make gestures

Imports physics and, for the bytes, board. The oracles of the tests share no code with it; boards
that are damaged, and those that are drawn, are in tests/support/lab.
"""
