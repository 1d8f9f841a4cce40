# SPDX-License-Identifier: Apache-2.0
"""What newtons are worth on real fabric: errors of force on presses that no curve was fitted to.

Fetch the recordings first; they carry no licence and are no part of this repository:

    git clone https://github.com/Lupasic/tactile-sensor-velostat velostat
    git clone https://github.com/patrickruiz1/FSR_AppliedMedical fsr
    python -m benchmarks.fabric.newtons --velostat velostat --fsr fsr

Velostat: a curve for each of 16 places of one cell, from one press of each force in run 1 (or
--train 2), scored on the other run. FSR: three presses of three of the 15 series; the others are
scored, also with a gain by the first press of each series. `static`: `fit_curve` by the last 0.3 s
of each press; `creep`: `fit_reference`, and what a running skin makes of it. Errors are the median
and the 90th percentile [%] of the force, of samples above 10 % of full scale (40 N; FSR 49 N).
Of 50 g that a hand lays on for 10 to 90 s, 12 times: what `measure_creep` finds, or why not.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactile_skin import Circuit, Creep, PressureCurve, fit_curve, fit_reference, measure_creep
from tactile_skin.calibration.creep import Standing
from tactile_skin.calibration.rest import measure_rest

from .. import harness
from .recordings import FSR, TIPS, VELOSTAT, Press, fsr, joined, velostat

FULL_SCALE = 40.0  # N
LEAST = 0.1  # of it, above which samples count
FIRST, HOLD = 0.3, 0.7  # s since the contact
ENDS = 0.2  # s of a press whose mean is a load that stands, and so long before it is let go
HELD = 0.95  # of its largest force, above which it is held
LOW = 0.7  # of the force, below which it is felt too low
TRAINED = 3  # series of the FSR, and presses of each
LEFT = 1.0, 1.2  # s after the release, in which what is left is read
BEFORE = 0.5  # s before the contact, as the force sensor says it, until which the sensor rests
SPREAD = 0.1  # of the usual place, below which a tip lies next to the cell

Felt = Callable[[Press], np.ndarray]


def at_rest(found: list[Press], circuit: Circuit):
    """Return the rest of the sensor, before each press."""
    return measure_rest(
        np.concatenate([press.adc[press.since < -BEFORE] for press in found]), circuit
    )


def felt(press: Press, circuit: Circuit, curve: PressureCurve, creep: Creep) -> np.ndarray:
    """(n,) [N] that a running skin finds in a press."""
    before = np.median(press.adc[press.since < -BEFORE], axis=0)
    tared = curve.resting_at(circuit.two_terminal(before))
    force = tared.force(circuit.two_terminal(press.adc))
    if not creep.share:
        return force[:, 0, 0]
    standing = Standing(creep, curve)
    return np.array([standing.update(t, f)[0, 0] for t, f in zip(press.times, force, strict=True)])


def standing(press: Press) -> np.ndarray:
    """(n,) bool frames of the end of a press, before it is let go."""
    held = press.times[press.force > HELD * press.force.max()][-1] - ENDS
    return (press.times > held - ENDS) & (press.times <= held)


def methods(found: list[Press], circuit: Circuit) -> tuple[dict[str, Felt], Creep]:
    """Return curves by presses, static and with creep, as functions of another press."""
    rest, stream = at_rest(found, circuit), joined(found)
    ends = [standing(press) for press in found]
    frames = [press.adc[end].mean(0) for press, end in zip(found, ends, strict=True)]
    loads = [press.force[end].mean() for press, end in zip(found, ends, strict=True)]
    static = fit_curve(np.array(frames), np.array(loads), circuit, rest).curve
    fit, _ = fit_reference(stream.adc, stream.times, stream.force, stream.times, circuit, rest)
    curve = fit.curve
    return {
        "static": lambda press: felt(press, circuit, static, Creep()),
        "creep": lambda press: felt(press, circuit, curve, fit.creep),
    }, fit


def scored(press: Press, by: Felt) -> np.ndarray:
    """(n, 4) since the contact [s], force, what is felt [N], and what is left of its peak."""
    found, there = by(press), press.since >= 0.0
    released = press.times[there][-1] if there.any() else 0.0
    after = press.times - released
    left = found[(after > LEFT[0]) & (after < LEFT[1])]
    share = np.median(left) / press.force.max() if left.size else np.nan
    table = [press.since, press.force, found, np.full(found.size, share)]
    return np.stack(table, 1)[there]


def row(tables: list[np.ndarray], full_scale: float) -> dict[str, float]:
    """Return the figures of a group."""
    table = np.concatenate(tables)
    since, force, found, _ = table[table[:, 1] > LEAST * full_scale].T
    off, figures = np.abs(found / force - 1.0), {}
    parts = {"first": since < FIRST, "all": since >= 0.0, "holds": since > HOLD}
    for name, part in parts.items():
        for of, q in (("median", 0.5), ("p90", 0.9)):
            figures[f"{name} {of}"] = float(np.quantile(off[part], q)) if part.any() else np.nan
    figures["below 0.7"] = float(np.mean(found < LOW * force))
    figures["left"] = float(np.nanquantile([table[0, 3] for table in tables if len(table)], 0.95))
    return figures


def of_velostat(folder: Path, tip: str, train: int) -> dict:
    """Score one run's places by curves of the other's."""
    places = velostat(folder, tip, train), velostat(folder, tip, 3 - train)
    reach = np.array([max(np.median(p.adc[p.since > 0.0]) for p in place) for place in places[0]])
    reach /= 1.0 - reach  # in proportion to the conductance
    tables: dict[str, list[np.ndarray]] = {}
    said, shares = [], []
    for known, new, there in zip(*places, reach > SPREAD * np.median(reach), strict=True):
        if not there:
            continue
        by, fit = methods(known, VELOSTAT)
        shares.append((fit.creep.share, fit.creep.time))
        said.append([fit.first.median, fit.first.p90, fit.holds.median, fit.holds.p90])
        for name, one in by.items():
            tables.setdefault(name, []).extend(scored(press, one) for press in new)
    print(f"creep found: {sorted(shares)}; error stated {np.mean(said, 0).round(3)}")
    return {name: row(of, FULL_SCALE) for name, of in tables.items()}


def of_fsr(folder: Path) -> dict:
    """Score 15 series of one day by presses of three of them."""
    paths = sorted(folder.glob("*Stability(*.csv"), key=lambda p: float(p.name.split("(")[1][:3]))
    series = [fsr(path) for path in paths]
    places = np.linspace(0, len(series) - 1, TRAINED).astype(int)
    by, fit = methods([press for k in places for press in series[k][:TRAINED]], FSR)
    print(f"creep found: {fit.creep}")
    new = [of[TRAINED * (k in places) :] for k, of in enumerate(series)]
    tables: dict[str, list[np.ndarray]] = {}
    for presses in new:
        for name, one in by.items():
            tables.setdefault(name, []).extend(scored(press, one) for press in presses)
            first = scored(presses[0], one)
            first = first[first[:, 1] > 0.5 * first[:, 1].max()]
            gain = np.median(first[:, 1] / first[:, 2])
            rest = [scored(press, one) * [1.0, 1.0, gain, 1.0] for press in presses[1:]]
            tables.setdefault(f"{name}, one gain press", []).extend(rest)
    return {
        name: row(of, max(p.force.max() for of in series for p in of))
        for name, of in tables.items()
    }


def laid(path: Path) -> str:
    """Return what a load that stands shows of creep, a hand's second at both ends left out."""
    ohm, times = np.loadtxt(path).T
    adc = (VELOSTAT.r_ref / (VELOSTAT.r_ref + ohm))[:, None, None]
    stands = times[ohm < ohm.max() / 4.0]
    rests, there = times < stands[0] - 1.0, times < stands[-1] - 2.0
    there &= ~rests & np.r_[True, np.diff(times) > 0.0]
    try:
        rest = measure_rest(adc[rests], VELOSTAT)
        return str(measure_creep(adc[there], times[there], VELOSTAT, rest))
    except ValueError as error:
        return f"refused: {error}"


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--velostat", type=Path, metavar="FOLDER")
    parser.add_argument("--fsr", type=Path, metavar="FOLDER")
    parser.add_argument("--train", type=int, choices=(1, 2), default=1, help="run of the Velostat")
    args = parser.parse_args(arguments)
    found = {}
    if args.velostat:
        for tip in TIPS:
            figures = of_velostat(args.velostat / "src/experimental_data", tip, args.train)
            found |= {f"Velostat, {tip} tip, {name}": of for name, of in figures.items()}
        for path in sorted(args.velostat.glob("**/question_1_5/**/*.txt")):
            print(f"{path.parts[-3]} {path.parts[-2]}: {laid(path)}")
    if args.fsr:
        figures = of_fsr(args.fsr / "data/FSR_S1/raw")
        found |= {f"FSR, {name}": of for name, of in figures.items()}
    for name, figures in found.items():
        print(name, {of: f"{value:.1%}" for of, value in figures.items()})
    return found


if __name__ == "__main__":
    harness.run(main)
