"""Both implementations of the fixed point: tests/physics and tests/solvers run over each."""

import pytest

from tactile_skin.physics import kernel

COMPILED = kernel._compiled


@pytest.fixture(autouse=True, params=["compiled", "in NumPy"])
def implementation(request):
    """What `kernel` calls during one test."""
    if request.param == "compiled" and COMPILED is None:
        pytest.skip("no compiler was found at installation")
    kernel._compiled = COMPILED if request.param == "compiled" else None
    yield request.param
    kernel._compiled = COMPILED
