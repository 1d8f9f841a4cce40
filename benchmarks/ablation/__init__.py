# SPDX-License-Identifier: Apache-2.0
"""What each mechanism that doubts readings is worth."""
