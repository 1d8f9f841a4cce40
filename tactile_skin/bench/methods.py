"""Every method on the same frames: error, ghosts and time."""

from __future__ import annotations

import platform

import numpy as np

from .. import scenes
from ..circuit import Circuit, forward
from ..curve import GRAM, PressureCurve
from ..solvers import METHODS, compensate
from .timing import against_y

_GHOST = 20.0  # g on a cell that nothing touches


def measure(frames: int, seed: int, track=lambda items: items) -> dict:
    """All methods on `frames` fresh frames of each family and readout.

    Args:
        track: wraps the list of cases, for a progress bar.

    Returns:
        {"machine", "seed", "frames", "forward", "rows"}: per method, readout and family the mean
        error and its 95th percentile [g a cell], the relative error of the sum, ghosts a frame,
        and the time of a frame in y.
    """
    circuit, curve = Circuit(), PressureCurve()
    cases = [(r, f) for r in scenes.READOUTS for f in scenes.FAMILIES]
    rows = []
    for readout, family in track(cases):
        rng = np.random.default_rng([seed, cases.index((readout, family))])
        force = scenes.sample(family, frames, *circuit.shape, rng)
        adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), readout, rng)
        for method in METHODS:
            found = np.empty_like(force)

            def work(k, adc=adc, found=found, method=method):
                found[k] = compensate(adc[k], circuit, curve, method).force

            times = against_y(work, frames)
            rows.append(
                {"method": method, "readout": readout, "family": family}
                | errors(found, force)
                | {key: times[key] for key in ("p50_y", "p99_y")}
            )
    resistance = curve.resistance(scenes.sample("blobs", 1, *circuit.shape, rng)[0])
    one = against_y(lambda k: forward(circuit, resistance), 2000)
    return {
        "machine": f"{platform.processor() or platform.machine()}, numpy {np.__version__}",
        "seed": seed,
        "frames": frames,
        # the paper's way solves 256 systems of 257 equations for the same readings
        "forward": {"p50_y": one["p50_y"], "literal_over_forward": 256 / one["p50_y"]},
        "rows": rows,
    }


def errors(found: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Figures of DESIGN's list, from (n, rows, cols) forces found and true [N]."""
    error = np.abs(found - force) / GRAM
    total = force.sum((1, 2))
    ghosts = (found / GRAM > _GHOST) & (force == 0)
    return {
        "mean_g": float(error.mean()),
        "p95_g": float(np.percentile(error, 95)),
        "sum_error": float(np.median(np.abs(found.sum((1, 2)) - total) / np.maximum(total, 1e-9))),
        "ghosts": float(ghosts.sum((1, 2)).mean()),
    }


def table(result: dict) -> str:
    """The result as text."""
    lines = [
        f"{result['frames']} frames a family and readout, seed {result['seed']}; "
        f"{result['machine']}",
        f"forward model: {result['forward']['p50_y']:.3f} y for all readings, the literal "
        f"equations {result['forward']['literal_over_forward']:.0f} times that",
        "",
        "method       readout  family   mean g  p95 g   sum err  ghosts   p50 y   p99 y",
    ]
    for r in sorted(result["rows"], key=lambda r: list(METHODS).index(r["method"])):
        lines.append(
            f"{r['method']:<12} {r['readout']:<8} {r['family']:<7} {r['mean_g']:7.2f} "
            f"{r['p95_g']:7.1f} {100 * r['sum_error']:7.1f} % {r['ghosts']:6.2f} "
            f"{r['p50_y']:7.2f} {r['p99_y']:7.2f}"
        )
    return "\n".join(lines)
