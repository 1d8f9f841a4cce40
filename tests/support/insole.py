# SPDX-License-Identifier: Apache-2.0
"""Frames of another maker's insole: its circuit, and what the solvers make of its readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_skin import Circuit, PressureCurve, compensate, forward

# The ESP32's ADC at 12 dB, as its vendor's calibration has it for a nominal chip: 142 mV read 0,
# and a count is 0.806 mV (1100 mV * 196602 / 65536 / 4096). The divider stands on 3.3 V.
COUNT = 1100.0 * 196602 / 65536 / 4096  # mV
ADC_OFFSET = 142.0 / COUNT  # counts
FULL_SCALE = 3300.0 / COUNT  # counts
THRESHOLD = 500  # counts; the recorder wrote 0 for all up to here
NOISE = 6.0  # counts RMS, between the quietest frames of a person standing
DROPS = 25  # readings of a frame, a tenth, that may be dropped as impossible
# The divider's trimmer is not documented and the fit does not care: 0.3 to 4 kohm explain the
# frames alike. At 350 ohm the pressure adds up to a person's weight.
R_REF = 350.0

# Velostat under a disc of 3 mm radius, from the authors' clamp measurements (kPa -> kohm); below
# and above, extended to an untouched and a fully pressed cell.
_PRESSURE = (2.502, 7.132, 14.889, 25.024, 37.411, 50.048, 75.072, 100.472, 150.0)  # kPa
_RESISTANCE = (15.7, 9.05, 4.92, 2.79, 2.41, 2.15, 2.06, 1.99, 1.75)  # kohm
_REST = 200.0  # kohm; others measured a fall by a factor of 35 to 370 from no load to 1.2 kg
AREA = np.pi * 0.003**2  # m^2
_PITCH = 0.0075  # m


def curve() -> PressureCurve:
    """Force on one disc [N] <-> its resistance [ohm]."""
    force = np.array([0.0, *_PRESSURE, 1500.0]) * 1e3 * AREA
    return PressureCurve(force, np.array([_REST, *_RESISTANCE, 0.2]) * 1e3)


def circuit(mask: np.ndarray, r_ref: float = R_REF) -> Circuit:
    return Circuit(*mask.shape, r_ref=r_ref, r_par=0.0, adc_bits=12, mask=mask)


def ratio(counts, offset: float = ADC_OFFSET):
    """Counts of the ESP32 -> ADC ratio, the voltage as a share of the divider's supply."""
    return (counts + offset) / FULL_SCALE


def fit(counts: np.ndarray, skin: Circuit, cells: PressureCurve, offset: float = ADC_OFFSET):
    """`map` of one frame of counts (rows, cols), -1 where there is no sensor.

    Some crossings of this insole read less than their neighbours' paths alone let through, as if
    the line broke off for that sample: no resistance of the cell explains that. Those readings are
    taken for missing, at most DROPS of them.

    Returns:
        the Estimate, and the number of readings dropped.
    """
    there = skin.populated.copy()
    adc = np.where(there, ratio(counts.astype(float), offset), np.nan)
    noise, threshold = NOISE / FULL_SCALE, ratio(THRESHOLD, offset)
    arguments = {"noise": noise * skin.full_scale, "threshold": threshold, "missing": True}
    estimate = compensate(adc, skin, cells, "map", **arguments)
    for _ in range(3):
        model = forward(skin, cells.resistance(estimate.force))
        below = np.maximum(adc, threshold) < model - 4 * noise
        impossible = there & below & (estimate.force < 1e-3)
        if not impossible.any() or np.count_nonzero(skin.populated & ~there) > DROPS:
            break
        there &= ~impossible
        adc = np.where(there, adc, np.nan)
        estimate = compensate(adc, skin, cells, "map", **arguments)
    dropped = np.count_nonzero(skin.populated & ~there)
    if dropped > DROPS:
        estimate = replace(estimate, status="suspect", message=f"{dropped} impossible readings")
    return estimate, dropped


def touched(frames: np.ndarray) -> np.ndarray:
    """(n,) bool: frames with more than 60 readings above the threshold."""
    return (frames > 0).sum((1, 2)) > 60


def unexplained(counts: np.ndarray, skin: Circuit, force: np.ndarray, offset=ADC_OFFSET) -> float:
    """Mean square misfit in units of the noise, of all readings; dropped ones too, each at most 16.

    Unlike the residual it does not gain by dropping.
    """
    model = forward(skin, curve().resistance(force)) * FULL_SCALE - offset
    low = np.minimum(THRESHOLD - model, 0.0)
    misfit = np.where(counts > 0, counts - model, low)[skin.populated] / NOISE
    return float(np.minimum(np.square(misfit), 16.0).mean())


def summary(frames: np.ndarray, skin: Circuit, offset: float = ADC_OFFSET) -> dict:
    """Residual [counts], status and weight over frames of counts (n, rows, cols)."""
    cells = curve()
    found, dropped = zip(*(fit(frame, skin, cells, offset) for frame in frames), strict=True)
    residual = np.quantile([e.residual for e in found], (0.05, 0.5, 0.95))
    misfit = [
        unexplained(frame, skin, e.force, offset) for frame, e in zip(frames, found, strict=True)
    ]
    share = _PITCH**2 / AREA  # the discs stand for the whole sole
    why = [reason(e.message) for e in found if e.status != "ok"]
    return {
        "frames": len(found),
        "residual p5 p50 p95": [round(float(r), 1) for r in residual],
        "readings dropped p50 max": [float(np.median(dropped)), int(max(dropped))],
        "unexplained": round(float(np.mean(misfit)), 2),
        "weight N p50": round(float(np.median([e.force.sum() for e in found]) * share)),
        "ok": float(np.mean([e.status == "ok" for e in found])),
        "suspect": float(np.mean([e.status == "suspect" for e in found])),
        "why": {name: why.count(name) for name in sorted(set(why))},
    }


def reason(message: str) -> str:
    """The test that spoke, of an Estimate's message."""
    kinds = {"evenly": "load", "lean": "r_par", "residual": "residual", "alike": "short"}
    return next((name for word, name in kinds.items() if word in message), message)


def twins(frames: np.ndarray, skin: Circuit, seed: int = 0) -> np.ndarray:
    """What a sound insole would read of such feet: the fits' cells, each 30 % off, with noise."""
    rng = np.random.default_rng(seed)
    cells = curve()
    made = np.full(frames.shape, -1, np.int16)
    for twin, frame in zip(made, frames, strict=True):
        resistance = cells.resistance(fit(frame, skin, cells)[0].force)
        resistance *= np.exp(0.3 * rng.standard_normal(skin.shape))
        read = forward(skin, resistance) * FULL_SCALE - ADC_OFFSET
        read = np.rint(read + NOISE * rng.standard_normal(skin.shape))
        twin[skin.populated] = np.where(read > THRESHOLD, read, 0)[skin.populated]
    return made


def miswired(frames: np.ndarray, row: np.ndarray, col: np.ndarray, rng):
    """The frames with their cells permuted, and with the picture's grid for the wiring."""
    mask = frames[0] >= 0
    permuted = frames.copy()
    for frame in permuted:
        frame[mask] = rng.permutation(frame[mask])
    picture = np.where(row >= 0, frames[:, row, col], -1)
    keep = (row >= 0).any(1), (row >= 0).any(0)
    return permuted, picture[:, keep[0]][:, :, keep[1]]


def controls(frames: np.ndarray, row: np.ndarray, col: np.ndarray, seed: int = 0) -> dict:
    """The same frames with the cells permuted, and with the picture's grid for the wiring.

    And, for what the tests say of such a load when nothing is wrong, simulated twins of them.
    """
    mask = frames[0] >= 0
    permuted, picture = miswired(frames, row, col, np.random.default_rng(seed))
    return {
        "simulated": summary(twins(frames, circuit(mask), seed), circuit(mask)),
        "permuted": summary(permuted, circuit(mask)),
        "picture's grid": summary(picture, circuit(picture[0] >= 0)),
    }
