"""`tactile-skin bench recorded`: every method on frames without a truth: time, doubt, agreement."""

from __future__ import annotations

import time

import numpy as np

from ..calibration.rest import measure_rest
from ..health.doctor import recorded
from ..middleware.config import read_skin
from ..physics.circuit import Circuit
from ..physics.curve import GRAM, PressureCurve
from ..recording.frames import read_frames, recorded_skin
from ..solvers import METHODS, compensate

_REFERENCE = "map"
_MOST = 0.5  # share of frames without blanks from which on the others are left out


def measure(n: int, frames: str, config: str | None, seed: int, track=lambda items: items) -> dict:
    """Each method on the n frames, one after the other, in which most happens.

    Args:
        frames: file, as read_frames takes it.
        config: parameter file; None: as it was recorded.
        seed: of nothing; every part of the bench has one.

    Returns:
        the figure "recorded" as plain data: `file`, `frames`, `notes`, and for each method p50_ms,
        p99_ms, the shares of `suspect` and `failed` frames, `total_n` [N, mean] and `apart_g`, the
        mean absolute difference of a cell to `map` [g].

    Raises:
        ValueError: a file, or a configuration, that is refused.
    """
    skin = recorded_skin(frames) if config is None else read_skin(config)
    found = read_frames(frames, skin.circuit)
    adc, notes = _complete(found.ratio(skin.adc), skin.circuit.populated)
    curve, noise, note = _at_rest(adc, skin)
    adc, notes = _busiest(adc, n), [*found.notes, *notes, note]

    def solve(method):
        return _solve(method, adc, skin.circuit, curve, noise)

    reference = solve(_REFERENCE)["force"]
    solved = {}
    for name in track(METHODS):
        try:
            solved[name] = solve(name)
        except ValueError as error:  # a network of another circuit
            notes.append(f"{name} is left out: {error}")
    methods = {}
    for name, result in solved.items():
        p50, p99 = 1e3 * np.percentile(result["seconds"], (50, 99))
        methods[name] = {
            "p50_ms": float(p50),
            "p99_ms": float(p99),
            "suspect": float(np.mean(result["status"] == "suspect")),
            "failed": float(np.mean(result["status"] == "failed")),
            "total_n": float(result["force"].sum((1, 2)).mean()),
            "apart_g": float(np.abs(result["force"] - reference).mean() / GRAM),
        }
    about = {"file": str(frames), "frames": len(adc), "notes": notes}
    return {"recorded": about | {"methods": methods}}


def _complete(adc: np.ndarray, populated: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """The frames in which every cell was read, if these are most; and what was left out."""
    whole = ~np.isnan(adc[:, populated]).any(1)
    if whole.all() or whole.mean() < _MOST:
        return adc, []
    n, why = np.count_nonzero(~whole), "not all methods take them"
    return adc[whole], [f"{n} of {len(adc)} frames with blanks are left out: {why}"]


def _at_rest(adc: np.ndarray, skin) -> tuple[PressureCurve, float | None, str]:
    """The curve of cells that rest as in the calmest frames; their noise [ADC steps]; a note."""
    try:
        calm = adc[recorded.record(adc, skin.circuit, None).quiet]
        rest = measure_rest(calm, skin.circuit)
        cells = skin.circuit.populated
        at_rest = np.where(cells, rest.conductance, 1.0 / skin.curve.rest_resistance)
        curve = skin.curve.resting_at(1.0 / at_rest)
    except ValueError as error:
        return skin.curve, None, f"the rest is the curve's, not measured: {error}"
    return curve, rest.noise, f"the rest is measured in the {len(calm)} calmest frames"


def _busiest(adc: np.ndarray, n: int) -> np.ndarray:
    """The n frames, one after the other, that are farthest from the usual one."""
    activity = np.nan_to_num(np.abs(adc - np.nanmedian(adc, axis=0))).mean((1, 2))
    sums = np.convolve(activity, np.ones(min(n, len(adc))), "valid")
    start = int(sums.argmax())
    return adc[start : start + n]


def _solve(method: str, adc: np.ndarray, circuit: Circuit, curve, noise: float | None) -> dict:
    estimate, force, status, seconds = None, [], [], []
    missing = method in ("map", "auto")
    for frame in adc:
        begun = time.perf_counter()
        estimate = compensate(
            frame, circuit, curve, method, start=estimate, noise=noise, missing=missing
        )
        seconds.append(time.perf_counter() - begun)
        force.append(estimate.force)
        status.append(estimate.status)
    return {"force": np.array(force), "status": np.array(status), "seconds": seconds}


def table(data: dict) -> str:
    lines = [f"{data['file']}: the busiest {data['frames']} frames", *data["notes"]]
    lines.append(
        f"{'':12} {'p50':>8} {'p99':>8} {'suspect':>8} {'failed':>8} {'total':>9}  from map"
    )
    for name, found in data["methods"].items():
        lines.append(
            f"{name:12} {found['p50_ms']:5.2f} ms {found['p99_ms']:5.2f} ms "
            f"{100 * found['suspect']:6.1f} % {100 * found['failed']:6.1f} % "
            f"{found['total_n']:7.1f} N  {found['apart_g']:5.1f} g a cell"
        )
    return "\n".join(lines)


def draw(data: dict):
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 4.2), layout="constrained")
    for name, found in data["methods"].items():
        doubted = 100 * (found["suspect"] + found["failed"])
        axes.plot(found["p50_ms"], doubted, "o", label=name)
        axes.annotate(name, (found["p50_ms"], doubted), (4, 4), textcoords="offset points")
    axes.set_xscale("log")
    axes.set_xlabel("time of a frame, p50 [ms]")
    axes.set_ylabel("frames in doubt [%]")
    axes.grid(alpha=0.25, linewidth=0.6)
    return figure


DRAW = {"recorded": draw}
