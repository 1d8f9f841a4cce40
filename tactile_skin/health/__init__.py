# SPDX-License-Identifier: Apache-2.0
"""A running skin, and what is wrong with it: from evidence to findings."""
