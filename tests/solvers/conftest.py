"""Every test here runs over both implementations of the inner loops."""

from support.implementations import implementation  # noqa: F401
