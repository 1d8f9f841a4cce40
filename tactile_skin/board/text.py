# SPDX-License-Identifier: Apache-2.0
"""Lines of numbers -> frames, as a description says how a sketch prints them.

Readings are separated by commas, semicolons, tabs or spaces, one kind a line; runs of spaces count
as one, and a separator may end the line. `nan`, `-`, or nothing between two separators stands for a
crossing that was not read. Brackets in pairs, or at the ends of a line, labels (a name, then a
colon or an equals sign) and escape sequences are passed over. Decimals, as of a mean of
several scans, keep their fraction.

A line holds a frame, a row or one reading. Where a row or a reading does not say which one it is
(`{row}`, `{col}`, `{index}`), a frame begins behind a line that holds no readings, or with two
opening brackets, or where a terminal is cleared.
"""

from __future__ import annotations

import dataclasses
import math
import re
from operator import ne

import numpy as np

from ..readings.scale import below_zero, other_scale
from .frame import NAMES, Frame, Parser, about

_PLAIN = b"0123456789., \t\r;"  # what a line of numbers holds, and
_WORDS = b"-naNA"  # what stands for one that is missing
_DIGITS = b"0123456789.-"
_ABSENT = {b"", b"-", b"nan", b"NaN", b"NAN"}
_SEPARATORS = b",;\t"
_NEWS = 1.25  # by which a number exceeds what was named before it is named: each text is news
_ALIKE = 0.15  # by which the share of plain bytes of a damaged line may differ from a sound one's
_PIECE = 0.5  # of a sound line's numbers that a damaged one has, at least
_NUMBER = re.compile(rb"\d+")
LABEL = re.compile(rb'"?[A-Za-z_][\w .]*"?(?:\[\d+\])?[ \t]*[:=]')
_NAMES = r"[\s\[({]*" + LABEL.pattern.decode() + r"[ \t]*"  # of a place, as of a JSON object
HEX = re.compile(rb"(?<![\w.])(?:0[xX])?([0-9A-Fa-f]{1,8})(?![\w.]|[ \t]*[:=])")
_OPEN, _CLOSE = b"[({<", b"])}>"
# A word of a line that is no number, with the number behind it.
_WORD = re.compile(rb"\b(?!nan\b)[a-z_]\w*(?:[ \[]\d+)?", re.IGNORECASE)
MATS = 4  # boards, at most, that print in turn on one line, and
_OUT_OF_TURN = 0.2  # of the share of names that change, that from turn to turn: lines get lost
BLANKED = bytes.maketrans(_OPEN + _CLOSE, b" " * 8)
_AT_ENDS = re.compile(rb"^[\s\[({<]+|[\s\])}>]+(?=[,;\s]*$)")
# A frame of rows in brackets, or one on a terminal that is cleared, or whose cursor goes home.
BEGINS = re.compile(rb"^[\s,]*[\[({][\s]*[\[({]|^[\s]*\x1b\[[0-9;]*[HJf]")
_ESCAPES = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")  # of a terminal: colours, clear, cursor home
ENDS = re.compile(rb"[\])}]\s*[\])}][,;\s]*$")
_FIELD = re.compile(r"\{(row|col|index|skip|values)\}")
_VALUES, _PLACES = "values", ("index", "row", "col")


def unescaped(line: bytes) -> bytes:
    """Return a line without the escape sequences of a terminal."""
    return _ESCAPES.sub(b"", line) if b"\x1b" in line else line


def in_decimals(text: bytes) -> bytes:
    """Return a text with decimal numbers in place of hexadecimal ones."""
    return HEX.sub(lambda number: b"%d" % int(number[1], 16), text)


def line(samples: np.ndarray) -> bytes:
    """Return a frame as sketches print it; samples: (rows, cols) whole numbers, in ADC steps."""
    return b",".join(b"%d" % s for s in samples.ravel().tolist()) + b"\r\n"


@dataclasses.dataclass(frozen=True)
class TextFormat:
    """How a board prints its frames; the default reads a frame, or a row, of numbers a line.

    Raises:
        ValueError: a line without `{values}`, or with a field twice; an empty line end; a `first`
            or a full scale out of range.
    """

    line: str = about(
        "a line of readings as it is printed: {values}, with {row}, {col} or {index} of the first "
        "of them, and {skip} for what is none",
        "{values}",
    )
    end: str = about("what ends a line", "\n")
    first: int = about("the first {row}, {col} or {index}", 0, 0, 1)
    hexadecimal: bool = about("the numbers are, with or without 0x in front", False)
    full_scale: float = about(
        "what is printed of an input at the supply; 0: 2^adc_bits - 1, ADC steps", 0.0, 0.0, 2e7
    )
    request: str = about("what asks the board for a frame; empty: it sends by itself", "")

    def __post_init__(self):
        fields = [name for name in _FIELD.findall(self.line) if name != "skip"]
        if _VALUES not in fields or len(set(fields)) < len(fields):
            raise ValueError(
                f"format.line = {self.line!r}: must hold {{values}} once, and each of {{row}}, "
                "{col} and {index} at most once"
            )
        if not self.end:
            raise ValueError("format.end is empty: must be what ends a line")

    @property
    def places(self) -> list[str]:
        """Which of row, col and index a line states."""
        return [name for name in _FIELD.findall(self.line) if name in _PLACES]

    def pattern(self) -> re.Pattern:
        """Return what a line of readings matches, without its end."""
        parts = []
        for text, name in zip(*[iter([*_FIELD.split(self.line), ""])] * 2, strict=True):
            words = text.split()
            if text and not words:
                parts.append(r"[ \t]+")
            elif words:
                parts += [r"[ \t]*", r"[ \t]*".join(map(re.escape, words)), r"[ \t]*"]
            if name == _VALUES:
                parts.append("(?P<values>.*)")
            elif name == "skip":
                parts.append(".*?")
            elif name:
                parts.append(rf"(?:{_NAMES})?(?P<{name}>\d+)")
        return re.compile("".join(parts).encode(), re.DOTALL)


class TextParser(Parser):
    """Frames from lines of numbers.

    There is no CRC: a line counts only if it holds as many numbers as a frame, a row or, where it
    says which, one reading; each in the ADC's range, in digits and a decimal point, or one that was
    not read. A digit that the wire changed into another goes unnoticed. Other lines are passed over
    unless they look like readings that were damaged. Frames of several names that come in turn, as
    `L:` and `R:`, are of several boards: none of them counts.

    Numbers with decimals, none above 5.5 or 1/400 of the ADC's range, may be volts, shares of the
    supply or kohm: no frames until a larger one arrives, or `full_scale` says what they are.
    """

    def __init__(self, rows: int, cols: int, adc_bits: int = 10, fmt: TextFormat | None = None):
        self.format = fmt or TextFormat()
        super().__init__((rows, cols), self.format.request)
        self.rows, self.cols, self.adc_bits = rows, cols, adc_bits
        self._end = self.format.end.encode()
        self._pattern = None if self.format.line == "{values}" else self.format.pattern()
        self._cells = rows * cols
        places = self.format.places
        self._piece = {("row",): cols, ("col",): rows, (): cols}.get(tuple(places), 1)
        self._placed = bool(places)
        self._buffer = bytearray()
        self._in_line = False  # what comes before the first line end is the rest of a line
        self._longest = 24 * self._cells + 256  # bytes of a line, with its labels
        self._sound = 1.0, self._cells  # plain share and numbers of the last line of readings
        self._few = 0  # numbers of the last line that held far fewer
        self._trails = False  # a separator ends the board's lines
        self._empty_ends = 0  # lines that end with an empty field
        self._volts = self.format.full_scale == 0.0  # the numbers may be
        self._values = np.zeros(self._cells)  # of the frame that is put together [ADC steps]
        self._filled = np.zeros(self._cells, bool)
        self._next = -1  # cell that the next row begins with; -1: a frame has not begun
        self._early = False  # a frame is known to end with its last row
        self._name = self._heading = b""  # words of the last line of readings, and of another

    def _cut(self, data: bytes) -> list[Frame]:
        self._buffer += data
        *lines, rest = self._buffer.split(self._end)
        self._buffer = rest
        frames: list[Frame] = []
        for line in lines:
            if self._in_line:
                frames += self._line(bytes(line))
            else:
                self.counters.skipped_bytes += len(line) + len(self._end)
            self._in_line = True
        if len(self._buffer) > self._longest:
            self.counters.skipped_bytes += len(self._buffer)
            self._buffer.clear()
            self._in_line = False
        return frames

    def _line(self, line: bytes) -> list[Frame]:
        """Return the frame that a line completes, if any."""
        opens, line = BEGINS.match(line), unescaped(line)
        match = self._pattern.fullmatch(line) if self._pattern else None
        numbers = None
        if len(line) <= self._longest and (match or not self._pattern):
            numbers = self._numbers(match["values"] if match else line)
        size = 0 if numbers is None else numbers.size
        frame = size == self._cells and not self._placed
        if numbers is None or not (frame or size == self._piece):
            return self._no_reading(line)
        self._sound, self._name = (_plain(line), size), _words(line)
        steps = self._in_range(numbers, b"." in line)
        if steps is None:
            self._spoil()
            return []
        if frame:
            self._next = -1
            return self._frame(steps)
        if self._placed:
            return self._place(steps, match.groupdict() if match else {})
        before = self._border() if opens else []
        return before + self._follow(steps) + (self._border() if ENDS.search(line) else [])

    def _no_reading(self, line: bytes) -> list[Frame]:
        """Pass over a line of another kind, which ends a frame of rows; or count a damaged one."""
        share, wanted = self._sound
        n = len(_NUMBER.findall(line))
        few = n < _PIECE * wanted
        regular, self._few = few and n == self._few, n if few else self._few
        if line.strip() and _plain(line) >= share - _ALIKE and not regular:
            self._spoil()
            return []
        self.counters.passed += 1
        frames = self._border()
        heading = _words(line) or self._heading
        if heading and not (self._heading or self.counters.boards):
            self.counters.names.clear()  # those of earlier frames were not heard
        self._heading = heading
        return frames

    def _spoil(self) -> None:
        """Drop what is left of the frame, since a line was damaged."""
        self.counters.corrupt += 1
        self._next = -1
        self._filled[:] = False

    # --- rows in their order

    def _follow(self, steps: np.ndarray) -> list[Frame]:
        if self._next < 0:
            return []
        if self._next == self._cells:  # it was not the last row
            self._spoil()
            self._early = False
            return []
        self._values[self._next : self._next + steps.size] = steps
        self._next += steps.size
        return self._frame(self._values) if self._early and self._next == self._cells else []

    def _border(self) -> list[Frame]:
        """End a frame here, and begin another."""
        whole, begun = self._next == self._cells, self._next > 0
        self._next = 0
        if whole and not self._early:
            self._early = True
            return self._frame(self._values)
        if begun and not whole:
            self.counters.corrupt += 1
            self._in_turn()  # its name is known nevertheless
        return []

    # --- rows or readings that say which they are

    def _place(self, steps: np.ndarray, at: dict[str, bytes]) -> list[Frame]:
        first = self.format.first
        index, row, col = (int(at.get(name, first)) - first for name in _PLACES)
        if not (0 <= row < self.rows and 0 <= col < self.cols and 0 <= index < self._cells):
            self._spoil()
            return []
        start = index + row * self.cols + col
        column = self.format.places == ["col"]
        cells = slice(start, None, self.cols) if column else slice(start, start + steps.size)
        if start == 0:
            self.counters.corrupt += bool(self._filled.any())
            self._filled[:] = False
        elif not self._filled[0]:  # the frame's begin was missed
            return []
        elif self._filled[cells].any():
            self._spoil()
            return []
        self._values[cells], self._filled[cells] = steps, True
        if not self._filled.all():
            return []
        self._filled[:] = False
        return self._frame(self._values)

    # --- numbers

    def _frame(self, steps: np.ndarray) -> list[Frame]:
        unread = np.isnan(steps)
        # nothing was read, or the frame was sent as nothing; or nobody knows whose it is
        if self._in_turn() or unread.all():
            self.counters.corrupt += 1
            return []
        # what is not read travels beside the samples; a board of 16 bits has no fraction to keep
        known = np.where(unread, 0.0, steps)
        crossings = unread.reshape(self.rows, self.cols) if unread.any() else None
        return [self._numbered(known, self.adc_bits, crossings)]

    def _in_turn(self) -> bool:
        """Whether several boards print in turn: the names of frames, or those above them, do.

        Once they do, it holds as long as two of the names still arrive: a line may be lost.
        """
        counters = self.counters
        texts = self._name or b"(no name)", self._heading
        counters.names.append((*texts, *(text.translate(None, b"0123456789") for text in texts)))
        turns = [set(each) for each in zip(*counters.names, strict=True) if _take_turns(each)]
        if turns:
            counters.boards = tuple(sorted(turns[0]))
        elif counters.boards:
            recent = set().union(*counters.names).intersection(counters.boards)
            if len(counters.names) < NAMES or len(recent) < 2:
                counters.boards = ()
        return bool(counters.boards)

    def _numbers(self, text: bytes) -> np.ndarray | None:
        """Return a line's numbers, NaN for those not read; None if it holds anything else."""
        if self.format.hexadecimal:
            text = in_decimals(text)
        if text.translate(None, _PLAIN + _WORDS):
            if b":" in text or b"=" in text:
                text = LABEL.sub(b" ", text)
            if not _balanced(text):
                text = _AT_ENDS.sub(b" ", text)
            if _balanced(text):
                text = text.translate(BLANKED)
            if text.translate(None, _PLAIN + _WORDS):
                return None
        kinds = [b for b in _SEPARATORS if b in text]
        if len(kinds) > 1 and ord("\t") in kinds:  # tabs beside commas are blanks
            kinds.remove(ord("\t"))
            text = text.replace(b"\t", b" ")
        if len(kinds) > 1:
            return None
        if kinds:
            words = [w.strip() for w in text.strip(b" \r").split(bytes(kinds))]
            words = self._without_trailing(words)
        else:
            words = text.split()
        if any(w.translate(None, _DIGITS) for w in words if w not in _ABSENT):
            return None
        try:
            return np.array([math.nan if w in _ABSENT else float(w) for w in words])
        except ValueError:  # two points in a number
            return None

    def _without_trailing(self, words: list[bytes]) -> list[bytes]:
        """Return the fields without the one that a separator at the line's end would add.

        Where lines are known to end with one, an empty last field is a number that was lost.
        """
        if words[-1] or len(words) == 1:
            return words
        _, wanted = self._sound
        self._trails = self._trails or len(words) - 1 == wanted
        if len(words) == wanted and not self._trails:
            self._empty_ends += 1
            if self._empty_ends > 1:
                return words
        return words[:-1]

    def _in_range(self, numbers: np.ndarray, decimals: bool) -> np.ndarray | None:
        """Return the numbers in ADC steps; None if they cannot be, or may be volts."""
        if np.isnan(numbers).all():
            return numbers
        largest, top = float(np.nanmax(numbers)), 2**self.adc_bits - 1
        if np.nanmin(numbers) < -below_zero(self.format.full_scale or top):
            return None
        numbers = np.maximum(numbers, 0.0)
        if self.format.full_scale:
            numbers = numbers * (top / self.format.full_scale)
            beyond = largest * top > (top + 0.5) * self.format.full_scale  # rounded on the board
            numbers = np.minimum(numbers, top)
        else:
            beyond = largest > top
        counters = self.counters
        if beyond:
            counters.out_of_range += 1
            if largest > _NEWS * counters.largest:
                counters.largest = largest
            return None
        self._volts = self._volts and largest <= other_scale(top)
        return None if self._volts and decimals else numbers


def _balanced(text: bytes) -> bool:
    return all(text.count(a) == text.count(b) for a, b in zip(_OPEN, _CLOSE, strict=True))


def _words(line: bytes) -> bytes:
    """Return the words of a line without what stands between them."""
    return b" ".join(_WORD.findall(line)) if line.translate(None, _PLAIN) else b""


def _take_turns(names: tuple[bytes, ...]) -> bool:
    """Whether names, of which there are several, come again and again in one order."""
    if not 2 <= len(set(names)) <= len(names) // 2:
        return False
    changes, *later = (
        sum(map(ne, names[n:], names)) / (len(names) - n)
        for n in range(1, min(MATS, len(names) // 2) + 1)
    )
    return min(later) < _OUT_OF_TURN * changes


def _plain(line: bytes) -> float:
    """Return the share of a line's bytes that a line of numbers may hold."""
    line = line.strip()
    return 1.0 - len(line.translate(None, _PLAIN + _WORDS)) / max(len(line), 1)
