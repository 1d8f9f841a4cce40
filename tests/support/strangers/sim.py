# SPDX-License-Identifier: Apache-2.0
"""Readings of simulated strangers' boards, by the public forward model."""

import numpy as np

from tactile_skin import Circuit, PressureCurve, forward


def finger(shape, row, col, force, width=0.8):
    """Return (rows, cols) forces [N] of a touch whose standard deviation is `width` cells."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    g = np.exp(-((y - row) ** 2 + (x - col) ** 2) / (2 * width**2))
    return force * g / g.sum()


def fabric(circuit: Circuit, seed=1, scatter=0.03, curve=None) -> PressureCurve:
    """Return the curve of a fabric whose cells differ by `scatter` at rest."""
    curve = curve or PressureCurve()
    rng = np.random.default_rng(seed)
    factors = np.exp(scatter * rng.standard_normal(circuit.shape))
    return curve.resting_at(curve.rest_resistance * factors)


def counts(circuit: Circuit, curve, force, rng, *, noise=0.7, full=None, inverted=False, top=None):
    """Return (..., rows, cols) whole ADC steps that the board reads under forces [N].

    Args:
        noise: RMS of a reading [ADC steps].
        full: what the supply reads [ADC steps]; None: the converter's end.
        top: where the converter ends [ADC steps]; None: 2^bits - 1.
    """
    ratio = forward(circuit, curve.resistance(force))
    ratio = 1 - ratio if inverted else ratio
    read = ratio * (full or circuit.full_scale) + noise * rng.standard_normal(ratio.shape)
    return np.clip(np.rint(read), 0, top or circuit.full_scale).astype(int)


def touches(shape, seconds, fps, *, seed=3, rest=3.0, hard=(2, 25), hold=0.8, gap=0.8):
    """Return (n, rows, cols) forces [N]: single and double touches after `rest` seconds."""
    rng = np.random.default_rng(seed)
    out = np.zeros((int(seconds * fps), *shape))
    t = rest
    while t + hold < seconds:
        force = np.zeros(shape)
        for _ in range(rng.integers(1, 3)):
            at = rng.uniform(0, shape[0] - 1), rng.uniform(0, shape[1] - 1)
            force += finger(shape, *at, rng.uniform(*hard), rng.uniform(0.6, 1.6))
        begin, end = int(t * fps), int((t + hold) * fps)
        k = np.arange(end - begin)
        ramp = np.minimum(k, k[::-1]) / max(1, 0.12 * fps)
        out[begin:end] += force * np.minimum(1, ramp)[:, None, None]
        t += hold + gap
    return out
