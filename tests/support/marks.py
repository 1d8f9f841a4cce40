# SPDX-License-Identifier: Apache-2.0
"""Marks of single cases of a parametrised test: more of what another case shows."""

import pytest


def ci(*values):
    """Return a case that runs in CI, or with `pytest -m ci`."""
    return pytest.param(*values, marks=pytest.mark.ci)


def slow(*values):
    """Return a case that runs with `pytest -m slow` only."""
    return pytest.param(*values, marks=pytest.mark.slow)
