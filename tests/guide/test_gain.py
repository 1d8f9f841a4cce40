# SPDX-License-Identifier: Apache-2.0
"""`calibrate --gain`, what weights prove, and that a wrong entry ends unproved."""

import datetime
from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.lab.unknown import Unknown
from support.marks import ci, slow
from support.strangers.sim import finger
from support.weights import known
from test_guide import Person

from tactile_skin.commands import calibrate
from tactile_skin.guide.calibrated import known_of
from tactile_skin.guide.calibration import Guide
from tactile_skin.guide.gain import measure_gain, write_gain
from tactile_skin.middleware.config import read_skin
from tactile_skin.physics.proof import NOTHING, WEIGHT

SHAPE = 10, 10
DAY = datetime.date(2026, 11, 28)
WEIGHTS = 4.0, 44.0, 10.0, 25.0  # N
CONFIG = """# my mat
/**:
  ros__parameters:
    circuit: {{rows: 10, cols: 10, r_ref: {r_ref}, r_par: {r_par}, r_line: {r_line}}}  # measured
    geometry: {{shape: plane}}
stop_on_push: {{ros__parameters: {{debounce: 0.02}}}}
"""


class Presses(Person):
    """Presses three places whenever it is asked to, then lays one weight on."""

    def __init__(self, board, weight: float):
        super().__init__(board, (), shape=SHAPE)
        self._laid = finger(SHAPE, 4.6, 5.2, weight, 1.0)
        self._touches = [2.0 * touch for touch in self._touches]

    def ask(self, text: str) -> str:
        super().ask(text)
        self._force = self._laid if "Lay the weight" in text else 0.0 * self._laid
        return ""

    def say(self, text: str) -> None:
        self.heard.append(text)
        self._pressing = self._pressing or "Press hard" in text or "more places" in text


def described(board: Unknown, path, r_ref: float = 1.0):
    """Write the file of a board whose r_ref is entered as `r_ref` times the true one."""
    true = known(board)
    path.write_text(CONFIG.format(r_ref=r_ref * true.r_ref, r_par=true.r_par, r_line=true.r_line))
    return read_skin(path)


def guide_of(skin, person) -> Guide:
    given = known_of(skin)
    return Guide(skin.circuit, person.frames, person.ask, person.say, today=lambda: DAY, **given)


@pytest.fixture
def board():
    return Unknown(SHAPE, seed=61)


def test_one_weight_scales_the_curve_and_proves_it(tmp_path):
    """All other entries stay, comments too; a second time it changes little."""
    board, path = Unknown(SHAPE, seed=801), tmp_path / "mine.yaml"
    skin = described(board, path)
    before = yaml.safe_load(path.read_text())
    factors = []
    for _ in range(2):
        guide = guide_of(skin, Presses(board, 20.0))
        factors.append(measure_gain(guide, 20.0, skin))
        write_gain(path, path, guide, factors[-1], skin)
        skin = read_skin(path)
    assert abs(factors[0] - 1.0) > 0.1 and factors[1] == pytest.approx(1.0, abs=0.04)
    assert (skin.proof.by, skin.proof.date) == (WEIGHT, DAY) and 0.1 <= skin.proof.error <= 0.3
    after = yaml.safe_load(path.read_text())
    parameters = after["/**"]["ros__parameters"]
    assert set(parameters.pop("curve")) <= {
        *("gain", "force", "resistance", "proof", "proof_error", "proof_date")
    }
    assert after == before and "# my mat" in path.read_text() and "# measured" in path.read_text()
    assert skin.curve.gain[0, 0] == pytest.approx(np.prod(factors), rel=1e-3)


@pytest.mark.parametrize(
    ("weight", "why"), [(60.0, r"factor of .*run calibrate with weights"), (0.5, "factor of")]
)
def test_a_factor_that_no_fabric_has_is_refused(board, tmp_path, weight, why):
    skin = described(board, tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match=f"not proved: .*{why}"):
        measure_gain(guide_of(skin, Presses(board, 8.0)), weight, skin)


def test_a_gain_that_makes_up_for_a_wrong_r_ref_is_refused(board, tmp_path):
    """It would be right at that weight, and at a palm's pressure felt too light."""
    skin = described(board, tmp_path / "mine.yaml", r_ref=1.6)
    with pytest.raises(ValueError, match=r"not proved: .*r_ref"):
        measure_gain(guide_of(skin, Presses(board, 20.0)), 20.0, skin)


@pytest.mark.parametrize(
    ("r_ref", "light", "proof"),
    [slow(1.0, False, WEIGHT), ci(2.0, False, WEIGHT), ci(10.0, True, NOTHING)],
)
def test_weights_prove_what_touches_explain(board, tmp_path, r_ref, light, proof):
    """A wrong r_ref is as good as the right one with the r_par that reads alike, found or not."""
    path = tmp_path / "mine.yaml"
    skin = described(board, path, r_ref)
    person = Person(board, WEIGHTS, shape=SHAPE)
    if light:
        person._touches = [0.01 * touch for touch in person._touches]
    guide = guide_of(skin, person)
    guide.run()
    calibrate.write(path, path, guide, skin)
    found = read_skin(path)
    assert found.proof.by == guide.proof.by == proof
    heard = "\n".join(person.heard)
    assert ("Proved by" in heard) == (proof == WEIGHT) != ("Not proved: " in heard)
    if proof == WEIGHT:
        assert found.proof.error >= 0.1 and found.proof.date == DAY
        assert found.circuit.r_par == pytest.approx(r_ref * board.r_par, rel=0.05)
        assert ("reads the same" in heard) == (r_ref != 1.0)


@pytest.mark.ci
def test_touches_without_a_weight_write_nothing(board, tmp_path):
    """Readings tell resistances as multiples of r_ref: which is right is said, not chosen."""
    skin = described(board, tmp_path / "mine.yaml", 2.0)
    person = Person(board, (), shape=SHAPE)
    guide = guide_of(skin, person)
    guide.run()
    assert guide.found.told["r_par"] and not guide.learnt
    guide.known = replace(guide.known, by="resistor")
    assert "r_par" in guide.learnt
