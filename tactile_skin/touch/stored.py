# SPDX-License-Identifier: Apache-2.0
"""Plain numbers with a head of JSON, in an .npz file that runs nothing when it is read."""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError

_MOST_BYTES = 50_000_000  # of a file: a minute of 64 x 64 cells; 5 million are 32 gestures' trees


def save(path: str | Path, head: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Write arrays, and what is said of them."""
    text = np.frombuffer(json.dumps(head).encode(), np.uint8)
    with open(path, "wb") as file:
        np.savez_compressed(file, head=text, **arrays)  # type: ignore[arg-type]  # names of ours


@contextlib.contextmanager
def load(path: str | Path, what: str) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Head and arrays of such a file; whoever reads them may refuse them by a ValueError.

    Raises:
        FileError: no such file, too large, or not `what`; the message names it.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"larger than {_MOST_BYTES} bytes")
        with np.load(path, allow_pickle=False) as data:
            arrays = dict(data)
        yield json.loads(bytes(arrays.pop("head")).decode()), arrays
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: is no {what}: {error}") from error
