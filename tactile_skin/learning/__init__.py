# SPDX-License-Identifier: Apache-2.0
"""Networks that invert the matrix, and how they are trained.

Imports physics; training, the simulation.
"""
