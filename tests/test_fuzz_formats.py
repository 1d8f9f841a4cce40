# SPDX-License-Identifier: Apache-2.0
"""Damaged bytes between sound frames of every described format: the sound ones come out.

Text and packets without a checksum cannot tell all damage; what they say stays within the ADC's
range. The quick runs are small; `pytest -m slow tests/test_fuzz_formats.py -s` damages 10 million
bytes in all, and prints what came out.
"""

import tracemalloc

import numpy as np
import pytest
from strangers.test_formats import BITS, SHAPE, pictures
from support.strangers import boards
from test_fuzz import Stream, _burst, _cut, _double, _flip, _lose, _noise, _splice_anywhere

from tactile_skin.board.formats import make_parser
from tactile_skin.board.recognise import recognise

FORMATS = {**boards.TEXT, **boards.PACKETS}
HARMS = _flip, _burst, _lose, _double, _cut, _splice_anywhere, _noise
FULL_SCALE = {"volts": 5.0, "millivolts": 5000.0}
QUICK = 200, 8_000  # sound frames, damaged bytes, of each format
FULL = 4_000, 10_000_000 // len(FORMATS)
SUMS = {"words_with_a_sum": 8, "slip_with_a_crc": 32, "cobs_with_a_crc": 16}  # bits
UNBOUNDED = 300_000  # bytes that never form a frame, and
MOST = 3_000_000  # bytes of memory that they may take


def parser_of(name: str):
    """A parser by what is recognised in a clean stream."""
    seen = recognise(boards.sent(FORMATS[name], pictures()), SHAPE)
    fmt = seen.format
    if name in FULL_SCALE:
        fmt = type(fmt)(**{**vars(fmt), "full_scale": FULL_SCALE[name]})
    return make_parser(seen.protocol, *SHAPE, BITS, fmt)


def fuzz(name: str, sound: int, damaged_bytes: int, seed: int):
    """(share of sound frames between sound ones that came out, wrong, damaged, bytes damaged)."""
    dice, make = np.random.default_rng(seed), FORMATS[name]
    known = pictures(sound, seed=seed)
    whole = [boards.sent(make, known[k : k + 1]) for k in range(sound)]

    def frame(shape, k, dice):
        return whole[k]

    def harm(shape, k, dice):
        one, other = (whole[dice.integers(sound)] for _ in range(2))
        return (HARMS[k % len(HARMS)](one, other, dice),)

    stream = Stream(SHAPE, sound, damaged_bytes, dice, frame, harm)
    parser = parser_of(name)
    frames = stream.feed(parser, dice)
    top = 65535 >> (16 - BITS) << (16 - BITS)
    assert all(f.samples.shape == SHAPE and f.samples.max() <= top for f in frames)
    reads = {f.samples.tobytes() for f in parser_of(name).feed(b"".join(whole))}
    came = {f.samples.tobytes() for f in frames}
    sound_on = np.concatenate([[False], stream.sound, [False]])
    between = stream.sound & sound_on[:-2] & sound_on[2:]
    expected = [piece for piece, good in zip(stream.pieces, between, strict=True) if good]
    pairs = parser_of(name)
    due = set()
    for piece in expected:
        due |= {f.samples.tobytes() for f in pairs.feed(piece)}
    assert due, "no frame stands between two others"
    recovered = len(due & came) / len(due)
    wrong = sum(f.samples.tobytes() not in reads for f in frames)
    return recovered, wrong, int((~stream.sound).sum()), stream.damaged_bytes


@pytest.mark.parametrize("amount", [QUICK, pytest.param(FULL, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FORMATS)
def test_sound_frames_come_through_damaged_bytes(name, amount):
    recovered, wrong, damaged, size = fuzz(name, *amount, seed=3)
    print(f"\n{name}: {size} damaged bytes: {recovered:.2%} recovered, {wrong} of {damaged} read")
    assert recovered >= 0.97
    if name in SUMS:  # so many pass a sum by chance, and four standard deviations
        expected = damaged / 2 ** SUMS[name]
        assert wrong <= expected + 4.0 * expected**0.5 + 1.0


@pytest.mark.parametrize("byte", [b"7", b"[", b"\xff"])
@pytest.mark.parametrize("name", FORMATS)
def test_bytes_that_never_form_a_frame_take_no_memory(name, byte):
    parser = parser_of(name)
    tracemalloc.start()
    try:
        for _ in range(UNBOUNDED // 10_000):
            parser.feed(10_000 * byte)
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_streams_are_recognised_or_not_but_never_as_another(name):
    """What is sure of a stream with damaged bytes in it is what the clean one says."""
    dice = np.random.default_rng(5)
    clean = recognise(boards.sent(FORMATS[name], pictures()))
    for _ in range(4):
        data = bytearray(boards.sent(FORMATS[name], pictures()))
        for place in dice.integers(0, len(data), dice.integers(1, 40)):
            data[place] = dice.integers(256)
        seen = recognise(bytes(data))
        assert not seen.sure or (seen.protocol, seen.cells) == (clean.protocol, clean.cells)
        assert not recognise(dice.bytes(len(data))).sure
