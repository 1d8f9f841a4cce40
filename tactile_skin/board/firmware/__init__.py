# SPDX-License-Identifier: Apache-2.0
"""The program of the board's ATmega328P in C, and what builds and flashes it.

Imports physics and the board's protocol.
"""
