# SPDX-License-Identifier: Apache-2.0
"""Ghosts, noise and accuracy of floating, loaded and grounded matrices.

    noise      what noise makes of the force, and ghosts, of the exact inverse to first order
    accuracy   newton on ideal readings, map on `scan`, the same touches for each readout
    speed      floating, in times y, to compare two versions: run them in turn
    wrong      how often a frame of one readout is suspect to another, after a tare by that
    right      how often one is suspect on its own readout: of a sound board, and with r_par off
    drivers    what is felt of a grounded board whose drivers are not those that are configured
    diodes     what is felt of a loaded board that is driven through diodes
    named      streams of a minute, with the readout that `diagnose` names
    calibrate  what `calibrate` has: a rest, then five touches; r_par is up to 20 % off

Paper's circuit, default curve. Streams through all nodes: `python -m benchmarks.faults --shapes
8x8-loaded-rows`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support.kirchhoff import DIODES, forward_voltage
from support.lab.board import KNOTS, FaultBoard
from support.lab.parts import Diode
from support.lab.touches import everyday

from tactile_skin import (
    Circuit,
    PressureCurve,
    compensate,
    diagnose,
    forward,
    identify,
    measure_rest,
)
from tactile_skin.bench.measure import Clock, frames
from tactile_skin.calibration.rest import resting_conductance
from tactile_skin.health.doctor import other_readout
from tactile_skin.physics import readouts
from tactile_skin.physics.adc import Adc
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import scenes
from tactile_skin.solvers.reading import SCAN_NOISE

from .. import harness

CIRCUIT, CURVE = Circuit(), PressureCurve()
FAMILIES = "blobs", "rects", "random", "bodies"
KINDS = (
    ("floating", "rows"),
    ("loaded", "rows"),
    ("loaded", "columns"),
    ("grounded", "rows"),
    ("grounded", "columns"),
)
REST_SCATTER = 0.1  # RMS, relative, of the cells at rest


def circuit_of(kind, base: Circuit = CIRCUIT) -> Circuit:
    return replace(base, readout=kind[0], driven=kind[1])


def noise() -> None:
    """One standard deviation of a touched cell's force by each reading's noise."""
    print("readout   scene        ghost   std of a touched cell [g], median")
    for kind in (k for k in KINDS if k[1] == "rows"):
        circuit = circuit_of(kind)
        for scene in ("one_finger", "two_fingers", "push_left"):
            force = scenes.script(scene, *circuit.shape)(0.0)
            touched, idle = force > 0.05, force == 0.0
            g = 1.0 / CURVE.resistance(force)
            network = readouts.solve(circuit, g)
            rest = forward(circuit, CURVE.resistance(np.zeros_like(force)))
            ghost = (network.adc - rest)[idle].max() / (network.adc - rest).max()
            row, col = np.divmod(np.arange(g.size, dtype=np.int32), np.int32(circuit.cols))
            slopes = network.sensitivity(
                np.ones(g.shape),
                np.arange(g.size, dtype=np.int32),
                row,
                col + np.int32(circuit.rows),
            )
            inverse = np.linalg.inv(slopes.astype(float))
            std_g = np.sqrt(np.square(inverse).sum(1)).reshape(g.shape)
            std_g *= SCAN_NOISE / circuit.full_scale
            step = 1e-4 + 1e-4 * force
            by_force = (1.0 / CURVE.resistance(force + step) - g) / step  # S/N
            median = np.median((std_g / by_force)[touched]) / GRAM
            print(f"{circuit.readout:9} {scene:12} {100 * ghost:4.0f} %  {median:5.2f}")


def accuracy(n: int, seed: int, families=FAMILIES) -> None:
    """The same touches, each read in all ways."""
    print("readout          family  newton, ideal: worst g  y p50  map, scan: mean g  ok %  y p50")
    for family in families:
        for kind in KINDS:
            circuit = circuit_of(kind)
            rng = np.random.default_rng(seed)
            force, adc = frames(family, "ideal", n, rng, circuit, CURVE)
            clock, worst = Clock(), 0.0
            for truth, frame in zip(force, adc, strict=True):
                found = clock(compensate, frame, circuit, CURVE, "newton", noise=0.0)
                worst = max(worst, np.abs(found.force - truth).max() / GRAM)
            rng = np.random.default_rng(seed)
            force, adc = frames(family, "scan", n, rng, circuit, CURVE)
            fits, error, ok = Clock(), 0.0, 0
            for truth, frame in zip(force, adc, strict=True):
                found = fits(compensate, frame, circuit, CURVE, "map", noise=SCAN_NOISE)
                error += np.abs(found.force - truth).mean() / GRAM / n
                ok += found.status == "ok"
            print(
                f"{' '.join(kind):16} {family:7} {worst:10.1e} {clock.quantile(0.5):17.2f} "
                f"{error:15.2f} {100 * ok / n:10.1f} {fits.quantile(0.5):6.2f}",
                flush=True,
            )


def speed(n: int, seed: int) -> None:
    """p50 of floating frames."""
    for family in FAMILIES:
        line = []
        for method, readout in (("newton", "ideal"), ("map", "scan"), ("fixed_point", "scan")):
            _, adc = frames(family, readout, n, np.random.default_rng(seed), CIRCUIT, CURVE)
            clock = Clock()
            for frame in adc:
                clock(compensate, frame, CIRCUIT, CURVE, method, noise=SCAN_NOISE)
            line.append(f"{method} {clock.quantile(0.5):.2f}")
        print(f"{family:7}", "  ".join(line), flush=True)


def light(n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N] of fingertips of 0.05 to 1 N."""
    rows, cols = shape
    return np.array(
        [
            scenes.finger(rows, cols, rng.uniform(1, rows - 2), rng.uniform(1, cols - 2), newtons)
            for newtons in 10.0 ** rng.uniform(-1.3, 0.0, n)
        ]
    )


def wrong(n: int, seed: int, shape=(16, 16)) -> None:
    """Suspect frames, or failed ones, by what a board is and what it is taken for [%]."""
    families = "bodies", "pictures", "blobs", "rects", "random", "light"
    print(f"{'is':16} {'taken for':16} " + " ".join(f"{f:>8}" for f in families))
    base = Circuit(*shape)
    for true in KINDS:
        for supposed in KINDS:
            name = f"{' '.join(true):16} {' '.join(supposed):16}"
            rng = np.random.default_rng(seed)
            rest = np.exp(REST_SCATTER * rng.standard_normal(shape))
            rest = CURVE.resting_at(CURVE.rest_resistance * rest)
            board, taken = circuit_of(true, base), circuit_of(supposed, base)
            at_rest = forward(board, rest.resistance(np.zeros(shape)))
            try:
                curve = CURVE.resting_at(1.0 / resting_conductance(at_rest, taken, 0.1))
            except ValueError as error:
                print(f"{name} no rest: {error}"[:90])
                continue
            line = []
            for family in families:
                if family == "light":
                    ratio = forward(board, rest.resistance(light(n, shape, rng)))
                    adc = scenes.read_out(board, ratio, "scan", rng)
                else:
                    _, adc = frames(family, "scan", n, rng, board, rest)
                found = compensate(adc, taken, curve, "map", noise=SCAN_NOISE)
                line.append(f"{100.0 * np.mean(found.status != 'ok'):8.1f}")
            print(name, " ".join(line), flush=True)


def even(n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N]: loads on all cells, whose touch scatters by 5 to 20 %."""
    level = np.exp(rng.uniform(np.log(0.3), np.log(9.0), (n, 1, 1)))
    return level * np.exp(rng.uniform(0.05, 0.2, (n, 1, 1)) * rng.standard_normal((n, *shape)))


def palms(n: int, shape, rng) -> np.ndarray:
    """(n, rows, cols) force [N]: broad loads, softer and softer towards their rim."""
    row, col = np.mgrid[: shape[0], : shape[1]]
    found = []
    for power in rng.choice([2, 3, 4], n):
        (y, x), (high, wide) = (
            rng.uniform(*ends, 2) * shape for ends in ((0.15, 0.85), (0.2, 0.4))
        )
        rim = np.abs((row - y) / high) ** power + np.abs((col - x) / wide) ** power
        most = np.exp(rng.uniform(np.log(0.3), np.log(6.0)))
        found.append(most * np.exp(-rim + 0.1 * rng.standard_normal(shape)))
    return np.array(found)


def scanned(board: Circuit, taken: Circuit, family: str, n: int, seed: int):
    """(n, rows, cols) loads [N] on a fabric that scatters, readings, the curve with its rest."""
    made, shape = {"palms": palms, "even": even, "light": light}, board.shape
    rng = np.random.default_rng(seed)
    scatter = REST_SCATTER * rng.standard_normal(shape)
    rest = CURVE.resting_at(CURVE.rest_resistance * np.exp(scatter))
    at_rest = forward(board, rest.resistance(np.zeros(shape)))
    curve = CURVE.resting_at(1.0 / resting_conductance(at_rest, taken, 0.1))
    make = made.get(family) or (lambda n, shape, rng: scenes.sample(family, n, *shape, rng))
    force = np.minimum(make(n, shape, rng), CURVE.max_force)
    adc = scenes.read_out(board, forward(board, rest.resistance(force)), "scan", rng)
    return force, adc, curve


def right(n: int, seed: int, shape=(16, 16), **parts) -> None:
    """Suspect frames of boards whose readout is known, one fabric for each seed [%]."""
    print("of a sound board, noise not given and given; r_par of the board 0.8 and 1.2 times [%]")
    families = "bodies", "pictures", "blobs", "rects", "random", "palms", "even"
    print(f"{'readout':17}" + " ".join(f"{f:>23}" for f in families))
    cases = (1.0, None), (1.0, SCAN_NOISE), (0.8, SCAN_NOISE), (1.2, SCAN_NOISE)
    for kind in KINDS:
        line, taken = [], circuit_of(kind, Circuit(*shape, **parts))
        for family in families:
            suspect = []
            for off, given in cases:
                board = replace(taken, r_par=off * taken.r_par)
                _, adc, curve = scanned(board, taken, family, n, seed)
                found = compensate(adc, taken, curve, "map", noise=given)
                suspect.append(100.0 * np.mean(found.status != "ok"))
            line.append("{:5.1f} {:5.1f} {:5.1f} {:5.1f}".format(*suspect))
        print(f"{' '.join(kind):17}" + " ".join(line), flush=True)


def drivers(n: int, seed: int, shape=(16, 16), r_ref: float = CIRCUIT.r_ref) -> None:
    """Force felt over true one, median, and suspect frames [%], by the drivers' resistance."""
    ideal = Circuit(*shape, r_ref=r_ref, r_par=0.0, readout="grounded")
    for r_drive, supposed in ((0.0, 0.0), (25.0, 0.0), (70.0, 0.0), (25.0, 25.0), (70.0, 70.0)):
        board, taken, line = *(replace(ideal, r_drive=r) for r in (r_drive, supposed)), []
        for family in ("bodies", "blobs", "rects", "palms", "light"):
            force, adc, curve = scanned(board, taken, family, n, seed)
            found = compensate(adc, taken, curve, "map", noise=SCAN_NOISE)
            felt = np.median(found.force.sum((1, 2)) / force.sum((1, 2)))
            line.append(f"{family} {felt:.2f} {100.0 * np.mean(found.status != 'ok'):3.0f} %")
        print(f"{r_drive:3.0f} ohm, taken for {supposed:3.0f}:  " + "   ".join(line), flush=True)


def diodes(n: int, seed: int, shape=(8, 8)) -> None:
    """Force felt over true one by touches: 5th percentile, median, 95th; suspect frames.

    With the diode not entered; as its data sheet has it; 25 mV below; and then with the r_par that
    the touches tell.
    """
    for diode in DIODES:
        for supply, r_ref in ((5.0, 1780.0), (5.0, 10e3), (3.3, 1780.0), (3.3, 10e3)):
            board = Circuit(*shape, r_ref=r_ref, r_par=25.0, readout="loaded")
            rng = np.random.default_rng(seed)
            scatter = REST_SCATTER * rng.standard_normal(shape)
            rest = CURVE.resting_at(CURVE.rest_resistance * np.exp(scatter))
            force = scenes.sample("bodies", n, *shape, rng)
            every = np.concatenate([np.zeros((20, *shape)), force])
            ideal = forward(board, rest.resistance(every))
            ratio = Diode(*DIODES[diode], supply).ratio(ideal, board)
            steps = np.rint(
                board.full_scale * ratio + SCAN_NOISE * rng.standard_normal(ratio.shape)
            )
            volts = forward_voltage(diode, 1e-3)
            print(f"{diode} at {supply} V, r_ref {r_ref:5.0f} ohm:", flush=True, end="")
            for entered in (0.0, volts, volts - 0.025, None):
                adc = Adc(board, diode=volts - 0.025 if entered is None else entered, supply=supply)
                idle, touched = np.split(adc.ratio(steps), [20])
                taken, at_rest = board, measure_rest(idle, board)
                if entered is None:
                    taken = identify(touched, board, at_rest).circuit
                    at_rest = measure_rest(idle, taken)
                curve = CURVE.resting_at(1.0 / at_rest.conductance)
                found = compensate(touched, taken, curve, "map", noise=SCAN_NOISE)
                felt = np.quantile(found.force.sum((1, 2)) / force.sum((1, 2)), (0.05, 0.5, 0.95))
                print("  {:.2f} {:.2f} {:.2f}".format(*felt), end=" ")
                print(f"{100 * np.mean(found.status != 'ok'):3.0f} %", end="", flush=True)
            print()


def recording(circuit: Circuit, seed: int, seconds=60.0) -> np.ndarray:
    """(n, rows, cols) ADC ratio of a minute of touches, 20 frames a second."""
    rng = np.random.default_rng(seed)
    board = FaultBoard(circuit, CURVE, rng)
    force = everyday(circuit.populated, seconds, rng, CURVE.max_force, hard=False).force
    ratio = board.ratio(force[:: KNOTS // 20])
    steps = ratio * circuit.full_scale + SCAN_NOISE * rng.standard_normal(ratio.shape)
    return np.clip(np.rint(4.0 * steps) / 4.0, 0.0, circuit.full_scale) / circuit.full_scale


def named(n: int, seed: int, shape=(8, 8)) -> None:
    """What `diagnose` says of each true readout, taken for each."""
    print("is \\ taken for: streams whose readout is named rightly (taken for itself: not named)")
    for true in KINDS:
        line = []
        for supposed in KINDS:
            good = 0
            for k in range(n):
                board, taken = (circuit_of(kind, Circuit(*shape)) for kind in (true, supposed))
                found = diagnose(recording(board, seed + k), taken, series=False)
                said = [f for f in found if f.kind == "readout"]
                if true == supposed:
                    good += not said
                else:
                    words = f"readout: {true[0]}", f"driven: {true[1]}"
                    expected = words[: 1 if true[0] == "floating" else 2]
                    good += bool(said) and all(word in said[0].remedy for word in expected)
            line.append(f"{good}/{n}")
        print(f"{' '.join(true):16}  " + "  ".join(f"{word:8}" for word in line), flush=True)


def calibrate(n: int, seed: int, shape=(8, 8)) -> None:
    """Boards whose readout is named rightly by five touches, and those named wrongly."""
    print("is \\ taken for: named rightly, named wrongly")
    for true in KINDS:
        line = []
        for supposed in KINDS:
            right = wrongly = 0
            for k in range(n):
                rng = np.random.default_rng([seed, k])
                base = Circuit(*shape, r_par=CIRCUIT.r_par * rng.uniform(0.8, 1.2))
                board = FaultBoard(circuit_of(true, base), CURVE, rng)
                force = scenes.sample("bodies", 5, *shape, rng)
                at_rest = np.zeros((20, *shape))
                steps = board.ratio(np.concatenate([at_rest, force])) * CIRCUIT.full_scale
                steps += SCAN_NOISE * rng.standard_normal(steps.shape)
                ratio = np.clip(np.rint(4.0 * steps) / 4.0, 0.0, 1023.0) / CIRCUIT.full_scale
                taken, rest = circuit_of(supposed, Circuit(*shape)), ratio[:20].mean(0)
                found = other_readout(taken, rest, SCAN_NOISE, ratio[20:])
                words = f"readout: {true[0]}", f"driven: {true[1]}"
                words = words[: 1 if true[0] == "floating" else 2]
                good = bool(found) and all(word in found.remedy for word in words)
                right += good
                wrongly += bool(found) and not good
            line.append(f"{right}, {wrongly}")
        print(f"{' '.join(true):16}  " + "  ".join(f"{word:8}" for word in line), flush=True)


def main(arguments=None):

    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("what", choices=[*_WHAT])
    parser.add_argument("--n", type=int, default=20, help="frames of a family, or streams")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--side", type=int, default=16, help="of wrong, right, drivers, diodes")
    parser.add_argument("--r-ref", type=float, default=CIRCUIT.r_ref, help="ohm, of right, drivers")
    parser.add_argument("--r-par", type=float, default=CIRCUIT.r_par, help="ohm, of right")
    args = parser.parse_args(arguments)
    _WHAT[args.what](args)


_WHAT = {
    "noise": lambda args: noise(),
    "accuracy": lambda args: accuracy(args.n, args.seed),
    "speed": lambda args: speed(args.n, args.seed),
    "wrong": lambda args: wrong(args.n, args.seed, (args.side, args.side)),
    "right": lambda args: right(
        args.n, args.seed, (args.side, args.side), r_ref=args.r_ref, r_par=args.r_par
    ),
    "drivers": lambda args: drivers(args.n, args.seed, (args.side, args.side), args.r_ref),
    "diodes": lambda args: diodes(args.n, args.seed, (args.side, args.side)),
    "named": lambda args: named(args.n, args.seed),
    "calibrate": lambda args: calibrate(args.n, args.seed),
}

if __name__ == "__main__":
    harness.run(main)
