# SPDX-License-Identifier: Apache-2.0
"""How the shipped networks were made."""
