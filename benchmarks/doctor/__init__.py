# SPDX-License-Identifier: Apache-2.0
"""What is said of damaged, wrongly described and sound boards."""
