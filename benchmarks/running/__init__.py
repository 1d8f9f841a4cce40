# SPDX-License-Identifier: Apache-2.0
"""The running skin: latency, signals, hours, recordings, the page."""
