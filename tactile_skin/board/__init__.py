# SPDX-License-Identifier: Apache-2.0
"""What is sent by a board, or by one that is simulated, up to a frame that is known to be fresh.

Imports physics.
"""
