# SPDX-License-Identifier: Apache-2.0
"""Damaged boards through the complete chain: silent failures, missed pushes, false stops.

examples:
  python -m benchmarks.faults --quick                              # one minute
  python -m benchmarks.faults --shapes 4x4 16x16 --minutes 10      # some shapes
  python -m benchmarks.faults --faults dead --streams 50 --minutes 0
  python -m benchmarks.faults --faults --minutes 120               # sound boards only
"""

from __future__ import annotations

from .. import harness
from . import reliability, table


def main(arguments=None) -> None:
    parser = harness.picture_parser(__doc__, __spec__)
    parser.add_argument("--shapes", nargs="+", metavar="SHAPE", choices=reliability.SHAPES)
    parser.add_argument(
        "--faults", nargs="*", metavar="NAME", help="names, or dead or electrical (default: all)"
    )
    parser.add_argument("--minutes", type=float, help="of sound streams, in all (default 60)")
    parser.add_argument("--streams", type=int, help="of each fault and begin (default 1)")
    parser.add_argument("--jobs", type=int, help="processes (default: one a core)")
    given = parser.parse_args(arguments)
    chosen = reliability.QUICK if given.quick else reliability.FULL
    names = "shapes", "faults", "minutes", "streams", "jobs"
    chosen = chosen | {k: getattr(given, k) for k in names if getattr(given, k) is not None}
    for name, least in (("minutes", 0.0), ("streams", 1), ("jobs", 1)):
        if not chosen.get(name, least) >= least:
            parser.error(f"--{name} = {chosen[name]}: must be {least:g} or more")
    if given.faults is not None:
        try:
            chosen["faults"] = reliability.named(given.faults)
        except ValueError as error:
            parser.error(str(error))
    print(table.table(harness.draw(reliability, chosen, given)["faults"]))


if __name__ == "__main__":
    harness.run(main)
