# SPDX-License-Identifier: Apache-2.0
"""A simulated board whose truth is known, and what the tests of LeRobot need."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.simulated import serving

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation import scenes, simulator

HERE = Path(__file__).parent


def pytest_collection_modifyitems(config, items):
    """Skip all of it where LeRobot is not: it wants Python 3.12."""
    if not importlib.util.find_spec("lerobot"):
        for item in items:
            if HERE in item.path.parents:
                item.add_marker(pytest.mark.skip(reason="lerobot is not installed: .ci/learning"))


class Touched:
    """A scene: nothing for 5 s, then two fingers whose force rises and falls."""

    QUIET = 5.0  # s in which the rest is measured

    def __init__(self, shape):
        self.log: list[tuple[float, float]] = []  # perf_counter [s], total [N]
        self._shapes = [
            scenes.finger(*shape, 0.3 * shape[0], 0.4 * shape[1], 1.0, 1.4),
            scenes.finger(*shape, 0.7 * shape[0], 0.7 * shape[1], 1.0, 1.4),
        ]

    def __call__(self, t):
        level = np.clip(t - self.QUIET, 0.0, 1.0)
        forces = level * (8.0 + 4.0 * np.sin(3.0 * t)), level * (7.0 + 3.0 * np.cos(2.0 * t))
        self.log.append((time.perf_counter(), sum(forces)))
        return sum(f * s for f, s in zip(forces, self._shapes, strict=True))

    def at(self, times):
        """Total force [N] at times of `perf_counter` [s]."""
        when, total = np.array(self.log).T
        return np.interp(times, when, total)


@pytest.fixture
def touched(tmp_path):
    """Link of a board that is served, its scene, and its parameter file."""
    circuit = Circuit()
    scene = Touched(circuit.shape)
    board = simulator.Board(circuit, PressureCurve(), scene)
    path = tmp_path / "mine.yaml"
    values = {"geometry": {"shape": "plane"}, "circuit": {"rows": 16, "cols": 16}}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
    with serving(tmp_path / "board", board) as served:
        yield tmp_path / "board", scene, path, served
