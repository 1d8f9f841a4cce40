# SPDX-License-Identifier: Apache-2.0
"""What was found wrong, as a value (finding.py), and its words (words.csv)."""
