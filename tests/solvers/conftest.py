# SPDX-License-Identifier: Apache-2.0
"""Every test here runs over both implementations of the inner loops."""

from support.implementations import implementation  # noqa: F401
