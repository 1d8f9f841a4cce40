# SPDX-License-Identifier: Apache-2.0
"""Hands that make gestures, and events that are none."""
