# SPDX-License-Identifier: Apache-2.0
"""The page: what the skin sees and says, in a browser. Its server is a process of its own.

Imports msg, physics, solvers, touch, health, middleware, recording, guide, calibrated.
"""
