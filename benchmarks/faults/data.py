# SPDX-License-Identifier: Apache-2.0
"""Dead data: what arrives is not what the skin feels now, though it looks like frames.

Each fault is a function that damages a `FaultBoard`; it stays once it is there, unless its name
says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from support.lab.board import BOTH, TEXT, Fault, FaultBoard, Sent

_SPACING = 2e-4  # s between frames that a link held back and now delivers fast

# --- what a frame says ---------------------------------------------------------------------------


def _frozen(board: FaultBoard, lasts: float = np.inf) -> None:
    kept: list[Sent] = list(board.history)[-1:]
    end = board.t + lasts

    def tamper(sent: Sent) -> Sent:
        if not kept:
            kept.append(sent)
        return replace(sent, samples=kept[0].samples) if sent.t < end else sent

    board.tamper = tamper


def _ring(length: int, clock: bool = False):
    """The last frames over and over; with `clock` with their own numbers and device times."""

    def damage(board: FaultBoard) -> None:
        ring = list(board.history)[-length:]
        place = 0

        def tamper(sent: Sent) -> Sent:
            nonlocal place
            if len(ring) < length:
                ring.append(sent)
                board.damaged_at = sent.t  # until here the frames are live
                return sent
            old = ring[place % length]
            place += 1
            if clock:
                return replace(sent, **{k: getattr(old, k) for k in _NUMBERS}, samples=old.samples)
            return replace(sent, samples=old.samples)

        board.tamper = tamper

    return damage


_NUMBERS = ("sequence", "device_us")


def _numbers(change: Callable[[FaultBoard, Sent, Sent], dict]):
    """The samples are live; change(board, sent, first frame of the fault) gives other numbers."""

    def damage(board: FaultBoard) -> None:
        first: list[Sent] = []

        def tamper(sent: Sent) -> Sent:
            first.append(sent) if not first else None
            return replace(sent, **change(board, sent, first[0]))

        board.tamper = tamper

    return damage


def _back(sent: Sent, first: Sent) -> int:
    return 2 * first.sequence - sent.sequence


def _back_us(sent: Sent, first: Sent) -> int:
    return 2 * first.device_us - sent.device_us


def _restarts(period: float):
    """The board starts anew every `period` [s]: number and device time from 0."""

    def damage(board: FaultBoard) -> None:
        start, number = -np.inf, 0

        def tamper(sent: Sent) -> Sent:
            nonlocal start, number
            if sent.t - start >= period:
                start, number = sent.t, 0
            number += 1
            return replace(
                sent, sequence=number - 1, device_us=round((sent.t - start) * 1e6) + 10_000
            )

        board.tamper = tamper

    return damage


def _every(n: int):
    def damage(board: FaultBoard) -> None:
        board.tamper = lambda sent: sent if sent.sequence % n == 0 else None

    return damage


# --- samples and link ----------------------------------------------------------------------------


def _all_samples(share: float):
    def damage(board: FaultBoard) -> None:
        board.converter.stuck_samples = round(share * board.circuit.full_scale)

    return damage


def _no_signal(board: FaultBoard) -> None:
    """The multiplexer's enable is lost: the ADC sees one constant voltage, and its noise."""
    board.converter.signal, board.converter.stuck_ratio = False, board.rng.uniform(0.03, 0.1)


def _kept_lines(axis: int, share: float):
    def damage(board: FaultBoard) -> None:
        lines = board.circuit.shape[axis]
        n = max(1, round(share * lines)) if share else 1
        board.kept.swapaxes(0, axis)[board.rng.permutation(lines)[:n]] = True

    return damage


def _corrupt(share: float):
    def damage(board: FaultBoard) -> None:
        def link(t, data):
            if board.rng.random() < share:
                at = int(board.rng.integers(len(data)))
                wrong = b"?" if board.protocol == TEXT else bytes([data[at] ^ 0x10])
                data = data[:at] + wrong + data[at + 1 :]
            return [(t, data)]

        board.link = link

    return damage


def _lost(share: float):
    def damage(board: FaultBoard) -> None:
        board.link = lambda t, data: [] if board.rng.random() < share else [(t, data)]

    return damage


def _stalls(spacing: Callable[[FaultBoard], float]):
    """Before each push the link stalls for 0.3 to 3 s, then delivers what piled up.

    Args:
        spacing: time between the frames delivered then [s].
    """

    def damage(board: FaultBoard) -> None:
        stalls = []
        for start, end in board.pushes:
            begin = start - board.rng.uniform(0.05, 0.5)
            longest = max(0.35, min(3.0, end - begin - 0.5))  # the push goes on after it
            if begin > board.t:
                stalls.append((begin, begin + board.rng.uniform(0.3, longest)))
        last, gap = -np.inf, spacing(board)

        def link(t, data):
            nonlocal last
            due = next((end for begin, end in stalls if begin <= t < end), t)
            last = max(due, last + gap)
            return [(last, data)]

        board.link = link

    return damage


DATA = (
    Fault("frozen scan", "the samples stand still, number and time rise", _frozen, True,
          protocols=BOTH),
    Fault("frozen for 2 s", "the same, then live again", lambda b: _frozen(b, 2.0), True, True,
          protocols=BOTH),
    Fault("ADC stuck at 5 %", "every sample reads 5 % of full scale", _all_samples(0.05), True,
          protocols=BOTH),
    Fault("ADC stuck at 40 %", "every sample reads 40 % of full scale", _all_samples(0.4), True,
          protocols=BOTH),
    Fault("ADC stuck at 0", "every sample reads 0", _all_samples(0.0), True, protocols=BOTH),
    Fault("ADC stuck at full scale", "every sample reads full scale", _all_samples(1.0), True,
          protocols=BOTH),
    Fault("no signal", "the ADC sees one constant voltage and its noise", _no_signal, True,
          protocols=BOTH),
    Fault("ring of 5", "the last 5 frames over and over, under rising numbers", _ring(5), True,
          protocols=BOTH),
    Fault("ring of 20", "the last 20 frames over and over, under rising numbers", _ring(20), True,
          protocols=BOTH),
    Fault("ring of 100", "the last 100 frames over and over, under rising numbers", _ring(100),
          True, protocols=BOTH),
    Fault("ring of 5, whole", "number and device time are repeated as well", _ring(5, True), True),
    Fault("ring of 20, whole", "number and device time are repeated as well", _ring(20, True),
          True),
    Fault("ring of 100, whole", "number and device time are repeated as well", _ring(100, True),
          True),
    Fault("number backward", "the sequence number falls, the samples are live",
          _numbers(lambda b, s, f: {"sequence": _back(s, f)}), True),
    Fault("time backward", "the device time falls, the samples are live",
          _numbers(lambda b, s, f: {"device_us": _back_us(s, f)}), True),
    Fault("both backward", "number and device time fall",
          _numbers(lambda b, s, f: {"sequence": _back(s, f), "device_us": _back_us(s, f)}), True),
    Fault("time stands still", "the device time no longer changes",
          _numbers(lambda b, s, f: {"device_us": f.device_us}), True),
    Fault("time at half pace", "the device time gains half a second in a second",
          _numbers(lambda b, s, f: {"device_us": (f.device_us + s.device_us) // 2}), True),
    Fault("restart in each frame", "a random number and a device time near 0 in each frame",
          _numbers(lambda b, s, f: {"sequence": int(b.rng.integers(65536)), "device_us": 10_000}),
          True),
    Fault("restart every 0.5 s", "number and device time begin anew every 0.5 s", _restarts(0.5)),
    Fault("backlog, in one read", "the link stalls for 0.3 to 3 s while a hand begins to "
          "press, then gives all that piled up at once",
          _stalls(lambda b: 0.0), True, True, BOTH, True),
    Fault("backlog, fast", "what piled up comes in 0.2 ms a frame",
          _stalls(lambda b: _SPACING), True, True, BOTH, True),
    Fault("backlog, at double pace", "what piled up comes at twice the pace of the frames",
          _stalls(lambda b: 0.5 / b.rate), True, True, BOTH, True),
    Fault("50 % corrupt", "half of the frames are damaged on the way", _corrupt(0.5),
          protocols=BOTH),
    Fault("90 % corrupt", "nine of ten frames are damaged on the way", _corrupt(0.9),
          protocols=BOTH),
    Fault("30 % lost", "three of ten frames are lost on the way", _lost(0.3), protocols=BOTH),
    Fault("60 % lost", "six of ten frames are lost on the way", _lost(0.6), protocols=BOTH),
    Fault("90 % lost", "nine of ten frames are lost on the way", _lost(0.9), protocols=BOTH),
    Fault("every 8th frame", "the board sends only every 8th frame", _every(8)),
    Fault("half of the rows frozen", "half of the rows are not read any more", _kept_lines(0, 0.5),
          True),
    Fault("one row frozen", "one row is not read any more", _kept_lines(0, 0.0)),
    Fault("one column frozen", "one column is not read any more", _kept_lines(1, 0.0)),
)  # fmt: skip
