# SPDX-License-Identifier: Apache-2.0
"""Force felt over the true one after the guide, on boards with an ESP32's ADC and on a Mega's.

Unknown boards, of which r_ref and the ADC are entered: 8 x 8 cells, text, an ESP32 whose chip is
one that others measured, with an offset and a gain of its own; 16 x 16, binary, 10 bits, linear. A
person does what `calibrate` asks, the file it writes is launched on a driven clock, and a hand
presses with 3 to 40 N; each press counts by the median of what is felt while it stands.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import yaml
from support.esp32 import CHIPS, LATEST, RATE, REST, UnknownEsp32, felt
from support.lab.unknown import Unknown
from support.weights import objects, presses

from tactile_skin.board import protocol
from tactile_skin.guide.calibrated import known_of, write
from tactile_skin.guide.calibration import Guide
from tactile_skin.middleware.config import read_skin
from tactile_skin.middleware.threads import one_thread
from tactile_skin.physics.creep import NO_CREEP

from .. import harness
from ..calibration.proved import OBJECTS, Hands

PRESSES, STANDS, APART = 40, 16, 12  # that are felt; frames of each, and between two
ENTER, LAY = 3.0, 8.0  # s that a person takes for a key, and for a thing
FRACTION = 6  # bits
SMALL = 8.0  # N


class Person(Hands):
    """Does what the guide asks, keeps what it says, and how long it took."""

    def __init__(self, *board_and_things):
        super().__init__(*board_and_things)
        self._creep = NO_CREEP  # benchmarks.calibration.creep is of creep
        self.said: list[str] = []
        self.seconds = 0.0

    def ask(self, text: str) -> str:
        word = super().ask(text)
        self.said.append(f"{text} [{word}]")
        self.seconds += LAY if word else ENTER
        return word

    def say(self, text: str) -> None:
        super().say(text)
        self.said.append(text)

    def wait(self, seconds: float) -> None:
        self.seconds += seconds

    def frames(self, seconds: float) -> np.ndarray:
        self.seconds += seconds
        return super().frames(seconds)


def launched(board: Unknown, skin, adc: dict, force: np.ndarray) -> tuple[np.ndarray, float]:
    """(n,) felt over true of presses (n, rows, cols) [N]; share of the time in a fault stop."""
    each = np.repeat(np.concatenate([np.zeros((1, *force.shape[1:])), force]), 1, 0)
    still, pause = np.zeros((int(REST * RATE), *force.shape[1:])), np.zeros((APART, *force.shape[1:]))
    stream = np.concatenate([still, *(np.concatenate([[f] * STANDS, pause]) for f in each[1:])])
    exposed = {f.tobytes(): board.expose(f) for f in each}
    ratio = np.array([board.sample(exposed[f.tobytes()]) for f in stream])
    encode = None
    if isinstance(board, UnknownEsp32):
        readings = np.rint(board.adc.count(ratio)).astype(int)
    else:
        readings = np.rint(ratio * skin.circuit.full_scale * 2**FRACTION).astype(np.int32)

        def encode(k: int, frame: np.ndarray) -> bytes:
            return protocol.encode(k, round(1e6 * k / RATE), frame, skin.circuit.adc_bits, FRACTION)

    found, stopped, _ = felt(skin.circuit, readings, stream, adc, encode)
    return np.median(found.reshape(len(force), STANDS - 2 * LATEST), 1), stopped


def run(board: Unknown, seed: int, entered: dict, words: bool) -> dict:
    """Guide a person over a board; figures before and after."""
    shape, rng = board.supposed.shape, np.random.default_rng([seed, 17])
    person = Person(board, 1.0, objects(OBJECTS, shape, rng)[0], rng)
    force, _ = presses(PRESSES, shape, np.random.default_rng([seed, 18]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.yaml"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"circuit": entered}}}))
        skin = read_skin(path)
        before, _ = launched(board, skin, parameters(path), force)
        guide = Guide(skin.circuit, person.frames, person.ask, person.say, person.wait, **known_of(skin))
        guide.run()
        write(path, path, guide, skin)
        skin = read_skin(path)
        after, stopped = launched(board, skin, parameters(path), force)
    if words:
        print(*person.said, sep="\n")
    print(
        f"{seed}: r_par {board.r_par:.0f}, found {skin.circuit.r_par:.0f}; before "
        f"{np.quantile(before, (0.1, 0.5, 0.9, 1)).round(2)}, after "
        f"{np.quantile(after, (0.1, 0.5, 0.9, 1)).round(2)}, stopped {stopped:.1%}, "
        f"{len(guide.touches)} touches, {person.seconds / 60:.1f} minutes",
        flush=True,
    )
    small = force.sum((1, 2)) < SMALL
    return {"before": before, "after": after, "small": after[small], "seconds": person.seconds}


def parameters(path: Path) -> dict:
    """Return the entries of a file but for those of the circuit's own, as section.name."""
    sections = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    return {f"{section}.{k}": v for section, of in sections.items() for k, v in of.items()}


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=6, help="of each kind")
    parser.add_argument("--seed", type=int, default=520000)
    parser.add_argument("--kinds", nargs="+", default=["mega", "1000", "4700", "10000"])
    parser.add_argument("--words", action="store_true", help="all that the guide says")
    args = parser.parse_args(arguments)
    found: dict[str, dict] = {}
    with one_thread():
        for kind in args.kinds:
            boards = []
            for seed in range(args.seed, args.seed + args.boards):
                if kind == "mega":
                    board, entered = Unknown((16, 16), seed), {"rows": 16, "cols": 16}
                else:
                    board = UnknownEsp32((8, 8), seed, float(kind), seed % len(CHIPS))
                    entered = {"rows": 8, "cols": 8, "adc_bits": 12, "adc_table": "esp32"}
                entered |= {"r_ref": board.supposed.r_ref}
                boards.append(run(board, seed, entered, args.words))
            found[kind] = of = {k: np.hstack([b[k] for b in boards]) for k in boards[0]}
            for name in ("before", "after", "small"):
                low, middle, most = np.quantile(of[name], (0.1, 0.5, 1.0))
                print(f"{kind}, {name}: {middle:.2f}, p10 {low:.2f}, most {most:.2f}")
            print(f"{kind}: {max(of['seconds']) / 60:.1f} minutes at most", flush=True)
    return {kind: {k: v.tolist() for k, v in of.items()} for kind, of in found.items()}


if __name__ == "__main__":
    harness.run(main)
