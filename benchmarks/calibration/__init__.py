# SPDX-License-Identifier: Apache-2.0
"""What a skin learns of its board: rest, circuit, curve, creep."""
