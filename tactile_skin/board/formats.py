# SPDX-License-Identifier: Apache-2.0
"""The protocols by name: which parser reads each, and which description of a format it takes."""

from __future__ import annotations

import dataclasses

from .frame import Parser
from .packets import PacketFormat, PacketParser
from .protocol import BinaryParser
from .text import TextFormat, TextParser

Format = TextFormat | PacketFormat | None
FORMATS: dict[str, type[TextFormat] | type[PacketFormat] | None] = {
    "binary": None,
    "text": TextFormat,
    "packets": PacketFormat,
}
PROTOCOLS = tuple(FORMATS)


def fields() -> dict[str, dataclasses.Field]:
    """Name -> field of all descriptions; what two of them share is one parameter."""
    kinds = [kind for kind in FORMATS.values() if kind is not None]
    return {field.name: field for kind in kinds for field in dataclasses.fields(kind)}


def make_format(protocol: str, values: dict) -> Format:
    """Return the description of a format from what a parameter file says under `format`.

    Raises:
        ValueError: an unknown protocol or name, one of another protocol, or a value that is none.
    """
    if protocol not in FORMATS:
        raise ValueError(f"protocol {protocol!r}: must be one of {', '.join(PROTOCOLS)}")
    kind = FORMATS[protocol]
    known = {field.name for field in dataclasses.fields(kind)} if kind else set()
    given = {}
    for name, value in values.items():
        if name in known:
            given[name] = type(getattr(kind, name))(value)
        elif name not in fields():
            raise ValueError(f"format.{name}: must be one of {', '.join(fields())}")
        elif value != fields()[name].default:
            raise ValueError(f"format.{name} = {value!r}: no {protocol} has it, leave it out")
    return kind(**given) if kind else None


def make_parser(protocol: str, rows: int, cols: int, adc_bits: int, fmt: Format = None) -> Parser:
    """Return a parser of a protocol named in PROTOCOLS; without `fmt` of its default format.

    Raises:
        ValueError: an unknown protocol, or packets without a description.
    """
    if protocol == "binary":
        return BinaryParser()
    fmt = fmt or make_format(protocol, {})
    if isinstance(fmt, PacketFormat):
        return PacketParser(rows, cols, adc_bits, fmt)
    return TextParser(rows, cols, adc_bits, fmt)
