# SPDX-License-Identifier: Apache-2.0
"""Times: against the number of cells, and of the compiled loops."""

import json

import numpy as np
import pytest

from benchmarks import kernel as benchmark
from benchmarks.accuracy import growth
from tactile_skin.bench import chart
from tactile_skin.physics import compiled
from tactile_skin.solvers import METHODS


def test_a_power_law_has_its_exponent():
    sizes = [8, 16, 32, 64]
    assert growth.exponent(sizes, [9.0, *(s**3.0 for s in sizes[1:])]) == pytest.approx(1.5)
    assert growth.exponent([16], [1.0]) is None


# --- the pictures ---


@pytest.fixture(scope="module")
def drawn():
    pytest.importorskip("matplotlib")
    chart.prepare()


def lines(figure) -> set[tuple]:
    return {
        tuple(np.round(line.get_ydata(), 9))
        for axis in figure.axes
        for line in axis.get_lines()
        if len(line.get_ydata())
    }


def test_what_is_drawn_is_what_is_written(drawn, tmp_path):
    """The growth picture's curves are the numbers of the JSON beside it."""
    from matplotlib import pyplot as plt

    data = growth.measure(4, 1, sizes=(8, 16), shares=(0.1, 0.3))["growth"]
    machine = {"processor": "p", "cores": 1, "numpy": "n", "scipy": "s", "kernel": "k"}
    figures = []

    def draw(read_back):
        figures.append(growth.draw(read_back))
        return figures[-1]

    chart.write(tmp_path, "growth", data | {"seed": 1, "quick": True, "machine": machine}, draw)
    written = json.loads((tmp_path / "growth.json").read_text())
    assert (tmp_path / "growth.png").stat().st_size > 10_000
    curves = lines(figures[0])
    assert tuple(np.round(written["touched"]["16"], 9)) in curves
    for method, entry in written["methods"].items():
        for key in ("p50_ms", "mean_g"):
            if entry[key] and (key == "p50_ms" or method in METHODS):
                assert tuple(np.round(entry[key], 9)) in curves
    plt.close("all")


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
