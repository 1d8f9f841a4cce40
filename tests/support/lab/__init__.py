# SPDX-License-Identifier: Apache-2.0
"""Boards that may be damaged or that nobody here made, and a day's touches: for tests, benchmarks.

board.py, damage.py   a board in time with its link, and what may happen to it
parts.py              its parts, which may be bad
unknown.py            boards whose circuit, curve and creep are drawn
touches.py            what touches a skin in a day
"""
