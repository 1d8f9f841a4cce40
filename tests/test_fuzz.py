# SPDX-License-Identifier: Apache-2.0
"""Damaged bytes between sound frames: the sound ones come out, and nothing else does.

The quick runs are small; `pytest -m slow tests/test_fuzz.py -s` mixes 10 million damaged bytes with
100,000 sound frames for each size and parser, and prints what came out.
"""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from tactile_skin.board.frame import Counters, Frame
from tactile_skin.board.protocol import MAGIC, BinaryParser, crc16, encode
from tactile_skin.board.text import TextParser

SHAPES = [(4, 4), (16, 16)]
QUICK = 1_500, 150_000  # sound frames, damaged bytes
FULL = 100_000, 10_000_000
AMOUNTS = [QUICK, pytest.param(FULL, marks=pytest.mark.slow)]
CHANCE = 1 / 65_536  # that a CRC of 16 bits fits bytes which it was not made for
FOREIGN = 1 << 31  # us, in the device times of the frames that are damaged


class Stream:
    """Sound frames, and pieces of damaged bytes, in an order that the dice choose.

    Attributes:
        pieces: as sent; a piece is one sound frame, or a number of damaged bytes.
        sound: which of them are sound frames.
        originals: the frames that were damaged, as they were before.
    """

    def __init__(
        self, shape, sound: int, damaged_bytes: int, dice: np.random.Generator, make, harm
    ):
        self.shape = shape
        frames = [make(shape, k, dice) for k in range(sound)]
        harms, self.originals, size = [], [], 0
        while size < damaged_bytes:
            bytes_, *originals = harm(shape, len(harms), dice)
            harms.append(bytes_)
            self.originals += originals
            size += len(bytes_)
        pieces, sound_ones = frames + harms, np.arange(len(frames) + len(harms)) < sound
        order = np.argsort(dice.random(len(pieces)), kind="stable")
        order[np.sort(np.flatnonzero(sound_ones[order]))] = np.arange(sound)  # keep their own order
        self.pieces = [pieces[k] for k in order]
        self.sound = sound_ones[order]
        self.damaged_bytes = size

    def feed(self, parser, dice) -> list[Frame]:
        """In chunks of 1 to 4096 bytes, many of them short."""
        data, frames, at = b"".join(self.pieces), [], 0
        sizes = np.exp(dice.uniform(0.0, math.log(4096), len(data) // 100 + 10)).astype(int)
        for size in itertools.cycle(sizes.tolist()):
            if at >= len(data):
                return frames
            frames += parser.feed(data[at : at + size])
            at += size


# --- binary -----------------------------------------------------------------------------------


def binary(shape, k: int, dice, time: int = 0) -> bytes:
    """Frame k; its device time says which it is."""
    return encode(k, time + k, dice.integers(0, 1 << 16, shape), 10, 6)


def _flip(frame, other, dice):
    bits = np.unpackbits(np.frombuffer(frame, np.uint8))
    bits[dice.choice(bits.size, dice.integers(1, 21), replace=False)] ^= 1
    return np.packbits(bits).tobytes()


def _burst(frame, other, dice):
    at, n = dice.integers(len(frame)), dice.integers(1, 65)
    struck = bytearray(frame)
    for place in range(at, min(at + n, len(frame))):
        struck[place] ^= int(dice.integers(1, 256))
    return bytes(struck)


def _lose(frame, other, dice):
    at = dice.integers(len(frame))
    return frame[:at] + frame[at + dice.integers(1, 65) :]


def _double(frame, other, dice):
    at = dice.integers(len(frame) - 1)
    return frame[: at + dice.integers(1, 33)] + frame[at:]


def _cut(frame, other, dice):
    return frame[: dice.integers(1, len(frame))]


def _splice(frame, other, dice):
    at = dice.integers(1, len(frame))
    return frame[:at] + other[at:]


def _splice_anywhere(frame, other, dice):
    return frame[: dice.integers(1, len(frame))] + other[dice.integers(1, len(frame)) :]


def _noise(frame, other, dice):
    return dice.bytes(dice.integers(1, 2 * len(frame)))


def _magic(frame, other, dice):
    return MAGIC * int(dice.integers(1, 20)) + frame[2 : dice.integers(2, 20)]


def _lie(frame, other, dice):
    """A header with a right CRC, of another size: the parser waits for what never comes."""
    header = bytearray(frame[:13])
    header[3], header[4] = dice.integers(1, 65, 2)
    return bytes(header) + crc16(header).to_bytes(2, "little") + dice.bytes(dice.integers(0, 50))


HARMS = _flip, _burst, _lose, _double, _cut, _splice, _splice_anywhere, _noise, _magic, _lie


def harmed(shape, k: int, dice) -> tuple[bytes, ...]:
    """Bytes that hold no sound frame, and the frames that they were made of."""
    while True:
        frame, other = (binary(shape, 2 * k + j, dice, FOREIGN) for j in (0, 1))
        bytes_ = HARMS[k % len(HARMS)](frame, other, dice)
        if frame not in bytes_ and other not in bytes_:
            return bytes_, frame, other


def identity(frame: Frame) -> tuple:
    return frame.sequence, frame.device_time_us, frame.adc_bits, frame.samples.tobytes()


def identity_sent(data: bytes) -> tuple:
    number = int.from_bytes
    return number(data[7:9], "little"), number(data[9:13], "little"), data[5], data[15:-2]


def fuzz_binary(shape, sound: int, damaged_bytes: int, seed: int):
    """(share of the sound frames that arrived, wrong frames, counters, bytes damaged)"""
    dice = np.random.default_rng(seed)
    stream = Stream(shape, sound, damaged_bytes, dice, binary, harmed)
    parser = BinaryParser()
    frames = stream.feed(parser, dice)
    sent = {
        identity_sent(piece)
        for piece, good in zip(stream.pieces, stream.sound, strict=True)
        if good
    }
    # One that lost its last byte is whole again if the byte behind it is the same by chance.
    mended = set(map(identity_sent, stream.originals))
    arrived = [identity(frame) for frame in frames]
    right = [found for found in arrived if found in sent]
    assert len(set(right)) == len(right), "a frame came twice"
    assert right == sorted(right, key=lambda found: found[1]), "frames came in another order"
    wrong = sum(found not in sent and found not in mended for found in arrived)
    return len(right) / sound, wrong, parser.counters, stream.damaged_bytes


def by_chance(counters: Counters) -> int:
    """Wrong frames that the CRC may let pass: what is expected and four standard deviations."""
    expected = counters.corrupt * CHANCE
    return math.ceil(expected + 4.0 * math.sqrt(expected))


@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("shape", SHAPES)
def test_sound_frames_come_through_damaged_bytes(shape, amount):
    """A damaged frame whose header is whole passes a CRC of 16 bits once in 65,536 times; what
    damages its header too, or is none, must pass two.
    """
    recovered, wrong, counters, size = fuzz_binary(shape, *amount, seed=1)
    print(
        f"\nbinary {shape[0]}x{shape[1]}: {size} damaged bytes, {amount[0]} sound frames: "
        f"{recovered:.4%} recovered, {wrong} wrong of {counters.corrupt} damaged "
        f"({counters.corrupt * CHANCE:.1f} expected); {counters}"
    )
    assert recovered >= 0.999
    assert wrong <= (0 if amount == QUICK else by_chance(counters))
    assert counters.corrupt > 100


@pytest.mark.slow
def test_a_damaged_frame_passes_as_often_as_its_checksum_must_let_it():
    """Once in 65,536 times, not more often: of 2 million damaged beyond what the CRC always finds
    (3 bits, or a burst of 16)."""
    dice, n = np.random.default_rng(3), 2_000_000
    frame, passed = bytearray(binary((2, 2), 1, dice)), 0
    for noise in dice.integers(0, 256, (n, 8), np.uint8):
        frame[15:23] = noise.tobytes()
        parser = BinaryParser()
        passed += len(parser.feed(bytes(frame)))
    print(f"\n{passed} of {n} passed, {n * CHANCE:.1f} expected")
    assert abs(passed - n * CHANCE) < 4.0 * math.sqrt(n * CHANCE)


# --- text -------------------------------------------------------------------------------------

WORD = re.compile(rb"(?:\d+\.?\d*|\.\d+|-|nan|NaN|NAN)?")


def text(shape, k: int, dice) -> bytes:
    return b",".join(b"%d" % v for v in dice.integers(0, 1024, shape[0] * shape[1])) + b"\n"


def _letters(frame, other, dice):
    struck = bytearray(frame)
    for place in dice.integers(0, len(frame), dice.integers(1, 4)):
        struck[place] = dice.choice(np.frombuffer(b"0123456789,.\n -+eExX_naif\0\xff", np.uint8))
    return bytes(struck)


TEXT_HARMS = _flip, _burst, _lose, _double, _cut, _splice_anywhere, _noise, _letters


def harmed_text(shape, k: int, dice) -> tuple[bytes]:
    """Bytes that end as a line does, and hold no sound one."""
    while True:
        frame, other = text(shape, k, dice), text(shape, k, dice)
        bytes_ = TEXT_HARMS[k % len(TEXT_HARMS)](frame, other, dice).rstrip(b"\n") + b"\n"
        if not {frame, other} & set(bytes_.splitlines(keepends=True)):
            return (bytes_,)


class Reference:
    """What lines say: as many fields as there are cells, numbers of the ADC's range or none.

    Nobody can tell that such a line was damaged, but for a last field that is empty: it counts
    from the second one on, unless lines were seen that end with a separator.
    """

    def __init__(self, shape):
        self.cells, self.trailing, self.open = shape[0] * shape[1], False, 0

    def values(self, line: bytes) -> np.ndarray | None:
        """(cells,) NaN where nothing was read; None: the line holds no frame."""
        if len(line) > 12 * self.cells + 2:
            return None
        kinds = [c for c in (b",", b";", b"\t") if c in line]
        kinds = kinds[:1] if kinds[1:] == [b"\t"] else kinds
        if len(kinds) > 1:
            return None
        words = line.strip(b" \r") if kinds == [b"\t"] else line
        words = [w.strip(b" \t\r") for w in words.split(kinds[0])] if kinds else line.split()
        if kinds and not words[-1]:
            self.trailing |= len(words) == self.cells + 1
            self.open += len(words) == self.cells and not self.trailing
            if len(words) != self.cells or self.trailing or self.open < 2:
                words = words[:-1]
        if set(line) - set(b"0123456789.,;- \t\rnaNA") or len(words) != self.cells:
            return None
        if not all(map(WORD.fullmatch, words)):
            return None
        values = np.array([float(w) if w[-1:] in b"0123456789." and w else np.nan for w in words])
        return None if np.isnan(values).all() or np.nanmax(values) > 1023 else values


def fuzz_text(shape, sound: int, damaged_bytes: int, seed: int):
    """(share of the sound lines that arrived, lines damaged, of these frames, bytes damaged)"""
    dice = np.random.default_rng(seed)
    stream = Stream(shape, sound, damaged_bytes, dice, text, harmed_text)
    stream.pieces.insert(0, b"\n")
    stream.sound = np.insert(stream.sound, 0, False)
    parser, reference = TextParser(*shape), Reference(shape)
    frames = iter(stream.feed(parser, dice))
    found = next(frames, None)
    recovered = damaged = passed = 0
    for piece, good in zip(stream.pieces, stream.sound, strict=True):
        for line in piece[:-1].split(b"\n"):
            expected = reference.values(line)
            fits = expected is not None and found is not None
            if fits:
                absent = False if found.unread is None else found.unread
                read = np.where(absent, np.nan, found.samples)
                fits = np.array_equal(read.ravel(), np.rint(64.0 * expected), equal_nan=True)
            recovered += good and fits
            damaged += not good
            passed += not good and fits
            assert good or fits == (expected is not None), line
            found = next(frames, None) if fits else found
    assert found is None, "a frame that no line holds"
    return recovered / sound, damaged, passed, stream.damaged_bytes


@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("shape", SHAPES)
def test_sound_lines_come_through_damaged_text(shape, amount):
    """A line that still holds as many numbers in range passes, as it must without a checksum: what
    comes out is what the line says, to the last sample."""
    recovered, damaged, passed, size = fuzz_text(shape, *amount, seed=1)
    print(
        f"\ntext {shape[0]}x{shape[1]}: {size} damaged bytes, {amount[0]} sound lines: "
        f"{recovered:.4%} recovered, {passed} of {damaged} damaged lines still hold a frame"
    )
    assert recovered >= (1.0 if amount == QUICK else 0.999)
    assert passed < 0.3 * damaged
