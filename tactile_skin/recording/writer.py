# SPDX-License-Identifier: Apache-2.0
"""An MCAP file with ROS 2 messages, of which a killed process leaves all that was flushed."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ..errors import FileError
from ..msg import Message
from . import cdr

_PROFILE = "ros2"  # MCAP's name of what is written here


class Writer:
    """Writes a recording.

    Args:
        path: file to make; it must not be there.
        attachments: name -> bytes, to be written first.
        now: time of the attachments [ns since 1970].

    Raises:
        FileError: the file is there already.
        OSError: it cannot be written; so do all methods.
    """

    def __init__(self, path, attachments: dict[str, bytes], now: int):
        self.path = Path(path)
        library = cdr.mcap().writer
        try:
            self._file = self.path.open("xb")
        except FileExistsError:
            raise FileError(f"{path}: is there already: must be a new file") from None
        self._writer = library.Writer(self._file)
        self._channels: dict[str, int] = {}
        self._schemas: dict[type[Message], int] = {}
        self._span: tuple[int, int] | None = None
        self._writer.start(_PROFILE)
        for name, data in attachments.items():
            self._writer.add_attachment(now, now, name, "", data)
        self.flush()

    @property
    def size(self) -> int:
        """Bytes of the file. For the thread that writes: while the disk hangs, so does this."""
        return self.path.stat().st_size if self._file.closed else self._file.tell()

    @property
    def seconds(self) -> float:
        return 0.0 if self._span is None else (self._span[1] - self._span[0]) * 1e-9

    def write(self, topic: str, kind: type[Message], t: int, data: bytes) -> None:
        """Write a message as CDR, received at t [ns since 1970]; topic: full name."""
        if topic not in self._channels:
            if kind not in self._schemas:
                text = cdr.definition(kind).encode()
                self._schemas[kind] = self._writer.register_schema(kind.TYPE, cdr.SCHEMAS, text)
            self._channels[topic] = self._writer.register_channel(
                topic, cdr.MESSAGES, self._schemas[kind]
            )
        self._writer.add_message(self._channels[topic], t, data, t)
        self._span = (self._span or (t, t))[0], t

    def flush(self) -> None:
        """End the chunk and hand it to the operating system: a kill no longer loses it."""
        self._writer.flush()

    def close(self) -> None:
        """Write the index, and end the file."""
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        """End the file as it is, without another word to a disk that takes none."""
        with contextlib.suppress(OSError):  # what waits in the buffer, again
            self._file.close()
