# SPDX-License-Identifier: Apache-2.0
"""Boards as strangers have them: their sketches, their links, their readings."""
