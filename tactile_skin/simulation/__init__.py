# SPDX-License-Identifier: Apache-2.0
"""A skin that nobody has to build: what touches it, its matrix, and the board that reads it.

Imports physics and, for the bytes, board. The oracles of the tests share no code with it; boards
that are damaged, and those that are drawn, are in tests/support/lab.
"""
