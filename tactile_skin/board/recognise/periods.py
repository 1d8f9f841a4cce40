# SPDX-License-Identifier: Apache-2.0
"""Bytes that are no text: packets of one size, their head, words and check.

A packet's constant bytes come again at one distance. Only what stays the same while readings move
is format. What no check proves is never sure: at a wrong baud rate bytes repeat as well.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from ..packets import (
    CHECKS,
    ESCAPES,
    WORDS,
    PacketFormat,
    PacketParser,
    bytes_of,
    check_of,
    readings_of,
)
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
# Word -> bytes after which readings begin with a byte again, and which of these moves most. Of four
# readings of 10 bits it is that whose highest bits are the lowest of one.
_MOVES = {
    **{"u8": (1, 0), "u16le": (2, 0), "u16be": (2, 1), "u24le": (3, 0), "u24be": (3, 2)},
    **{"u12be": (3, 1), "u12le": (3, 1), "u10be": (5, 1), "u10le": (5, 3)},
}


def recognise_packets(data: bytes, shape: tuple[int, int] | None = None) -> Seen:
    """Return what bytes that are no text are; `about` is empty where no period is in them."""
    escape, packets = _unescaped(data)
    period, start = (packets.shape[1], 0) if escape else _period(data)
    if not period:
        return Seen("", _delimited(data), data[:64])
    if not escape:  # a packet may begin at any of its bytes
        count = (len(data) - start) // period
        packets = np.frombuffer(data[start : start + count * period], np.uint8)
        packets = packets.reshape(-1, period)
    sample = data[start : start + period]
    still = (packets == packets[0]).all(0)
    about = f"every {period} bytes {' '.join(_pattern(packets[0, : _leading(still)]))}"
    about = f"{escape} packets of {period - 1} bytes" if escape else about
    cells = shape[0] * shape[1] if shape else 0
    best = _proved(packets.ravel(), still, cells, escape)
    best = best or _unproved(packets.ravel(), still, cells, escape)
    if best is None or not isinstance(best.format, PacketFormat):
        return Seen("", f"{about}, but no readings of {', '.join(WORDS)} between", sample)
    parser = PacketParser(1, best.cells, 16, replace(best.format, full_scale=2.0**24))
    frames = len(parser.feed(data))
    found = replace(best, sample=sample, frames=frames, sure=best.sure and frames >= FEW)
    return replace(found, about=f"{about}: {best.about}")


def _unescaped(data: bytes) -> tuple[str, np.ndarray]:
    """Return how bytes are escaped, and the packets behind their marks; empty: they are not.

    A packet in which none had to be looks like one whose mark may stand among its readings as well:
    the parser takes both.
    """
    for name, (mark, plain) in ESCAPES.items():
        parts = [mark + plain(part) for part in data.split(mark)[1:-1] if part]
        size, often = Counter(map(len, parts)).most_common(1)[0] if parts else (0, 0)
        if size > _SHORTEST and often >= max(_REPEATS, _MOST * len(parts)):
            flat = b"".join(part for part in parts if len(part) == size)
            return name, np.frombuffer(flat, np.uint8).reshape(-1, size)
    return "", np.zeros((0, 0), np.uint8)


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


def _proved(flat: np.ndarray, still: np.ndarray, cells: int, escape: str) -> Seen | None:
    """Return packets with a check in front of a run of constant bytes; None: no check fits."""
    period = len(still)
    runs, best = [0] if escape else _runs(flat[:period], still), None
    for name, (size, _, _) in sorted(CHECKS.items(), key=lambda item: -item[1][0]):
        # the high byte of a sum may be the same in all packets, as what ends a packet is
        shifts = range(size if name[:3] == "sum" and not escape else 1)
        for at, high in ((begin + high, high) for begin in runs for high in shifts):
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
                how = {"check": name, "unchecked": unchecked, "escape": escape}
                found = _checked(sound, fixed, end, cells, how)
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


def _ways(moves: np.ndarray) -> tuple[bool, list[tuple[str, int]]]:
    """Return which words the bytes may be, and where the first one begins; whether that shows."""
    for size in (5, 3, 4, 2):
        words = moves[: len(moves) // size * size].reshape(-1, size)
        if len(words) < FEW:
            continue
        usual, ends = words.mean(0), np.sort(words, 1)
        words = words[ends[:, -1] > ends[:, -2]]
        at, often = Counter(words.argmax(1).tolist()).most_common(1)[0] if len(words) else (0, 0)
        clear = often >= max(_MOST * len(words), FEW)
        if clear and np.sort(usual)[-1] > _LIVELY * np.sort(usual)[-2]:
            # the highest bits of a pair of 12 bits move less than its lowest ones
            other = "u12le" if usual[at - 1] < usual[(at + 1) % size] else "u12be"
            fit = {w: place for w, (n, place) in _MOVES.items() if n == size and w != other}
            return True, [(word, (at - place) % size) for word, place in fit.items()]
    known = int(np.count_nonzero(moves)) >= FEW
    return known, [("u8", 0)] if known else []


def _counters(packets: np.ndarray, fixed: int) -> int:
    """How many bytes behind the constant ones count, or tell the time."""
    steps = np.diff(packets[:, fixed : fixed + _UNKNOWN], axis=0)  # modulo 256
    counts = ((steps == np.median(steps, 0).astype(np.uint8)) & (steps != 0)).mean(0) >= _STEADY
    return int(np.flatnonzero(counts)[-1]) + 1 if counts.any() else 0


def _checked(packets, fixed: int, end: int, cells: int, how: dict) -> Seen | None:
    """Return the readings between a head at the begin and a check at `end`."""
    begin, moves = fixed + _counters(packets, fixed), _moves(packets)
    known, ways = _ways(moves[begin:end])
    fits = []
    for k, (word, (size, _)) in enumerate(_MOVES.items()):
        least = max(begin - (begin - end) % size, 1 + (end - 1) % size)
        first = end - bytes_of(word, cells) if cells else least
        if 1 <= first <= begin + _UNKNOWN:
            shows = any(w == word and (first - begin - at) % size == 0 for w, at in ways)
            readings = readings_of(packets[:, first:end], word) / 2.0 ** WORDS[word]
            rough = 0.0 if shows else float(np.abs(np.diff(readings, axis=0)).mean())
            fits.append((not shows, rough, k, word, first))
    if not fits or (known and not cells and all(each[0] for each in fits)):
        return None
    hidden, *_, word, first = min(fits)
    if cells:
        sure = first <= begin and (not hidden or len(fits) == 1)
    else:
        size = _MOVES[word][0]
        words = moves[first:end].reshape(-1, size).max(1)
        if not words.all():  # a cell that does not move looks like a byte of the head
            first = max(range(first, 0, -size), key=lambda f: _square(8 * (end - f) // WORDS[word]))
        many = end - first >= 5 * FEW  # as the widest pattern needs to show
        cells = 8 * (end - first) // WORDS[word]
        sure = not hidden and many and bool(words.all()) and not likely_less(cells)
    head = _pattern(packets[0][: min(first, fixed)]) + ["??"] * (first - fixed)
    return _seen(packets[:, first:end], PacketFormat(" ".join(head), word, **how), sure)


def _square(cells: int) -> float:
    rows, cols = sides(cells)
    return rows / cols


def _pattern(values: np.ndarray) -> list[str]:
    return [f"{b:02X}" for b in values]


def _seen(inner: np.ndarray, fmt: PacketFormat, sure: bool) -> Seen:
    values = readings_of(inner, fmt.word)
    proof = f", proved by {fmt.check}" if fmt.check else ""
    about = f"{values.shape[1]} readings of {fmt.word}{proof}"
    largest = float(values.max())
    return Seen("packets", about, b"", fmt, None, values.shape[1], sure=sure, largest=largest)


def _unproved(flat: np.ndarray, still: np.ndarray, cells: int, escape: str) -> Seen | None:
    """Return the readings behind a run of constant bytes; a check that is not known is left out."""
    period, back = len(still), 0 if escape else int(np.argmin(still[::-1]))
    if still.all():
        return None
    packets = _turned(flat, period, -back)
    fixed = int(np.argmin(np.roll(still, back)))
    counters, moves, end = _counters(packets, fixed), _moves(packets), period
    begin = fixed + counters
    wild = max(_WILD, _LIVELY * float(np.quantile(moves[begin:], 0.85)))
    while end > begin and moves[end - 1] > wild:
        end -= 1
    known, ways = _ways(moves[begin:end])
    if ways == [("u8", 0)] and (moves[begin:end] > _WILD).mean() > 1.0 - _MOST:
        return None
    best = None
    for word, at in ways if known else [(word, 0) for word in ("u8", "u16le", "u16be")]:
        wide = _MOVES[word][0]
        more = bytes_of(word, cells) - (end - begin) if cells else (begin - end) % wide
        for left in range(max(more, 0) if escape else 0, max(more, 0) + 1):
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
            between = (left and counters) or (right and end < period)
            if between or (known and (first + right - begin - at) % wide):
                continue
            high = inner[:, wide - 1 if word.endswith("le") else 0 :: wide]
            strange = np.abs(rest - np.median(high))
            if best is None or strange.sum() > best[0]:
                unlike = (rest < high.min()) | (rest > high.max()) | (strange == strange.max())
                best = strange.sum(), word, inner, rest, unlike | (more <= 0), first
    if best is None:
        return None
    _, word, inner, rest, sure, first = best
    sure[0] |= bool(escape)  # its mark
    head = [b if s else "??" for b, s in zip(_pattern(rest), sure, strict=True)]
    tail = ["??"] * (period - first - inner.shape[1])
    while head[0] == "??" or (head[0] in ("0D", "0A") and len(set(head) - {"??"}) > 1):
        tail.append(head.pop(0))
    head += ["??"] * (first - len(rest))
    fmt = PacketFormat(" ".join(head), word, tail=" ".join(tail), escape=escape)
    return _seen(inner, fmt, False)


def _delimited(data: bytes) -> str:
    """Return what byte ends packets of different sizes; empty if none does."""
    for value in (0xFF, 0x00, 0xC0, 0x7E):
        gaps = np.diff(np.flatnonzero(np.frombuffer(data, np.uint8) == value))
        if len(gaps) >= _REPEATS and gaps.min() > _SHORTEST and gaps.std() < 0.3 * gaps.mean():
            return f"{value:02X} after {gaps.min()} to {gaps.max()} bytes: packets of no fixed size"
    return ""
