# SPDX-License-Identifier: Apache-2.0
"""What a policy that feels gains by compensation."""
