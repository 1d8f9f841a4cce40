# SPDX-License-Identifier: Apache-2.0
"""A user's files, read within limits: each refusal is one line that names file, line and key.

Imports nothing of ours but errors. YAML is read by yaml_files.
"""

from __future__ import annotations

import codecs
import stat
from collections.abc import Iterator
from pathlib import Path

from .errors import FileError

_BLOCK = 1 << 20  # bytes of a text that are read at once; no line is as long
_SHOWN = 60  # characters of a value that a message shows
_LINE = 800  # characters of a message; the names of all parameters of a node fit


def read_bytes(path, most: int) -> bytes:
    """All of a regular file of at most `most` bytes.

    Devices and pipes are not opened: they may never end, or never begin.

    Raises:
        FileError: not a regular file, or too large.
        OSError: it cannot be read.
    """
    path = _regular(path)
    with path.open("rb") as file:
        data = file.read(min(most, path.stat().st_size) + 1)  # takes so much memory ahead
    if len(data) > most:
        raise _too_large(path, most)
    return data


def _regular(path) -> Path:
    if not str(path) or "\0" in str(path):
        raise FileError(f"file name {str(path)!r}: must not be empty, or hold a NUL character")
    path = Path(path)
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device or pipe"
        raise FileError(f"{path}: is {kind}: must be a regular file")
    return path


def _too_large(path: Path, most: int) -> FileError:
    return FileError(f"{path}: is too large: must be at most {most // 1024} KiB")


def read_lines(path, most: int) -> Iterator[list[str]]:
    """Yield the lines of a text, some at a time; as `read_bytes` and `decode`.

    Raises:
        FileError: as `read_bytes`, or a line that is longer than any.
        OSError: it cannot be read.
    """
    path = _regular(path)
    with path.open("rb") as file:
        data = file.read(_BLOCK)
        decoder = codecs.getincrementaldecoder(_encoding(data))("replace")
        rest, number = "", 1
        while data:
            if file.tell() > most:
                raise _too_large(path, most)
            text = rest + decoder.decode(data)
            rest = (text.splitlines(keepends=True) or [""])[-1]  # it may go on
            if len(rest) > _BLOCK:
                raise FileError(f"{path}: line {number}: is longer than {_BLOCK // 1024} KiB")
            lines = text[: len(text) - len(rest)].splitlines()
            number += len(lines)
            yield lines
            data = file.read(_BLOCK)
        yield (rest + decoder.decode(b"", True)).splitlines()


def decode(data: bytes) -> str:
    """Return UTF-8 text, or UTF-16 as PowerShell's > writes it; what is neither as U+FFFD."""
    return data.decode(_encoding(data), "replace")


def _encoding(data: bytes) -> str:
    utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return "utf-16" if utf_16 else "utf-8-sig"


def read_text(path, most: int) -> str:
    """All of a UTF-8 text file, as `read_bytes`; a byte order mark in front is dropped.

    Raises:
        FileError: as `read_bytes`, or not UTF-8.
        OSError: it cannot be read.
    """
    data = read_bytes(path, most)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileError(
            f"{path}: line {line}: not UTF-8 text: byte 0x{data[error.start]:02x}"
        ) from error


def shorten(value) -> str:
    """Return a value's repr, for a message: cut in its middle where it is long."""
    return _cut(repr(value), _SHOWN)


def one_line(error: BaseException) -> str:
    """Return an exception's message on one line of bounded length."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    return _cut(" ".join(text.splitlines()) or type(error).__name__, _LINE)


def _cut(text: str, most: int) -> str:
    end = most // 3
    return text if len(text) <= most else f"{text[: most - end - 3]}...{text[-end:]}"
