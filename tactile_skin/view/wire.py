# SPDX-License-Identifier: Apache-2.0
"""Numbers and arrays as one string of bytes, which wire.js reads.

    length of the head (4 bytes, little-endian) | head: JSON, padded to 4 bytes | arrays

The head is an object; its `arrays` lists [name, dtype, shape] of each array that follows, in order,
little-endian, each padded to 4 bytes.
"""

from __future__ import annotations

import json
import struct

import numpy as np

_LENGTH = struct.Struct("<I")


def parts_of(head: dict, arrays: dict[str, np.ndarray]) -> tuple[str, bytes]:
    """Return two parts, for `packed_with`: what several messages have in common.

    Args:
        head: JSON's own types; NaN is not allowed.
        arrays: float32, uint16 or uint8, any shape.
    """
    parts, listed = [], []
    for name, array in arrays.items():
        array = np.ascontiguousarray(array)
        listed.append([name, array.dtype.str, array.shape])
        parts.append(_padded(array.tobytes(), b"\0"))
    return _json({"arrays": listed} | head), b"".join(parts)


def packed_with(more: dict, head: str, arrays: bytes) -> bytes:
    """Return a message of the parts, with more in its head."""
    text = f"{_json(more)[:-1]},{head[1:]}" if more else head
    said = _padded(text.encode(), b" ")
    return b"".join((_LENGTH.pack(len(said)), said, arrays))


def _json(values: dict) -> str:
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _padded(data: bytes, fill: bytes) -> bytes:
    return data + fill * (-len(data) % 4)
