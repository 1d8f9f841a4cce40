# SPDX-License-Identifier: Apache-2.0
"""Tell the cells of a table from its other columns: time, date, counter, label.

A column is known by its name, or by what it does: it is text, rises by one, rises, repeats.
Otherwise nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import datetime
from enum import Enum
from itertools import product
from typing import NamedTuple

import numpy as np

MOST = 4  # columns of a line that are no cells
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT = re.compile(r"(?:^|[\[(_ .])(s|ms|us|µs|ns)[\])]?$", re.IGNORECASE)  # ends a column's name
_SPELT = (
    (re.compile(r"milli|msec", re.IGNORECASE), "ms"),
    (re.compile(r"micro|usec", re.IGNORECASE), "us"),
    (re.compile(r"nano|nsec", re.IGNORECASE), "ns"),
    (re.compile(r"second|(?<![a-z])secs?(?![a-z])", re.IGNORECASE), "s"),
)
_TIME = re.compile(
    r"time|date|millis|micros|epoch|stamp|clock|elapsed|second|^t$|^ts$", re.IGNORECASE
)
_COUNTER = re.compile(
    r"^(unnamed.*|index|idx|id|no\.?|nr\.?|#|n|seq|sequence|counter|"
    r"(frame|sample|scan|packet)s?[ _]?(no|nr|number|id|idx|index|count)?\.?)$",
    re.IGNORECASE,
)
_LABEL = re.compile(
    r"label|class|^cls$|target|posture|pose|gesture|activity|category|^y$|^rows?$|^lines?$|"
    r"subject|person|user|participant",
    re.IGNORECASE,
)
_PERSON = re.compile(r"subject|person|user|participant", re.IGNORECASE)
# How days and times of day are written, as strptime has it, with any of -/. and one blank between.
_DAYS = ("%Y %m %d", "%d %m %Y", "%m %d %Y", "")
_CLOCKS = ("%H:%M:%S", "%H:%M", "%I:%M:%S %p", "%I:%M %p", "")
_BETWEEN = re.compile(r"[-/.T_, ]+|(?<=\d)(?=[ap]m)", re.IGNORECASE)
_FRACTION = re.compile(r"(?<=:\d\d)[.,](\d*)")  # of a second
_ZONE = re.compile(r"[\s_,]*(?:Z|UTC|GMT|(?<=:\d\d)[+-]\d\d:?\d\d)$")
_COLUMN_FIRST = re.compile(r"(?<![a-z])[cx][a-z]*[ _]*#.*(?<![a-z])[ry][a-z]*[ _]*#")
_TRIED = 10  # texts by which a way to write them is tried
DAY = 86400.0  # s
_EPOCH_FROM = 9.4e8  # s since 1970 of the year 2000, by which a stamp is known
_EPOCH_TO = 4.1e9  # the same of 2100
_SHORTEST = 0.9e-3  # s between two frames, where nothing says the unit of their times
_LONGEST = 4.0  # the same
_MOSTLY = 0.9  # share of a column's lines that show what it does
_RISES = 0.95  # the same of a time, which may be set back
_REPEATED = 0.2  # share of a time's steps that are 0 where its clock is coarser than the frames


class Role(Enum):
    """What a column that holds no cell is."""

    TIME = "time"
    COUNTER = "counter"
    LABEL = "label"


class Column(NamedTuple):
    """One column of a table."""

    name: str  # in the header; empty: none
    numbers: np.ndarray  # (n,) its values; NaN: text, or nothing
    words: Sequence[str] = ()  # its texts; empty: all are numbers

    @property
    def is_text(self) -> bool:
        return bool(self.words) and bool(np.isnan(self.numbers).mean() > 1.0 - _MOSTLY)


def texts(column: Column) -> np.ndarray:
    """Return (n,) what a column of labels says of each line; empty: nothing."""
    if column.is_text:
        return np.array(column.words, object)
    return np.array([f"{n:g}" * (n == n) for n in column.numbers.tolist()], object)


class Split(NamedTuple):
    """Where the cells of a table are."""

    front: int  # columns before them
    roles: list[Role]  # of all other columns, those in front first


def split(column: Callable[[int], Column], width: int, cells: int, cycle: int = 1) -> Split | None:
    """Return which columns of a table are its cells; None: its columns do not tell.

    Args:
        column: returns the column of a number from 0.
        width: how many there are.
        cells: how many of them are cells, next to each other.
        cycle: lines of a frame.
    """
    others = width - cells
    if not others:
        return Split(0, [])
    ends = {k: _role(column(k), cycle) for k in (*range(others), *range(cells, width))}
    found: list[Split] = []
    for front in range(others + 1):
        roles = [role for k in (*range(front), *range(front + cells, width)) if (role := ends[k])]
        if len(roles) == others:
            found.append(Split(front, roles))
    if not found or (
        len(found) > 1 and (found[-1].front < others or Role.LABEL in found[-1].roles)
    ):
        return None
    return found[-1]  # of two that rise, the time is in front


def named(names: Sequence[str], rows: int, cols: int) -> list[int]:
    """Return the columns that a header names as cells, row by row; empty: it names none.

    Such as R1C1 to R7C7, s_0_0, FSR1 to FSR64, s11 to s88: names that differ by numbers alone.

    Raises:
        ValueError: it names rows and columns of another mat.
    """
    alike: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        alike.setdefault(re.sub(r"\d+", "#", name.lower()), []).append(k)
    found = [(stem, k) for stem, k in alike.items() if "#" in stem and len(k) == rows * cols]
    if len(found) != 1:
        return []
    ((stem, places),) = found
    numbers = np.array([[int(n) for n in re.findall(r"\d+", names[k])] for k in places])
    numbers = numbers[:, np.ptp(numbers, axis=0) > 0]
    if numbers.shape[1] == 1 and np.ptp(numbers) != rows * cols - 1:
        numbers = np.column_stack(np.divmod(numbers[:, 0], 10))
    numbers = numbers[:, ::-1] if _COLUMN_FIRST.search(stem) else numbers
    size = tuple((np.ptp(numbers, axis=0) + 1).tolist())
    if np.prod(size) != len(places) or len(np.unique(numbers, axis=0)) < len(places):
        return []
    if size not in ((rows, cols), (rows * cols,)):
        raise ValueError(
            f"the header names {size[0]} x {size[1]} cells, from {names[places[0]]} to "
            f"{names[places[-1]]}: the circuit is {rows} x {cols}"
        )
    return [places[k] for k in np.lexsort(numbers.T[::-1])]


def _role(column: Column, cycle: int) -> Role | None:
    """Return what the column is; None: a cell, maybe."""
    values = column.numbers[: _used(column)]
    steps = np.diff(values)
    if named := role_by_name(column.name, counts(values)):
        return named
    if column.is_text:
        return Role.LABEL if stamps(column.words[: len(values)]) is None else Role.TIME
    if not len(values) or np.isnan(values).any():
        return None
    if cycle > 1 and (values % 1 == 0).all() and (repeated := _role_by_lines(values, cycle)):
        return repeated
    return Role.TIME if len(steps) > 1 and (steps > 0.0).mean() >= _RISES else None


def counts(values: np.ndarray) -> bool:
    """Return whether (n,) numbers rise by one, and are no seconds since 1970."""
    steps = np.diff(values)
    return len(steps) > 1 and (steps == 1.0).mean() >= _MOSTLY and not values[0] > _EPOCH_FROM


def role_by_name(name: str, counts: bool) -> Role | None:
    """Return what a column is by its name; a time without a unit that `counts` is a counter."""
    if is_time_name(name):
        return Role.COUNTER if counts and not unit_of(name) else Role.TIME
    if _COUNTER.match(name):
        return Role.COUNTER
    return Role.LABEL if _LABEL.search(name) else Role.COUNTER if counts else None


def _role_by_lines(values: np.ndarray, cycle: int) -> Role | None:
    """Return what (n,) integers are by how they run through the `cycle` lines of each frame.

    What counts the lines of a frame is a label, the row of a line; what stays within a frame and
    rises from one to the next is a counter. None: neither.
    """
    lines = values[: len(values) // cycle * cycle].reshape(-1, cycle)
    within = np.diff(lines, axis=1)
    if len(lines) and (within == 1.0).all():
        return Role.LABEL
    if len(lines) > 1 and not within.any() and (np.diff(lines[:, 0]) > 0).all():
        return Role.COUNTER
    return None


def _used(column: Column) -> int:
    """How many of its lines were written: the others stand at 0, or empty, at the end."""
    there = np.flatnonzero(~np.isnan(column.numbers) & (column.numbers != 0.0))
    if column.is_text:
        there = np.flatnonzero([bool(word) for word in column.words])
    return int(there[-1]) + 1 if there.size else len(column.numbers)


# --- time ----------------------------------------------------------------------------------------


def times(columns: list[Column], notes: list[str], places: list[str]) -> np.ndarray | None:
    """Return the seconds that columns of times say, (n,), NaN where they say none.

    A day and a time of day in two columns are added up. What is assumed of the column, named as in
    `places`, goes to `notes`.
    """
    dated = [(stamps(c.words), c) if c.is_text else (None, c) for c in columns]
    texts = [found for found, _ in dated if found is not None]
    if texts:
        days = [found.seconds for found in texts if not found.clock]
        clocks = [found for found in texts if found.clock]
        if clocks:
            day = days[0] if days and not clocks[0].day else 0.0
            seconds = clocks[0].seconds + day
            return seconds if clocks[0].day or days else _past_midnight(seconds)
    for (_, column), place in zip(dated, places, strict=True):
        if column.is_text:
            notes.append(f"{place} says no time that is known: passed over")
            continue
        unit = unit_of(column.name)
        if unit is None:
            unit = _unit_by_value(column.numbers[: _used(column)], place)
            notes.append(f"{place} is taken as the time in {unit}")
        whole = unit == "s" and not (column.numbers % 1.0 > 0.0).any()  # and ns, as ROS has it
        rest = [c.numbers for c in columns if whole and unit_of(c.name) == "ns"]
        return column.numbers * _UNITS[unit] + (rest[0] % 1e9 * _UNITS["ns"] if rest else 0.0)
    return None


def is_label_name(name: str) -> bool:
    """Return whether a name is that of classes, or of who made them."""
    return bool(_LABEL.search(name))


def is_person(name: str) -> bool:
    """Return whether a name of labels is that of people."""
    return bool(_PERSON.search(name))


def is_time_name(name: str) -> bool:
    """Return whether a name is that of a time."""
    return bool(_TIME.search(name) or unit_of(name))


def unit_of(name: str) -> str | None:
    """Return the unit of time that a column's name says; None: none."""
    if match := _UNIT.search(name.strip()):
        return match[1].lower().replace("µ", "u")
    return next((unit for spelt, unit in _SPELT if spelt.search(name)), None)


def _unit_by_value(values: np.ndarray, place: str) -> str:
    """Return the only unit in which steps are those of a board, and times of today today's."""
    steps = np.diff(values[~np.isnan(values)])
    if not (rises := steps > 0.0).any():
        return "s"
    step = float(np.median(steps[rises]) * rises.mean())  # of a clock coarser than the frames, too
    now = float(np.nanmedian(values))
    likely = {u for u, scale in _UNITS.items() if _SHORTEST <= step * scale < _LONGEST}
    slow = 100.0  # s between two frames of a log
    for unit, scale in _UNITS.items():
        if _EPOCH_FROM < now * scale < _EPOCH_TO and step * scale < slow:
            likely = likely & {unit}  # a board that runs for a month counts as many milliseconds
    if len(likely) != 1:
        raise ValueError(f"{place} rises by {step:.4g} a frame: name its unit: time_s, time_ms")
    return likely.pop()


class Stamps(NamedTuple):
    """Times in a column."""

    seconds: np.ndarray  # (n,) since 1970, or of the day; NaN: none
    # day, clock: whether they say the day, and the time of day
    day: bool
    clock: bool


def stamps(words: Sequence[str]) -> Stamps | None:
    """Return what dates or times of day say; None: most of the texts are neither.

    ISO 8601 and its usual variants, days with the year in front or behind, am and pm.
    """
    for day, clock in product(_DAYS, _CLOCKS):
        written = f"{day} {clock}".strip()
        if not written or all(_seconds(word, written) is None for word in words[:_TRIED]):
            continue
        found = [_seconds(word, written) for word in words]
        seconds = np.array([np.nan if s is None else s for s in found])
        if np.isfinite(seconds).sum() >= _MOSTLY * sum(map(bool, words)):
            return Stamps(seconds, bool(day), bool(clock))
    return None


def _seconds(word: str, written: str) -> float | None:
    """Since 1970, or of the day; None: the text is not written so."""
    fraction = _FRACTION.search(word)  # strptime takes no nanoseconds
    word = _ZONE.sub("", _FRACTION.sub("", word).strip())
    try:
        read = datetime.strptime(_BETWEEN.sub(" ", word), written)
    except ValueError:
        return None
    since = datetime(1970, 1, 1) if "%Y" in written else datetime(1900, 1, 1)
    return (read - since).total_seconds() + float(f"0.{fraction[1]}0" if fraction else 0.0)


def _past_midnight(seconds: np.ndarray) -> np.ndarray:
    falls = np.diff(seconds, prepend=seconds[:1]) < -0.5 * DAY
    return seconds + DAY * np.cumsum(falls)


def spread(stamps: np.ndarray) -> np.ndarray | None:
    """Return (n,) stamps [s] of a clock coarser than the frames, spread evenly; None: it is not."""
    steps = np.diff(stamps)
    if len(steps) < 2 or (steps < 0.0).any() or not (steps == 0.0).mean() > _REPEATED:
        return None
    begins = np.flatnonzero(np.r_[True, steps > 0.0])
    lengths = np.diff(np.r_[begins, len(stamps)])
    if len(begins) < 3:  # of no step is it known when it began
        return None
    interval = np.diff(stamps[begins])[1:] / lengths[1:-1]
    usual = float(np.median(interval))
    within = np.arange(len(stamps)) - np.repeat(begins, lengths)
    each = np.repeat(np.r_[usual, interval, usual], lengths)
    found = np.repeat(stamps[begins], lengths) + within * each
    first = lengths[0]
    found[:first] = stamps[begins[1]] - usual * np.arange(first, 0, -1)
    return found
