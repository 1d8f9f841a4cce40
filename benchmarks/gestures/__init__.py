# SPDX-License-Identifier: Apache-2.0
"""What gestures are worth: which pictures serve, on which board, how soon, and what is none."""
