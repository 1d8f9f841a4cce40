"""Numbers and arrays as one string of bytes: from the node to the server, and on to the page.

    length of the head (4 bytes, little-endian) | head: JSON, padded to 4 bytes | arrays

The head is an object; its `arrays` lists [name, dtype, shape] of each array that follows, in order,
little-endian, each padded to 4 bytes (wire.js reads the same).
"""

from __future__ import annotations

import json
import struct

import numpy as np

_LENGTH = struct.Struct("<I")
_DTYPES = {name: np.dtype(name) for name in ("<f4", "<u2", "|u1")}


def pack(head: dict, arrays: dict[str, np.ndarray]) -> bytes:
    """Args:
    head: JSON's own types; NaN is not allowed.
    arrays: float32, uint16 or uint8, any shape.
    """
    return packed_with({}, *parts_of(head, arrays))


def parts_of(head: dict, arrays: dict[str, np.ndarray]) -> tuple[str, bytes]:
    """The same in two parts, for `packed_with`: what several messages have in common."""
    parts, listed = [], []
    for name, array in arrays.items():
        array = np.ascontiguousarray(array)
        listed.append([name, array.dtype.str, array.shape])
        parts.append(_padded(array.tobytes(), b"\0"))
    return _json({"arrays": listed} | head), b"".join(parts)


def packed_with(more: dict, head: str, arrays: bytes) -> bytes:
    """A message of the parts, with more in its head."""
    text = f"{_json(more)[:-1]},{head[1:]}" if more else head
    said = _padded(text.encode(), b" ")
    return b"".join((_LENGTH.pack(len(said)), said, arrays))


def unpack(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """What was packed; the arrays are read-only."""
    at = _LENGTH.size + _LENGTH.unpack_from(data)[0]
    head, arrays = json.loads(data[_LENGTH.size : at]), {}
    for name, dtype, shape in head.pop("arrays"):
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, _DTYPES[dtype], count, at).reshape(shape)
        at += count * _DTYPES[dtype].itemsize
        at += -at % 4
    return head, arrays


def _json(values: dict) -> str:
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _padded(data: bytes, fill: bytes) -> bytes:
    return data + fill * (-len(data) % 4)
