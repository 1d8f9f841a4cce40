# SPDX-License-Identifier: Apache-2.0
"""Bytes that are no text: packets of one size, their head, words and check.

A packet's constant bytes come again at one distance. Only what stays the same while readings move
is format. What no check proves is never sure: at a wrong baud rate bytes repeat as well.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from ..packets import CHECKS, WORDS, PacketFormat, PacketParser, check_of
from .columns import FEW, likely_less, sides
from .seen import Seen

_REPEATS = 6  # packets, at least, in a sample
_LONGEST = 8192 + 64  # bytes of a packet: 64 x 64 words, and what is round them
_SHORTEST = 6  # bytes
_CHAIN = 0.8  # share of the sample that one period explains
_MARKS = 24  # runs of constant bytes that are tried as a head
_HEAD = 16  # constant bytes, at most, of a packet that are no readings, and
_UNKNOWN = 8  # others
_STEADY = 0.7  # share of the steps of a counter that are its usual one: lost packets make others
_LIVELY = 1.5  # times as much as any other byte of a word moves its lowest one
_MOST = 0.9  # of packets or words, as damage and touches make others
_WILD = 24.0  # steps from packet to packet, on average, of a byte that is no reading's highest


def recognise_packets(data: bytes, shape: tuple[int, int] | None = None) -> Seen:
    """Return what bytes that are no text are; `about` is empty where no period is in them."""
    period, start = _period(data)
    if not period:
        return Seen("", _delimited(data), data[:64])
    count = (len(data) - start) // period - 1
    # one more: a packet may begin at any of its bytes
    packets = np.frombuffer(data[start : start + (count + 1) * period], np.uint8)
    sample = bytes(packets[:period])
    still = (packets.reshape(-1, period) == packets[:period]).all(0)
    about = f"every {period} bytes {' '.join(_pattern(packets[: _leading(still)]))}"
    cells = shape[0] * shape[1] if shape else 0
    best = _proved(packets, still, cells) or _unproved(packets, still, cells)
    if best is None or not isinstance(best.format, PacketFormat):
        return Seen("", f"{about}, but no readings of 8 or 16 bits between", sample)
    parser = PacketParser(1, best.cells, 16, replace(best.format, full_scale=65535.0))
    frames = len(parser.feed(data))
    found = replace(best, sample=sample, frames=frames, sure=best.sure and frames >= FEW)
    return replace(found, about=f"{about}: {best.about}")


def _period(data: bytes) -> tuple[int, int]:
    """At what distance some bytes come again, and where they first do; 0, 0: at none."""
    singles = np.frombuffer(data, np.uint8).astype(np.uint16)
    best = 0.0, 0, 0
    for codes in (singles[:-1] << 8 | singles[1:], singles):
        for code, n in Counter(codes.tolist()).most_common(256):
            if n < _REPEATS:
                break
            here = codes == code
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
            score = share * chain[0] / n * (1.0 if code else 0.5)
            if share >= _CHAIN and score > best[0] + 1e-3:
                best = score, period, -chain[1]
        if best[1]:
            break
    return best[1:]


def _turned(flat: np.ndarray, period: int, at: int) -> np.ndarray:
    """Return packets, a row each, that begin at a byte of the period."""
    at %= period
    return flat[at : at + (len(flat) // period - 1) * period].reshape(-1, period)


def _runs(values: np.ndarray, still: np.ndarray) -> list[int]:
    """Return where runs of constant bytes begin: first those of bytes that stand nowhere else."""
    often = Counter(values[still].tolist())
    begins = np.flatnonzero(still & ~np.roll(still, 1)).tolist() or [0]

    def rarest(at: int) -> int:
        run = int(np.argmin(np.append(np.roll(still, -at), False)))
        return min((often[b] for b in np.roll(values, -at)[:run].tolist()), default=0)

    return sorted(begins, key=rarest)[:_MARKS]


def _proved(flat: np.ndarray, still: np.ndarray, cells: int) -> Seen | None:
    """Return packets with a check in front of a run of constant bytes; None: no check fits."""
    period = len(still)
    runs, best = _runs(flat[:period], still), None
    for name, (size, _, _) in sorted(CHECKS.items(), key=lambda item: -item[1][0]):
        # the high byte of a sum may be the same in all packets, as what ends a packet is
        for at, high in ((begin + high, high) for begin in runs for high in range(size)):
            packets = _turned(flat, period, at)
            some = list({bytes(p): None for p in packets[: 4 * FEW]})
            fixed = _leading(np.roll(still, -at))
            for unchecked in range(fixed + 1):
                end = period - size

                def fits(packet: bytes, name=name, end=end, unchecked=unchecked) -> bool:
                    return packet[end:] == check_of(name, packet[unchecked:end])

                fit = list(map(fits, some[:2]))
                fit += map(fits, some[2:] if any(fit) else ())
                if sum(fit) < max(FEW, _MOST * len(some)):
                    continue
                if high and some[0][-1:] + some[0][:1] == b"\r\n":
                    continue
                sound = packets[[fits(bytes(p)) for p in packets]]
                found = _checked(sound, fixed, end, cells, name, unchecked)
                if best:  # a sum of 16 bits, or one of 8 with a reading of 0 or an end next to it?
                    return replace(found if found and best.sure < found.sure else best, sure=False)
                if 0 not in sound[:, end:].max(0) or not found:
                    return found
                best = found
    return best and replace(best, sure=False)


def _leading(still: np.ndarray) -> int:
    """How many bytes from the first on are the same in all packets, as far as a head may be."""
    return int(np.argmin(np.append(still[:_HEAD], False)))


def _moves(packets: np.ndarray) -> np.ndarray:
    """How far each byte moves from packet to packet, on average, modulo 256."""
    steps = np.diff(packets, axis=0)
    return np.minimum(steps, 0 - steps).mean(0)


def _lowest(moves: np.ndarray) -> tuple[int, int]:
    """Return of how many bytes a word is, and which is its lowest; 0 bytes: too few move."""
    for size in (5, 3, 4, 2):  # 5 bytes: 4 words of 10 bits; 3: of 24 bits, or 2 of 12
        words = moves[: len(moves) // size * size].reshape(-1, size)
        if len(words) < FEW:
            continue
        ends, means = np.sort(words, 1), np.sort(words.mean(0))
        words = words[ends[:, -1] > ends[:, -2]]
        at, often = Counter(words.argmax(1).tolist()).most_common(1)[0] if len(words) else (0, 0)
        clear = often >= max(_MOST * len(words), FEW)
        if clear and means[-1] > _LIVELY * means[-2]:
            return size, at
    return int(np.count_nonzero(moves) >= FEW), 0


def _counters(packets: np.ndarray, fixed: int) -> int:
    """How many bytes behind the constant ones count, or tell the time."""
    steps = np.diff(packets[:, fixed : fixed + _UNKNOWN], axis=0)  # modulo 256
    counts = ((steps == np.median(steps, 0).astype(np.uint8)) & (steps != 0)).mean(0) >= _STEADY
    return int(np.flatnonzero(counts)[-1]) + 1 if counts.any() else 0


def _checked(packets, fixed: int, end: int, cells: int, check: str, unchecked: int) -> Seen | None:
    """Return the readings between a head at the begin and a check at `end`."""
    begin, moves = fixed + _counters(packets, fixed), _moves(packets)
    size, at = _lowest(moves[begin:end])
    if size > 2:
        return None
    sizes = [s for s in (1, 2) if 1 <= end - cells * s <= begin + _UNKNOWN] if cells else [1, 2]
    if not sizes:
        return None
    known = size in sizes or (sizes == [1])
    size = size if size in sizes else sizes[0]
    order = "le" if (begin + at - end) % 2 == 0 else "be"
    if cells:
        first = end - cells * size
        sure = known and first <= begin
    else:
        first = max(begin - (end - begin) % size, 1 + (end - 1) % size)
        words = moves[first:end].reshape(-1, size).max(1)
        if not words.all():  # a cell that does not move looks like a byte of the head
            first = max(range(first, 0, -size), key=lambda f: _square((end - f) // size))
        many = end - first >= 5 * FEW  # as the widest pattern needs to show
        sure = known and many and bool(words.all()) and not likely_less(len(words))
    word = "u8" if size == 1 else f"u16{order}"
    head = _pattern(packets[0][: min(first, fixed)]) + ["??"] * (first - fixed)
    fmt = PacketFormat(" ".join(head), word, check, unchecked)
    return _seen(packets[:, first:end], fmt, sure)


def _square(cells: int) -> float:
    rows, cols = sides(cells)
    return rows / cols


def _pattern(values: np.ndarray) -> list[str]:
    return [f"{b:02X}" for b in values]


def _seen(inner: np.ndarray, fmt: PacketFormat, sure: bool) -> Seen:
    values = np.ascontiguousarray(inner).view(WORDS[fmt.word])
    proof = f", proved by {fmt.check}" if fmt.check else ""
    about = f"{values.shape[1]} readings of {fmt.word}{proof}"
    largest = float(values.max())
    return Seen("packets", about, b"", fmt, None, values.shape[1], sure=sure, largest=largest)


def _unproved(flat: np.ndarray, still: np.ndarray, cells: int) -> Seen | None:
    """Return the readings behind a run of constant bytes; a check that is not known is left out."""
    period, back = len(still), int(np.argmin(still[::-1]))
    if still.all():
        return None
    packets = _turned(flat, period, -back)
    fixed = int(np.argmin(np.roll(still, back)))
    counters, moves, end = _counters(packets, fixed), _moves(packets), period
    begin = fixed + counters
    wild = max(_WILD, _LIVELY * float(np.median(moves[begin:])))
    while end > begin and moves[end - 1] > wild:
        end -= 1
    size, low = _lowest(moves[begin:end])
    if size != 2 and (moves[begin:end] > _WILD).mean() > 1.0 - _MOST:
        return None
    best = None
    for word in {1: ("u8",), 2: ("u16le", "u16be")}.get(size, WORDS if not size else ()):
        wide = np.dtype(WORDS[word]).itemsize
        more = cells * wide - (end - begin) if cells else (end - begin) % wide
        for left in range(max(more, 0) + 1):
            # the last `left` and the first `right` bytes of the run are readings
            right = max(more, 0) - left
            turned = np.roll(packets, -right, 1)
            first = begin - left - right - min(more, 0)
            rest = turned[0][: fixed - left - right]
            inner = turned[:, first:end]
            if (
                not 0 < len(rest) <= first <= _HEAD + _UNKNOWN
                or inner.shape[1] < wide * FEW
                or -more > _UNKNOWN
            ):
                continue
            if (left and counters) or (right and end < period):
                continue
            if size == 2 and (first + right - begin - low + (word == "u16be")) % 2:
                continue
            high = inner[:, wide - 1 if word == "u16le" else 0 :: wide]
            strange = np.abs(rest - np.median(high))
            if best is None or strange.sum() > best[0]:
                unlike = (rest < high.min()) | (rest > high.max()) | (strange == strange.max())
                best = strange.sum(), word, inner, rest, unlike | (more <= 0), first
    if best is None:
        return None
    _, word, inner, rest, sure, first = best
    head = [b if s else "??" for b, s in zip(_pattern(rest), sure, strict=True)]
    tail = ["??"] * (period - first - inner.shape[1])
    while head[0] == "??" or (head[0] in ("0D", "0A") and len(set(head) - {"??"}) > 1):
        tail.append(head.pop(0))
    head += ["??"] * (first - len(rest))
    return _seen(inner, PacketFormat(" ".join(head), word, tail=" ".join(tail)), False)


def _delimited(data: bytes) -> str:
    """Return what byte ends packets of different sizes; empty if none does."""
    for value in (0xFF, 0x00, 0xC0, 0x7E):
        gaps = np.diff(np.flatnonzero(np.frombuffer(data, np.uint8) == value))
        if len(gaps) >= _REPEATS and gaps.min() > _SHORTEST and gaps.std() < 0.3 * gaps.mean():
            return f"{value:02X} after {gaps.min()} to {gaps.max()} bytes: packets of no fixed size"
    return ""
