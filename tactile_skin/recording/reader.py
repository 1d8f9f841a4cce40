# SPDX-License-Identifier: Apache-2.0
"""Recordings read back, those that end in the middle too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..errors import FileError
from ..middleware.bus import Time
from ..middleware.config import SkinConfig, skin_of
from ..msg import DiagnosticArray, Image, Message, TimeReference, image_array
from . import cdr, configuration

_M = TypeVar("_M", bound=Message)
ADC, TAKEN = "skin/adc", "skin/taken"
_MAGIC, _VERSION = b"\x89MCAP", b"0\r\n"
EVER = 2**63  # ns since 1970: after all recordings


@dataclass(frozen=True)
class Topic:
    """type: ROS 2's name of its messages; count: messages in the recording."""

    type: str
    count: int


class Recording:
    """An MCAP file with ROS 2 messages, as `tactile-skin record` or `ros2 bag record` makes it.

    A file that ends in the middle, as after a power cut, is read up to there.

    Args:
        path: the file.
        namespace: of the skin, where a recording holds several.

    Attributes:
        topics: full name -> Topic.
        span: times of the first and the last message [ns since 1970].
        damage: what the last reading of it had to leave out, in words; empty: nothing.
        attachments: name -> bytes.

    Raises:
        FileError: no such recording; the message names the file.
        OSError: it cannot be opened.
        ModuleNotFoundError: mcap or rosbags is not installed.
    """

    def __init__(self, path, namespace: str = ""):
        self.path, self._namespace = Path(path), namespace.strip("/")
        self.damage = ""
        self.attachments: dict[str, bytes] = {}
        self._schemas: dict[int, str] = {}  # number -> type
        self._channels: dict[int, tuple[str, str]] = {}  # number -> topic, type
        self._undeclared: Counter[int] = Counter()  # number of a channel -> its messages, left out
        # place in the file, and times of the first and the last message, of each chunk [ns]
        self._chunks: list[tuple[int, int, int]] = []
        self._check_magic()
        counts, self.span = self._index() or self._scan()
        self.topics: dict[str, Topic] = {}
        for channel, (topic, kind) in self._channels.items():
            others = self.topics.get(topic, Topic(kind, 0))
            self.topics[topic] = Topic(kind, others.count + counts[channel])

    # --- the readings ---

    @cached_property
    def adc_topic(self) -> str:
        """Full name of the skin/adc that is read.

        Raises:
            FileError: there is none, or there are several and no namespace is given.
        """
        found = [topic for topic in self.topics if topic.endswith(f"/{ADC}")]
        name = f"/{self._namespace}/{ADC}".replace("//", "/")
        if name in found:
            return name
        if len(found) == 1 and not self._namespace:
            return found[0]
        if not self.topics:
            raise FileError(f"{self.path}: holds no message{self.damage and f': it {self.damage}'}")
        there = ", ".join(found or self.topics)
        raise FileError(f"{self.path}: has no topic {name}; there are: {there}")

    @cached_property
    def _readings(self) -> tuple[np.ndarray, np.ndarray]:
        return self.images(self.adc_topic)

    @property
    def stamps(self) -> np.ndarray:
        """(n,) int64, arrival of each reading's last byte [ns since 1970]."""
        return self._readings[0]

    @property
    def times(self) -> np.ndarray:
        """(n,) seconds since the first reading."""
        return (self.stamps - self.stamps[:1].sum()) * 1e-9

    @property
    def adc(self) -> np.ndarray:
        """(n, rows, cols) uint16, skin/adc: ADC steps * 2^(16 - bits); 65535: not read."""
        return self._readings[1]

    def images(self, topic: str) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (n,) [ns since 1970] and pictures (n, rows, cols) of a topic of images.

        Raises:
            FileError: no such topic, other messages, or pictures of different sizes.
        """
        if topic not in self.topics or self.topics[topic].type != Image.TYPE:
            raise FileError(f"{self.path}: has no topic {topic} of {Image.TYPE}")
        stamps, pictures = [], []
        for message in self._of(Image, topic):
            try:
                pictures.append(image_array(message))
            except ValueError as error:
                raise FileError(f"{self.path}: {topic}: {error}") from error
            if pictures[-1].shape != pictures[0].shape:
                sizes = " to ".join("{} x {}".format(*pictures[k].shape) for k in (0, -1))
                raise FileError(f"{self.path}: {topic}: its size changes from {sizes}")
            stamps.append(Time.from_msg(message.header.stamp).nanoseconds)
        return np.array(stamps, np.int64), np.array(pictures)

    def messages(
        self, *topics: str, begin: int = 0, end: int = EVER
    ) -> Iterator[tuple[str, int, Message]]:
        """Topic, time of recording [ns since 1970] and message, in the order of the recording.

        Args:
            topics: full names; none: all topics whose type msg.py has.
            begin, end: only those recorded from begin to before end [ns since 1970].

        Raises:
            FileError: a message that is not of its type.
        """
        for channel, t, data in self._messages(begin, end, topics):
            topic, kind = self._channels[channel]
            if kind not in cdr.KINDS:
                continue
            try:
                yield topic, t, cdr.decode(cdr.KINDS[kind], data)
            except ValueError as error:
                raise FileError(f"{self.path}: {topic} at {t} ns: {error}") from error

    def _of(self, kind: type[_M], topic: str, begin: int = 0, end: int = EVER) -> Iterator[_M]:
        """Return the messages of this kind of a topic; as `messages`."""
        for _, _, message in self.messages(topic, begin=begin, end=end):
            if isinstance(message, kind):
                yield message

    @property
    def diagnostics_topic(self) -> str:
        """Of the skin whose readings `adc_topic` are."""
        return f"{self.adc_topic.removesuffix(ADC)}skin/diagnostics"

    def readings(
        self, begin: int = 0, end: int = EVER
    ) -> Iterator[tuple[int, Image | DiagnosticArray]]:
        """Return skin/adc and the driver's own diagnostics, by their stamps [ns since 1970]."""
        here = self.adc_topic.removesuffix(ADC)
        driver = f"{here}serial_driver".lstrip("/")
        topics = self.adc_topic, self.diagnostics_topic
        for _, _, message in self.messages(*topics, begin=begin, end=end):
            if isinstance(message, DiagnosticArray):
                message.status = [status for status in message.status if status.name == driver]
            if isinstance(message, Image) or (
                isinstance(message, DiagnosticArray) and message.status
            ):
                yield Time.from_msg(message.header.stamp).nanoseconds, message

    def taken(self, begin: int = 0, end: int = EVER) -> dict[int, int]:
        """Stamp of a reading -> when the skin's compensation took it up [both ns since 1970]."""
        topic = self.adc_topic.removesuffix(ADC) + TAKEN
        if topic not in self.topics:
            return {}
        return {
            Time.from_msg(m.header.stamp).nanoseconds: Time.from_msg(m.time_ref).nanoseconds
            for m in self._of(TimeReference, topic, begin, end)
        }

    @cached_property
    def parameters(self) -> dict[str, dict]:
        """Node's full name -> {parameter: value}, of all nodes that ran; empty: none attached."""
        return configuration.parameters(self.attachments, str(self.path))

    @cached_property
    def skin(self) -> SkinConfig:
        """Circuit, curve and geometry that it was recorded with; without any, the defaults.

        Raises:
            ValueError: a value that is out of range; the message names the file.
        """
        return skin_of(self.node_parameters("compensation"), str(self.path))

    def node_parameters(self, name: str) -> dict:
        """Those of the skin's node of this name, in the namespace of `adc_topic`."""
        return self.parameters.get(self.adc_topic.removesuffix(ADC) + name, {})

    # --- the container ---

    def _check_magic(self) -> None:
        with self.path.open("rb") as file:
            magic = file.read(len(_MAGIC + _VERSION))
        if not magic:
            raise FileError(f"{self.path}: is empty")
        if not magic.startswith(_MAGIC):
            raise FileError(
                f"{self.path}: is no MCAP file. Of a board's table or array one is made by: "
                "tactile-skin replay FILE config:=YAML --out FILE.mcap"
            )
        if not magic.endswith(_VERSION):
            raise FileError(f"{self.path}: its version of MCAP is {magic[5:6]!r}: must be b'0'")

    def _index(self) -> tuple[Counter[int], tuple[int, int]] | None:
        """Messages of each channel, and `span`, from the index at the end, if there is one."""
        mcap, size = cdr.mcap(), self.path.stat().st_size
        with self.path.open("rb") as file:
            try:
                reader = mcap.reader.SeekingReader(file, record_size_limit=size)
                summary = reader.get_summary()
                statistics = summary.statistics
                for record in (*summary.schemas.values(), *summary.channels.values()):
                    self._declare(record)
                for record in reader.iter_attachments():
                    self.attachments[record.name] = record.data
                self._chunks = sorted(
                    (c.chunk_start_offset, c.message_start_time, c.message_end_time)
                    for c in summary.chunk_indexes
                )
                span = statistics.message_start_time, statistics.message_end_time
                return Counter(statistics.channel_message_counts), span
            except Exception:  # cut off, or damaged: whatever wrong bytes lead to
                return None

    def _scan(self) -> tuple[Counter[int], tuple[int, int]]:
        """Count the messages of each channel, and find `span`, by reading all of it."""
        counts: Counter[int] = Counter()
        first, last = EVER, 0
        for channel, t, _ in self._messages():
            counts[channel] += 1
            first, last = min(first, t), max(last, t)
        return counts, (first, last) if counts else (0, 0)

    def _declare(self, record) -> None:
        """Take a schema or a channel."""
        if hasattr(record, "topic"):
            self._channels[record.id] = record.topic, self._schemas.get(record.schema_id, "")
        else:
            self._schemas[record.id] = record.name

    def _messages(
        self, begin: int = 0, end: int = EVER, topics: tuple[str, ...] = ()
    ) -> Iterator[tuple[int, int, bytes]]:
        """Channel, time of recording [ns] and CDR of each message from begin to before end.

        What is damaged is left out, and named in `damage`. Of a part only its chunks are read.
        """
        library, size = cdr.mcap(), self.path.stat().st_size
        start, stop = len(_MAGIC + _VERSION), size
        within = [at for at, first, last in self._chunks if last >= begin and first < end]
        if part := bool(self._chunks) and (begin > 0 or end < EVER):
            start, stop = (within[0], within[-1] + 1) if within else (size, size)
        damaged, whole, chunks = 0, False, []
        self._undeclared.clear()
        with self.path.open("rb") as file:
            good = file.seek(start)
            records = library.stream_reader.StreamReader(
                file, skip_magic=True, emit_chunks=True, record_size_limit=size
            ).records
            while good < stop:
                try:
                    record = next(records)
                except Exception as error:  # cut off, or damaged: whatever wrong bytes lead to
                    whole = isinstance(error, StopIteration)  # it ends as it should
                    break
                found = [record]
                if isinstance(record, library.records.Chunk):
                    try:
                        found = library.stream_reader.breakup_chunk(record, validate_crc=True)
                        chunks.append((good, record.message_start_time, record.message_end_time))
                    except Exception:  # whatever the decompression makes of wrong bytes
                        damaged, found = damaged + 1, []
                yield from self._wanted(found, begin, end, topics)
                good = file.tell()
        said = [f"{damaged} damaged chunks are left out"] if damaged else []
        for number, count in self._undeclared.items():
            said.append(f"{count} messages of channel {number}, not declared, are left out")
        if part and not said:
            return
        self._chunks = self._chunks or chunks
        if not (whole or part):
            left = f": its last {size - good} bytes are no whole record" if good < size else ""
            said.append(f"ends without an index{left}")
        self.damage = "; ".join(said)

    def _wanted(
        self, records: list, begin: int, end: int, topics: tuple[str, ...]
    ) -> Iterator[tuple[int, int, bytes]]:
        """Return the messages of the topics and of the time; other records are kept."""
        library = cdr.mcap().records
        for record in records:
            if isinstance(record, library.Message):
                if record.channel_id not in self._channels:
                    self._undeclared[record.channel_id] += 1
                    continue
                here = not topics or self._channels[record.channel_id][0] in topics
                if here and begin <= record.log_time < end:
                    yield record.channel_id, record.log_time, record.data
            elif isinstance(record, library.Attachment):
                self.attachments[record.name] = record.data
            elif isinstance(record, (library.Schema, library.Channel)):
                self._declare(record)
