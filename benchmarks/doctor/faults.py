# SPDX-License-Identifier: Apache-2.0
"""How many faults `diagnose` names, and how often it names one on a sound board.

Each board is a `FaultBoard`: Kirchhoff's laws for its own wiring, a fabric whose curve is up to
30 % off in level, 5 to 8 % scatter, 3 % at rest, 0.5 % of a touch carried to the neighbours, 1 step
of noise, one of three ways to make a frame of scans; 8 x 8 to 32 x 32. A quarter of them is
floating, half loaded, a quarter grounded, driven by rows or columns; or as --readouts says.
Fingers, palms, edges, strokes and pushes for T seconds, and one or two faults from the first frame
on. A fault counts as named if a finding has its kind and its line or cell; one that changes no
reading by a step, as a ceiling that no touch reaches, is not counted. Any finding that no planted
fault explains is a false alarm.
"""

from __future__ import annotations

import time
from collections import defaultdict

import numpy as np
from support.damaged import KINDS, WHOLE, Case, explains, readout_of

from tactile_skin import Circuit, diagnose
from tactile_skin.physics.readouts import READOUTS

from .. import harness

MIXED = ("floating", "loaded", "loaded", "grounded")


def draw(rng, readout: str) -> tuple[str, ...]:
    """One or two kinds of fault that such a board may have."""
    kinds = [k for k in KINDS if k not in ("bits", "drivers")]
    kinds = [k for k in kinds if k != "resistor" or readout != "floating"]
    if rng.random() < 0.1:
        return ("bits",)
    n = rng.integers(1, 3)
    while True:
        chosen = tuple(kinds[k] for k in rng.choice(len(kinds), n, replace=False))
        if sum(k in WHOLE for k in chosen) < 2:
            return chosen


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=80, help="with faults")
    parser.add_argument("--sound", type=int, default=60)
    parser.add_argument("--seed", type=int, default=5000, help="of the first board")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--kinds", nargs="*", choices=list(KINDS), help="these, one on a board")
    parser.add_argument("--readouts", nargs="+", choices=READOUTS, default=MIXED)
    parser.add_argument("--r-ref", type=float, default=Circuit().r_ref, metavar="OHM")
    parser.add_argument("--r-par", type=float, default=Circuit().r_par, metavar="OHM")
    args = parser.parse_args(arguments)
    named, false, spent = defaultdict(list), [], 0.0
    for seed in range(args.seed, args.seed + args.boards + args.sound):
        faulty = seed < args.seed + args.boards
        readout = readout_of(seed, args.readouts)["readout"]
        faults = draw(np.random.default_rng([seed, 2]), readout) if faulty else ()
        if faulty and args.kinds:
            faults = (args.kinds[seed % len(args.kinds)],)
        parts = {"r_ref": args.r_ref, "r_par": args.r_par}
        case = Case(seed, faults, args.seconds, readouts=args.readouts, **parts)
        begun = time.process_time()
        found = diagnose(case.frames, case.circuit, None)
        spent += time.process_time() - begun
        left = list(found)
        words = []
        for kind, name, rows, cols in case.faults:
            mine = [f for f in found if explains(f, kind, name, rows, cols, case.cut)]
            left = [f for f in left if f not in mine]
            if kind in case.hidden:
                words.append(f"{name}: changes nothing")
                continue
            named[kind].append(bool(mine))
            words.append(f"{name} {sorted(rows)}/{sorted(cols)}: {'named' if mine else 'MISSED'}")
        if left:
            false.append(seed)
        size = "{}x{}".format(*case.circuit.shape)
        kind = f"{case.circuit.readout} by {case.circuit.driven}, {case.board.readout}"
        print(f"{seed} {size} {kind}: {'; '.join(words) or 'sound'}", flush=True)
        for f in left:
            print(f"      also: {f}", flush=True)
    boards = args.boards + args.sound
    for kind, hits in named.items():
        print(f"{kind}: {sum(hits)} of {len(hits)}")
    hits = sum(map(sum, named.values()))
    print(
        f"named {hits} of {sum(map(len, named.values()))} faults; boards with a finding too many: "
    )
    sound = sum(s >= args.seed + args.boards for s in false)
    print(f"{len(false) - sound} of {args.boards} damaged, {sound} of {args.sound} sound")
    print(f"{spent / boards:.1f} s a board (processor time)")
    return {"named": named, "false alarms": false}


if __name__ == "__main__":
    harness.run(main)
