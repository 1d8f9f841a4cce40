# SPDX-License-Identifier: Apache-2.0
"""What this board is, found from its own frames, and whether it is so still.

Imports physics and solvers.
"""
