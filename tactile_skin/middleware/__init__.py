# SPDX-License-Identifier: Apache-2.0
"""Topics, parameters, launch files, logs, threads and signals: what carries data between nodes.

Imports physics and touch, of which config makes objects, and msg.
"""
