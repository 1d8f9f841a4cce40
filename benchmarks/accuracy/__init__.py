# SPDX-License-Identifier: Apache-2.0
"""How far solvers and features are from the truth, and how fast."""
