# SPDX-License-Identifier: Apache-2.0
"""Takes of gestures, from the live skin or from a recording."""

from __future__ import annotations

import contextlib
import datetime
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np

from ... import launch
from ...arguments import split
from ...msg import Image, image_array
from ...recording import Recording
from ...recording.columns import is_person
from ...recording.frames import KINDS, is_recording
from ...recording.reader import EVER
from ...replay.results import Job, collect
from ...touch.recogniser import Cells, Pictures
from ...touch.take import PAUSE, SUFFIX, Take, touches
from ..replay import recording_of

_LOOK = 0.1  # s between two looks whether a take is over
_OF_TABLES: dict[str, type] = {"config": str, "rate": float, "full_scale": float}


def record(args) -> int:
    """Write takes to files until there are enough; returns the exit status."""
    if args.times < 1:
        raise ValueError(f"--times {args.times}: must be 1 or more")
    name = args.name
    if Path(name).suffix.lower() in KINDS and not is_recording(name):  # it names the gestures
        name, args.words = "", [args.name, *args.words]
    for option, text in (("NAME", name), ("--person", args.person)):
        if _plain(text) != text:
            raise ValueError(f"{option} {text!r}: must be of letters, digits, - and _")
    files, given = split(args.words, None)
    if len(files) > 1:
        raise ValueError(f"one recording, not {len(files)}: {' '.join(files)}")
    args.out.mkdir(parents=True, exist_ok=True)
    kept: Counter = Counter()
    with contextlib.suppress(KeyboardInterrupt):
        for take in _takes(files, given, name, args):
            if len(take.pictures) < 2:
                print(f"  a touch of {take.period:.2f} s is too short to be kept")
                continue
            kept[take.label] += 1
            stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
            path = args.out / f"{take.label}-{take.person}-{stamp}-{kept.total()}{SUFFIX}"
            take.save(path)
            force = take.pictures.sum((1, 2)).max()
            print(f"  {path.name}: {len(take.pictures) * take.period:.1f} s, up to {force:.1f} N")
            if kept.total() == args.times and not files:
                break
    for label, n in (kept or {name: 0}).items():
        print(f"{n} take{'s' * (n != 1)} of {label or 'any gesture'} in {args.out}")
    return 0 if kept else 1


def _plain(text: str) -> str:
    """Return a text with what no name of a file should hold as _."""
    return re.sub(r"[^\w-]", "_", text)


class Course:
    """Pictures of what was felt, as a recogniser sees them, until they are taken."""

    def __init__(self, geometry):
        self._geometry, self._cells = geometry, Cells(geometry.pitch)
        self._pictures = Pictures(self._cells)
        self._found: list = []
        self._periods: list[float] = []

    def add(self, t: float, pressure, std=0.0) -> None:
        """Take a frame at t [s]: (rows, cols) pressure and its standard deviation [Pa]."""
        area = self._geometry.cell_area
        if picture := self._pictures.update(t, pressure * area, std * area):
            self._found.append(picture.force)
            self._periods.append(picture.period)

    def takes(self, pause: float = 0.0) -> list[tuple]:
        """Return pictures (T, rows, cols) [N], period [s] and pitch [m] of each touch so far.

        There are none before nothing has touched for a pause [s].
        """
        if not self._found:
            return []
        pictures, period = np.array(self._found), float(np.median(self._periods))
        silent = pictures[max(0, len(pictures) - round(pause / period)) :]
        if pause and silent.any():
            return []
        self._found, self._periods = [], []
        return [(take, period, self._cells.pitch) for take in touches(pictures, period)]


def _takes(files: list[str], given: dict[str, str], name: str, args) -> Iterable[Take]:
    if not files:
        return (Take(name, args.person, *take) for take in _live(given, name, args))
    known: dict[str, type] = {"namespace": str} if is_recording(files[0]) else _OF_TABLES
    if wrong := ", ".join(sorted(set(given) - {*known})):
        raise ValueError(f"{wrong}: of a file, only {', '.join(f'{n}:=' for n in known)} is taken")
    _, given = split(args.words, known)
    if not is_recording(files[0]):
        return of_table(files[0], given, name, args.person)
    recording = Recording(files[0], given.get("namespace", ""))
    return (Take(name, args.person, *take) for take in _recorded(recording, [EVER])[0])


def _recorded(recording: Recording, ends: Iterable[int]) -> list[list[tuple]]:
    """Return the takes of a recording, those before each time [ns since 1970] together."""
    pressure = recording.adc_topic.removesuffix("adc") + "pressure"
    course, std, found = Course(recording.skin.geometry), {}, []
    if f"{pressure}_std" in recording.topics:
        std = dict(zip(*recording.images(f"{pressure}_std"), strict=True))
    stamps, frames = recording.images(pressure)
    parts = [0, *np.searchsorted(stamps, [*ends])]
    for a, b in pairwise(parts):
        for stamp, frame in zip(stamps[a:b].tolist(), frames[a:b], strict=True):
            course.add(stamp / 1e9, frame, std.get(stamp, 0.0))
        found.append(course.takes())
    return found


def of_table(path: str, given: dict, name: str, person: str) -> list[Take]:
    """Return the takes of a foreign file's frames: each touch, of the class that its frames name.

    Args:
        given: config, rate and full_scale, as of replay.
        name: of the gesture, where the file has no labels; else only of these; empty: all.
        person: who made it, where no column says it.

    Raises:
        ValueError: it has no labels, or several that differ.
    """
    with tempfile.TemporaryDirectory(prefix="tactile_skin_") as folder:
        config, out = given.get("config"), f"{folder}/out.mcap"
        made, frames = recording_of(path, Path(folder), config, given)
        if frames is None:
            raise ValueError(f"{path}: has no labels: gestures record NAME makes takes of it")
        people = [each for column, each in frames.labels.items() if is_person(column)]
        classes = {k: each for k, each in frames.labels.items() if not is_person(k)}
        several = {k: each for k, each in classes.items() if len(set(each)) > 1} or classes
        if len(several) > 1 or not (several or name):
            there = ", ".join(several) or "none"
            raise ValueError(
                f"{path}: must have one column of labels, with a header such as gesture: {there}"
            )
        whose = people[0] if people else np.array([""] * len(frames.values))
        what = next(iter(several.values()), np.array([name] * len(frames.values)))
        if name and name not in what:
            there = ", ".join(sorted(set(filter(None, what))))
            raise ValueError(f"{path}: NAME {name!r}: must be one of its labels, {there}")
        collect(Job(made, config=config or "", out=out))
        begins = [0, *np.flatnonzero((what[1:] != what[:-1]) | (whose[1:] != whose[:-1])) + 1]
        ends = [*Recording(made).stamps[begins[1:]].tolist(), EVER]
        return [
            Take(_plain(what[at]), _plain(whose[at] or person), *take)
            for at, takes in zip(begins, _recorded(Recording(out), ends), strict=True)
            for take in takes
            if what[at] and name in ("", what[at])
        ]


def _live(given: dict[str, str], name: str, args):
    """Yield the takes of the skin of a launch file, as they are made."""
    plan = launch.read_plan(launch.find(launch.default_file(given)), {"monitor": "false"} | given)
    course = Course(launch.read_skin(given.get("config")).geometry)
    std: list = [0.0]

    def on_std(message) -> None:
        std[0] = image_array(message)

    def on_pressure(message) -> None:
        stamp = message.header.stamp
        course.add(stamp.sec + stamp.nanosec / 1e9, image_array(message), std[0])

    with launch.Skin(plan) as skin:
        skin.node.create_subscription(Image, "skin/pressure_std", on_std, 10)
        skin.node.create_subscription(Image, "skin/pressure", on_pressure, 10)
        print(
            f"{name}, {args.times} times: hands off for two seconds, then make the gesture, "
            f"and leave the skin alone for {PAUSE:g} s after each; Ctrl-C ends",
            flush=True,
        )
        while not skin.failed:
            time.sleep(_LOOK)
            yield from course.takes(PAUSE)
