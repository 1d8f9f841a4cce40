# SPDX-License-Identifier: Apache-2.0
"""Several skins as one: whether the body must stop, and touches that cross from mat to mat.

Imports touch and behaviours; no bus, no clock.
"""
