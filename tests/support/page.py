"""What a page reads of a message, as wire.js does."""

import json

import numpy as np


def unpack(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """The head, and the arrays by their names."""
    at = 4 + int.from_bytes(data[:4], "little")
    head, arrays = json.loads(data[4:at]), {}
    for name, dtype, shape in head.pop("arrays"):
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, dtype, count, at).reshape(shape)
        at += count * np.dtype(dtype).itemsize
        at += -at % 4
    return head, arrays
