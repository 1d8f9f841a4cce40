# SPDX-License-Identifier: Apache-2.0
"""Recorded readings through the nodes of the skin, on a clock that is driven.

Imports everything but bench and the command line.
"""
