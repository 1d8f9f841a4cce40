# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the compiled loops."""

import pytest

from benchmarks import kernel as benchmark
from tactile_skin.physics import compiled


@pytest.mark.skipif(compiled.library is None, reason="no compiler was found at installation")
@pytest.mark.parametrize("scene", benchmark.SCENES)
def test_both_forms_take_turns_and_the_compiled_one_stays(scene):
    library = compiled.library
    row = benchmark.measure(scene, 8, 2)
    assert compiled.library is library
    assert row.compiled > 0.0 and row.plain > 0.0 and row.ratio > 0.0


def test_without_a_compiler_there_is_nothing_to_measure(monkeypatch):
    monkeypatch.setattr(compiled, "library", None)
    with pytest.raises(SystemExit, match="nothing is compiled"):
        benchmark.measured(1)
