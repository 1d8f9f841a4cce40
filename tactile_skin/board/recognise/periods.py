# SPDX-License-Identifier: Apache-2.0
"""Bytes that are no text: packets of one size, their head, words and check.

A packet's constant bytes come again at one distance. What no check proves is never sure: at a wrong
baud rate bytes repeat as well.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from ..packets import CHECKS, WORDS, PacketFormat, PacketParser, check_of
from .columns import EVEN, sides
from .seen import Seen

_REPEATS = 6  # packets, at least, in a sample
_LONGEST = 8192 + 64  # bytes of a packet: 64 x 64 words, and what is round them
_SHORTEST = 6  # bytes
_CHAIN = 0.8  # share of the sample that one period explains
_MARKS = 24  # pairs of bytes that are tried as a head
_SMOOTH = 0.1  # of the words' range, by which a reading may differ from that of the packet before
_HEAD = 8  # bytes, at most, between a head's constant ones and the readings
_CHECK_FRAMES = 4  # packets that a check must fit
_STEADY = 0.7  # share of the steps of a counter that are its usual one: lost packets make others
_HIGH_BYTE = 1 << 15  # words above it have their bytes in the other order, or are none
_PAIR = 1 << 12  # words above it may be two bytes: few boards have an ADC of more bits


def recognise_packets(data: bytes, shape: tuple[int, int] | None = None) -> Seen:
    """Return what bytes that are no text are; `about` is empty where no period is in them."""
    period, start = _period(data)
    if not period:
        return Seen("", _delimited(data), data[:64])
    count = (len(data) - start) // period
    packets = np.frombuffer(data[start : start + count * period], np.uint8).reshape(count, period)
    sample = bytes(packets[0])
    best = None
    for offset in _starts(packets):
        turned = np.frombuffer(
            data[start + offset : start + offset + (count - 1) * period], np.uint8
        ).reshape(count - 1, period)
        found = _described(turned, shape)
        if found and (best is None or found.sure > best.sure):
            best = found
        if best and best.sure:
            break
    constant = " ".join(f"{b:02X}" for b in sample[: _constant(packets)])
    about = f"every {period} bytes {constant}"
    if best is None or not isinstance(best.format, PacketFormat):
        return Seen("", f"{about}, but no readings of 8 or 16 bits between", sample)
    parser = PacketParser(1, best.cells, 16, replace(best.format, full_scale=65535.0))
    frames = len(parser.feed(data))
    found = replace(best, sample=sample, frames=frames, sure=best.sure and frames >= _CHECK_FRAMES)
    return replace(found, about=f"{about}: {best.about}")


def _period(data: bytes) -> tuple[int, int]:
    """At what distance some bytes come again, and where they first do; 0, 0: at none."""
    pairs = np.frombuffer(data[:-1], np.uint8).astype(np.uint16) << 8
    pairs = pairs | np.frombuffer(data[1:], np.uint8)
    best = 0.0, 0, 0
    for pair, n in Counter(pairs.tolist()).most_common(256):
        if n < _REPEATS:
            break
        here = pairs == pair
        places = np.flatnonzero(here)
        period, often = Counter(np.diff(places).tolist()).most_common(1)[0]
        if often < _REPEATS - 1 or not _SHORTEST <= period <= _LONGEST:
            continue
        chain = max(
            (int(np.count_nonzero(here[start::period])), -start)
            for start in places[:_MARKS].tolist()
        )
        share = chain[0] * period / len(data)
        # what stands in every packet and nowhere else is its head; zeros are high bytes
        score = share * chain[0] / n * (1.0 if pair else 0.5)
        if share >= _CHAIN and score > best[0] + 1e-3:
            best = score, period, -chain[1]
    return best[1:]


def _constant(packets: np.ndarray) -> int:
    """How many bytes from the first on are the same in all packets."""
    same = (packets == packets[0]).all(0)
    return int(np.argmin(same)) if not same.all() else len(same)


def _starts(packets: np.ndarray) -> list[int]:
    """Offsets at which a head may begin: constant bytes behind others, those of a head first."""
    same = (packets == packets[0]).all(0)
    begins = np.flatnonzero(same & ~np.roll(same, 1)).tolist() or [0]
    nonzero = [b for b in begins if packets[0][b]]
    return [0, *[b for b in nonzero if b][:_MARKS]]


def _described(packets: np.ndarray, shape: tuple[int, int] | None) -> Seen | None:
    """Words, check and tail behind a head at the begin of each packet."""
    count, period = packets.shape
    fixed = min(_constant(packets), _HEAD)
    cells = shape[0] * shape[1] if shape else 0
    if count < _CHECK_FRAMES or not fixed:
        return None
    for name, (size, _, _) in sorted(CHECKS.items(), key=lambda item: -item[1][0]):
        for tail in range(3):
            end = period - tail - size
            for unchecked in range(min(fixed, 4) + 1):

                def fits(packet, name=name, size=size, end=end, unchecked=unchecked) -> bool:
                    check = check_of(name, bytes(packet[unchecked:end]))
                    return bytes(packet[end : end + size]) == check

                if all(map(fits, packets[:_CHECK_FRAMES])):
                    sound = packets[[fits(packet) for packet in packets]]
                    rest = (name, unchecked, tail, True)
                    return _words(sound[:, :end], sound, fixed, rest, cells)
    return _words(packets, packets, fixed, ("", 0, 0, False), cells)


def _words(body: np.ndarray, packets: np.ndarray, fixed: int, rest: tuple, cells: int):
    """Return the readings: words that are smooth over the packets, behind head and counters."""
    check, unchecked, tail, proved = rest
    begin = _behind_counters(packets, fixed)
    cuts = [
        cut
        for head in range(1, begin + _HEAD + 1)
        for spare in range(1 if proved else 3)  # bytes behind that are no readings
        for cut in _cuts(body, head, spare, cells, begin)
    ]
    if not cuts:
        return None
    _, head, spare, word, values = max(cuts, key=lambda cut: cut[0])
    words = values.shape[1]
    pattern = [f"{b:02X}" for b in packets[0][: min(head, fixed)]] + ["??"] * (head - fixed)
    end = packets[:, packets.shape[1] - tail - spare :]
    ends = [f"{c[0]:02X}" if (c == c[0]).all() else "??" for c in end.T]
    about = f"{words} readings of {word}" + (f", proved by {check}" if proved else "")
    fmt = PacketFormat(" ".join(pattern), word, check, unchecked, " ".join(ends))
    largest = float(values.max())
    clear = head == begin and packets[0][head - 1] != 0 and largest < _PAIR  # 0: a cell's?
    sure = proved and (clear or words == cells)
    return Seen("packets", about, b"", fmt, None, words, sure=sure, largest=largest)


def _behind_counters(packets: np.ndarray, fixed: int) -> int:
    """Where readings begin: behind the constant bytes, and those that count or tell the time."""
    steps = np.diff(packets[:, fixed : fixed + _HEAD], axis=0)  # modulo 256
    counts = ((steps == np.median(steps, 0).astype(np.uint8)) & (steps != 0)).mean(0) >= _STEADY
    return fixed + (int(np.flatnonzero(counts)[-1]) + 1 if counts.any() else 0)


def _cuts(body: np.ndarray, head: int, spare: int, cells: int, begin: int):
    """Ways to cut packets into readings: (rank, head, spare, word, values)."""
    inner = body[:, head : body.shape[1] - spare]
    for word, kind in WORDS.items():
        size = np.dtype(kind).itemsize
        if inner.shape[1] < 4 * size or inner.shape[1] % size:
            continue
        values = inner.copy().view(kind).astype(float)
        span = max(values.max(), 1.0)
        jumps = np.abs(np.diff(values, axis=0)).mean(0) / span
        if jumps.max() > _SMOOTH:
            continue
        words = values.shape[1]
        rows, cols = sides(words)
        wide = size if span < _HIGH_BYTE else 0  # no reading has noise in its high byte
        even = rows >= EVEN * cols
        rank = words == cells, wide, even, -abs(head - begin), -spare, -jumps.mean()
        yield rank, head, spare, word, values


def _delimited(data: bytes) -> str:
    """Return what byte ends packets of different sizes; empty if none does."""
    for value in (0xFF, 0x00, 0xC0, 0x7E):
        gaps = np.diff(np.flatnonzero(np.frombuffer(data, np.uint8) == value))
        if len(gaps) >= _REPEATS and gaps.min() > _SHORTEST and gaps.std() < 0.3 * gaps.mean():
            return f"{value:02X} after {gaps.min()} to {gaps.max()} bytes: packets of no fixed size"
    return ""
