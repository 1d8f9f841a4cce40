# SPDX-License-Identifier: Apache-2.0
"""The wire format has one description in C and one in Python; descriptions and commands."""

import re
import struct

import pytest

from tactile_skin.board import description, protocol
from tactile_skin.board.description import Description, command, find_description
from tactile_skin.board.firmware import build

HEADER = (build.HERE / "protocol.h").read_text()


@pytest.fixture(scope="module")
def defines() -> dict[str, int]:
    """The header's numbers and letters."""
    found = dict(re.findall(r"#define (\w+) ('.'|0x[0-9A-F]+|\d+)", HEADER))
    return {k: ord(v[1]) if v.startswith("'") else int(v, 0) for k, v in found.items()}


def layout(name: str) -> tuple[str, list[str]]:
    """The format, as of `struct`, and the fields of a struct of the header."""
    body = re.search(rf"struct {name} {{(.*?)}};", HEADER, re.S)[1]
    body = re.sub(r"/\*.*?\*/", "", body, flags=re.S)
    letters, names = "<", []
    for bits, fields in re.findall(r"uint(\d+)_t ([^;]+);", body):
        for field in fields.split(","):
            name, _, count = field.strip().rstrip("]").partition("[")
            letters += f"{count}s" if count else {"8": "B", "16": "H", "32": "I"}[bits]
            names.append(name)
    return letters, names


def same(one: str, other: str) -> bool:
    return re.sub(r"8B", "BBBBBBBB", one) == re.sub(r"8B", "BBBBBBBB", other)


def test_the_header_has_the_frame_of_protocol_py(defines):
    letters, names = layout("header")
    assert same(letters, protocol._HEADER.format)
    assert names[2:6] == ["rows", "cols", "adc_bits", "fraction_bits"]
    assert bytes([defines["FRAME_MAGIC_0"], defines["FRAME_MAGIC_1"]]) == protocol.MAGIC
    assert defines["PROTOCOL_VERSION"] == protocol.VERSION
    assert defines["CRC_START"] == protocol.crc16(b"")


def test_the_header_has_the_description_of_description_py(defines):
    letters, names = layout("description")
    assert same(letters, description._BODY.format + "H")
    assert names[2:-1] == list(Description.__dataclass_fields__)
    magic = bytes([defines["DESCRIPTION_MAGIC_0"], defines["DESCRIPTION_MAGIC_1"]])
    assert magic == description.MAGIC
    assert struct.calcsize(letters) == description.SIZE


def test_the_header_has_the_commands_of_description_py(defines):
    letters, _ = layout("command")
    assert same(letters, "<BBBH")
    assert defines["COMMAND_MAGIC"] == description.COMMAND_MAGIC
    for name in ("DESCRIBE", "RATE", "FILTER", "RAW"):
        assert chr(defines[f"COMMAND_{name}"]) == getattr(description, name)
    assert (defines["MIN_RATE"], defines["MAX_RATE"]) == description.RATES
    assert (defines["MIN_FILTER"], defines["MAX_FILTER"]) == description.FILTERS


@pytest.mark.parametrize(("letter", "value"), [("r", 0), ("r", 101), ("f", 0), ("f", 9)])
def test_a_value_that_the_board_would_not_take_is_refused(letter, value):
    with pytest.raises(ValueError, match="must be from 1"):
        command(letter, value)


def test_a_damaged_description_is_none():
    body = description._BODY.pack(description.MAGIC, 1, 1, 4, 5, 10, 6, 100, 3, 250, 1)
    whole = body + struct.pack("<H", protocol.crc16(body))
    assert find_description(b"ab" + whole + description.MAGIC).cols == 5
    for k in range(len(whole)):
        assert find_description(whole[:k] + bytes([whole[k] ^ 4]) + whole[k + 1 :]) is None
        assert find_description(whole[:k]) is None
