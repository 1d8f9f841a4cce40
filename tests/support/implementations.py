"""Both implementations of the inner loops: tests/physics and tests/solvers run over each."""

import pytest

from tactile_skin.physics import compiled

COMPILED = compiled.library


@pytest.fixture(autouse=True, params=["compiled", "in NumPy"])
def implementation(request):
    """What runs during one test."""
    if request.param == "compiled" and COMPILED is None:
        pytest.skip("no compiler was found at installation")
    compiled.library = COMPILED if request.param == "compiled" else None
    yield request.param
    compiled.library = COMPILED
