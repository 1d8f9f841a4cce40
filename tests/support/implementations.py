# SPDX-License-Identifier: Apache-2.0
"""Both implementations of the inner loops: tests/physics and tests/solvers run over each."""

import pytest

from tactile_skin.physics import compiled

from .marks import slow

COMPILED = compiled.library
# test_kernel.py compares the two function by function: the rest of NumPy's runs with the slow tests
_BOTH = ["in NumPy"] if COMPILED is None else ["compiled", slow("in NumPy")]


@pytest.fixture(autouse=True, params=_BOTH)
def implementation(request):
    """What runs during one test."""
    compiled.library = COMPILED if request.param == "compiled" else None
    yield request.param
    compiled.library = COMPILED
