# SPDX-License-Identifier: Apache-2.0
"""How often diodes are named, and how often something else is taken for them.

Loaded boards of 8x8, 9x9 and 16x16 cells, r_ref of 1.8, 10 and 35 kohm, 40 s of touches each:
sound, with r_par or r_ref that are not the board's, and driven through diodes.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from support.diodes import R_REF, recorded
from support.kirchhoff import DIODES

from tactile_skin import diagnose

from .. import harness

CASES = {  # name -> diode and supply [V], or what the configuration has wrong [ohm], or as a factor
    "sound": {},
    "r_par 326": {"r_par": 326.0},
    "r_par 0": {"r_par": 0.0},
    "r_par 90": {"r_par": 90.0},
    "r_ref +10 %": {"r_ref": 1.1},
    "r_ref -10 %": {"r_ref": 0.9},
} | {f"{name} {supply:g} V": (name, supply) for name in DIODES for supply in (5.0, 3.3)}


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=6, help="of each r_ref")
    parser.add_argument("--seed", type=int, default=41)
    args = parser.parse_args(arguments)
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
    return {"named": named, "other": other}


if __name__ == "__main__":
    harness.run(main)
