"""The measurements measure what they say, and the pictures show what was measured."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from kirchhoff import adc_ratio
from yardsticks import watch
from yardsticks.solvers import other_board, r_par_std

from tactile_skin import Circuit, PressureCurve, cli, forward
from tactile_skin.bench import (
    cases,
    chart,
    choose,
    growth,
    run,
    speed,
    stability,
    textile,
    touch_to_stop,
    way,
)
from tactile_skin.bench.faults import FAULTS, TROUBLES, UNEVEN, faulty, pressed
from tactile_skin.bench.measure import Clock, day, errors
from tactile_skin.bench.textile import Board, Textile
from tactile_skin.learning import scenes
from tactile_skin.physics.curve import GRAM
from tactile_skin.solvers import METHODS

CIRCUIT, CURVE = Circuit(), PressureCurve()
SMALL = Circuit(5, 4)


@pytest.fixture(scope="module")
def resistance():
    force = scenes.sample("blobs", 3, 16, 16, np.random.default_rng(0))
    return CURVE.resistance(force)


def seen(skin: Textile, force, seed=0, circuit=CIRCUIT):
    return textile.expose(skin, circuit, CURVE, force, np.random.default_rng(seed))


# --- the richer model ---


def test_a_skin_that_differs_in_nothing_is_the_solvers(resistance):
    ratio = CIRCUIT.ratio(textile.two_terminal(resistance))
    np.testing.assert_allclose(ratio, forward(CIRCUIT, resistance), rtol=1e-12)
    force = CURVE.force(resistance[0])
    np.testing.assert_allclose(seen(Textile(), force), forward(CIRCUIT, resistance[0]), rtol=1e-9)


def test_the_model_meets_the_papers_equations():
    resistance = np.random.default_rng(1).uniform(100, 5000, (5, 4))
    rho = textile.two_terminal(resistance)
    np.testing.assert_allclose(SMALL.ratio(rho), adc_ratio(resistance, 1780.0, 326.0), rtol=1e-10)


def test_stripe_resistance_by_hand():
    """The path is row, cell, column; two cells of a row share its first half."""
    assert textile.two_terminal(np.array([[100.0]]), line=7.0) == pytest.approx(114.0)
    near, far = textile.two_terminal(np.array([[100.0, 300.0]]), line=8.0)[0]
    assert near == pytest.approx(4 + 100 + 8)  # half the row, the cell, the whole column
    assert far == pytest.approx(8 + 300 + 8)


def test_stripe_resistance_by_the_whole_network():
    """Against a nodal solve with a node at each crossing of each stripe."""
    rows, cols, line = 3, 4, 20.0
    cell = np.random.default_rng(2).uniform(100, 2000, (rows, cols))
    n = rows * cols
    laplacian = np.zeros((2 * n + rows + cols,) * 2)  # row sides, column sides, leads

    def resistor(a, b, ohm):
        laplacian[[a, b], [a, b]] += 1 / ohm
        laplacian[[a, b], [b, a]] -= 1 / ohm

    for i in range(rows):
        for j in range(cols):
            k = i * cols + j
            resistor(k, n + k, cell[i, j])
            resistor(k, k - 1 if j else 2 * n + i, line / cols)
            resistor(n + k, n + k - cols if i else 2 * n + rows + j, line / rows)
    inverse = np.linalg.pinv(laplacian)
    a, b = np.meshgrid(2 * n + np.arange(rows), 2 * n + rows + np.arange(cols), indexing="ij")
    expected = inverse[a, a] + inverse[b, b] - 2 * inverse[a, b]
    np.testing.assert_allclose(textile.two_terminal(cell, line), expected, rtol=1e-9)


def test_a_cut_lead_reads_nothing_and_harms_no_other_line(resistance):
    rho = textile.two_terminal(resistance[0], cuts={3: 0, 20: 0})
    sound = textile.two_terminal(resistance[0])
    assert np.isinf(rho[3]).all() and np.isinf(rho[:, 4]).all()
    others = np.ix_(np.arange(16) != 3, np.arange(16) != 4)
    np.testing.assert_allclose(rho[others], sound[others], rtol=1e-10)


def test_a_broken_stripe_is_two_stripes(resistance):
    """The far part has no lead: as a network of 17 rows of which the last is not read."""
    rho = textile.two_terminal(resistance[0], cuts={3: 5})
    split = np.full((17, 16), 1e12)
    split[:16] = resistance[0]
    split[16, 5:], split[3, 5:] = resistance[0, 3, 5:], 1e12
    np.testing.assert_allclose(rho, textile.two_terminal(split)[:16], rtol=1e-6)


def test_shorted_lines_read_nearly_alike(resistance):
    rho = textile.two_terminal(resistance[0], shorts=[6, 16 + 9])
    assert np.abs(rho[6] - rho[7]).max() < 1.0 and np.abs(rho[:, 9] - rho[:, 10]).max() < 1.0


# --- boards that are not as configured ---


def test_what_an_exact_inverse_misses_by_is_the_boards_doing():
    row = other_board("blobs", "R_par", 6, seed=1)
    force = scenes.sample("blobs", 6, 16, 16, np.random.default_rng(1))
    load = np.abs(force).mean() / GRAM
    assert 0.02 * load < row["newton"] < load
    assert row["physics"] < 2.0 * row["newton"]
    both = other_board("blobs", "both", 6, seed=1)
    curve = other_board("blobs", "curve", 6, seed=1)
    assert curve["newton"] < both["newton"]


def test_a_frame_tells_r_par_less_where_the_rest_is_not_known():
    row = r_par_std("rects", 4, seed=1)
    known, alike = row["rest known"][0], row["rest alike"][0]
    assert 0.3 < known < alike < 16.3, "5 % of 326 ohm"


# --- troubles do what they say ---


def test_every_trouble_has_its_sound_strength_and_a_field_of_the_skin():
    for trouble in TROUBLES:
        assert trouble.sound is None or trouble.sound in trouble.strengths, trouble.name
        for strength in trouble.strengths:
            assert isinstance(trouble.textile(strength), Textile)
        if trouble.sound is not None:
            assert trouble.textile(trouble.sound) == UNEVEN, trouble.name


def test_open_leads_and_lines_at_full_scale_are_as_many_as_asked():
    force = np.zeros((16, 16))
    for n in (1, 3):
        adc = seen(Textile(open=n), force)
        assert (adc == 0).all(1).sum() + (adc == 0).all(0).sum() == n
        adc = seen(Textile(full_scale=n), force)
        assert (adc == 1).all(1).sum() + (adc == 1).all(0).sum() == n


def test_stuck_cells_conduct_without_a_load():
    adc = seen(Textile(stuck=2), np.zeros((16, 16)))
    rest = forward(CIRCUIT, np.full((16, 16), CURVE.rest_resistance))
    assert (adc > 2 * rest).sum() >= 2


def test_a_contact_that_moves_reads_otherwise():
    force = scenes.finger(16, 16, 7.5, 7.5, 10.0)
    still, moved = (seen(Textile(moving=m), force, seed=3) for m in (0.0, 6.0))
    change = np.abs(moved - still).max(1)
    assert change.max() > 20 / 1023
    slow = seen(Textile(moving=0.01), force, seed=3)
    assert np.abs(slow - still).max() < 3 / 1023


def test_the_readout_saturates_and_has_the_noise_asked_for():
    ratio = np.full((60, 60), 0.6)
    circuit = Circuit(60, 60)
    rng = np.random.default_rng(4)
    assert textile.sample(Textile(ceiling=0.5), circuit, ratio, rng).max() <= 0.5005
    steps = textile.sample(Textile(noise=4.0), circuit, ratio, rng) * 1023
    assert steps.std() == pytest.approx(2.0, rel=0.1)  # the mean of four


def test_coupling_leaks_into_neighbours_only():
    force = np.zeros((16, 16))
    force[8, 8] = 500 * GRAM
    change = np.abs(seen(Textile(lateral=0.05), force) - seen(Textile(), force))
    assert change[8, 9] > 5 / 1023 and change[8, 9] > 5 * change[2, 2]


def test_pressed_areas_are_as_large_and_heavy_as_asked():
    rng = np.random.default_rng(5)
    for share in (0.1, 0.5, 1.0):
        force = pressed(20, share, 300.0, CIRCUIT, rng)
        assert (force > 0).mean() == pytest.approx(share, abs=0.03)
        assert force[force > 0].mean() == pytest.approx(300 * GRAM, rel=0.05)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_changes_the_reading(fault, resistance):
    adc = faulty(CIRCUIT, resistance[0], fault, np.random.default_rng(6))
    assert np.abs(adc - forward(CIRCUIT, resistance[0])).max() > 2 / 1023


def test_an_unknown_fault_is_refused(resistance):
    with pytest.raises(ValueError, match="must be one of open, short"):
        faulty(CIRCUIT, resistance[0], "rust", np.random.default_rng(0))


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


def test_a_power_law_has_its_exponent():
    sizes = [8, 16, 32, 64]
    assert growth.exponent(sizes, [9.0, *(s**3.0 for s in sizes[1:])]) == pytest.approx(1.5)
    assert growth.exponent([16], [1.0]) is None


def test_most_of_a_day_is_idle():
    force, adc = day(2000, np.random.default_rng(7), CIRCUIT, CURVE)
    assert force.shape == adc.shape
    assert 0.4 < (force == 0).all((1, 2)).mean() < 0.9


def test_objects_carry_their_load():
    for name in cases.OBJECTS:
        force = cases.pressed(name, 200.0)
        assert force.shape == (16, 16) and force.max() == pytest.approx(200 * GRAM)
        assert 8 < (force > 0).sum() < 160, name


def test_a_scale_of_two_has_slope_two_and_no_spread():
    truth = {"a": [1.0, 2.0], "b": [4.0]}
    found = {"a": [2.0, 4.0], "b": [8.0]}
    assert cases.scale(truth, found) == pytest.approx({"slope": 2.0, "spread": 0.0})


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
    board = Board(Textile(noise=1.0, rest=0.03, r_par=0.85, line=20.0), circuit, CURVE, 4)
    touches = board.sample(board.expose(scenes.sample("bodies", 20, 12, 12, rng)), rng)
    return stability.learn(board.at_rest(125, rng), touches, circuit, CURVE)


def test_a_running_skin_has_learnt_its_circuit_and_its_rest(learnt):
    assert not learnt.refused and 0.3 < learnt.noise < 0.8  # the mean of 4 scans
    assert learnt.circuit.r_par == pytest.approx(0.85 * 326.0, rel=0.03)
    assert np.mean(learnt.circuit.r_line) == pytest.approx(20.0, abs=6.0)
    assert np.std(np.log(learnt.curve.rest_resistance)) == pytest.approx(0.03, rel=0.5)


def test_a_running_skin_refuses_the_rest_of_a_board_with_an_open_lead():
    small, rng = Circuit(8, 8), np.random.default_rng(3)
    board = Board(Textile(noise=1.0, rest=0.03, open=1), small, CURVE, 4)
    found = stability.learn(board.at_rest(125, rng), [], small, CURVE)
    assert "Is it connected?" in found.refused


def test_what_stays_silent_is_listed_worst_first_with_its_reason():
    def row(name, silent):
        trouble = {"trouble": name, "unit": "%", "strengths": [1.0, 2.0, 4.0], "reason": "why"}
        return trouble | {"running": {"silent": silent}}

    data = {"troubles": [row("noise", [0, 0, 0.1]), row("short", [0] * 3),
                         row("curve off", [0.01, 0.03, 0.5])]}  # fmt: skip
    assert choose.silent(data) == [
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


@pytest.mark.parametrize(
    ("verdict", "section"),
    [("noise hides", "silent"), ("told: the robot stops", "told"), ("right, or told", "told"),
     ("compensated", "right")],
)  # fmt: skip
def test_a_trouble_stands_where_its_verdict_says(verdict, section):
    assert stability._section({"verdict": verdict, "reason": "noise hides"}) == section


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

    data = growth.measure(4, 1, sizes=(8, 16))["growth"]
    machine = {"processor": "p", "cores": 1, "numpy": "n", "scipy": "s", "kernel": "k"}
    figures = []

    def draw(read_back):
        figures.append(growth.draw(read_back))
        return figures[-1]

    chart.write(tmp_path, "growth", data | {"seed": 1, "quick": True, "machine": machine}, draw)
    written = json.loads((tmp_path / "growth.json").read_text())
    assert (tmp_path / "growth.png").stat().st_size > 10_000
    curves = lines(figures[0])
    for entry in written["methods"].values():
        for key in ("p50_ms", "mean_g"):
            if entry[key]:
                assert tuple(np.round(entry[key], 9)) in curves
    plt.close("all")


def test_the_speed_picture_shows_every_method(drawn):
    from matplotlib import pyplot as plt

    data = speed.measure(2, 300, 1)["speed"]
    figure = speed.draw(data)
    for axis, (key, readout) in zip(figure.axes, speed._PANELS, strict=True):
        drawn = {
            (*np.round(line.get_xdata(), 9), *np.round(line.get_ydata(), 9))
            for line in axis.get_lines()
        }
        names = [text.get_text().split()[0] for text in axis.texts]
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


def test_the_tables_hold_each_method_and_family(drawn):
    data = json.loads((Path(__file__).parents[2] / "docs/bench/speed.json").read_text())
    auto = next(p for p in data["readouts"]["scan"] if p["method"] == "auto")
    first = choose.lines(data)[2]
    assert first.startswith("| `auto` | a robot") and f"| {auto['p99_ms']:.1f} |" in first
    table = choose.paper(data)
    assert len(table) == 2 + len(METHODS)
    assert all(line.count("|") == 2 + 2 * len(scenes.FAMILIES) for line in table)


@pytest.mark.parametrize("page", ["docs/lab/accuracy.md", "docs/lab/bench.md"])
def test_the_pages_hold_the_lines_of_the_run_that_they_show(page):
    root = Path(__file__).parents[2]
    text = (root / page).read_text()
    assert "<!-- which method -->" in text
    assert choose.fill(text, choose.blocks(root / "docs/bench")) == text


def test_only_the_named_block_of_a_page_is_replaced():
    page = "before\n<!-- a -->\nold\nlines\n<!-- end -->\nafter <!-- end -->\n"
    assert choose.fill(page, {"a": "new", "b": "none"}) == (
        "before\n<!-- a -->\nnew\n<!-- end -->\nafter <!-- end -->\n"
    )


def test_every_method_has_a_look_of_its_own():
    assert set(chart.STYLES) == set(METHODS)
    assert len({marker for _, marker, _ in chart.STYLES.values()}) == len(METHODS)


def test_an_unknown_part_is_named(capsys, tmp_path):
    assert cli.main(["bench", "colour", "--out", str(tmp_path / "out")]) == 2
    assert "part 'colour': must be one of speed, cases" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_without_matplotlib_the_extra_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["bench", "--quick", "--out", str(tmp_path / "out")]) == 2
    assert "pip install 'tactile_skin[charts]'" in capsys.readouterr().err


@pytest.mark.slow
def test_the_whole_command(tmp_path):
    pytest.importorskip("matplotlib")
    assert cli.main(["bench", "--quick", "--out", str(tmp_path), "--seed", "3"]) == 0
    parts = [run.PARTS[name] for name in run.PARTS if name not in run.ON_REQUEST]
    names = {name for module, _, _ in parts for name in module.DRAW}
    assert {path.stem for path in tmp_path.glob("*.png")} == names
    for name in names:
        written = json.loads((tmp_path / f"{name}.json").read_text())
        assert written["seed"] == 3 and written["machine"]["numpy"] == np.__version__


@pytest.mark.slow
def test_a_skin_decides_on_every_frame():
    found = way.run_skins(1, "naive", 100, 3.0, 0)
    assert found["frames"] >= 280 and found["missed"] == 0
    assert 0.0 < found["p50_ms"] <= found["p99_ms"] <= found["max_ms"]


# --- touch to stop ---

CALLS = [(0.5, True, "stale"), (1.0, False, ""), (2.01, True, "push"), (2.1, True, "push + x")]


@pytest.mark.parametrize(
    ("start", "end", "found"),
    [(2.0, 2.2, 2.01), (1.5, 2.2, 2.01), (2.0, 2.005, None), (2.05, 2.2, None), (0.7, 0.9, None)],
)
def test_a_stop_counts_from_free_and_in_its_time(start, end, found):
    """One that stood already is none of the push's."""
    assert touch_to_stop._stop_after(CALLS, start, end) == found


def test_a_push_is_seen_when_the_samples_hold_it_not_when_it_is_applied():
    """The low-pass is some scans behind a force that comes at once."""
    force = scenes.finger(16, 16, 7.0, 8.0, 60.0, 1.8)
    recorder = touch_to_stop._Recorder([(0.1, 0.0, force)], seed=0)
    for _ in range(60):
        recorder.scan()
    (scans,) = recorder.scans
    first = next(k for k, (_, newtons, _) in enumerate(scans) if newtons >= 30.0)
    seen = [t for t, _, _ in scans].index(touch_to_stop._seen(scans))
    assert first == 0
    assert 2 <= seen <= 6
    assert touch_to_stop._seen(scans[:seen]) is None


def test_a_muted_board_says_nothing_and_goes_on_scanning():
    recorder = touch_to_stop._Recorder([], seed=0)
    recorder.mute = True
    assert b"".join(recorder.scan() for _ in range(20)) == b""
    assert recorder.silent_since is not None


def test_the_picture_shows_every_push_and_every_cut():
    pytest.importorskip("matplotlib")
    chart.prepare()
    from matplotlib import pyplot as plt

    rises = [
        {"rise_ms": r, "seen_ms": [5.0, 9.0, 7.0], "applied_ms": [15.0, 19.0, 17.0], "missed": 1}
        for r in (0.0, 20.0, 50.0, 100.0)
    ]
    cuts = {"closed_ms": [1.0, 2.0], "silent_ms": [110.0, None]}
    figure = touch_to_stop.draw({"rises": rises, "cuts": cuts})
    seen, applied, cut = figure.axes
    for axis, first in ((seen, 5.0), (applied, 15.0)):
        for line in axis.get_lines()[:4]:
            np.testing.assert_allclose(line.get_xdata(), [0.0, first, first + 2, first + 4])
            np.testing.assert_allclose(line.get_ydata(), [0.0, 0.25, 0.5, 0.75])
    assert cut.get_lines()[1].get_ydata()[-1] == 0.5  # one never came
    plt.close(figure)


def test_the_page_holds_the_table_of_the_run_that_it_shows():
    root = Path(__file__).parents[2]
    data = json.loads((root / "docs/bench/touch_to_stop.json").read_text())
    assert sum(entry["missed"] for entry in data["rises"]) == 0
    assert touch_to_stop.table(data) in (root / "docs/lab/stop.md").read_text()


@pytest.mark.slow
def test_touch_to_stop_on_the_running_skin():
    """Typical times only: the tail is the machine's, see docs/lab/stop.md."""
    found = touch_to_stop.measure(4, 2, 0)["touch_to_stop"]
    for entry in found["rises"]:
        assert entry["missed"] == 0 and len(entry["seen_ms"]) == 4
        assert np.median(entry["seen_ms"]) <= touch_to_stop.LIMIT_MS
    for times in found["cuts"].values():
        assert len(times) == 2 and max(times) <= touch_to_stop.CUT_LIMIT_MS


# --- a fault that lasts ---


def test_a_short_that_comes_under_a_touch_is_reported_and_a_sound_skin_is_not():
    for name in ("sound", "one short"):
        seen = watch.watched("strokes", watch.SKINS[name], False, 1, 1)
        assert seen["fault"].any() == (name != "sound")
        assert seen["doubted"].mean() < 0.2 if name == "sound" else seen["fault"].argmax() <= 20
