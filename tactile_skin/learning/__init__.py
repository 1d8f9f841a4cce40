"""Networks that invert the matrix, and the scenes that they learn from.

Imports physics.
"""
