# SPDX-License-Identifier: Apache-2.0
"""Nodes that watch the others, and hold none of them up."""
