# SPDX-License-Identifier: Apache-2.0
"""The program of the board's ATmega328P in C, what builds and flashes it, and the chip simulated.

Imports physics and the board's protocol.
"""
