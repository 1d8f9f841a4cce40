# SPDX-License-Identifier: Apache-2.0
"""Boards as they are: firmware, converters, text, another maker's insole."""
