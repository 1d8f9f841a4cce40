# SPDX-License-Identifier: Apache-2.0
"""Lines of text: which of them hold readings, and what else stands in them.

Lines that are alike but for their numbers are one kind; the kind with the most numbers holds the
readings. A number in front that counts through a frame says which row or cell follows, one that
only rises is a time or a counter. The parser proves it: it reads the sample by the description.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ...readings.scale import below_zero
from ..protocol import MAX_LINES
from ..text import (
    BEGINS,
    BLANKED,
    ENDS,
    LABEL,
    MATS,
    TextFormat,
    TextParser,
    in_decimals,
    unescaped,
)
from .columns import (
    EVEN,
    FEW,
    STEADY,
    cycle,
    in_front,
    likely_less,
    may_be_less,
    more_behind,
    more_in_front,
    roles,
)
from .hexadecimal import may_be_hexadecimal, with_letters
from .seen import Seen

_KINDS_SOUND = 0.9  # share of the blocks of lines that have the same size
_NEGATIVE = 0.1  # share of the lines that hold a negative number: fewer are damaged
_FEWEST_CELLS = 4  # of a frame that is sure: what a damaged stream leaves seems to have fewer
# A row is so much more like that of the frame before than like the next row: where another kind of
# line stands behind so many rows, where nothing does, and where lines are numbered.
_LIKE_BEFORE = 0.7
_LIKE_BEFORE_UNMARKED = 0.5
_LIKE_BEFORE_NUMBERED = 0.9
_SHOWN_LINES = 3  # lines of readings in a sample
_NAME_SHOWN = 24  # characters
_TIME = re.compile(rb"(?:\d+-\d+-\d+[T ])?\d+:\d+:\d+(?:[.,]\d+)?|\d+-\d+-\d+")
# A name, or a place such as (0, 1), and a mark behind.
_MARK = re.compile(
    rb"^(?P<label>[^,;\t]*?(?:\d,[^,;\t]{0,3}\d[^,;\t]*?)?(?:[:=]|->))(?P<rest>[^:=]*)$", re.DOTALL
)
# Words, with numbers among them, and a blank in front of readings that other marks separate.
_WORDS = re.compile(
    rb"^(?P<label>[^,;\t]{0,40}[^\d\s,;.\-\[({][^,;\t]{0,40})(?: +|[ \t]+(?=[^\t]*$))"
    rb"(?P<rest>-?[\d.][^\s,;]* *[,;\t].*)$",
    re.DOTALL,
)
_CHECK = re.compile(rb"\*[ \t]*[0-9A-Fa-f]{1,8}[ \t]*$")  # as NMEA ends a line
_NAME = LABEL.pattern.decode()
_LABELS = re.compile(rb"[\[{(\s]*" + LABEL.pattern)
_COMMAS = re.compile(rb"(?:\d,\d+, +-?){3}")  # of fractions
_GLUE = re.compile(rb"-?\d")
_GLUED = "a number with signs at it, as in 12#3F, may be a reading: print separators between"
_MATS = (
    "the numbers stand in several arrays: of one mat, or of two? docs/formats.md says how two mats "
    "on one board are entered"
)
_NUMBER = "\0"  # in a label: no board prints it in a line
_ROW = re.compile(rf"\b(?:row|r)[\W_]*{_NUMBER}", re.IGNORECASE)
_INTEGER = re.compile(r"\d+")
_WHOLE = re.compile(rb"\s*\d+(?=[\s,]*$)")
_NO_TEXT = re.compile("[^ -}]+")  # what differs from line to line, `~` in place of a time
_NUMERIC = re.compile(rb"-?(?:\d+\.?\d*|\.\d+)|-|nan|NaN|NAN")
_LINE_ENDS = (b"\n", b"\r", b"#", b">", b"]", b"}", b"|", b"$", b"!")


@dataclass(frozen=True)
class _Line:
    """A line taken apart: text in front with its numbers, fields, readings, fields behind."""

    label: str  # _NUMBER in place of each number
    lead: tuple[float, ...]  # these numbers
    front: int  # fields in front that are no numbers
    values: tuple[float, ...]
    behind: int
    separator: str
    check: str  # the description of a checksum behind; empty: there is none
    opens: bool
    closes: bool
    doubt: str  # why the numbers may not be the readings of one mat; empty: nothing is known

    @property
    def kind(self) -> tuple:
        return self.label, self.front, len(self.values), self.behind, self.separator, self.check


def _number(word: bytes) -> float:
    return np.nan if word.strip(b"-").lower() in (b"", b"nan") else float(word)


def _take_apart(line: bytes, hexadecimal: bool = False) -> _Line | None:
    """None where a line holds no number, or more that is none."""
    opens, closes = bool(BEGINS.match(line)), bool(ENDS.search(line))
    line = unescaped(line)
    body = _TIME.sub(lambda time: b" ".join([b"~"] * len(time[0].split())), line.strip())
    body, checks = _CHECK.subn(b"", body)
    marks = list(_LABELS.finditer(body))
    label, doubt = b"", ""
    if len(marks) >= 2:
        ends = [m.start() for m in marks[1:]] + [len(body)]
        pieces = [body[m.end() : end] for m, end in zip(marks, ends, strict=True)]
        sizes = [len(re.findall(rb"[\d.]+", piece)) for piece in pieces]
        framed = max(sizes) > len(sizes)  # one of them holds the readings
        usual = max(sizes) if framed or len(sizes) == 2 else Counter(sizes).most_common(1)[0][0]
        k = sizes.index(usual)
        if framed and set(sizes[k + 1 :]) == {1}:
            pieces[k + 1 :] = [b"~," if b"," in pieces[k] else b"~"] * len(pieces[k + 1 :])
        doubt = _MATS if framed and sum(size > 1 for size in sizes[k:]) > 1 else ""
        if k:
            joints = [
                (whole[0] if (whole := _WHOLE.match(piece)) else b"~") + b"," * (b"," in piece)
                for piece in pieces[:k]
            ]
            label = b"".join(m.group() + j for m, j in zip(marks, joints, strict=False))
            label += marks[k].group()
        body = b" ".join(pieces[k:])
    elif match := _MARK.match(body) or _WORDS.match(body):
        label, body = match["label"], match["rest"]
    text = label.decode("ascii", "replace")
    lead = tuple(float(n) for n in _INTEGER.findall(text))
    text = _INTEGER.sub(_NUMBER, _NO_TEXT.sub("{skip}", text))
    if _COMMAS.search(body):
        return None
    body = in_decimals(body) if hexadecimal else body
    body = body.translate(BLANKED).strip()
    counts = {s: body.count(s) for s in (b",", b";", b"\t")}
    separator = max(counts, key=lambda mark: counts[mark]) if any(counts.values()) else b" "
    words = body.split() if separator == b" " else [w.strip() for w in body.split(separator)]
    if words and not words[-1]:
        words.pop()
    numeric = [bool(_NUMERIC.fullmatch(w)) or not w for w in words]
    if not any(n and w for n, w in zip(numeric, words, strict=True)):
        return None
    front = numeric.index(True)
    end = len(words) - numeric[::-1].index(True)
    if not all(numeric[front:end]) or 2 * (end - front) < len(words):
        return None
    values, check = tuple(_number(w) for w in words[front:end]), "*{skip}" * checks
    around = words[:front] + words[end:]
    doubt = doubt or (_GLUED if any(_GLUE.match(w) for w in around) else "")
    behind, between = len(words) - end, separator.decode()
    return _Line(text, lead, front, values, behind, between, check, opens, closes, doubt)


def _template(kind: tuple, lead: list[str], front: list[str], behind: int) -> str:
    """Return the description of a line; _NUMBER in its label stands for those of `lead`."""
    label, skips, _, more, separator, check = kind
    names = iter(lead)
    text = re.sub(_NUMBER, lambda _: f"{{{next(names)}}}", label)
    fields = ["{skip}"] * skips + [f"{{{name}}}" for name in front] + ["{values}"]
    fields += ["{skip}"] * (more + behind)
    return f"{text} {separator.join(fields)}{check}".strip()


# --- the sample ----------------------------------------------------------------------------------


def _blocks(lines: list[_Line | None], kind: tuple) -> list[int]:
    """How many lines of a kind stand between two others; those at both ends may be cut."""
    sizes = [0]
    for line in lines:
        here = line is not None and line.kind == kind
        if line is None or not here or line.opens:
            sizes.append(0)
        sizes[-1] += here
        if line is not None and here and line.closes:
            sizes.append(0)
    return [size for size in sizes[:-1] if size][1:]


def _apart(values: np.ndarray, lag: int) -> float:
    """How far the readings of most lines are from those of the line `lag` before [as printed].

    The median over the lines: under a touch they move by more than rows differ.
    """
    return float(np.nanmedian(np.nanmean(np.abs(values[lag:] - values[:-lag]), axis=1)))


def _numbers_mats(column: np.ndarray, values: np.ndarray) -> bool:
    """Whether a number that counts few lines may be that of the mat: lines are like those before.

    A counter's are not: without a touch all are alike.
    """
    n = int(np.ptp(column)) + 1
    counts = 2 <= n <= MATS and cycle(column) == n
    return counts and _apart(values, n) < _LIKE_BEFORE_NUMBERED * _apart(values, 1)


def _repeats_after(values: np.ndarray) -> int:
    """After how many lines, more than one, a line comes again; 0: each is like the one before."""
    most = min(MAX_LINES, len(values) // 3)
    if most < 2:
        return 0
    apart = [_apart(values, lag) for lag in range(1, most + 1)]
    best = int(np.argmin(apart)) + 1
    return best if best > 1 and apart[best - 1] < _LIKE_BEFORE_UNMARKED * apart[0] else 0


def recognise_lines(
    data: bytes, shape: tuple[int, int] | None = None, hexadecimal: bool | None = None
) -> Seen:
    """Return what text is; `shape` is the (rows, cols) that are expected, if any.

    Numbers are hexadecimal if that is said, or where letters stand among them.
    """
    often = [end for end in _LINE_ENDS if data.count(end) > FEW]
    end = next(iter(often or [end for end in _LINE_ENDS if data.count(end) > 1]), None)
    if end is None:
        digits = len(data) - len(data.translate(None, b"0123456789"))
        words = "numbers arrive, but no line ever ends: end each frame by Serial.println()"
        return Seen("", words if digits > len(data) / 4 else _NO_NUMBERS, data, text=True)
    raw = data.split(end)[1:-1]
    letters = with_letters(raw) if hexadecimal is None else hexadecimal
    lines = [_take_apart(line, letters) for line in raw]
    kinds = Counter(line.kind for line in lines if line)
    if not kinds:
        return Seen("", _NO_NUMBERS, next(filter(bytes.strip, raw), data), text=True)
    kind = max(kinds, key=lambda each: (each[2] * kinds[each], each[2]))
    sample = b"".join(line + end for line in raw[: _SHOWN_LINES * len(raw) // kinds[kind]])
    lines, kind = _without_names(lines, kinds, kind, shape)
    decimals = any(
        b"." in line for line, parts in zip(raw, lines, strict=True) if parts and parts.kind == kind
    )
    found = replace(_structure(lines, kind, end, shape), decimals=decimals)
    if isinstance(found.format, TextFormat):
        found = replace(found, format=replace(found.format, hexadecimal=letters))
    found = _proved(replace(found, sample=sample, text=True), data, shape)
    numbers = [
        word
        for line, parts in zip(raw, lines, strict=True)
        if parts and parts.kind == kind
        for word in re.findall(rb"[\d.]+", line)[-kind[2] :]
    ]
    if hexadecimal is not None or letters or not (digits := may_be_hexadecimal(numbers)):
        return found
    about = f"{found.about}; numbers of {digits} digits may be hexadecimal"
    return replace(found, about=about, sure=False, digits=digits * found.sure)


def _without_names(lines, kinds: Counter, kind: tuple, shape) -> tuple[list, tuple]:
    """Return lines and their kind without the names that rows have in turn, such as A:, B:, C:."""
    alike = {k for k, n in kinds.items() if k[1:] == kind[1:] and 2 * n >= kinds[kind]}
    if len(alike) < 2 or not all(re.fullmatch(_NAME, each[0]) for each in alike):
        return lines, kind
    names = " ".join(sorted(each[0] for each in alike))
    doubt = f"{names} may begin the rows of one mat, or lines of several mats"
    doubt = "" if shape == (len(alike), kind[2]) else doubt
    mats = bool(shape) and shape[0] * shape[1] == kind[2]  # a line is a frame: one of them is read
    bare = [
        replace(line, label=line.label if mats else "", doubt=line.doubt or doubt)
        if line and line.kind in alike
        else line
        for line in lines
    ]
    return bare, kind if mats else ("", *kind[1:])


_NO_NUMBERS = (
    "text arrives, but no lines of numbers: print decimal numbers (no hexadecimal) with commas "
    "between, and points in fractions"
)
_SINGLE = "a reading a line: print its number in front (of one column, give rows and cols)"


def _structure(lines, kind: tuple, end: bytes, shape: tuple[int, int] | None) -> Seen:
    """Return what a frame is made of."""
    chosen = [line for line in lines if line and line.kind == kind]
    lead = np.array([line.lead for line in chosen])
    values = np.array([line.values for line in chosen])
    front, sure = (0, True) if kind[0] else in_front(values)
    cells = shape[0] * shape[1] if shape else 0
    more, clear = more_in_front(values[:, front:], cells)
    front += more
    numbers, values = np.hstack([lead, values[:, :front]]), values[:, front:]
    names, first, size, known = roles(numbers, values.shape[1], cells)
    # what stands among names, in front of the last of them, is no reading
    known = known or (kind[0].endswith((":", "=")) and not front)
    behind, ended = (0, True) if size else more_behind(values, cells)
    clear, values = clear and ended, values[:, : values.shape[1] - behind]
    clear = clear and bool(cells or not may_be_less(values))
    doubt = next((line.doubt for line in chosen if line.doubt), "")
    if values.shape[1] == cells and any(_numbers_mats(column, values) for column in numbers.T):
        doubt = doubt or "the numbers in front may be those of several mats that print in turn"
    width, sure = values.shape[1], sure and known and clear and not doubt
    line = _template(kind, names[: lead.shape[1]], names[lead.shape[1] :], behind)
    if not any((kind[0], kind[1], kind[3], kind[5], front, behind)):
        line = "{values}"
    fmt = TextFormat(line, end.decode(), first)

    def seen(about: str, shape=None, protocol="text", sure=sure) -> Seen:
        count = shape[0] * shape[1] if shape else width * (size[0] if size else 1)
        known = {"shape": shape, "cells": count, "sure": sure and count >= _FEWEST_CELLS}
        about = f"{about}; {doubt}" if doubt else about
        return Seen(protocol, about, b"", fmt if protocol else None, **known, **_scale(values))

    if np.mean((values < -below_zero(values.max())).any(1)) >= _NEGATIVE:
        return seen("negative numbers: print what the ADC reads, nothing subtracted", None, "")
    if len(size) == 2:
        return seen("a reading a line, with its row and column", size)
    if size and width == 1:
        return seen(f"a reading a line, with its number, {size[0]} a frame")
    if size:
        # a counter of frames that begins again looks like the number of a row
        next_to, below = _apart(values, 1), _apart(values, size[0])
        says_row = bool(_ROW.search(kind[0]))
        turned = (width, size[0]) == shape != (size[0], width) and not says_row
        named = says_row or turned or (size[0], width) == shape
        about = f"a {'column' if turned else 'row'} a line, with its number: {size[0]} of {width}"
        even = size[0] >= EVEN * width  # few of many are mats with a number, or a toggle in front
        differ = named or (even and below < _LIKE_BEFORE_NUMBERED * next_to)
        if turned:
            fmt = replace(fmt, line=fmt.line.replace("{row}", "{col}"))
        elif not differ:
            about += f", or a frame of {width} a line behind a counter: say which by rows and cols"
        sure = sure and differ and cells in (0, size[0] * width)  # else some may be none
        return seen(about, shape if turned else (size[0], width), sure=sure)
    if width == 1 != (shape or (0, 0))[1]:
        return seen(_SINGLE, None, "")
    blocks = _blocks(lines, kind)
    rows, often = Counter(blocks).most_common(1)[0] if blocks else (1, 0)
    if rows > 1 and often >= _KINDS_SOUND * len(blocks) and width != cells:
        next_to, below = _apart(values, 1), _apart(values, rows)
        differ = below < _LIKE_BEFORE * next_to or (rows, width) == shape
        if differ or not below:
            about = f"{width} numbers a line, {rows} lines, then another line: a row a line"
            return seen(about, (rows, width), sure=sure and differ)
        sure = False  # a frame a line, and another line at times?
    if width != cells and (period := _repeats_after(values)):
        about = (
            f"{width} numbers a line, and the lines repeat after {period}: a row a line, but "
            "nothing says where a frame begins: print an empty line after each"
        )
        return seen(about, (period, width), "", sure=False)
    extra = " and ".join(
        f"{n} {where}"
        for n, where in (
            (kind[1] + numbers.shape[1], "in front"),
            (behind + kind[3] + bool(kind[5]), "behind"),
        )
        if n
    )
    about = f"a frame a line, {width} readings" + (f", {extra} that are none" if extra else "")
    sure = sure and bool(cells or not likely_less(width))
    return seen(about, shape if width == cells else None, sure=sure)


def _scale(readings: np.ndarray) -> dict:
    numbers = np.unique(readings[~np.isnan(readings)])
    steps = np.diff(numbers)
    return {
        "largest": float(numbers[-1]) if len(numbers) else 0.0,
        "step": float(steps.min()) if len(steps) else 1.0,
        "at_largest": int((readings == numbers[-1]).sum()) if len(numbers) else 0,
    }


def of_boards(names: tuple[bytes, ...]) -> str:
    """Return what to do about boards of these names that print in turn."""
    several = " and ".join(name.decode("ascii", "replace")[:_NAME_SHOWN] for name in names)
    return (
        f"frames named {several} come in turn, as of several mats: print one mat's, under one "
        "name, or give each a driver of your own (docs/formats.md)"
    )


def _proved(found: Seen, data: bytes, shape) -> Seen:
    """How many frames the parser reads by what was found, and whether that is all there is."""
    if not isinstance(found.format, TextFormat):
        return found
    rows, cols = found.shape or (
        shape if shape and shape[0] * shape[1] == found.cells else (1, found.cells)
    )
    top = max(found.largest, 1.0)
    parser = TextParser(rows, cols, 16, replace(found.format, full_scale=top))
    parser.feed(data)
    frames, corrupt = parser.counters.frames, parser.counters.corrupt
    if boards := parser.counters.boards:
        found = replace(found, about=f"{found.about}; {of_boards(boards)}", sure=False)
    sure = found.sure and frames >= FEW and corrupt <= (1.0 - STEADY) * frames + 1
    return replace(found, frames=frames, sure=sure, protocol="text" if frames else "")
