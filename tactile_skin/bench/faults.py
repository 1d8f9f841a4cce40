"""Readings that the solver's circuit does not explain: what breaks on real boards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..circuit import Circuit, forward, two_terminal_resistance

FAULTS = ("open", "short", "r_par +10 %", "r_par -10 %", "moving")


def faulty(circuit: Circuit, resistance: np.ndarray, fault: str, rng) -> np.ndarray:
    """(rows, cols) ideal ADC ratio of a circuit with one fault.

    open: one line is cut. short: two neighbouring lines touch. r_par: the true one differs from
    the circuit's. moving: the contact moves by a column in the middle of the scan.

    Raises:
        ValueError: an unknown fault.
    """
    if fault not in FAULTS:
        raise ValueError(f"fault {fault!r}: must be one of {', '.join(FAULTS)}")
    if fault.startswith("r_par"):
        true = replace(circuit, r_par=circuit.r_par * (1.1 if "+" in fault else 0.9))
        return forward(true, resistance)
    if fault == "moving":
        adc = forward(circuit, resistance)
        half = rng.integers(1, circuit.rows)
        adc[half:] = forward(circuit, np.roll(resistance, 1, axis=1))[half:]
        return adc
    turned = rng.random() < 0.5
    r = np.array(resistance.T if turned else resistance)
    if fault == "open":
        r[rng.integers(r.shape[0])] = np.inf
        return forward(circuit, r.T if turned else r)
    i = rng.integers(r.shape[0] - 1)
    g = 1.0 / r
    merged = np.delete(g, i + 1, 0)
    merged[i] += g[i + 1]
    rho = two_terminal_resistance(merged)
    rho = np.insert(rho, i + 1, rho[i], 0)
    return circuit.ratio(rho.T if turned else rho)
