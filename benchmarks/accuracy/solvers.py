# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy of the solvers.

Times are multiples of y, one `numpy.linalg.solve` of 257 dense equations with one thread,
measured between the frames they are compared with. Errors are grams a cell. `--only
detection`: how often `map` tells a fault, in four minutes.
"""

from __future__ import annotations

import json
import os

import numpy as np
from support.accuracy import accuracy
from support.troubled import FAULTS, expose, faulty

from benchmarks.accuracy.growth import exponent
from tactile_skin import Circuit, PressureCurve, compensate, forward
from tactile_skin.bench.measure import GHOST, NOISE, Clock, day, frames, moving_touch
from tactile_skin.learning import network
from tactile_skin.physics import readouts
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.simulation.textile import Textile
from tactile_skin.solvers.reading import SCAN_NOISE

from .. import harness


def other_board(family: str, off: str, n: int, seed=1) -> dict:
    """Error [g] on boards that are not as the solver is told, and what of it is the board's doing.

    R_par is off by 5 %, up or down, or the curve by up to 20 %, or both. "physics" and "map" read
    `scan`. "newton" inverts the same boards exactly, from readings without noise or rounding: what
    it misses by, any inverse does that believes its R_par and curve and nothing else.

    Args:
        off: "R_par", "curve" or "both".
    """
    circuit, curve = Circuit(), PressureCurve()
    rng = np.random.default_rng(seed)
    force = scenes.sample(family, n, *circuit.shape, rng)
    total = dict.fromkeys(("physics", "map", "newton"), 0.0)
    for truth in np.minimum(force, curve.max_force):
        r_par, gain = rng.choice((0.95, 1.05)), rng.uniform(0.0, 0.2)
        skin = Textile(
            noise=1.0, r_par=1.0 if off == "curve" else r_par, curve=0.0 if off == "R_par" else gain
        )
        exact = expose(skin, circuit, curve, truth, rng)
        scan = skin.converter(circuit).frame(exact, rng)
        for method in total:
            adc = exact if method == "newton" else scan
            found = compensate(adc, circuit, curve, method).force
            total[method] += np.abs(found - truth).mean() / GRAM / n
    return {"family": family, "off": off, "frames": n} | total


def r_par_std(family: str, n: int, seed=1) -> dict:
    """Standard deviation [ohm] to which a `scan` frame determines R_par, at best (Cramer-Rao).

    At best: of a fit that knows which cells are touched, takes nothing for granted about how hard,
    and knows the others' resistance, or (second) only that it is the same for all.
    """
    circuit, curve = Circuit(), PressureCurve()
    cells = circuit.rows * circuit.cols
    rng = np.random.default_rng(seed)
    force, adc = frames(family, "ideal", n, rng, circuit, curve)
    std = np.empty((2, n))
    for k in range(n):
        resistance = curve.resistance(force[k])
        network = readouts.solve(circuit, 1.0 / resistance)
        one_by_one = np.eye(cells).reshape(cells, *circuit.shape)
        changes = [network.change(cell).ravel() for cell in one_by_one]
        steps = np.array(changes).T / -resistance.ravel()  # d adc / d log resistance
        touched = force[k].ravel() > 0
        pattern = np.square(adc[k]).ravel() / circuit.r_ref  # - d adc / d R_par
        for row, unknown in enumerate((steps[:, touched], np.c_[steps[:, touched], steps.sum(1)])):
            u, scale, _ = np.linalg.svd(unknown, full_matrices=False)
            u = u[:, scale > 1e-9 * scale[0]]
            left = np.linalg.norm(pattern - u @ (u.T @ pattern)) * circuit.full_scale
            std[row, k] = SCAN_NOISE / max(left, 1e-9)
    quantiles = np.quantile(std, (0.5, 0.9), axis=1).T.tolist()
    return {"family": family, "frames": n, "rest known": quantiles[0], "rest alike": quantiles[1]}


def networks(family, readout, n, seed=1) -> dict:
    """Both networks and newton on the same frames: error [g a cell], over newton's, time."""
    circuit, curve = Circuit(), PressureCurve()
    force, adc = frames(family, readout, n, np.random.default_rng(seed), circuit, curve)
    table = {}
    for method in ("newton", "physics", "cnn"):
        compensate(adc[0], circuit, curve, method, noise=NOISE[readout])
        clock = Clock()
        found = [
            clock(compensate, frame, circuit, curve, method, noise=NOISE[readout]) for frame in adc
        ]
        error = np.abs(np.array([e.force for e in found]) - force).mean((1, 2)) / GRAM
        table[method] = {
            "mean g": float(error.mean()),
            "standard error": float(error.std() / n**0.5),
            "suspect": float(np.mean([e.status == "suspect" for e in found])),
            "p50 y": clock.quantile(0.5),
            "p99 y": clock.quantile(0.99),
        }
        if readout != "ideal":  # which newton inverts exactly
            table[method]["over newton"] = table[method]["mean g"] / table["newton"]["mean g"]
    return {"family": family, "readout": readout, "frames": n} | table


def batches(kind: str, n: int, seed=1) -> dict:
    """Frames a second of a network on a recording, in one call."""
    circuit, curve = Circuit(), PressureCurve()
    _, adc = frames("blobs", "scan", n, np.random.default_rng(seed), circuit, curve)
    weights = network.shipped(kind)
    weights.predict(adc[:200])
    clock = Clock()
    clock(weights.predict, adc)
    return {"network": kind, "frames": n, "frames a second": n / clock.calls[0]}


def tracking(method: str, readout: str, touches: int, seed=1) -> dict:
    """Time and error from the last frame of a moving touch, 50 frames each."""
    circuit, curve = Circuit(), PressureCurve()
    rng = np.random.default_rng(seed)
    clock, errors = Clock(), []
    for _ in range(touches):
        force = moving_touch(50, rng)
        adc = scenes.read_out(circuit, forward(circuit, curve.resistance(force)), readout, rng)
        last = compensate(adc[0], circuit, curve, method)
        for truth, frame in zip(force[1:], adc[1:], strict=True):
            last = clock(compensate, frame, circuit, curve, method, start=last)
            errors.append(np.abs(last.force - truth).max() / GRAM)
    return {
        "method": method,
        "readout": readout,
        "frames": len(errors),
        "worst g": float(max(errors)),
        "p50 y": clock.quantile(0.5),
        "p99 y": clock.quantile(0.99),
    }


def detection(n: int, readout: str, seed=1) -> dict:
    """Share of frames that `map` calls suspect: sound ones, and those spoilt by a fault.

    Spoilt: the mean error exceeds 30 g and, on the same scene and noise, exceeds that of the sound
    circuit by 30 g; "any": only the first, whatever the cause.
    """
    circuit, curve = Circuit(), PressureCurve()
    table = {}
    for family in scenes.FAMILIES:
        for fault in FAULTS:
            rng = np.random.default_rng([seed, list(FAULTS).index(fault)])
            force = scenes.sample(family, n, *circuit.shape, rng)
            seen = []
            for truth in force:
                r = curve.resistance(truth)
                noise = rng.integers(1 << 31)
                for adc in (forward(circuit, r), faulty(circuit, r, fault, rng)):
                    adc = scenes.read_out(circuit, adc, readout, np.random.default_rng(noise))
                    estimate = compensate(adc, circuit, curve, "map")
                    seen.append(
                        (np.abs(estimate.force - truth).mean() / GRAM, estimate.status == "suspect")
                    )
            error, suspect = np.array(seen).reshape(n, 2, 2).transpose(2, 1, 0)
            any_cause = error[1] > 30
            spoilt = any_cause & (error[1] - error[0] > 30)
            table[f"{family}, {fault}"] = {
                "sound suspect": float(suspect[0].mean()),
                "spoilt": int(spoilt.sum()),
                "spoilt suspect": float(suspect[1][spoilt].mean()) if spoilt.any() else None,
                "any": int(any_cause.sum()),
                "any suspect": float(suspect[1][any_cause].mean()) if any_cause.any() else None,
            }
    return table


def stream(n: int, seed=1) -> dict:
    """Time, error and ghosts over a day-like stream."""
    circuit, curve = Circuit(), PressureCurve()
    force, adc = day(n, np.random.default_rng(seed), circuit, curve)
    table = {}
    for name, method, keep in (
        ("auto", "auto", True),
        ("map, last frame", "map", True),
        ("map", "map", False),
    ):
        clock, last, ghosts, means, methods = Clock(), None, [], [], {}
        for truth, frame in zip(force, adc, strict=True):
            last = clock(compensate, frame, circuit, curve, method, start=last if keep else None)
            ghosts.append(((last.force > GHOST * GRAM) & (truth == 0)).any())
            means.append(np.abs(last.force - truth).mean() / GRAM)
            methods[last.method] = methods.get(last.method, 0) + 1
        table[name] = {
            "mean y": clock.mean,
            "mean g": float(np.mean(means)),
            "frames with ghosts": float(np.mean(ghosts)),
            "methods": methods,
        }
    return table


def growth(method: str, n: int, sizes=(16, 32, 64), seed=1) -> dict:
    """Time over the size of the skin on the `random` family, and its exponent in the cells."""
    curve = PressureCurve()
    readout = "ideal" if method == "newton" else "scan"
    table, times = {}, []
    for size in sizes:
        circuit = Circuit(rows=size, cols=size)
        for family in ("blobs", "random"):
            frames_here = max(n * 16 // size, 2)
            row = accuracy(method, family, readout, frames_here, seed, circuit, curve)
            table[f"{size}x{size} {family}"] = {
                key: row[key] for key in ("frames", "p50 y", "mean g", "worst g", "failed")
            }
        times.append(row["p50 y"])
    return table | {"exponent in cells (random)": exponent(sizes, times)}


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--quick", action="store_true", help="a twentieth of the frames")
    parser.add_argument("--only", default="", metavar="TEXT", help="rows with this in their name")
    parser.add_argument("--seed", type=int, default=int.from_bytes(os.urandom(3)))
    args = parser.parse_args(arguments)
    share = 20 if args.quick else 1
    print(f"seed {args.seed}", flush=True)

    rows = [("newton", accuracy, "newton", f, "ideal", 10_000 // share) for f in scenes.FAMILIES]
    rows += [("newton, last frame", tracking, "newton", "ideal", 40 // share)]
    rows += [("map", accuracy, "map", f, "scan", 300 // share) for f in scenes.FAMILIES]
    rows += [
        ("the networks", networks, family, "scan", 300 // share)
        for family in ("bodies", "pictures", *scenes.FAMILIES)
    ]
    # as the paper's table, which is of exact readings
    rows += [("the networks", networks, f, "ideal", 900 // share) for f in scenes.FAMILIES]
    rows += [
        ("another board", other_board, f, off, 300 // share)
        for f in scenes.FAMILIES
        for off in ("R_par", "curve", "both")
    ]
    # not `random`: where every cell is touched R_par is not determined
    rows += [("R_par in a frame", r_par_std, f, 60 // share) for f in ("blobs", "rects")]
    rows += [("batches", batches, kind, 2000) for kind in network.NETWORKS]
    rows += [("map, last frame", tracking, "map", "scan", 40 // share)]
    rows += [(f"detection, {r}", detection, 300 // share, r) for r in ("scan", "adc10")]
    rows += [
        ("auto against the others", accuracy, method, family, readout, 300 // share)
        for family in scenes.FAMILIES
        for readout in scenes.READOUTS
        for method in ("naive", "fixed_point", "newton", "map", "auto")
    ]
    rows += [("day", stream, 6000 // share)]
    rows += [("growth", growth, method, 20 // min(share, 4)) for method in ("newton", "map")]
    found = []
    for name, measure, *settings in rows:
        if args.only in name:
            found.append({"row": name} | measure(*settings, seed=args.seed))
            print(json.dumps(found[-1], indent=1), flush=True)
    return found


if __name__ == "__main__":
    harness.run(main)
