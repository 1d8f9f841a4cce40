# SPDX-License-Identifier: Apache-2.0
"""Lines of a text file as a table of numbers, whatever separates, brackets or surrounds them."""

from __future__ import annotations

import csv
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from ..errors import FileError
from ..files import decode, read_bytes, shorten
from ..physics.circuit import Circuit
from .columns import Column, times
from .gathered import Gathered, Line
from .tables import ABSENT, Found, frames_of, headed, number

Blocks = Callable[[], Iterator[list[str]]]  # begins to read a text; its lines, some at a time
_SAMPLE = 200  # lines that tell the separator
_BRACKETS = str.maketrans("[](){}", "      ")  # of arrays that were printed
_COMMA = re.compile(r"\d[\d,]*,\d+")  # a number with commas: of decimals, or of thousands
_THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")  # may be one of thousands
_HUNDREDS = re.compile(r"\d{3}")  # a number that has none where commas mark thousands
_ARROW = " -> "  # behind the time that the serial monitor of Arduino's IDE puts before a line
_UNIT = re.compile(r"^[#\s]*units?\b[^:=]*[:=\s]\s*(.*)$", re.IGNORECASE)
# Units that no ADC has, of systems that were calibrated.
_PRESSURE = re.compile(r"n/(cm|mm|m)|k?pa$|mmhg|psi|kg|mbar|bar$|newton", re.IGNORECASE)
_NAME = re.compile(r'(?<![\w"])"?([A-Za-z_][\w .]*)"?\s*[:=]')  # of a number
# The time in a heading above the rows of a frame, and its unit.
_TIMED = re.compile(
    r"(?<![a-z])(timestamp|time|millis|micros|elapsed|t)[ _]*[\[(]?([a-z]*)[\])]?\s*[:=]\s*"
    r"(\d+\.?\d*)(?![\d:/-])\s*([mun]?s\b)?",
    re.IGNORECASE,
)
_RATE = re.compile(
    r"(seconds?[ _]per[ _]frame)|fps|frames?[ _](?:rate|per[ _]second)|sampl\w+[ _](?:rate|freq)",
    re.IGNORECASE,
)
_HEADING = 3  # names in a line above the rows of a frame, at most
_TEXT = 0.5  # share of a line's fields that are no numbers, at least, where it is no line of them
_LARGEST_REFERENCE = 1 << 26  # bytes


class _Form(NamedTuple):
    """How the lines of a file are written."""

    separator: str | None  # None: spaces
    point: str  # what a comma within a number stands for: a point, or nothing


def read_text(blocks: Blocks, circuit: Circuit) -> Found:
    """Return the frames of a text (ValueError: it holds none, or lines of another size).

    Args:
        blocks: begins to read it, and yields its lines, some at a time.
        circuit: whose frames they are.
    """
    form = _form(blocks)
    width = _usual(islice(_sorted(blocks, form), _SAMPLE))
    while True:
        gathered, passed, rate, stated = _gather(blocks, form, width)
        if not gathered.widths:
            lines = (line for block in blocks() for line in block if line.strip())
            first = next((f": the first is {shorten(line)}" for line in lines), "")
            raise ValueError(
                f"holds no line of numbers with commas, semicolons, tabs or spaces between{first}"
            )
        widths = gathered.widths
        usual = max(widths, key=lambda width: width * widths[width].lines)
        if usual == width:
            break
        width = usual  # its first lines are of another one
    alike = widths.pop(width)
    sizes = circuit.rows * circuit.cols, circuit.cols, circuit.rows
    trails = width not in sizes and alike.trails
    names = [h for h in (alike.header, alike.names) if len(h) == width]
    width -= trails
    header = names[0][:width] if names else []
    found = frames_of(headed(gathered.table(width, header)), circuit)
    notes = []
    above = [k for k in passed if k < alike.begin]
    among, others = passed[len(above) :], sum(other.lines for other in widths.values())
    above = above[: -1 if header else None]
    for dropped, why, at in (
        (len(above), "before the numbers: passed over", above),
        (len(among), "with text among the numbers: dropped", among),
        (others, f"of other than {width} fields: dropped", [a.begin for a in widths.values()]),
    ):
        if dropped:
            notes.append(f"{dropped} lines {why} (the first: line {min(at)})")
    found.notes[:0], found.rate = notes, rate
    if found.times is None:
        found.times = _times(stated, found)
    return found


def _times(stated: dict[int, re.Match[str]], found: Found) -> np.ndarray | None:
    """Return (n,) times [s] of frames by the headings above them, if there they rise; else None."""
    said = np.array([float(time[3]) for time in stated.values()])
    if len(said) < 2 or not (np.diff(said) > 0.0).all():
        return None
    name, unit, _, behind = next(iter(stated.values())).groups()
    above = np.searchsorted(np.array([*stated]), found.lines) - 1
    column = Column(f"time_{name}_{behind or unit}", np.where(above < 0, np.nan, said[above]))
    return times([column], found.notes, ["what the headings say"])


def _usual(lines: Iterable[Line]) -> int:
    """Return how many fields most of what stands in lines has; 1: none is of numbers."""
    weight = Counter({1: 0})
    for line in lines:
        if not line.is_text:
            weight[len(line.words)] += len(line.words)
    return weight.most_common(1)[0][0]


def _gather(
    blocks: Blocks, form: _Form, width: int
) -> tuple[Gathered, array[int], float | None, dict[int, re.Match[str]]]:
    """Return lines of numbers, those of text by number, the rate in their head, and their times."""
    gathered, passed, header, rate = Gathered(width), array("i"), [], None
    stated: dict[int, re.Match[str]] = {}
    for line in _sorted(blocks, form):
        if line.is_text:
            _check_unit(line)
            if not gathered.widths:
                rate = _rate(" ".join(line.words)) or rate
            passed.append(line.number)
            header = line.words
            if time := _TIMED.search(" ".join(header)):
                stated[line.number] = time
        else:
            gathered.add(line, header)
    return gathered, passed, rate, stated


def _rate(head: str) -> float | None:
    """Return the frames a second that a line of text says; None: none."""
    said, value = _RATE.search(head), re.search(r"\d*\.?\d+", head)
    if not said or not value or not float(value[0]):
        return None
    return 1.0 / float(value[0]) if said[1] else float(value[0])


def _named(line: str) -> tuple[str, list[str]]:
    """Return a line without names in front of its numbers, as of a JSON object, and each's name.

    What is in an array has none. A heading, of few names with no brace in front, stays as it is.
    """
    named = ":" in line or "=" in line
    if not named or (line.lstrip()[:1] != "{" and len(_NAME.findall(line)) <= _HEADING):
        return line, []
    fields = [_NAME.search(field) if "[" not in field else None for field in line.split(",")]
    return _NAME.sub(" ", line), [field[1] if field else "" for field in fields]


def _form(blocks: Blocks) -> _Form:
    """Return how the lines are written, by the first ones, and by the first with commas within."""
    separator = _separator(list(islice(_bare(blocks), _SAMPLE)))
    held = (line for line in _bare(blocks) if "," in line and (separator != "," or '"' in line))
    return _Form(separator, _point(list(islice(held, _SAMPLE)), separator))


def _bare(blocks: Blocks) -> Iterator[str]:
    return (_named(line)[0] for block in blocks() for line in block)


def _separator(lines: list[str]) -> str | None:
    """Return the separator of the file; None: spaces."""
    counts = {mark: sum(line.count(mark) for line in lines) for mark in ";\t,"}
    for mark in ";\t,":  # a comma may be the point of decimals
        if counts[mark] >= len(lines) / 2 and counts[mark] and 2 * counts[mark] >= counts[","]:
            return mark
    return None


def _point(lines: list[str], separator: str | None) -> str:
    """Return what a comma within a number of these lines stands for."""
    words = {word for line in lines for word in _words(line, _Form(separator, ","))}
    commas = [word for word in words if _COMMA.fullmatch(word)]
    by_thousands = commas and all(_THOUSANDS.fullmatch(word) for word in commas)
    return "" if by_thousands and any(_HUNDREDS.fullmatch(word) for word in words) else "."


def _words(line: str, form: _Form) -> list[str]:
    separator, point = form
    line = line.replace(_ARROW, separator or " ").translate(_BRACKETS)
    line = line.replace("\t", ",") if separator == "," else line  # behind a time
    if separator is None:
        return line.split()
    quoted = '"' in line
    words = (
        next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        if quoted
        else line.split(separator)
    )
    if separator == "," and not quoted:  # no word has a comma
        return [w.strip() for w in words]
    return [w.strip().replace(",", point) for w in words]


def _sorted(blocks: Blocks, form: _Form) -> Iterator[Line]:
    """Yield the lines that are not empty, each with its run, those of numbers and the others."""
    run, broken = 0, True
    for k, line in enumerate((line for block in blocks() for line in block), 1):
        bare, names = _named(line)
        words = _words(bare, form) if bare.strip() else []
        if not words:
            broken = True
            continue
        numbers, texts = _numbers(words)
        trails = bool(form.separator) and not words[-1]
        alike = len(texts) > 1 and len({words[k] for k in texts}) == 1  # where no cells are
        is_text = bool(texts) and len(texts) >= _TEXT * (len(words) - trails) and not alike
        run += broken and not is_text
        broken = is_text
        yield Line(k, words, numbers, texts, trails, run, names, is_text)


def _numbers(words: list[str]) -> tuple[np.ndarray, list[int]]:
    """Of a line's fields, NaN where there is none; and which fields are text."""
    try:
        numbers = np.array(list(map(float, words)))
        if np.isfinite(numbers).all():
            return numbers, []
    except ValueError:
        pass
    numbers = np.array([number(word) for word in words])
    absent = np.flatnonzero(np.isnan(numbers))
    return numbers, [int(k) for k in absent if words[k].lower() not in ABSENT]


def _check_unit(line: Line) -> None:
    """ValueError: a line of text says a unit of pressure."""
    if (match := _UNIT.match(words := " ".join(line.words))) and _PRESSURE.search(match[1]):
        raise ValueError(
            f"line {line.number} says {words.strip()}: these are pressures of a calibrated "
            "system, must be what the ADC reads"
        )


def read_reference(path: str) -> tuple[np.ndarray, np.ndarray]:
    """(m,) times [s] and (m,) forces [N] of a scale or sensor: a CSV of two columns.

    Raises:
        FileError: a line but the first that is not two numbers, times that do not rise.
        OSError: the file cannot be read.
    """
    lines = decode(read_bytes(path, _LARGEST_REFERENCE)).splitlines()
    blocks = partial(iter, [lines])
    values: list[np.ndarray] = []
    for line in _sorted(blocks, _form(blocks)):
        where = f"{path}: line {line.number}, {shorten(lines[line.number - 1])}"
        if len(line.numbers) != 2 or np.isnan(line.numbers).any():
            if line.number == 1:
                continue
            raise FileError(f"{where}: must be time,force")
        if values and line.numbers[0] <= values[-1][0]:
            raise FileError(f"{where}: times must rise [s]")
        values.append(line.numbers)
    if len(values) < 2:
        raise FileError(f"{path}: no lines of time [s],force [N]")
    times, force = np.array(values).T
    return times, force
