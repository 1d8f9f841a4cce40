# SPDX-License-Identifier: Apache-2.0
"""Several skins as one body."""
