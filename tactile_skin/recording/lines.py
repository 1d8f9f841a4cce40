# SPDX-License-Identifier: Apache-2.0
"""Lines of a text file as a table of numbers, whatever separates, brackets or surrounds them."""

from __future__ import annotations

import csv
import re
from collections import Counter
from typing import NamedTuple

import numpy as np

from ..errors import FileError
from ..files import decode, read_bytes, shorten
from ..physics.circuit import Circuit
from .tables import ABSENT, Found, Table, frames_of, number

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
_HEADING = 3  # names in a line above the rows of a frame, at most
_TEXT = 0.5  # share of a line's fields that are no numbers, at least, where it is no line of them
_LARGEST_REFERENCE = 1 << 26  # bytes
_PART = 0.5  # share of a frame's fields that a damaged line holds, at least


class Line(NamedTuple):
    """A line that is not empty."""

    number: int  # from 1
    words: list[str]
    numbers: np.ndarray  # of its fields; NaN: none
    trails: bool  # whether a separator ends it
    run: int  # that it belongs to


def read_text(text: str, circuit: Circuit) -> Found:
    """Return the frames of a text (ValueError: it holds none, or lines of another size)."""
    lines = text.splitlines()
    numeric, texts = sort_lines(lines)
    if not numeric:
        first = next((f": the first is {shorten(line)}" for line in lines if line.strip()), "")
        raise ValueError(
            f"holds no line of numbers with commas, semicolons, tabs or spaces between{first}"
        )
    weight: Counter[int] = Counter()
    for line in numeric:
        weight[len(line.words)] += len(line.words)
    width = weight.most_common(1)[0][0]
    alike = [line for line in numeric if len(line.words) == width]
    sizes = circuit.rows * circuit.cols, circuit.cols, circuit.rows
    trails = width not in sizes and all(line.trails for line in alike)
    width -= trails
    begin = alike[0].number
    header: list[str] = next((line.words for line in reversed(texts) if line.number < begin), [])
    header = next(
        (h[:width] for h in (header, _named(lines[begin - 1])[1]) if len(h) - trails == width), []
    )
    _check_unit(texts)
    found = frames_of(_table(numeric, width, trails, header), circuit)
    notes = []
    passed = [line.number for line in texts]
    above = [k for k in passed if k < begin]
    for dropped, why in (
        (above[: -1 if header else None], "before the numbers: passed over"),
        (passed[len(above) :], "with text among the numbers: dropped"),
        (
            [line.number for line in numeric if len(line.words) != width + trails],
            f"of other than {width} fields: dropped",
        ),
    ):
        if dropped:
            notes.append(f"{len(dropped)} lines {why} (the first: line {dropped[0]})")
    found.notes[:0] = notes
    return found


def _named(line: str) -> tuple[str, list[str]]:
    """Return a line without names in front of its numbers, as of a JSON object, and each's name.

    What is in an array has none. A heading, of few names with no brace in front, stays as it is.
    """
    named = ":" in line or "=" in line
    if not named or (line.lstrip()[:1] != "{" and len(_NAME.findall(line)) <= _HEADING):
        return line, []
    fields = [_NAME.search(field) if "[" not in field else None for field in line.split(",")]
    return _NAME.sub(" ", line), [field[1] if field else "" for field in fields]


def _separator(lines: list[str]) -> str | None:
    """Return the separator of the file; None: spaces."""
    counts = {mark: sum(line.count(mark) for line in lines) for mark in ";\t,"}
    for mark in ";\t,":  # a comma may be the point of decimals
        if counts[mark] >= len(lines) / 2 and counts[mark] and 2 * counts[mark] >= counts[","]:
            return mark
    return None


def _point(lines: list[str], separator: str | None) -> str:
    """Return what a comma within a number stands for: a point, or nothing, as of thousands."""
    held = [line for line in lines if "," in line and (separator != "," or '"' in line)]
    words = {word for line in held[:_SAMPLE] for word in _words(line, separator, ",")}
    commas = [word for word in words if _COMMA.fullmatch(word)]
    by_thousands = commas and all(_THOUSANDS.fullmatch(word) for word in commas)
    return "" if by_thousands and any(_HUNDREDS.fullmatch(word) for word in words) else "."


def _words(line: str, separator: str | None, point: str) -> list[str]:
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
    return [w.strip().replace(",", point) for w in words]


def sort_lines(lines: list[str]) -> tuple[list[Line], list[Line]]:
    """Return lines of numbers, and the others, each with its run."""
    numeric, texts, run, apart = [], [], 0, True
    lines = [_named(line)[0] for line in lines]
    separator = _separator(lines[:_SAMPLE])
    point = _point(lines, separator)
    for k, line in enumerate(lines, 1):
        words = _words(line, separator, point) if line.strip() else []
        numbers, text = _numbers(words)
        trails = bool(separator and words) and not words[-1]
        if not words or (text and text >= _TEXT * (len(words) - trails)):
            apart = True
            if words:
                texts.append(Line(k, words, numbers, trails, run))
        else:
            run += apart
            apart = False
            numeric.append(Line(k, words, numbers, trails, run))
    return numeric, texts


def _numbers(words: list[str]) -> tuple[np.ndarray, int]:
    """Of a line's fields, NaN where there is none; and how many fields are text."""
    numbers = np.array([number(word) for word in words])
    absent = np.flatnonzero(np.isnan(numbers))
    return numbers, sum(words[k].lower() not in ABSENT for k in absent)


def _check_unit(texts: list[Line]) -> None:
    """ValueError: a unit of pressure stands above the numbers."""
    for line in texts:
        if (match := _UNIT.match(words := " ".join(line.words))) and _PRESSURE.search(match[1]):
            raise ValueError(
                f"line {line.number} says {words.strip()}: these are pressures of a calibrated "
                "system, must be what the ADC reads"
            )


def _table(numeric: list[Line], width: int, trails: bool, header: list[str]) -> Table:
    """Return the lines of one width; what is left of a damaged one holds its place."""
    kept = [line for line in numeric if len(line.words) > _PART * width]
    damaged = np.array([len(line.words) != width + trails for line in kept])
    blank = np.full(width, np.nan)
    numbers = np.array(
        [blank if cut else line.numbers[:width] for line, cut in zip(kept, damaged, strict=True)]
    )
    texts = {
        int(k): np.array(
            ["" if cut else line.words[k] for line, cut in zip(kept, damaged, strict=True)], object
        )
        for k in np.flatnonzero(np.isnan(numbers).any(0))
    }
    numbered, runs = (np.array([getattr(line, of) for line in kept]) for of in ("number", "run"))
    return Table(numbers, numbered, runs, damaged, header, texts)


def read_reference(path: str) -> tuple[np.ndarray, np.ndarray]:
    """(m,) times [s] and (m,) forces [N] of a scale or sensor: a CSV of two columns.

    Raises:
        FileError: a line but the first that is not two numbers, times that do not rise.
        OSError: the file cannot be read.
    """
    lines = decode(read_bytes(path, _LARGEST_REFERENCE)).splitlines()
    numeric, texts = sort_lines(lines)
    values: list[np.ndarray] = []
    for line in sorted([*numeric, *texts], key=lambda line: line.number):
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
