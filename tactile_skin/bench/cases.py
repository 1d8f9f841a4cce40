"""Pictures of cases: objects pressed on the skin, and what each method makes of them.

As the paper's figures 8 and 9, and its weight experiment: the sum of load against the truth.
"""

from __future__ import annotations

import numpy as np

from ..physics.circuit import Circuit, forward
from ..physics.curve import GRAM, PressureCurve
from ..simulation import scenes
from ..solvers import METHODS, compensate
from . import chart
from .measure import NOISE, errors

PEAKS = (50.0, 100.0, 200.0, 400.0, 800.0)  # g on the object's hardest cell
_PICTURED = 400.0  # g, the peak that is shown as pictures
_SHOWN = ("naive", "cnn", "auto")

# Objects are capsules on a 16 x 16 skin: from (row, column) to (row, column), radius [cells], and
# their share of the peak pressure.
_RING = [
    (*(7.5 + 4.5 * np.array([np.sin(a), np.cos(a)])), *(7.5 + 4.5 * np.array(b)), 1.1, 1.0)
    for a, b in (
        (a, (np.sin(a + 0.3), np.cos(a + 0.3))) for a in np.arange(0.0, 2 * np.pi, 2 * np.pi / 21)
    )
]
_HAND = [
    (10.5, 6.0, 11.0, 9.0, 2.4, 0.6),
    (7.0, 4.3, 3.2, 3.2, 0.8, 1.0),
    (6.5, 6.2, 2.0, 5.8, 0.8, 1.0),
    (6.7, 8.2, 2.2, 8.6, 0.8, 1.0),
    (7.2, 10.2, 3.8, 11.4, 0.8, 1.0),
    (10.5, 11.0, 8.2, 13.6, 0.9, 0.8),
]
_FOOT = [
    (12.6, 7.0, 12.9, 7.0, 1.8, 1.0),
    (10.5, 8.6, 6.5, 9.4, 1.2, 0.45),
    (4.6, 5.8, 5.4, 9.4, 1.5, 0.9),
    (1.7, 5.2, 1.9, 5.2, 1.0, 0.8),
    (1.6, 7.4, 1.6, 7.4, 0.7, 0.6),
    (2.0, 9.2, 2.0, 9.2, 0.7, 0.6),
    (2.9, 10.8, 2.9, 10.8, 0.7, 0.5),
]
OBJECTS = {
    "ring": _RING,
    "cross": [(2.5, 7.5, 12.5, 7.5, 1.2, 1.0), (7.5, 2.5, 7.5, 12.5, 1.2, 1.0)],
    "hand": _HAND,
    "foot": _FOOT,
    "two fingers": [(4.0, 4.5, 4.0, 4.5, 1.3, 1.0), (11.0, 11.0, 11.0, 11.0, 1.3, 1.0)],
    "three fingers": [
        (4.0, 4.5, 4.0, 4.5, 1.3, 1.0),
        (11.0, 11.0, 11.0, 11.0, 1.3, 0.8),
        (4.0, 11.0, 4.0, 11.0, 1.3, 0.6),
    ],
}


def pressed(name: str, peak: float, fine: int = 8) -> np.ndarray:
    """(16, 16) force [N] of an object whose hardest cell carries `peak` g.

    A cell feels the mean over its area, taken at fine x fine points.
    """
    points = (np.arange(16 * fine) + 0.5) / fine - 0.5
    y, x = points[:, None], points[None]
    load = np.zeros((16 * fine,) * 2)
    for y0, x0, y1, x1, radius, share in OBJECTS[name]:
        long2 = (y1 - y0) ** 2 + (x1 - x0) ** 2
        along = ((y - y0) * (y1 - y0) + (x - x0) * (x1 - x0)) / long2 if long2 else 0.0
        along = np.clip(along, 0.0, 1.0)
        distance2 = (y - y0 - along * (y1 - y0)) ** 2 + (x - x0 - along * (x1 - x0)) ** 2
        soft = np.sqrt(np.maximum(1.0 - distance2 / (1.3 * radius) ** 2, 0.0))  # a soft tip
        load = np.maximum(load, share * soft)
    cells = load.reshape(16, fine, 16, fine).mean((1, 3))
    return cells / cells.max() * peak * GRAM


def measure(n: int, seed: int, track=lambda items: items) -> dict:
    """Each object at each load, n `scan` readings of it, by all methods.

    Returns:
        the figures "cases" (pictures, in g and ADC steps), "load" (sums against the truth), and
        "ghosts" (two fingers and a palm) as plain data.
    """
    circuit, curve = Circuit(), PressureCurve()
    rng, noise = np.random.default_rng(seed), NOISE["scan"]
    pictures = []
    sums = {method: {name: [] for name in OBJECTS} for method in METHODS}
    for name in track(list(OBJECTS)):
        for peak in PEAKS:
            force = pressed(name, peak)
            ideal = forward(circuit, curve.resistance(force))
            adc = [scenes.read_out(circuit, ideal, "scan", rng) for _ in range(n)]
            for method in METHODS:
                found = [compensate(f, circuit, curve, method, noise=noise).force for f in adc]
                sums[method][name].append(float(np.mean([f.sum() for f in found])))
                if peak == _PICTURED and method == "naive":
                    pictures.append({"object": name, **picture(force, adc[0], circuit, curve)})
    truth = {name: [float(pressed(name, peak).sum()) for peak in PEAKS] for name in OBJECTS}
    weighed = [
        {"method": method, "sum_n": found, **scale(truth, found)} for method, found in sums.items()
    ]
    return {
        "cases": {"peak_g": _PICTURED, "objects": pictures},
        "load": {"readings": n, "peaks_g": list(PEAKS), "truth_n": truth, "methods": weighed},
        "ghosts": ghosts(circuit, curve, rng),
    }


def picture(force: np.ndarray, adc: np.ndarray, circuit: Circuit, curve: PressureCurve) -> dict:
    """One case as lists: truth and what methods find [g], and the reading [ADC steps]."""
    noise = NOISE["scan"]
    found = {m: compensate(adc, circuit, curve, m, noise=noise).force for m in _SHOWN}
    return {
        "truth_g": _rounded(force / GRAM),
        "reading_steps": _rounded(adc * circuit.full_scale),
        "found_g": {m: _rounded(f / GRAM) for m, f in found.items()},
        "mean_g": {m: errors(f[None], force[None])["mean_g"] for m, f in found.items()},
    }


def scale(truth: dict, found: dict) -> dict:
    """Factor between the sums found and the true ones, as in the paper's section VI.

    Returns:
        slope, least squares through the origin; spread, the standard deviation of the single
        factors over their mean.
    """
    t = np.concatenate([truth[name] for name in truth])
    f = np.concatenate([found[name] for name in truth])
    factors = f / t
    return {
        "slope": float(t @ f / (t @ t)),
        "spread": float(factors.std() / factors.mean()),
    }


def ghosts(circuit: Circuit, curve: PressureCurve, rng) -> dict:
    """Two fingers and a palm: what is pressed, each reading on its own, tactile_skin [g]."""
    force = scenes.script("two_fingers", *circuit.shape)(0.0)
    force += scenes.finger(*circuit.shape, 12.0, 3.5, 30.0, width=1.5)
    adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), "scan", rng)
    panels = [{"title": "what is pressed", "load_g": _rounded(force / GRAM)}]
    for method, title in (("naive", "each reading on its own"), ("auto", "tactile_skin")):
        found = compensate(adc, circuit, curve, method, noise=NOISE["scan"]).force
        panels.append({"title": title, "load_g": _rounded(found / GRAM)})
    for panel in panels:
        panel["sum_n"] = float(np.sum(panel["load_g"]) * GRAM)
    return {"panels": panels}


def _rounded(values: np.ndarray) -> list:
    return np.round(values, 2).tolist()


# --- pictures ------------------------------------------------------------------------------------


def _bare(axis) -> None:
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_visible(True)
        spine.set_linewidth(0.5)


def draw_cases(data: dict):
    from matplotlib import pyplot as plt
    from matplotlib.colors import PowerNorm

    objects = data["objects"]
    titles = ["pressed", "reading", *_SHOWN, "auto - pressed"]
    figure, axes = plt.subplots(
        len(objects), len(titles), figsize=(9.0, 9.6), layout="constrained", squeeze=False
    )
    load = {"cmap": "magma", "norm": PowerNorm(0.5, 0.0, 1000.0)}
    for row, case in zip(axes, objects, strict=True):
        truth = np.array(case["truth_g"])
        images = [row[0].imshow(truth, **load)]
        images.append(row[1].imshow(case["reading_steps"], cmap="gray", vmin=200, vmax=860))
        for axis, method in zip(row[2:], _SHOWN, strict=False):
            axis.imshow(case["found_g"][method], **load)
            axis.set_xlabel(f"{case['mean_g'][method]:.1f} g a cell", fontsize=9.5, labelpad=2)
        off = np.array(case["found_g"]["auto"]) - truth
        images.append(row[-1].imshow(off, cmap="RdBu_r", vmin=-100, vmax=100))
        row[0].set_ylabel(case["object"], fontsize=11)
        for axis in row:
            _bare(axis)
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=11)
    bars = (
        (images[0], [2, 3, 4], "load on a cell [g]", [0, 20, 100, 300, 600, 1000]),
        (images[1], [1], "ADC steps", [200, 500, 800]),
        (images[2], [5], "error [g]", [-100, 0, 100]),
    )
    for image, columns, label, ticks in bars:
        bar = figure.colorbar(
            image,
            ax=axes[-1, columns].tolist(),
            location="bottom",
            ticks=ticks,
            aspect=8 * len(columns),
            shrink=0.9,
        )
        bar.set_label(label, fontsize=9.5)
        bar.ax.tick_params(labelsize=8.5)
    return figure


def draw_load(data: dict):
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 4, figsize=(9.0, 5.4), layout="constrained")
    truth = data["truth_n"]
    top = 1.15 * max(max(values) for values in truth.values())
    marks = dict(zip(truth, "osD^vP", strict=True))
    for axis, entry in zip(axes.flat, data["methods"], strict=False):
        axis.plot([0, top], [0, top], color="#b0b0b0", linewidth=1)
        for name, found in entry["sum_n"].items():
            axis.plot(
                truth[name],
                found,
                marker=marks[name],
                markersize=4.5,
                linewidth=0.9,
                color=chart.STYLES[entry["method"]][0],
                markerfacecolor="white",
                label=name,
            )
        axis.set_title(entry["method"], fontsize=11)
        axis.text(
            0.04,
            0.96,
            f"slope {entry['slope']:.2f}\nspread {100 * entry['spread']:.1f} %",
            transform=axis.transAxes,
            va="top",
            fontsize=9.5,
        )
        axis.set_xlim(0, top)
        highest = max(max(found) for found in entry["sum_n"].values())
        axis.set_ylim(0, 1.35 * max(top, highest))
        axis.tick_params(labelsize=9)
    spare = axes.flat[len(data["methods"])]
    spare.set_axis_off()
    handles, names = axes.flat[0].get_legend_handles_labels()
    for handle in handles:
        handle.set_color("#444444")
    spare.legend(handles, names, loc="center", fontsize=10, frameon=False)
    figure.supxlabel("true sum of load [N]", fontsize=10.5)
    figure.supylabel("sum found [N]", fontsize=10.5)
    return figure


def draw_ghosts(data: dict):
    from matplotlib import pyplot as plt
    from matplotlib.colors import PowerNorm

    panels = data["panels"]
    figure, axes = plt.subplots(1, len(panels), figsize=(9.0, 3.3), layout="constrained")
    top = max(np.max(panel["load_g"]) for panel in panels)
    for axis, panel in zip(axes, panels, strict=True):
        # gamma: a ghost of 20 g must show beside a finger of 500 g
        image = axis.imshow(panel["load_g"], cmap="magma", norm=PowerNorm(0.5, 0.0, top))
        axis.set_title(f"{panel['title']}: {panel['sum_n']:.1f} N", fontsize=11)
        _bare(axis)
    bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.02, ticks=[0, 20, 100, 300, 600])
    bar.set_label("load on a cell [g]")
    return figure


DRAW = {"cases": draw_cases, "load": draw_load, "ghosts": draw_ghosts}
