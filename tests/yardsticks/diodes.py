"""Diodes that the configuration does not know, and others that the doctor takes for them:
`python tests/yardsticks/diodes.py [--boards N] [--seed S]`.

Loaded boards of 8x8, 9x9 and 16x16 cells, r_ref of 1.8, 10 and 35 kohm, 40 s of touches each:
sound, with r_par or r_ref that are not the board's, and driven through diodes.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np
from kirchhoff import DIODES, behind_diodes
from yardsticks.doctor import Case

from tactile_skin import diagnose

SHAPES, R_REF, R_PAR = ((8, 8), (9, 9), (16, 16)), (1780.0, 10e3, 35e3), 25.0
CASES = {  # name -> diode and supply [V], or what the configuration has wrong [ohm], or as a factor
    "sound": {},
    "r_par 326": {"r_par": 326.0},
    "r_par 0": {"r_par": 0.0},
    "r_par 90": {"r_par": 90.0},
    "r_ref +10 %": {"r_ref": 1.1},
    "r_ref -10 %": {"r_ref": 0.9},
} | {f"{name} {supply:g} V": (name, supply) for name in DIODES for supply in (5.0, 3.3)}


def recorded(seed: int, r_ref: float, diode: str | None = None, supply: float = 5.0):
    """The circuit, and (n, rows, cols) ADC ratio of a board; whole ADC steps."""
    shape = SHAPES[seed % len(SHAPES)]
    case = Case(seed, (), 40.0, shape, readouts=("loaded",), r_ref=r_ref, r_par=R_PAR)
    frames = case.frames[::2]
    if diode:
        frames = np.array([behind_diodes(f, case.circuit, diode, supply) for f in frames])
    return case.circuit, np.rint(frames * case.circuit.full_scale) / case.circuit.full_scale


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=6, help="of each r_ref")
    parser.add_argument("--seed", type=int, default=41)
    args = parser.parse_args()
    named, other = Counter(), Counter()
    for seed in range(args.seed, args.seed + args.boards):
        for r_ref in R_REF:
            for name, case in CASES.items():
                wrong = dict(case) if isinstance(case, dict) else {}
                circuit, frames = recorded(seed, r_ref, *(() if wrong == case else case))
                if "r_ref" in wrong:
                    wrong["r_ref"] *= r_ref
                found = [finding.where for finding in diagnose(frames, replace(circuit, **wrong))]
                named[name] += "diode" in found
                other[name] += bool([where for where in found if where != "diode"])
        print(f"{seed}:", *(f"{name} {named[name]} ({other[name]})" for name in CASES), flush=True)
    print(f"of {args.boards * len(R_REF)} boards each: diodes named (and other findings)")


if __name__ == "__main__":
    main()
