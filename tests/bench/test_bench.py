# SPDX-License-Identifier: Apache-2.0
"""The measurements measure what they say, and the pictures show what was measured."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, cli, forward
from tactile_skin.bench import chart, run, speed, stability
from tactile_skin.bench.measure import Clock, day, errors
from tactile_skin.bench.troubles import TROUBLES, UNEVEN, pressed
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.simulation.textile import Sample, Textile
from tactile_skin.solvers import METHODS

CIRCUIT, CURVE = Circuit(), PressureCurve()


@pytest.fixture(scope="module")
def resistance():
    force = scenes.sample("blobs", 3, 16, 16, np.random.default_rng(0))
    return CURVE.resistance(force)


# --- troubles do what they say ---


def test_every_trouble_has_its_sound_strength_and_a_field_of_the_skin():
    for trouble in TROUBLES:
        assert trouble.sound is None or trouble.sound in trouble.strengths, trouble.name
        for strength in trouble.strengths:
            assert isinstance(trouble.textile(strength), Textile)
        if trouble.sound is not None:
            assert trouble.textile(trouble.sound) == UNEVEN, trouble.name


def test_pressed_areas_are_as_large_and_heavy_as_asked():
    rng = np.random.default_rng(5)
    for share in (0.1, 0.5, 1.0):
        force = pressed(20, share, 300.0, CIRCUIT, rng)
        assert (force > 0).mean() == pytest.approx(share, abs=0.03)
        assert force[force > 0].mean() == pytest.approx(300 * GRAM, rel=0.05)


# --- what the figures are made of ---


def test_errors_by_hand():
    truth = np.zeros((1, 2, 2))
    truth[0, 0, 0] = 100 * GRAM
    found = truth + 0.0
    found[0, 0, 0], found[0, 1, 1] = 90 * GRAM, 30 * GRAM
    result = errors(found, truth)
    assert result["mean_g"] == pytest.approx(10.0)
    assert result["worst_g"] == pytest.approx(30.0)
    assert result["sum_error"] == pytest.approx(0.2)
    assert result["ghosts"] == 1.0


def test_a_clock_counts_this_threads_work():
    clock = Clock()
    for _ in range(20):
        assert clock(lambda x: x + 1, 1) == 2
    assert 0.0 < clock.quantile(0.5) < 0.5 and clock.y > 0.0


def test_most_of_a_day_is_idle():
    force, adc = day(2000, np.random.default_rng(7), CIRCUIT, CURVE)
    assert force.shape == adc.shape
    assert 0.4 < (force == 0).all((1, 2)).mean() < 0.9


@pytest.mark.parametrize(
    ("silent", "reported", "words"),
    [
        (0.0, 0.0, "compensated"),
        (0.0, 0.3, "right, or told"),
        (0.0, 1.0, "told: the robot stops"),
        (0.03, 0.9, "weak where the pressure is low"),
    ],
)
def test_a_verdict_is_of_the_strengths_in_trouble(silent, reported, words):
    running = {"silent": [0.5, 0.0, silent], "reported": [0.0, reported, reported]}
    short = next(trouble for trouble in TROUBLES if trouble.name == "short")
    assert stability.verdict(short, running) == words


def test_every_trouble_has_a_reason_for_being_silent():
    assert all(trouble.reason for trouble in TROUBLES)


def test_a_method_that_refuses_a_frame_fails_loudly():
    force = np.zeros((1, 8, 8))
    force[0, 2:6, 2:6] = 900 * GRAM
    small = Circuit(8, 8)  # the shipped network is for 16 x 16
    adc = [np.full((8, 8), 0.5)]
    result = stability.judge(adc, force, small, CURVE, "cnn")
    assert result.reported[0] and result.fails[0]


def test_a_frame_fails_by_the_cells_that_are_touched():
    """However few they are; a fifth of their load is no failure, nor are 30 g."""
    force = np.zeros((1, 8, 8))
    force[0, 2, 2:4] = 500 * GRAM
    small = Circuit(8, 8)
    for off, fails in ((0.9, False), (0.7, True)):
        adc = forward(small, CURVE.resistance(off * force))
        assert stability.judge(adc, force, small, CURVE, "newton", noise=0.0).fails[0] == fails


@pytest.fixture(scope="module")
def learnt():
    """What a running skin knows of a board with another circuit."""
    circuit, rng = Circuit(12, 12), np.random.default_rng(3)
    board = Sample(Textile(noise=1.0, rest=0.03, r_par=0.85, line=20.0), circuit, CURVE, 4)
    touches = board.sample(board.expose(scenes.sample("bodies", 20, 12, 12, rng)), rng)
    return stability.learn(board.at_rest(125, rng), touches, circuit, CURVE)


def test_a_running_skin_has_learnt_its_circuit_and_its_rest(learnt):
    assert not learnt.refused and 0.3 < learnt.noise < 0.8  # the mean of 4 scans
    assert learnt.circuit.r_par == pytest.approx(0.85 * 326.0, rel=0.03)
    assert np.mean(learnt.circuit.r_line) == pytest.approx(20.0, abs=6.0)
    assert np.std(np.log(learnt.curve.rest_resistance)) == pytest.approx(0.03, rel=0.5)


def test_a_running_skin_refuses_the_rest_of_a_board_with_an_open_lead():
    small, rng = Circuit(8, 8), np.random.default_rng(3)
    board = Sample(Textile(noise=1.0, rest=0.03, open=1), small, CURVE, 4)
    found = stability.learn(board.at_rest(125, rng), [], small, CURVE)
    assert "Is it connected?" in found.refused


def test_what_stays_silent_is_listed_worst_first_with_its_reason():
    def row(name, silent):
        trouble = {"trouble": name, "unit": "%", "strengths": [1.0, 2.0, 4.0], "reason": "why"}
        return trouble | {"running": {"silent": silent}}

    data = {"troubles": [row("noise", [0, 0, 0.1]), row("short", [0] * 3),
                         row("curve off", [0.01, 0.03, 0.5])]}  # fmt: skip
    assert stability.silent(data) == [
        "- curve off [%]: 2 (3 %), 4 (50 %): why",
        "- noise [%]: 4 (10 %): why",
    ]


def test_the_stability_picture_shows_each_share(drawn):
    from matplotlib import pyplot as plt

    data = json.loads((Path(__file__).parents[2] / "docs/bench/stability.json").read_text())
    figure = stability.draw(data)
    lengths = sorted(bar.get_width() for bar in figure.axes[0].patches)
    wide = 0.94 * stability._STRIP
    shares = []
    for trouble in data["troubles"]:
        silent, told = (np.array(trouble["running"][key]) for key in ("silent", "reported"))
        split = np.concatenate([1.0 - silent - told, told, silent])
        shares += list(wide * split / len(silent))
    np.testing.assert_allclose(lengths, sorted(shares), atol=1e-9)
    plt.close(figure)


# --- the pictures ---


@pytest.fixture(scope="module")
def drawn():
    pytest.importorskip("matplotlib")
    chart.prepare()


@pytest.mark.ci
def test_the_speed_picture_shows_every_method(drawn):
    from matplotlib import pyplot as plt
    from matplotlib.text import Annotation

    data = speed.measure(2, 300, 1)["speed"]
    figure = speed.draw(data)
    for axis, (key, readout) in zip(figure.axes, speed._PANELS, strict=True):
        drawn = {
            (*np.round(line.get_xdata(), 9), *np.round(line.get_ydata(), 9))
            for line in axis.get_lines()
        }
        names = [t.get_text().split()[0] for t in axis.texts if isinstance(t, Annotation)]
        assert sorted(names) == sorted(METHODS if key == "readouts" else speed.WIRED)
        for p in data[key][readout]:
            error = round(max(p["mean_g"], speed._FLOOR), 9)
            times = np.round([p["p50_ms"], p["p99_ms"]], 9)
            assert (times[0], error) in drawn  # its mark
            assert (*times, error, error) in drawn  # its bar
            assert p["mean_g"] == p["families"]["bodies"]["mean_g"]
    assert set(speed.USES) == set(METHODS)
    assert set(p["families"]) == set(speed.FAMILIES)
    plt.close(figure)


def test_every_method_has_a_look_of_its_own():
    assert set(chart.STYLES) == set(METHODS)
    assert len({marker for _, marker, _ in chart.STYLES.values()}) == len(METHODS)


def test_an_unknown_part_is_named(capsys, tmp_path):
    assert cli.main(["bench", "colour", "--out", str(tmp_path / "out")]) == 2
    assert "part 'colour': must be one of speed, stability, or one file" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_without_matplotlib_the_extra_is_named(monkeypatch, capsys, tmp_path):
    pytest.importorskip("tqdm")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["bench", "--quick", "--out", str(tmp_path / "out")]) == 2
    assert "pip install 'tactile_skin[charts]'" in capsys.readouterr().err


@pytest.mark.slow
def test_the_whole_command(tmp_path):
    pytest.importorskip("matplotlib")
    assert cli.main(["bench", "--quick", "--out", str(tmp_path), "--seed", "3"]) == 0
    names = {name for module, _, _ in run.PARTS.values() for name in module.DRAW}
    assert {path.stem for path in tmp_path.glob("*.png")} == names
    for name in names:
        written = json.loads((tmp_path / f"{name}.json").read_text())
        assert written["seed"] == 3 and written["machine"]["numpy"] == np.__version__


@pytest.mark.ci
def test_a_users_own_circuit_and_touches_are_measured(drawn, tmp_path, capsys):
    """By the methods that know the circuit, in two panels; all troubles are of it as well."""
    config, rng = tmp_path / "mine.yaml", np.random.default_rng(3)
    config.write_text("/**: {ros__parameters: {circuit: {rows: 6, cols: 5, readout: loaded}}}\n")
    own = Circuit(6, 5, readout="loaded")
    force = scenes.sample("bodies", 30, 6, 5, rng)
    np.save(tmp_path / "mine.npy", np.rint(1023 * forward(own, CURVE.resistance(force))))
    words = f"config:={config}", str(tmp_path / "mine.npy"), "--out", str(tmp_path)
    assert cli.main(["bench", "speed", "--quick", *words]) == 0
    data = json.loads((tmp_path / "speed.json").read_text())
    assert [len(points) for points in data["panels"].values()] == [len(speed.WIRED)] * 2
    assert "| your circuit, touches of your recording | `auto` |" in capsys.readouterr().out
    given = 2, [1, 0], 6, own, CURVE, speed.WIRED
    outcome, compared = stability._on_board(TROUBLES[0], 1, *given)
    assert outcome.error.shape == (2,) and set(compared) == set(speed.WIRED)
