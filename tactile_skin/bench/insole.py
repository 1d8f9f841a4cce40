"""Real frames of a floating 32 x 10 insole: does the fit explain them, and what does it show?

    python -m tactile_skin.bench.insole FRAMES.npz [--picture docs/insole.png]

FRAMES.npz holds `counts` (n, 32, 10) int16, -1 where there is no sensor, and `row`, `col`
(33, 15), the line numbers from 0 of each cell of the insole's picture, -1 where there is none.
tests/data/insole_floating.npz is such a file; tests/data/insole_floating.txt names its source.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

import numpy as np

from .. import Circuit, PressureCurve, compensate, forward

FULL_SCALE = 4095  # 12 bits
THRESHOLD = 500 / FULL_SCALE  # the recorder wrote 0 for all counts up to 500
NOISE = 6.0  # counts RMS, 0.15 % of full scale
DROPS = 25  # readings of a frame, a tenth, that may be dropped as impossible
# The divider's trimmer is not documented; 1 to 4 kohm explain the frames alike.
R_REF = 1900.0

# Velostat under a disc of 3 mm radius, from the authors' clamp measurements (kPa -> kohm); below
# and above, extended to an untouched and a fully pressed cell.
_PRESSURE = (2.502, 7.132, 14.889, 25.024, 37.411, 50.048, 75.072, 100.472, 150.0)  # kPa
_RESISTANCE = (15.7, 9.05, 4.92, 2.79, 2.41, 2.15, 2.06, 1.99, 1.75)  # kohm
_AREA = np.pi * 0.003**2  # m^2


def curve() -> PressureCurve:
    """Force on one disc [N] <-> its resistance [ohm]."""
    force = np.array([0.0, *_PRESSURE, 1500.0]) * 1e3 * _AREA
    return PressureCurve(force, np.array([1000.0, *_RESISTANCE, 0.2]) * 1e3)


def circuit(mask: np.ndarray) -> Circuit:
    return Circuit(*mask.shape, r_ref=R_REF, r_par=0.0, adc_bits=12, mask=mask)


def fit(counts: np.ndarray, skin: Circuit, cells: PressureCurve):
    """`map` of one frame of counts (rows, cols), -1 where there is no sensor.

    Some crossings of this insole read less than their neighbours' paths alone let through, as if
    the line broke off for that sample: no resistance of the cell explains that. Those readings are
    taken for missing, at most DROPS of them.

    Returns:
        the Estimate, and the number of readings dropped.
    """
    adc = np.where(skin.populated, counts, np.nan) / FULL_SCALE
    there = skin.populated.copy()
    arguments = {"noise": NOISE, "threshold": THRESHOLD, "missing": True}
    estimate = compensate(adc, skin, cells, "map", **arguments)
    for _ in range(3):
        model = forward(skin, cells.resistance(estimate.force))
        below = np.maximum(adc, THRESHOLD) < model - 4 * NOISE / FULL_SCALE
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


def summary(frames: np.ndarray, skin: Circuit) -> dict:
    """Residual [counts] and status over frames of counts (n, rows, cols)."""
    found, dropped = zip(*(fit(frame, skin, curve()) for frame in frames), strict=True)
    residual = np.quantile([e.residual for e in found], (0.05, 0.5, 0.95))
    return {
        "frames": len(found),
        "residual p5 p50 p95": [round(float(r), 1) for r in residual],
        "readings dropped p50 max": [float(np.median(dropped)), int(max(dropped))],
        "ok": float(np.mean([e.status == "ok" for e in found])),
        "suspect": float(np.mean([e.status == "suspect" for e in found])),
    }


def controls(frames: np.ndarray, row: np.ndarray, col: np.ndarray, seed: int = 0) -> dict:
    """The same frames with the cells permuted, and with the picture's grid for the wiring."""
    rng = np.random.default_rng(seed)
    mask = frames[0] >= 0
    permuted = frames.copy()
    for frame in permuted:
        frame[mask] = rng.permutation(frame[mask])
    picture = np.where(row >= 0, frames[:, row, col], -1)
    keep = (row >= 0).any(1), (row >= 0).any(0)
    picture = picture[:, keep[0]][:, :, keep[1]]
    return {
        "permuted": summary(permuted, circuit(mask)),
        "picture's grid": summary(picture, circuit(picture[0] >= 0)),
    }


def draw(frame: np.ndarray, row: np.ndarray, col: np.ndarray, path) -> None:
    """One frame in the insole's geometry: as read, and after the fit."""
    from matplotlib import pyplot as plt

    mask = frame >= 0
    cells = curve()
    skin = circuit(mask)
    estimate, _ = fit(frame, skin, cells)
    naive = cells.force(skin.two_terminal(np.maximum(frame, 1) / FULL_SCALE))
    naive = np.where(frame > 0, naive, 0.0)
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 6), layout="constrained")
    for axis, force, title in (
        (axes[0], naive, "each reading taken for its own cell"),
        (axes[1], estimate.force, "after map"),
    ):
        pressure = force / _AREA / 1e3  # kPa
        image = np.where(row >= 0, pressure[row, col], np.nan)
        shown = axis.imshow(image, vmin=0.0, vmax=float(np.nanquantile(image, 0.99)))
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
        figure.colorbar(shown, ax=axis, shrink=0.6, label="pressure [kPa]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames")
    parser.add_argument("--picture", help="also draw one frame before and after, to this file")
    parser.add_argument("--controls", type=int, default=40, help="frames for the controls")
    args = parser.parse_args()
    with np.load(args.frames) as data:
        frames, row, col = data["counts"], data["row"], data["col"]
    frames = frames[touched(frames)]
    if args.picture:
        draw(frames[(frames > 0).sum((1, 2)).argsort()[len(frames) // 2]], row, col, args.picture)
    print("touched", json.dumps(summary(frames, circuit(frames[0] >= 0))), flush=True)
    for name, result in controls(frames[: args.controls], row, col).items():
        print(name, json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
