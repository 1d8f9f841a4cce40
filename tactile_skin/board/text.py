"""Lines of numbers <-> frames: one frame a line, as hobby sketches print them.

Numbers are separated by commas, semicolons, tabs or spaces, one kind a line; runs of spaces count
as one, and a separator may end the line. `nan`, `-`, or nothing between two separators stands for a
crossing that was not read. Decimals, as of a mean of several scans, keep their fraction.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .frame import Counters, Frame

BAUD = "is serial_driver.baud that of the board's sketch?"
_SEQUENCES = 1 << 16
_PLAIN = b"0123456789., \t\r;"  # what a line of numbers holds, and
_WORDS = b"-naNA"  # what stands for one that is missing
_DIGITS = b"0123456789."
_ABSENT = {b"", b"-", b"nan", b"NaN", b"NAN"}
_NEGATIVE = "negative numbers: print what the ADC reads, and set circuit.adc_offset"
_SEPARATORS = b",;\t"
_PRINTABLE = bytes(range(32, 127)) + b"\t\r\n"
_MANY = 64  # bytes that are enough to tell text from noise
_STRANGE = 0.05  # of a text's bytes are no text, at least, where the baud rate is wrong
_NEWS = 1.25  # by which a number exceeds what was named before it is named: each text is news


def line(samples: np.ndarray) -> bytes:
    """A frame as sketches print it; samples: (rows, cols) whole numbers, in ADC steps."""
    return b",".join(b"%d" % s for s in samples.ravel().tolist()) + b"\r\n"


class Unknown:
    """What bytes are in which no frame is found."""

    def __init__(self):
        self._bytes = self._strange = self._digits = self._lines = 0

    def feed(self, data: bytes) -> None:
        self._bytes += len(data)
        self._strange += len(data.translate(None, _PRINTABLE))
        self._digits += len(data) - len(data.translate(None, b"0123456789"))
        self._lines += data.count(b"\n")

    @property
    def is_noise(self) -> bool:
        return self._bytes >= _MANY and self._strange > _STRANGE * self._bytes

    @property
    def is_text(self) -> bool:
        """Lines of numbers, that is: any bytes may look like letters."""
        enough = self._bytes >= _MANY and self._lines and self._digits > 0.25 * self._bytes
        return bool(enough and not self.is_noise)


@dataclass
class TextParser:
    """Frames from lines of numbers.

    There is no CRC: a line counts only if it holds exactly rows * cols fields, each a number in the
    ADC's range, in digits and a decimal point, or one that was not read. A digit that the wire
    changed into another goes unnoticed.

    Args:
        recognise: takes all bytes while there was no frame, and says whose they are if they are
            known to be of another protocol.
    """

    rows: int
    cols: int
    adc_bits: int = 10
    counters: Counters = field(default_factory=Counters)
    recognise: Callable[[bytes], str] = field(default=lambda data: "", repr=False)

    def __post_init__(self):
        self._buffer = bytearray()
        self._in_line = False  # what comes before the first line end is the rest of a line
        self._longest = 12 * self.rows * self.cols + 2
        self._unknown: Unknown | None = Unknown()  # until the first frame
        self._reasons: Counter[str] = Counter()  # why lines were no frames, since one was
        self._foreign = ""  # whose bytes they are, if of another protocol
        self._trails = False  # a separator ends the board's lines
        self._empty_ends = 0  # lines that end with an empty field
        self.trouble = ""  # what is wrong with most lines, for a person; empty: no numbers

    wanted = 1  # a line's length is not known before its end

    def feed(self, data: bytes) -> list[Frame]:
        """Take a chunk; returns the frames that it completes, oldest first."""
        self._buffer += data
        *lines, rest = self._buffer.split(b"\n")
        self._buffer = rest
        frames = []
        for line in lines:
            if self._in_line:
                frame = self._frame(bytes(line))
                frames += [frame] if frame is not None else []
            else:
                self.counters.skipped_bytes += len(line) + 1
            self._in_line = True
        if len(self._buffer) > self._longest:
            self.counters.skipped_bytes += len(self._buffer)
            self._buffer.clear()
            self._in_line = False
        if self._unknown is not None:
            self._identify(data)
        return frames

    def _identify(self, data: bytes) -> None:
        """Say what the bytes are, while there is no frame in them."""
        self._unknown.feed(data)
        self._foreign = self.recognise(data) or self._foreign
        noise = f"the bytes are not text: {BAUD}" if self._unknown.is_noise else ""
        self.trouble = self._foreign or noise or self.trouble

    def _frame(self, line: bytes) -> Frame | None:
        steps, trouble = self._numbers(line)
        if steps is not None:
            trouble = self._wrong(steps)
        if steps is None or trouble:
            self.counters.corrupt += 1
            self._reasons[trouble] += 1
            if self._reasons[trouble] == max(self._reasons.values()):
                self.trouble = trouble
            if len(self._reasons) > 64:
                self._reasons.clear()
            return None
        self._reasons.clear()
        self.trouble, self._unknown = "", None
        unread = np.isnan(steps)
        # what is not read travels beside the samples; a board of 16 bits has no fraction to keep
        samples = np.rint(np.where(unread, 0.0, steps) * 2 ** (16 - self.adc_bits))
        samples = samples.astype(np.uint16).reshape(self.rows, self.cols)
        self.counters.frames += 1
        sequence = self.counters.frames % _SEQUENCES
        unread = unread.reshape(samples.shape) if unread.any() else None
        return Frame(samples, self.adc_bits, sequence, None, unread)

    def _numbers(self, line: bytes) -> tuple[np.ndarray | None, str]:
        """The line's numbers, NaN for those not read; or None, and what is wrong."""
        if len(line) > self._longest:  # of which the buffer drops a part, or not: as it was cut
            return None, ""
        kinds = [b for b in _SEPARATORS if b in line]
        if len(kinds) > 1 and ord("\t") in kinds:  # tabs beside commas are blanks
            kinds.remove(ord("\t"))
            line = line.replace(b"\t", b" ")
        if len(kinds) > 1:
            return None, (
                "lines with commas and semicolons: print one kind of separator, and decimals with "
                "a point"
            )
        if kinds:
            words = [w.strip() for w in line.strip(b" \r").split(bytes(kinds))]
            words = self._without_trailing(words)
        else:
            words = line.split()
        if line.translate(None, _PLAIN + _WORDS):
            return None, ""
        if line.translate(None, _PLAIN):
            for word in words:
                if word not in _ABSENT and word.translate(None, _DIGITS):
                    negative = word[:1] == b"-" and not word[1:].translate(None, _DIGITS)
                    return None, _NEGATIVE if negative else ""
        try:
            steps = np.array([math.nan if w in _ABSENT else float(w) for w in words])
        except ValueError:
            return None, ""
        if np.isnan(steps).all():
            return None, "lines in which no crossing was read" if steps.size > 1 else ""
        return steps, ""

    def _without_trailing(self, words: list[bytes]) -> list[bytes]:
        """A separator that ends the line adds no field; an empty last field does.

        Where lines are known to end with one, an empty last field is a number that was lost.
        """
        wanted = self.rows * self.cols
        if words[-1] or len(words) == 1:
            return words
        self._trails = self._trails or len(words) == wanted + 1
        if len(words) == wanted and not self._trails:
            self._empty_ends += 1
            if self._empty_ends > 1:
                return words
        return words[:-1]

    def _wrong(self, steps: np.ndarray) -> str:
        """Which setting does not go with a line of these numbers; empty if none."""
        wanted = self.rows * self.cols
        if steps.size != wanted:
            return (
                f"lines hold {steps.size} numbers, but circuit.rows = {self.rows} x "
                f"circuit.cols = {self.cols} are {wanted}: set circuit.rows and circuit.cols"
            )
        largest = float(np.nanmax(steps))
        if largest > 2**self.adc_bits - 1:
            counters = self.counters
            counters.out_of_range += 1
            if largest > _NEWS * counters.largest:
                counters.largest = largest
            bits = max(math.floor(math.log2(counters.largest)) + 1, self.adc_bits)
            advice = f"set circuit.adc_bits: {bits}"
            if bits > 16 or bits == self.adc_bits:
                advice = "these are not ADC steps"
            return (
                f"numbers up to {counters.largest:g}, but circuit.adc_bits = {self.adc_bits} ends "
                f"at {2**self.adc_bits - 1}: {advice}"
            )
        return ""
