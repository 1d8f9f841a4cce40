# SPDX-License-Identifier: Apache-2.0
"""Each method on loaded and grounded matrices, and what tells one readout from another."""

from pathlib import Path

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import frames
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.solvers import check_reading
from tactile_skin.solvers.fixed_point import first_guess
from tactile_skin.solvers.reading import SCAN_NOISE

CURVE = PressureCurve()
KINDS = [("loaded", "rows"), ("loaded", "columns"), ("grounded", "rows"), ("grounded", "columns")]
HELD = ("grounded", "rows", "25"), ("grounded", "columns", "70")  # r_drive [ohm]
CUSHION = Path(__file__).parents[1] / "data" / "cushion_loaded"


def skin(kind, rows=8, cols=10, **others) -> Circuit:
    readout, driven, *r_drive = kind
    others["r_drive"] = float(r_drive[0]) if r_drive else 0.0
    return Circuit(rows, cols, readout=readout, driven=driven, **others)


def press(shape, newtons=2.0) -> np.ndarray:
    return scenes.finger(*shape, shape[0] / 2, shape[1] / 3, newtons)


@pytest.mark.parametrize("kind", [*KINDS, *HELD], ids="-".join)
@pytest.mark.parametrize("family", ["blobs", "rects", "random", "bodies"])
def test_newton_inverts_ideal_readings(kind, family):
    circuit = skin(kind, 12, 16)
    force, adc = frames(family, "ideal", 3, np.random.default_rng(3), circuit, CURVE)
    found = compensate(adc, circuit, CURVE, "newton", noise=0.0)
    assert (found.status == "ok").all()
    assert np.abs(found.force - force).max() < 1e-3 * GRAM


@pytest.mark.parametrize("kind", [*KINDS, *HELD], ids="-".join)
@pytest.mark.parametrize("method", ["naive", "fixed_point", "newton", "map", "auto"])
def test_each_method_finds_a_single_cell(kind, method):
    circuit, force = skin(kind), np.zeros((8, 10))
    force[3, 4] = 3.0
    found = compensate(forward(circuit, CURVE.resistance(force)), circuit, CURVE, method)
    assert found.status == "ok"
    assert found.force.argmax() == force.argmax()
    if method not in ("naive", "fixed_point"):
        assert found.force[3, 4] == pytest.approx(3.0, rel=0.02)
        assert (found.std > 0).all()


@pytest.mark.parametrize("kind", [*KINDS, *HELD], ids="-".join)
def test_map_errs_by_what_it_says(kind):
    circuit = skin(kind, 16, 16)
    force, adc = frames("bodies", "scan", 8, np.random.default_rng(4), circuit, CURVE)
    found = compensate(adc, circuit, CURVE, "map", noise=SCAN_NOISE)
    assert (found.status == "ok").all()
    exact = compensate(adc, circuit, CURVE, "newton", noise=SCAN_NOISE)
    error, touched = np.abs(found.force - force), force > 20 * GRAM
    inverse = exact.force
    if kind[0] == "grounded":  # noise puts hard loads beyond the curve's end: each cell clipped
        guesses = [first_guess(check_reading(a, circuit, CURVE, noise=SCAN_NOISE)) for a in adc]
        inverse = CURVE.force(1.0 / np.array(guesses))
    assert error.mean() < 1.1 * np.abs(inverse - force).mean()
    assert 0.45 < (error <= found.std)[touched].mean() < 0.9


@pytest.mark.parametrize("kind", [*KINDS, *HELD], ids="-".join)
def test_a_mask_and_missing_readings(kind):
    mask = np.ones((8, 10), bool)
    mask[0, :4] = mask[7, 9] = False
    circuit = skin(kind, mask=mask)
    force = press(circuit.shape) * mask
    adc = forward(circuit, CURVE.resistance(force))
    exact = compensate(adc, circuit, CURVE, "newton", noise=0.0)
    assert np.abs(exact.force - force).max() < 1e-3 * GRAM
    adc[2, 2] = adc[6, 6] = np.nan
    found = compensate(adc, circuit, CURVE, "map", missing=True)
    assert found.status == "ok"
    assert found.force.sum() == pytest.approx(force.sum(), rel=0.1)


@pytest.mark.parametrize("newtons", [0.0, 2.0])
@pytest.mark.parametrize("kind", [("loaded", "rows"), ("virtual_ground", "rows")], ids="-".join)
def test_a_cell_that_is_not_read_has_a_large_standard_deviation(kind, newtons):
    """Though it is held at rest: there log g says nothing of newtons."""
    circuit = skin(kind, r_par=0.0)
    force = newtons * (scenes.finger(8, 10, 2.0, 2.0, 1.0) > 0.05)
    force[6, 8] = 5.0
    adc = forward(circuit, CURVE.resistance(force))
    adc[6, 8] = np.nan
    found = compensate(adc, circuit, CURVE, missing=True, noise=SCAN_NOISE)
    assert found.status == "ok"
    assert found.std[6, 8] > 0.2
    if not circuit.has_cross_talk:  # nothing is known of it
        assert abs(found.force[6, 8] - 5.0) < found.std[6, 8]


@pytest.mark.parametrize("kind", [("floating", "rows"), *KINDS, *HELD], ids="-".join)
def test_a_pressed_cell_that_is_not_read_lies_within_its_standard_deviation(kind):
    """As far as the others tell of it, which lose little or nothing to it, is what it says."""
    rng, off = np.random.default_rng(61), []
    for _ in range(12):
        circuit = skin(kind, r_ref=rng.choice([500.0, 4700.0]), r_par=rng.choice([0.0, 326.0]))
        force, at = np.zeros(circuit.shape), tuple(rng.integers(circuit.shape))
        force[at] = 5.0
        adc = forward(circuit, CURVE.resistance(force))
        adc = (adc + SCAN_NOISE / 1023 * rng.standard_normal(adc.shape)).clip(0.0, 1.0)
        adc[at] = np.nan
        found = compensate(adc, circuit, CURVE, missing=True, noise=SCAN_NOISE)
        off.append(abs(found.force[at] - 5.0) / found.std[at])
    assert np.median(off) < 1.0
    assert max(off) < 3.5


@pytest.mark.parametrize("kind", [*KINDS, *HELD], ids="-".join)
def test_an_untouched_skin_rests_and_a_stream_goes_on(kind):
    circuit, rng = skin(kind), np.random.default_rng(5)
    at_rest = forward(circuit, CURVE.resistance(np.zeros(circuit.shape)))
    assert compensate(at_rest, circuit, CURVE).method == "rest"
    last = None
    for newtons in (1.0, 1.2, 1.3, 1.3):
        force = press(circuit.shape, newtons)
        steps = forward(circuit, CURVE.resistance(force)) * 1023
        steps += SCAN_NOISE * rng.standard_normal(steps.shape)
        adc = np.clip(steps, 0.0, 1023.0) / 1023
        last = compensate(adc, circuit, CURVE, start=last, noise=SCAN_NOISE)
        assert last.status == "ok"
        assert last.force.sum() == pytest.approx(force.sum(), rel=0.1)


@pytest.mark.parametrize("true", [("floating", "rows"), *KINDS], ids="-".join)
@pytest.mark.parametrize("supposed", [("floating", "rows"), *KINDS], ids="-".join)
def test_another_readout_is_suspect(true, supposed):
    force = press((8, 10)) + scenes.finger(8, 10, 1.0, 8.0, 4.0)
    adc = forward(skin(true), CURVE.resistance(force))
    found = compensate(adc, skin(supposed), CURVE, "map", noise=SCAN_NOISE)
    assert (found.status == "ok") == (true == supposed)


@pytest.mark.parametrize("kind", KINDS[:2], ids="-".join)
def test_another_r_par_is_suspect(kind):
    """Of a grounded matrix r_par scales all readings, as r_ref does."""
    force = 3.0 * press((16, 16), 6.0)
    adc = forward(skin(kind, 16, 16, r_par=420.0), CURVE.resistance(force))
    found = compensate(adc, skin(kind, 16, 16), CURVE, "map", noise=SCAN_NOISE)
    assert found.status == "suspect"


@pytest.mark.parametrize("method", ["cnn", "physics"])
def test_networks_know_the_floating_readout_only(method):
    circuit = skin(KINDS[0], 16, 16)
    adc = forward(circuit, CURVE.resistance(np.zeros(circuit.shape)))
    with pytest.raises(ValueError, match="networks know the floating readout only, not 'loaded'"):
        compensate(adc, circuit, CURVE, method)


def test_a_recorded_cushion_fits_its_own_readout():
    """Nothing is known of its fabric: the curve only bounds the cells; noise is 1 to 3 counts."""
    wide = PressureCurve((0.0, 1.0), (3e7, 100.0))
    left = {}
    for kind in (("floating", "rows"), *KINDS[:3]):
        circuit = Circuit(9, 9, r_ref=35e3, r_par=0.0, readout=kind[0], driven=kind[1])
        residuals = []
        for path in sorted(CUSHION.glob("*.csv")):
            counts = np.loadtxt(path, delimiter=",").reshape(-1, 9, 9)
            pulled_up = 1.0 - counts / 1023.0
            found = compensate(pulled_up, circuit, wide, "newton", noise=2.9)
            residuals.append(found.residual)
        left[kind] = np.median(np.concatenate(residuals))
    own = left.pop(("loaded", "rows"))  # counts
    assert own < 1.0
    assert min(left.values()) > 3.0 * own


@pytest.mark.parametrize("kind", KINDS[2:], ids="-".join)
@pytest.mark.parametrize("family", ["rects", "random"])
def test_newton_believes_hard_loads_on_a_grounded_matrix(kind, family):
    """Of a hard load only noise is left of 1 - sum v: no cells meet the readings exactly."""
    circuit = skin(kind, 16, 16)
    _, adc = frames(family, "scan", 12, np.random.default_rng(12), circuit, CURVE)
    found = compensate(adc, circuit, CURVE, "newton", noise=SCAN_NOISE)
    assert (found.status == "ok").all()
    assert found.residual.max() < 2.0 * SCAN_NOISE


@pytest.mark.parametrize("noise", [SCAN_NOISE, 0.0])
@pytest.mark.parametrize("hurry", [False, True])
@pytest.mark.parametrize("kind", HELD, ids="-".join)
def test_a_hard_load_that_reads_as_a_light_one_does_is_suspect(kind, hurry, noise):
    """Unless the crossings without a cell were read."""
    rng = np.random.default_rng(8)
    mask = rng.random((8, 8)) < 0.8
    circuit = Circuit(
        8, 8, r_ref=4700.0, r_par=0.0, readout="grounded", driven=kind[1], r_drive=25.0, mask=mask
    )
    given = {"hurry": hurry, "noise": noise}
    last = None
    for newtons in (0.2, 5.0, 5.0, 5.0):
        force = newtons * rng.uniform(0.7, 1.3, circuit.shape) * mask
        force *= newtons > 1.0 or scenes.finger(8, 8, 4.0, 3.0, 1.0) > 0.05
        adc = forward(circuit, CURVE.resistance(force))
        adc += noise * rng.standard_normal(adc.shape) / 1023.0
        adc = adc.clip(0.0, 1.0)
        found = compensate(np.where(mask, adc, np.nan), circuit, CURVE, start=last, **given)
        assert (found.status == "ok") == (newtons < 1.0), found.message
        assert found.force.sum() > 0.8 * force.sum()
        last = found
        assert newtons < 1.0 or "those without a cell" in found.message
        read = compensate(adc, circuit, CURVE, noise=noise)
        assert read.status == "ok"
        assert read.force.sum() == pytest.approx(force.sum(), rel=0.15)


@pytest.mark.parametrize("noise", [SCAN_NOISE, 0.0])
@pytest.mark.parametrize("method", ["fixed_point", "newton", "map"])
@pytest.mark.parametrize("kind", HELD, ids="-".join)
def test_no_method_believes_the_lighter_of_two_pictures(kind, method, noise):
    """Line by line only the lighter one is found."""
    rng = np.random.default_rng(21)
    mask = rng.random((8, 8)) < 0.8
    circuit = skin(kind, 8, 8, r_ref=4700.0, r_par=0.0, mask=mask)
    for newtons in (0.2, 5.0):
        force = newtons * rng.uniform(0.7, 1.3, circuit.shape) * mask
        force *= newtons > 1.0 or scenes.finger(8, 8, 4.0, 3.0, 1.0) > 0.05
        adc = forward(circuit, CURVE.resistance(force))
        adc = (adc + noise * rng.standard_normal(adc.shape) / 1023.0).clip(0.0, 1.0)
        found = compensate(np.where(mask, adc, np.nan), circuit, CURVE, method, noise=noise)
        assert (found.status == "ok") == (newtons < 1.0), found.message
        assert found.force.sum() > 0.8 * force.sum()


@pytest.mark.parametrize("method", ["fixed_point", "newton", "map"])
@pytest.mark.parametrize("kind", HELD, ids="-".join)
def test_a_palm_on_a_matrix_of_another_shape_is_felt_in_full(kind, method):
    """Crossings without a cell read what the drivers let other lines leave."""
    rng = np.random.default_rng(5)
    for _ in range(8):
        circuit = skin(kind, mask=rng.random((8, 10)) < 0.8)
        force = rng.uniform(1.5, 2.5, circuit.shape) * circuit.populated
        adc = forward(circuit, CURVE.resistance(force))
        adc = np.round(adc * 1023 + rng.normal(0.0, 0.4, adc.shape)).clip(0, 1023) / 1023
        found = compensate(adc, circuit, CURVE, method, noise=SCAN_NOISE)
        assert found.status == "ok"
        assert found.force.sum() == pytest.approx(force.sum(), rel=0.12)


def test_a_reading_next_to_an_amplifiers_end_is_a_bound():
    """Noise that is cut off there leaves the mean of a saturated reading a step or two too low."""
    circuit = Circuit(readout="virtual_ground", r_ref=4700.0)
    force, adc = frames("blobs", "scan", 60, np.random.default_rng(5), circuit, CURVE)
    ends = forward(circuit, CURVE.resistance(force)) >= 1.0
    for noise in (None, SCAN_NOISE):
        found = compensate(adc, circuit, CURVE, "map", noise=noise)
        assert (found.status == "ok").all()
        off = np.abs(found.force - force)[ends]
        assert (off < 2.0 * found.std[ends]).mean() > 0.999


@pytest.mark.parametrize("seed", [18, 53, 82, 109])
def test_cells_at_an_amplifiers_end_leave_the_others_to_the_fit(seed):
    """Steps that took them below their bounds were refused, and the others never moved."""
    rng, circuit = np.random.default_rng(seed), Circuit(8, 8, readout="virtual_ground")
    force = np.zeros(circuit.shape)
    for _ in range(3):
        at, newtons = rng.uniform(0.0, 7.0, 2), 10.0 ** rng.uniform(0.5, 1.6)
        force += scenes.finger(8, 8, *at, newtons, width=rng.uniform(0.5, 2.5))
    force = np.minimum(force, CURVE.max_force)
    adc = scenes.read_out(circuit, forward(circuit, CURVE.resistance(force)), "adc10", rng)
    found = compensate(adc, circuit, CURVE, "map")
    assert found.status == "ok"
    assert (np.abs(found.force - force) < 5.0 * found.std + 1.0 * GRAM).all()
