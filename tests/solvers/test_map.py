# SPDX-License-Identifier: Apache-2.0
"""The noise-aware inverse: its prior, its accuracy, its spread, its doubts."""

import numpy as np
import pytest
from support.accuracy import accuracy
from support.marks import slow
from support.prior import family as by_family
from support.prior import load as load_of
from support.troubled import faulty, read

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.troubles import EVERYDAY
from tactile_skin.physics.curve import GRAM
from tactile_skin.physics.readouts import PASSIVE
from tactile_skin.simulation import scenes
from tactile_skin.solvers import map as map_solver
from tactile_skin.solvers import prior
from tactile_skin.solvers.map import _gauss_newton
from tactile_skin.solvers.reading import SCAN_NOISE, check_reading

CIRCUIT, CURVE = Circuit(), PressureCurve()


def scan(force, rng, circuit=CIRCUIT):
    return scenes.read_out(circuit, forward(circuit, CURVE.resistance(force)), "scan", rng)


@pytest.mark.parametrize("seed", [5, 7])
def test_unread_cells_of_a_large_skin_under_a_load_on_all_of_it(seed):
    """One that bears nothing yet has no curvature of its own in the steps of hundreds of cells."""
    rng, circuit = np.random.default_rng(seed), Circuit(24, 32)
    force = rng.uniform(0.0, 4.0, circuit.shape)
    adc = scan(force, rng, circuit)
    adc[rng.random(circuit.shape) < 0.3] = np.nan
    with np.errstate(divide="raise"):
        found = compensate(adc, circuit, CURVE, "map", missing=True)
    assert found.status == "ok"
    assert found.force.sum() == pytest.approx(force.sum(), rel=0.02)


def test_steps_under_a_load_on_all_cells_do_not_alternate_between_two_pictures():
    rng, circuit = np.random.default_rng(7), Circuit(readout="grounded")
    for force in scenes.sample("random", 3, 16, 16, rng):
        found = compensate(scan(force, rng, circuit), circuit, CURVE, "map", noise=SCAN_NOISE)
        assert found.iterations <= map_solver.MAX_STEPS // 2


@pytest.mark.parametrize("holes", [0.0, 0.25])
def test_the_priors_gradient_is_that_of_its_value(holes):
    rng = np.random.default_rng(0)
    x = rng.normal(2.0, 0.5, (5, 6))
    cells = rng.random((5, 6)) >= holes if holes else None
    between = prior.Differences((5, 6), cells)
    gradient = prior.touches(x, between).gradient
    for i in np.ndindex(x.shape):
        step = np.zeros(x.shape)
        step[i] = 1e-6
        up, down = (prior.touches(x + s, between).value for s in (step, -step))
        assert (up - down) / 2e-6 == pytest.approx(gradient[i], abs=1e-6)


@pytest.mark.parametrize("holes", [0.0, 0.25])
def test_the_level_priors_gradient_is_that_of_its_value(holes):
    """Its level is that of the forces and moves with them."""
    rng = np.random.default_rng(2)
    x = rng.normal(-8.0, 0.5, (5, 6))
    cells = rng.random((5, 6)) >= holes

    def level(x):
        force = CURVE.force(np.exp(-x))
        return prior.level(force, -CURVE.slope(force), cells)

    gradient = level(x).gradient
    assert np.abs(gradient[cells]).min() > 0.0 and not gradient[~cells].any()
    for i in np.argwhere(cells):
        step = np.zeros(x.shape)
        step[tuple(i)] = 1e-5
        slope = (level(x + step).value - level(x - step).value) / 2e-5
        assert slope == pytest.approx(gradient[tuple(i)], rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("side", [8, 16])
def test_a_load_on_a_whole_grounded_skin_keeps_its_sum(side):
    """Its readings tell how force is shared, its sum only just: no prior pulls it."""
    circuit = Circuit(side, side, readout="grounded")
    rng = np.random.default_rng(11)
    off = []
    for force in scenes.sample("random", 8, side, side, rng):
        adc = scan(force, rng, circuit)
        found = compensate(adc, circuit, CURVE, "map")
        assert found.status == "ok", found.message
        off.append(found.force.sum() / force.sum() - 1.0)
    assert abs(np.mean(off)) < 0.1, off


def test_the_priors_majorant_lies_above_it():
    """What makes every full step of the prior alone go down."""
    rng = np.random.default_rng(1)
    x = rng.normal(2.0, 0.5, (5, 6))
    between = prior.Differences((5, 6))
    at_x = prior.touches(x, between)
    for scale in (1e-3, 0.1, 0.5):
        d = scale * rng.uniform(-1.0, 1.0, x.shape)
        curvature = (d * prior.product(at_x, d, between)).sum()
        bound = at_x.value + (at_x.gradient * d).sum() + 0.5 * curvature
        assert prior.touches(x + d, between).value <= bound + 1e-9


def test_rounding_decides_nothing():
    """A cell that a step leaves at its bound stays there, whatever the last digit of the bound."""
    for force in scenes.sample("rects", 5, 16, 16, np.random.default_rng(7)):
        adc = np.rint(forward(CIRCUIT, CURVE.resistance(force)) * 1023) / 1023
        found, moved = (
            compensate(a, CIRCUIT, CURVE, "map").force for a in (adc, adc * (1 + 2e-15))
        )
        np.testing.assert_allclose(moved, found, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (3, 4)])
@pytest.mark.parametrize("masked", [False, True])
def test_the_precision_is_that_of_the_differences_one_by_one(shape, masked):
    rng = np.random.default_rng(6)
    cells = np.ones(shape, bool)
    if masked and min(shape) > 1:
        cells[1, 2] = False
    x = np.where(cells, rng.uniform(0.0, 2.0, shape), 0.0)
    rows = []
    for i, j in np.ndindex(shape):
        for step, ends in (
            ((1.0, 0.3), {(i, j): -1.0, (i, j + 1): 1.0}),
            ((1.0, 0.3), {(i, j): -1.0, (i + 1, j): 1.0}),
        ):
            if all(a < shape[0] and b < shape[1] and cells[a, b] for a, b in ends):
                d = sum(sign * x[end] for end, sign in ends.items())
                row = np.zeros(shape)
                for end, sign in ends.items():
                    row[end] = sign
                rows.append(np.sqrt(step[0] / (step[1] ** 2 + d * d)) * row.ravel())
    each = np.array(rows).reshape(-1, x.size)
    between = prior.Differences(shape, cells)
    terms = prior.touches(x, between)
    free = np.flatnonzero(cells)[::2]
    jacobian = rng.standard_normal((7, free.size)).astype(np.float32)
    expected = jacobian.T @ jacobian + (each.T @ each)[np.ix_(free, free)]
    found = prior.precision(jacobian.T @ jacobian, terms, between, free)
    np.testing.assert_allclose(np.triu(found), np.triu(expected), rtol=1e-4, atol=1e-4)
    direction = rng.standard_normal(shape) * cells
    product = prior.product(terms, direction, between).ravel()
    np.testing.assert_allclose(product, each.T @ (each @ direction.ravel()), atol=1e-9)


def test_the_step_goes_down_the_true_cost():
    """Slope of cost over log g by central differences, against the step's right-hand side."""
    circuit = Circuit(4, 5)
    rng = np.random.default_rng(2)
    truth = rng.uniform(0.1, 5.0, (4, 5))
    reading = check_reading(scan(truth, rng, circuit), circuit, CURVE)
    x = np.log(1.0 / CURVE.resistance(truth * rng.uniform(0.7, 1.3, truth.shape)))
    point = prior.Point(reading, np.exp(x), False)
    step = _gauss_newton(reading, point)
    direction = np.zeros(20)
    direction[step.free] = step.dx
    direction = 1e-6 * direction.reshape(4, 5)
    up, down = (prior.Point(reading, np.exp(x + s), False).cost for s in (direction, -direction))
    assert (up - down) / 2e-6 == pytest.approx(-2.0 * step.gain, rel=1e-3)


@pytest.mark.parametrize("family", ["bodies", "pictures"])
def test_neighbours_say_more_of_a_cell_than_the_built_in_prior(family):
    """On touches that nothing was tuned on, with a spread that stays honest."""
    table = by_family(family, 30, seed=71, noise=SCAN_NOISE)
    error = {name: row["error"].mean() for name, row in table.items()}
    assert error["map"] < 0.97 * error["built-in prior"] < 0.97 * error["newton"]
    assert 0.58 < table["map"]["within"] < 0.78
    assert table["map"]["failed"] == 0


def test_what_neighbours_say_gives_way_to_the_readings(monkeypatch):
    """Sure of nonsense, the network is not believed."""
    force = scenes.sample("bodies", 1, 16, 16, np.random.default_rng(8))[0]
    adc = scan(force, np.random.default_rng(9))
    sound = compensate(adc, CIRCUIT, CURVE, "map", noise=SCAN_NOISE)

    def nonsense(x, std, *_):
        return np.where(np.indices(x.shape).sum(0) % 2, 0.2, 6.0), np.full(x.shape, 1e-3)

    monkeypatch.setattr(prior.denoiser, "shipped", lambda: nonsense)
    found = compensate(adc, CIRCUIT, CURVE, "map", noise=SCAN_NOISE)
    assert found.status == "ok" and found.residual < 1.2 * sound.residual
    assert np.abs(found.force - force).mean() < 2.0 * np.abs(sound.force - force).mean()


@pytest.mark.parametrize("seed", [13, 132, 161])
def test_hard_bodies_on_half_of_the_skin_are_no_load_on_all_of_it(seed):
    """The first guess lifts the cells beside them; as they return to rest, the level prior goes."""
    rng = np.random.default_rng(seed)
    force = load_of("large bodies", 1, rng)[0]
    adc = scan(force, rng)
    found, exact = (
        np.abs(compensate(adc, CIRCUIT, CURVE, method, noise=SCAN_NOISE).force - force).mean()
        for method in ("map", "newton")
    )
    assert found < 0.8 * exact


@pytest.mark.parametrize(("family", "limit"), [("blobs", 4.2), ("rects", 13.0)])
@pytest.mark.parametrize(
    ("n", "seed", "within", "suspect"),
    [(60, 3, (0.55, 0.80), 1.0), slow(300, 12, (0.60, 0.76), 0.02)],
)
def test_errors_and_spread_on_scans(family, limit, n, seed, within, suspect):
    row = accuracy("map", family, "scan", n, seed=seed)
    assert row["mean g"] < limit
    assert within[0] < row["touched within 1 std"] < within[1]
    assert row["failed"] == 0.0 and row["suspect"] <= suspect


@pytest.mark.parametrize("shape", ["disc", "tilted bar", "ramp"])
def test_touches_that_are_not_separable_are_found_too(shape):
    """The prior leans towards rectangles; other footprints cost accuracy, not the answer."""
    y, x = np.arange(16)[:, None], np.arange(16)[None]
    force = {
        "disc": 200.0 * (np.hypot(y - 7.3, x - 8.1) < 4.2),
        "tilted bar": 200.0 * ((np.abs(y - x) < 2.5) & (np.abs(y + x - 15) < 9)),
        "ramp": 30.0 * np.clip(y - 4, 0, 8) * (np.abs(x - 8) < 4),
    }[shape] * GRAM
    found = compensate(scan(force, np.random.default_rng(4)), CIRCUIT, CURVE, "map")
    assert found.status == "ok"
    assert np.abs(found.force - force)[force > 0].mean() < 0.15 * force[force > 0].mean()
    assert found.force[force == 0].max() < 20 * GRAM


def test_readings_may_be_missing_or_capped():
    force = np.zeros((16, 16))
    force[4:8, 5:9] = 150 * GRAM
    rng = np.random.default_rng(7)
    adc = scan(force, rng)
    gone = rng.random((16, 16)) < 0.08
    missing = np.where(gone, np.nan, adc)
    threshold = np.quantile(adc, 0.3)
    capped = np.where(adc <= threshold, 0.0, adc)
    for reading, arguments in (
        (missing, {"missing": True}),
        (capped, {"threshold": threshold}),
    ):
        for method in ("map", "auto"):
            found = compensate(reading, CIRCUIT, CURVE, method, noise=0.52, **arguments)
            assert np.abs(found.force - force).max() < 40 * GRAM, (method, arguments)
        with pytest.raises(ValueError, match="use map or auto"):
            compensate(reading, CIRCUIT, CURVE, "newton", **arguments)


def test_a_factorisation_that_fails_is_no_success(monkeypatch):
    def fail(precision, b, low, high):
        return np.zeros(b.size), None, np.ones(b.size, bool)

    monkeypatch.setattr(map_solver, "solve_in_box", fail)
    adc = forward(CIRCUIT, CURVE.resistance(scenes.finger(16, 16, 7.0, 8.0, 12.0)))
    found = compensate(adc, CIRCUIT, CURVE, "map")
    assert (found.status, found.iterations > 0) == ("failed", True)


def test_conjugate_gradients_that_run_away_are_no_success(monkeypatch):
    monkeypatch.setattr(map_solver, "_DENSE", 0)
    adc = forward(CIRCUIT, CURVE.resistance(scenes.finger(16, 16, 7.0, 8.0, 12.0)))
    assert compensate(adc, CIRCUIT, CURVE, "map").status == "ok"
    nothing = lambda *a, **k: np.full(a[2].size, np.nan)  # noqa: E731
    monkeypatch.setattr(map_solver, "conjugate_gradients", nothing)
    assert compensate(adc, CIRCUIT, CURVE, "map").status == "failed"


@pytest.mark.parametrize("fault", ["open", "moving"])
def test_a_fault_that_spoils_the_answer_is_suspect(fault):
    rng = np.random.default_rng(8)
    spoilt, suspect = 0, 0
    for force in scenes.sample("rects", 25, 16, 16, rng):
        adc = faulty(CIRCUIT, CURVE.resistance(force), fault, rng)
        # what moves during the scan looks like noise, unless the noise is known
        noise = SCAN_NOISE if fault == "moving" else None
        adc = scenes.read_out(CIRCUIT, adc, "scan", rng)
        found = compensate(adc, CIRCUIT, CURVE, "map", noise=noise)
        if np.abs(found.force - force).mean() > 30 * GRAM:
            spoilt += 1
            suspect += found.status == "suspect" and found.message != ""
    assert spoilt >= 10 and suspect >= 0.9 * spoilt


def test_sound_scans_are_not_suspect():
    rows = [accuracy("map", family, "scan", 60, seed=11) for family in scenes.FAMILIES]
    assert np.mean([row["suspect"] for row in rows]) <= 0.03


def test_a_frame_like_the_last_one_keeps_its_estimate():
    """A standing touch costs one look; one that grows by a tenth is fitted anew."""
    rng = np.random.default_rng(21)
    force = scenes.finger(16, 16, 7.0, 8.0, 12.0, width=1.3)

    last = compensate(scan(force, rng), CIRCUIT, CURVE, "map")
    held = [compensate(scan(force, rng), CIRCUIT, CURVE, "map", start=last) for _ in range(20)]
    assert sum(e.force is last.force for e in held) >= 10
    assert all(0.3 < e.residual < 0.8 for e in held)
    grown = compensate(scan(1.1 * force, rng), CIRCUIT, CURVE, "map", start=last)
    assert grown.iterations > 0
    assert grown.force.sum() == pytest.approx(1.1 * 12.0, rel=0.05)


@pytest.mark.parametrize("shape", [(4, 4), (8, 12), (16, 16)])
@pytest.mark.parametrize("spread", [1.0, 2.5, 4.0])
def test_a_palm_is_not_suspect_and_its_sum_is_right(shape, spread):
    """Soft towards its rim, on an everyday skin: no edge, as the prior likes it."""
    rng = np.random.default_rng([*shape, round(10 * spread)])
    circuit = Circuit(*shape)
    row, col = np.indices(shape)
    for _ in range(6):
        centre = rng.uniform(0.0, np.array(shape) - 1.0)
        force = np.exp(-(np.square(row - centre[0]) + np.square(col - centre[1])) / 2 / spread**2)
        force *= rng.uniform(5.0, 60.0) / force.sum()
        force = np.minimum(force, 9.0)
        adc = read(EVERYDAY, circuit, CURVE, force, rng)
        estimate = compensate(adc, circuit, CURVE)
        assert estimate.status == "ok", estimate.message
        assert estimate.force.sum() == pytest.approx(force.sum(), rel=0.08)


@pytest.mark.parametrize("family", ["random", "palms"])
def test_the_level_prior_is_for_loads_whose_neighbours_are_not_alike(family):
    """Touches that cover the skin have neighbours that are, however much their cells differ."""
    rng, circuit = np.random.default_rng(31), Circuit(8, 8)
    y, x = np.mgrid[:8, :8] - 3.5
    for _ in range(20):
        force = scenes.sample("random", 1, 8, 8, rng)[0]
        if family == "palms":
            softer = np.exp(-(np.hypot(y, x) ** 2) / rng.uniform(8.0, 20.0))
            force = rng.uniform(1.0, 8.0) * softer * np.exp(0.15 * rng.standard_normal((8, 8)))
        g = 1.0 / CURVE.resistance(force)
        reading = check_reading(forward(circuit, 1.0 / g), circuit, CURVE, noise=0.0)
        assert prior.is_level(reading, g) == (family == "random")


def test_a_load_of_nothing_has_no_level(recwarn):
    """A step that is too long leads there: it costs more than any other, without a warning."""
    nothing = np.zeros((4, 4))
    assert prior.level(nothing, nothing - 1.0, np.ones((4, 4), bool))[0] == np.inf
    assert not recwarn.list


def test_readings_next_to_the_cut_off_err_to_neither_side():
    """Those just above it are the ones that noise raised."""
    rng, circuit = np.random.default_rng(8), Circuit(100, 200, readout="grounded")
    true = rng.uniform(0.0, 4.0, circuit.shape) / circuit.full_scale
    adc = scenes.read_out(circuit, true, "scan", rng)
    reading = check_reading(adc, circuit, CURVE, noise=SCAN_NOISE).above_cut_off()
    assert abs(reading.misfit(true).mean()) < 0.05 * SCAN_NOISE


def even(rng, scatter):
    """(16, 16) [N]: a load on all cells, whose touch scatters."""
    force = np.exp(rng.uniform(np.log(0.3), np.log(9.0)) + scatter * rng.standard_normal((16, 16)))
    return np.minimum(force, CURVE.max_force)


@pytest.mark.parametrize("scatter", [0.05, 0.2])
@pytest.mark.parametrize("readout", PASSIVE)
def test_an_even_load_on_all_cells_is_no_fault(readout, scatter):
    """The cells of its fit differ by noise, not by a load that would be too even."""
    circuit, rng = Circuit(readout=readout), np.random.default_rng(6)
    frames = [scan(even(rng, scatter), rng, circuit) for _ in range(40)]
    found = compensate(np.array(frames), circuit, CURVE, "map", noise=SCAN_NOISE)
    assert np.count_nonzero(found.status != "ok") <= 2


@pytest.mark.parametrize("readout", ["floating", "loaded"])
def test_readings_a_step_from_a_short_circuit_leave_any_force(readout):
    """With an r_ref that is far too large for the fabric."""
    circuit = Circuit(8, 8, r_ref=200e3, r_par=100.0, adc_bits=8, readout=readout)
    rng, curve = np.random.default_rng(4), PressureCurve()
    pressed = np.zeros(circuit.shape, bool)
    pressed[2:6, 2:6] = True
    force = pressed * rng.uniform(5.0, 9.8, circuit.shape)
    steps = forward(circuit, curve.resistance(force)) * 255 + rng.normal(0.0, 0.3, force.shape)
    adc = np.rint(steps).clip(0, 255) / 255
    found = compensate(adc, circuit, curve, noise=0.42)
    at_end = pressed & (adc >= circuit.ratio(0.0) - 1.0 / 255)
    assert np.count_nonzero(at_end) >= 8
    assert (np.abs(found.force - force) < 3.0 * found.std)[at_end].all()
