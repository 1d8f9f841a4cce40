# SPDX-License-Identifier: Apache-2.0
"""What a bad lead does to the doctor and to `identify`, by its ohms.

The boards are the doctor's (`doctor.py`), each with so many ohm in one line's lead. Named: with its
line, and how far its ohms are off. Others: findings that it does not explain. r_par: what
`identify` says of it, who knows of no lead, and the standard deviation that it states.
"""

from __future__ import annotations

import numpy as np
from support.damaged import Case

from tactile_skin import Finding, diagnose, identify
from tactile_skin.calibration.rest import measure_rest
from tactile_skin.health.doctor import recorded

from .. import harness

HELD = 60  # touches that identify is given, at most


class Led(Case):
    """A board one of whose leads has so many ohm."""

    def __init__(self, seed: int, ohm: float, seconds: float, shape):
        self._ohm = ohm
        super().__init__(seed, ("lead",) if ohm else (), seconds, shape)

    def _touches(self, seconds, rng):
        wires = self.board.matrix.wiring
        for lead in (wires.row_lead, wires.col_lead):
            lead[lead > 0.0] = self._ohm
        return super()._touches(seconds, rng)


def lead_of(found: list[Finding], case: Led) -> Finding | None:
    """The finding of the planted lead."""
    ((_, _, rows, cols),) = case.faults
    return next(
        (f for f in found if f.kind == "lead" and (set(f.rows), set(f.cols)) == (rows, cols)), None
    )


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=10, help="of each size and resistance")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--sizes", nargs="*", default=["8x8", "16x16"])
    parser.add_argument("--ohm", type=float, nargs="*", default=[0, 20, 50, 100, 200, 500])
    args = parser.parse_args(arguments)
    rows = []
    for size in args.sizes:
        for ohm in args.ohm:
            named, off, others, shift = 0, [], 0, []
            for seed in range(args.seed, args.seed + args.boards):
                case = Led(seed, ohm, args.seconds, tuple(map(int, size.split("x"))))
                found = diagnose(case.frames, case.circuit)
                mine = lead_of(found, case) if ohm else None
                others += len(found) - (mine is not None)
                if mine is not None:
                    named += 1
                    off.append(float(mine.evidence.split("what ")[1].split()[0]) - ohm)
                seen = recorded.record(case.frames, case.circuit, None)
                rest = measure_rest(case.frames[seen.quiet], case.circuit)
                said = identify(case.frames[seen.touches[:HELD]], case.circuit, rest)
                if said.told["r_par"]:
                    shift.append(
                        (said.circuit.r_par - case.board.matrix.circuit.r_par, said.std["r_par"])
                    )
            row = {"size": size, "ohm": ohm, "named": named, "off": off}
            rows.append(row | {"others": others, "r_par": shift})
            shifts = np.array(shift).reshape(-1, 2)
            print(
                f"{size} {ohm:g} ohm: named {named} of {args.boards if ohm else 0}, off by "
                f"{np.median(np.abs(off)) if off else float('nan'):.0f} ohm; others {others}; "
                f"r_par told {len(shift)}, off by {np.median(shifts[:, 0]) if shift else 0:+.1f} "
                f"ohm (stated std {np.median(shifts[:, 1]) if shift else 0:.1f})",
                flush=True,
            )
    return rows


if __name__ == "__main__":
    harness.run(main)
