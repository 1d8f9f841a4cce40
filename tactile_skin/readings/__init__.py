# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a board or a file are: ADC steps, another scale, or processed by somebody.

Plain numbers in, a typed answer with its words out; imports nothing of ours.
"""
