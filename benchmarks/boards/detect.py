# SPDX-License-Identifier: Apache-2.0
"""What `tactile-skin detect` makes of unknown boards.

A board: a format of support.strangers.boards, a size, a baud rate, an ADC, damage in one of five.
It is read through a UART that samples its bits at each baud rate that detect tries. One board in
six has a format that no description reads: it must not be named. Printed: of how many boards format
and baud are right and what is read is what was sent, and how many wrong ones were called sure.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from support.strangers import boards

from tactile_skin.board.formats import make_parser
from tactile_skin.board.recognise.listen import BAUDS, Heard

from .. import harness

SIZES = ((4, 4), (6, 6), (8, 8), (8, 12), (9, 9), (16, 16))
USED = (9_600, 57_600, 115_200, 230_400, 250_000, 500_000, 1_000_000)
UNREADABLE = (boards.run_lengths, boards.packed)
DAMAGED = 0.2  # share of the boards that lose or change a byte in a thousand
SECONDS = 4.0
# Correlation of what is read with what was sent: volts of two decimals are rounded to 2 ADC steps,
# and cells that are shifted by one correlate by 0.9 at most.
_ALIKE = 0.99


class Board:
    """One unknown board, and its bytes at any baud rate."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self.known = bool(rng.random() > 1 / 6)
        makers = [*boards.TEXT.values(), *boards.PACKETS.values()] if self.known else UNREADABLE
        self.make = makers[rng.integers(len(makers))]
        self.shape = SIZES[rng.integers(len(SIZES))]
        self.baud = int(USED[rng.integers(len(USED))])
        rest = rng.uniform(20, 200) * np.exp(0.1 * rng.standard_normal(self.shape))
        length = len(boards.sent(self.make, [rest.astype(int)]))
        n = int(np.clip(self.baud / 10 * SECONDS / length, 3, 60))
        touch = np.zeros((n, *self.shape))
        row, col = (rng.integers(k) for k in self.shape)
        touch[n // 3 : 2 * n // 3, row, col] = rng.uniform(200, 700)
        noise = rng.normal(0.0, 1.0, touch.shape)
        self.pictures = np.clip(np.rint(rest + touch + noise), 1, 1022).astype(int)
        self.data = boards.sent(self.make, self.pictures)
        if rng.random() < DAMAGED:
            data = np.frombuffer(self.data, np.uint8).copy()
            data[rng.random(data.size) < 1e-3] = rng.integers(256)
            self.data = data.tobytes()

    def at(self, baud: int) -> bytes:
        return self.data if baud == self.baud else boards.received(self.data, self.baud, baud)


def detect(board: Board) -> Heard:
    """What detect takes: the first that is sure, else the best understood."""
    best = None
    for baud in BAUDS:
        heard = Heard(board.at(baud), baud)
        if best is None or heard.rank > best.rank:
            best = heard
        if heard.seen.sure:
            break
    return best


def right(board: Board, heard: Heard) -> bool:
    """Whether the format and the baud are right: what is read is what was sent."""
    seen = heard.seen
    if not board.known:
        return not seen.protocol
    if (
        not seen.protocol
        or heard.baud != board.baud
        or seen.cells != board.shape[0] * board.shape[1]
    ):
        return False
    scale = seen.largest if seen.decimals or seen.largest > 1023 else 1023.0
    fmt = dataclasses.replace(seen.format, full_scale=scale)
    parser = make_parser(seen.protocol, *board.shape, 10, fmt)
    frames = [frame.samples.astype(float) for frame in parser.feed(board.data)]
    if len(frames) < min(2, len(board.pictures) - 2):
        return False
    truth = board.pictures.reshape(len(board.pictures), -1)
    read = np.array(frames).reshape(len(frames), -1)
    alike = [max(np.corrcoef(one, t)[0, 1] for t in truth) for one in read]
    return float(np.median(alike)) > _ALIKE


def main(arguments=None) -> dict:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--boards", type=int, default=40)
    parser.add_argument("--seed", type=int, default=5000)
    args = parser.parse_args(arguments)
    good = wrongly_sure = 0
    for seed in range(args.seed, args.seed + args.boards):
        board = Board(seed)
        heard = detect(board)
        found = right(board, heard)
        good += found
        wrongly_sure += heard.seen.sure and not found
        if not found:
            print(
                f"{seed}: {board.make.__name__} {board.shape} at {board.baud}: {heard.seen.about} "
                f"at {heard.baud}{', sure' if heard.seen.sure else ''}"
            )
    print(f"{good} of {args.boards} right, {wrongly_sure} wrong ones called sure")
    return {"boards": args.boards, "right": good, "wrongly sure": wrongly_sure}


if __name__ == "__main__":
    harness.run(main)
