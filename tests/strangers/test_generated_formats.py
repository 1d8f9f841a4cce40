# SPDX-License-Identifier: Apache-2.0
"""Formats of all kinds by chance: an untouched mat is heard, then readings reach every byte value.

What is recognised in the rest reads each frame under the touches, or says that it is not sure.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.marks import ci, slow

from tactile_skin.board.formats import make_parser
from tactile_skin.board.packets import CHECKS, check_of
from tactile_skin.board.recognise import explain, recognise
from tactile_skin.board.recognise.listen import Heard

SHAPE = 8, 8
CELLS = 64
LEVELS = 0, 1, 35, 60, 85, 100, 128, 180, 240  # of the untouched mat, of 255
CUT = 41  # bytes that were sent before anybody listened
SEEDS = [ci(0), *(slow(seed) for seed in range(1, 5))]


def packed(values, bits: int) -> bytes:
    text = "".join(f"{v:0{bits}b}" for v in values)
    return int(text, 2).to_bytes(len(text) // 8, "big")


WORDS = {  # name -> (bits of the ADC, the bytes of readings)
    "u8": (8, lambda v: v.astype("u1").tobytes()),
    **{
        f"u16{end}, {bits} bits": (bits, lambda v, kind=kind: v.astype(kind).tobytes())
        for end, kind in (("le", "<u2"), ("be", ">u2"))
        for bits in (10, 12, 16)
    },
}
WORDS |= {
    "10 bits, packed": (10, lambda v: packed(v, 10)),
    "12 bits, packed": (12, lambda v: packed(v, 12)),
    "12 bits, lowest first": (12, lambda v: packed(v[::-1], 12)[::-1]),
    "10 bits, lowest first": (10, lambda v: packed(v[::-1], 10)[::-1]),
    "u24le": (16, lambda v: v.astype("<u4").view("u1").reshape(-1, 4)[:, :3].tobytes()),
    "u24be": (16, lambda v: v.astype(">u4").view("u1").reshape(-1, 4)[:, 1:].tobytes()),
}


SUMS = {name: lambda data, name=name: check_of(name, data) for name in CHECKS}
NO_SUMS = {"": lambda data: b"", "of its own": lambda data: bytes([7 * sum(data) + 13 & 255])}


@pytest.mark.parametrize(
    ("name", "data", "check"),
    [
        ("crc8", b"123456789", "F4"),
        ("modbus", b"123456789", "37 4B"),
        ("crc32be", b"123456789", "CB F4 39 26"),
        ("fletcher16be", b"abcdefgh", "06 27"),
    ],
)
def test_checks_are_those_of_their_published_values(name, data, check):
    assert check_of(name, data) == bytes.fromhex(check)


def slip(data: bytes) -> bytes:
    return data.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc") + b"\xc0"


def cobs(data: bytes) -> bytes:
    found = b""
    for k, part in enumerate(parts := data.split(b"\0")):
        while len(part) >= 254:
            found += b"\xff" + part[:254]
            part = part[254:]
            if not part and k == len(parts) - 1:
                return found + b"\0"
        found += bytes([len(part) + 1]) + part
    return found + b"\0"


ESCAPES = {"slip": slip, "twice": lambda data: b"\xc0" + slip(data), "cobs": cobs}
HEADS = {
    "FF FF": lambda k: b"\xff\xff",
    "AA 55": lambda k: b"\xaa\x55",
    "A0": lambda k: b"\xa0",
    "FF FE FE FF": lambda k: b"\xff\xfe\xfe\xff",
    "AA 55, a counter": lambda k: b"\xaa\x55" + bytes([k & 255]),
    "A5 C3, a size": lambda k: b"\xa5\xc3\x01\x40",
}
TAILS = b"", b"\r\n", b"\xc0"


def pictures(bits: int, level: int, seed: int) -> np.ndarray:
    """(300, CELLS): 60 of an untouched mat, then touches that give each byte each value."""
    rng, step = np.random.default_rng(seed), 2 ** (bits - 8)
    rest = level * step + 2.0 * step**0.5 * rng.standard_normal(CELLS)
    read = np.rint(rest + 0.6 * rng.standard_normal((300, CELLS)))
    for k in range(240):
        hit = rng.random(CELLS) < (0.3 if k % 2 else 1.0)
        read[60 + k, hit] = ((k * 16 // 15) * step + rng.integers(0, step, CELLS))[hit]
    return np.clip(read, 0, 2**bits - 1).astype(int)


def judged(data: list[bytes], right: np.ndarray, bits: int, known) -> tuple[bool, bool]:
    """(whether all frames are read by what is recognised in the rest, whether that is sure)."""
    seen = recognise(b"".join(data[:60])[CUT:], known)
    if not seen.protocol or seen.cells != CELLS:
        return False, seen.sure
    fmt = replace(seen.format, full_scale=0.0)
    parser = make_parser(seen.protocol, *SHAPE, bits, fmt)
    frames = parser.feed(b"".join(data)[CUT:])
    read = np.array([frame.samples.ravel() for frame in frames]) / 2 ** (16 - bits)
    wanted = right[1 : 1 + len(read)]
    whole = len(read) >= len(right) - 2 and np.array_equal(read, wanted)
    return whole, seen.sure


def sent(rng, word: str, check: str, level: int, seed: int, escape: str = ""):
    bits, make = WORDS[word]
    head, tail = HEADS[rng.choice(list(HEADS))], TAILS[rng.integers(len(TAILS))]
    right, data = pictures(bits, level, seed), []
    for k, picture in enumerate(right):
        body = (b"" if escape and seed % 2 else head(k)) + make(picture)
        body += (SUMS | NO_SUMS)[check](body)
        data.append(ESCAPES[escape](body) if escape else body + tail)
    return data, right, bits


@pytest.mark.parametrize("seed", SEEDS)
def test_of_eighty_formats_nine_in_ten_are_right_and_none_is_wrong_and_sure(seed):
    """Packets by chance, one in eight without a check, or with one of its own: never sure.

    Without the cells the high byte of a sum, which is 0 at rest, may be a reading's or an end's.
    """
    rng, count = np.random.default_rng(59 + seed), {None: np.zeros(2), SHAPE: np.zeros(2)}
    for k in range(80):
        word, level = str(rng.choice(list(WORDS))), int(rng.choice(LEVELS))
        check = str(rng.choice(list(SUMS if k % 8 else NO_SUMS)))
        escape = str(rng.choice(["", "", *ESCAPES]))
        data, right, bits = sent(rng, word, check, level, k, escape)
        for known, counted in count.items():
            whole, sure = judged(data, right, bits, known)
            assert (whole and check in SUMS) or not sure, (k, word, level, check, escape, known)
            counted += whole, sure
    print(f"\nright and sure of 80: {count}")
    assert count[SHAPE][0] >= 0.92 * 80 and count[SHAPE][1] >= 0.75 * 80
    assert count[None][0] >= 0.75 * 80


def test_a_few_bytes_of_packed_readings_are_never_sure_to_be_readings():
    """Nine of 8 bits and a head that holds one more, or eight of 10 bits."""
    data = [b"\xff\xff" + packed(picture[:8], 10) for picture in pictures(10, 85, 3)[:60]]
    assert not recognise(b"".join(p + check_of("crc16le", p) for p in data)).sure


@pytest.mark.parametrize("level", [44, 50, 60, 100, 120])
@pytest.mark.parametrize("check", ["sum8", ""])
def test_packets_whose_bytes_can_be_printed_are_no_text(check, level):
    """A finding of every packet at one distance that no text has: a head, or a check."""
    right = pictures(8, level, 3)
    bodies = [b"\xaa\x55" + WORDS["u8"][1](picture) for picture in right]
    data = [body + (SUMS | NO_SUMS)[check](body) for body in bodies]
    assert judged(data, right, 8, None) == (True, bool(check))


TEXTS = {  # how a number is printed
    "decimal": "d",
    "decimal, padded": "04d",
    "hexadecimal": "x",
    "hexadecimal, padded": "03X",
    "hexadecimal, marked": "#06x",
}


@pytest.mark.parametrize("separator", [",", *(ci(mark) for mark in (" ", ", ", "; ", "\t"))])
@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("rows", [False, True])
def test_a_text_of_decimal_or_hexadecimal_numbers_is_read_under_touches(rows, kind, separator):
    """Of digits alone a text may be both: then it is asked, and what is typed reads it."""
    count = np.zeros(2)
    for level in LEVELS[1::3]:
        right = pictures(10, level, 1)
        data = []
        for picture in right[::4]:
            words = [format(v, TEXTS[kind]) for v in picture]
            each = np.array_split(words, 8 if rows else 1)
            text = "".join(separator.join(row) + "\r\n" for row in each) + "\r\n" * rows
            data.append(text.encode())
        heard = Heard(b"".join(data[:15])[CUT:], 115_200)
        if heard.seen.digits:
            assert not heard.seen.sure
            heard.read_as(kind.startswith("hex"))
        seen = heard.seen
        if not seen.protocol or seen.cells != CELLS:
            assert not seen.sure
            continue
        parser = make_parser(seen.protocol, *SHAPE, 10, seen.format)
        frames = parser.feed(b"".join(data)[CUT:])
        read = np.array([frame.samples.ravel() for frame in frames]) / 64
        whole = len(read) >= len(data) - 2 and np.array_equal(read, right[4::4][: len(read)])
        assert whole or not seen.sure
        count += whole, seen.sure
    assert count[0] == 3 and count[1] >= 2, count


def test_letters_under_a_touch_name_hexadecimal_numbers_that_are_read_as_decimal_ones():
    right = np.clip(pictures(8, 85, 2), 81, 255)
    data = [", ".join(format(v, "02x") for v in picture).encode() + b"\n" for picture in right]
    rest = [line for line, p in zip(data, right, strict=True) if p.max() < 90]
    heard = Heard(b"".join(rest), 9_600)
    assert heard.seen.digits == 2 and not heard.seen.sure and heard.settled
    assert "numbers of 2 digits may be hexadecimal" in heard.seen.about
    parser = make_parser("text", *SHAPE, 8, heard.seen.format)
    parser.feed(b"".join(data))
    assert "set serial_driver.format.hexadecimal: true" in explain(parser)


def test_a_class_of_one_letter_makes_no_number_hexadecimal():
    right = pictures(10, 85, 2)[:40]
    data = [f"{','.join(map(str, p))},{'abc'[k % 3]}\n" for k, p in enumerate(right)]
    assert not recognise("".join(data).encode()).format.hexadecimal
