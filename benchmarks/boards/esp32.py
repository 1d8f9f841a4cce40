# SPDX-License-Identifier: Apache-2.0
"""Force felt over the true one on boards with an ESP32's ADC, and time in a fault stop.

The boards' chips are two that others measured, not the shipped table; with --exact all follow that
table, with --spread each has an offset and a gain of its own. A driven clock, 8 x 8 floating cells
at 20 Hz, touches of 3 to 40 N.
"""

from __future__ import annotations

import numpy as np
from support.esp32 import CHIPS, felt, frames

from tactile_skin import Circuit
from tactile_skin.middleware.threads import one_thread

from .. import harness


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1900)
    parser.add_argument("--r-ref", type=float, nargs="+", default=[1000.0, 4700.0, 10000.0])
    parser.add_argument("--table", default="esp32", help="none: as without the table")
    chips = parser.add_mutually_exclusive_group()
    chips.add_argument("--exact", action="store_true", help="chips that follow the shipped table")
    chips.add_argument("--spread", action="store_true", help="chips off those by OFFSET and GAIN")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args(arguments)
    spread = {} if args.spread else {"offset": 0.0, "gain": 0.0}
    adc = {"circuit.adc_table": "" if args.table == "none" else args.table}
    rows = []
    with one_thread():
        for r_ref in args.r_ref:
            circuit = Circuit(8, 8, r_ref=r_ref, r_par=140.0, adc_bits=12)
            every, stopped = [], []
            for k in range(args.boards):
                of = None if args.exact else k % len(CHIPS)
                readings, force = frames(circuit, (args.seed, k), of, **spread)
                ratio, faults, why = felt(circuit, readings, force, adc)
                every.append(ratio)
                stopped.append(faults)
                if args.verbose:
                    q = np.quantile(ratio, (0.1, 0.5, 0.9)).round(2)
                    print(f"  board {k}: {q}, {faults:.1%}", dict(sorted(why.items())[:3]))
            rows.append({"r_ref": r_ref, "felt over true": every, "stopped": stopped})
            low, middle, high = np.quantile(np.concatenate(every), (0.1, 0.5, 0.9))
            print(
                f"r_ref {r_ref:6.0f}: felt over true {middle:.2f} ({low:.2f} to {high:.2f}), "
                f"fault stops {np.mean(stopped):.1%} of the time",
                flush=True,
            )
    return rows


if __name__ == "__main__":
    harness.run(main)
