"""Marks of single cases of a parametrised test."""

import pytest


def slow(*values):
    """Return a case that runs with `pytest -m slow` only: more of what another case shows."""
    return pytest.param(*values, marks=pytest.mark.slow)
