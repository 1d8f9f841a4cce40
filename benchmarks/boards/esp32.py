# SPDX-License-Identifier: Apache-2.0
"""Force felt over the true one on boards with an ESP32's ADC, and time in a fault stop.

The boards' chips are two that others measured, not the shipped table; with --exact all follow that
table, with --spread each has an offset and a gain of its own. A driven clock, 8 x 8 floating cells
at 20 Hz, touches of 3 to 40 N. With --guide boards are unknown but for r_ref and the ADC, a person
does what `calibrate` asks, and presses are felt before and after, each by its median; an r_ref of
0 stands for a Mega's 16 x 16 cells and linear ADC of 10 bits. The fabric does not creep.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import yaml
from support.esp32 import CHIPS, LATEST, RATE, REST, UnknownEsp32, felt, frames
from support.lab.unknown import Unknown
from support.weights import objects, presses

from tactile_skin import Circuit
from tactile_skin.guide.calibrated import known_of, write
from tactile_skin.guide.calibration import Guide
from tactile_skin.middleware.config import read_skin
from tactile_skin.middleware.threads import one_thread
from tactile_skin.physics.creep import NO_CREEP

from .. import harness
from ..calibration.proved import OBJECTS, Hands

PRESSES, STANDS, APART = 40, 16, 12  # that are felt; frames of each, and between two
ENTER, LAY = 3.0, 8.0  # s that a person takes for a key, and for a thing
SMALL = 8.0  # N


class Person(Hands):
    """Does what the guide asks, keeps what it says, and for how long it took [s]."""

    def __init__(self, board: Unknown, seed: int):
        rng = np.random.default_rng([seed, 17])
        super().__init__(board, 1.0, objects(OBJECTS, board.supposed.shape, rng)[0], rng)
        self._creep, self.heard, self.seconds = NO_CREEP, [], 0.0

    def ask(self, text: str) -> str:
        word = super().ask(text)
        self.heard.append(f"{text}[{word}]")
        self.wait(LAY if word else ENTER)
        return word

    def say(self, text: str) -> None:
        super().say(text)
        self.heard.append(text)

    def wait(self, seconds: float) -> None:
        self.seconds += seconds

    def frames(self, seconds: float) -> np.ndarray:
        self.wait(seconds)
        return super().frames(seconds)


def pressed(board: Unknown, path: Path, force: np.ndarray) -> tuple[np.ndarray, float]:
    """(n,) felt over true of presses (n, rows, cols) [N] by a file; share of time in a stop."""
    given, skin = yaml.safe_load(path.read_text())["/**"]["ros__parameters"], read_skin(path)
    entries = {f"{section}.{k}": v for section, of in given.items() for k, v in of.items()}
    rest, each = np.zeros((1, *force.shape[1:])), np.repeat(np.arange(len(force)), STANDS + APART)
    on = np.tile(np.arange(STANDS + APART) < STANDS, len(force))
    force = np.concatenate([force, rest])
    which = np.append(np.full(int(REST * RATE), len(force) - 1), np.where(on, each, len(force) - 1))
    exposed = np.array([board.expose(f) for f in force])
    ratio = np.array([board.sample(exposed[k]) for k in which])
    readings = np.rint(skin.adc.circuit.full_scale * ratio).astype(int)
    if isinstance(board, UnknownEsp32):
        readings = np.rint(board.adc.count(ratio)).astype(int)
    ratio, stopped, _ = felt(skin.circuit, readings, force[which], entries)
    return np.median(ratio.reshape(-1, STANDS - 2 * LATEST), 1), stopped


def guided(r_ref: float, k: int, seed: int, verbose: bool, adc: dict, **spread) -> tuple:
    """Return felt over true before and after, (n,) N, stopped and minutes, of one board."""
    board = UnknownEsp32((8, 8), seed, r_ref, k, **spread) if r_ref else Unknown((16, 16), seed)
    entered = adc | {"rows": board.supposed.rows, "cols": board.supposed.cols}
    entered |= {"adc_bits": board.supposed.adc_bits, "r_ref": board.supposed.r_ref}
    force, weight = presses(PRESSES, board.supposed.shape, np.random.default_rng([seed, 18]))
    person = Person(board, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": entered}}}))
        skin, (before, _) = read_skin(path), pressed(board, path, force)
        known = known_of(skin)
        guide = Guide(skin.circuit, person.frames, person.ask, person.say, person.wait, **known)
        guide.run()
        write(path, path, guide, skin)
        after, stopped = pressed(board, path, force)
    if verbose:
        print(*person.heard, sep="\n")
    return before, after, weight, stopped, person.seconds / 60.0


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1900)
    parser.add_argument("--r-ref", type=float, nargs="+", default=[1000.0, 4700.0, 10000.0])
    parser.add_argument("--table", default="esp32", help="none: as without the table")
    chips = parser.add_mutually_exclusive_group()
    chips.add_argument("--exact", action="store_true", help="chips that follow the shipped table")
    chips.add_argument("--spread", action="store_true", help="chips off those by OFFSET and GAIN")
    parser.add_argument("--guide", action="store_true", help="calibrate each board as a person")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args(arguments)
    spread = {} if args.spread else {"offset": 0.0, "gain": 0.0}
    table = "" if args.table == "none" else args.table
    rows = []
    with one_thread():
        for r_ref in args.r_ref:
            every, stopped, more = [], [], []
            for k in range(args.boards):
                of = None if args.exact else k % len(CHIPS)
                if args.guide:
                    adc = {"adc_table": table} if r_ref and table else {}
                    found = guided(r_ref, of, args.seed + k, args.verbose, adc, **spread)
                    before, ratio, weight, faults, minutes = found
                    more.append((before, ratio[weight < SMALL], minutes))
                else:
                    circuit = Circuit(8, 8, r_ref=r_ref, r_par=140.0, adc_bits=12)
                    readings, force = frames(circuit, (args.seed, k), of, **spread)
                    entries = {"circuit.adc_table": table}
                    ratio, faults, why = felt(circuit, readings, force, entries)
                every.append(ratio)
                stopped.append(faults)
                if args.verbose:
                    q = np.quantile(ratio, (0.1, 0.5, 0.9)).round(2)
                    print(f"  board {k}: {q}, {faults:.1%}", *([] if args.guide else [why]))
            rows.append({"r_ref": r_ref, "felt over true": every, "stopped": stopped})
            low, middle, high, most = np.quantile(np.concatenate(every), (0.1, 0.5, 0.9, 1.0))
            print(
                f"r_ref {r_ref:6.0f}: felt over true {middle:.2f} ({low:.2f} to {high:.2f}, "
                f"{most:.2f} at most), fault stops {np.mean(stopped):.1%} of the time",
                flush=True,
            )
            if args.guide:
                for name, part in ("before", 0), (f"below {SMALL:g} N", 1):
                    low, middle, high = np.quantile(
                        np.concatenate([m[part] for m in more]), (0.1, 0.5, 0.9)
                    )
                    print(f"    {name}: {middle:.2f} ({low:.2f} to {high:.2f})")
                print(f"    {max(m[2] for m in more):.1f} minutes at most", flush=True)
    return rows


if __name__ == "__main__":
    harness.run(main)
