# SPDX-License-Identifier: Apache-2.0
"""Damaged boards through the complete chain, and what was missed."""
