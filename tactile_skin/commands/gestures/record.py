# SPDX-License-Identifier: Apache-2.0
"""Takes of gestures, from the live skin or from a recording."""

from __future__ import annotations

import contextlib
import datetime
import time
from collections.abc import Iterable

import numpy as np

from ... import launch
from ...arguments import split
from ...msg import Image, image_array
from ...recording import Recording
from ...touch.recogniser import Cells, Pictures
from ...touch.take import PAUSE, SUFFIX, Take, touches

_LOOK = 0.1  # s between two looks whether a take is over


def record(args) -> int:
    """Write takes to files until there are enough; returns the exit status."""
    if args.times < 1:
        raise ValueError(f"--times {args.times}: must be 1 or more")
    for option, text in (("NAME", args.name), ("--person", args.person)):
        if not text.replace("-", "").replace("_", "").isalnum():
            raise ValueError(f"{option} {text!r}: must be of letters, digits, - and _")
    files, given = split(args.words, None)
    if len(files) > 1:
        raise ValueError(f"one recording, not {len(files)}: {' '.join(files)}")
    if files and (live := ", ".join(sorted(set(given) - {"namespace"}))):
        raise ValueError(f"{live}: of the live skin; of a recording, only namespace:= is taken")
    args.out.mkdir(parents=True, exist_ok=True)
    kept = 0
    with contextlib.suppress(KeyboardInterrupt):
        for pictures, period, pitch in _takes(files, given, args):
            if len(pictures) < 2:
                print(f"  a touch of {period:.2f} s is too short to be kept")
                continue
            kept += 1
            stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
            path = args.out / f"{args.name}-{args.person}-{stamp}-{kept}{SUFFIX}"
            Take(args.name, args.person, pictures, period, pitch).save(path)
            force = pictures.sum((1, 2)).max()
            print(f"  {path.name}: {len(pictures) * period:.1f} s, up to {force:.1f} N")
            if kept == args.times and not files:
                break
    print(f"{kept} take{'s' * (kept != 1)} of {args.name} in {args.out}")
    return 0 if kept else 1


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


def _takes(files: list[str], given: dict[str, str], args) -> Iterable[tuple]:
    if files:
        return _recorded(files[0], given.get("namespace", ""))
    return _live(given, args)


def _recorded(path: str, namespace: str) -> list[tuple]:
    """Return the takes of a recording."""
    recording = Recording(path, namespace)
    pressure = recording.adc_topic.removesuffix("adc") + "pressure"
    course, std = Course(recording.skin.geometry), {}
    if f"{pressure}_std" in recording.topics:
        std = dict(zip(*recording.images(f"{pressure}_std"), strict=True))
    for stamp, frame in zip(*recording.images(pressure), strict=True):
        course.add(stamp / 1e9, frame, std.get(stamp, 0.0))
    return course.takes()


def _live(given: dict[str, str], args):
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
            f"{args.name}, {args.times} times: hands off for two seconds, then make the gesture, "
            f"and leave the skin alone for {PAUSE:g} s after each; Ctrl-C ends",
            flush=True,
        )
        while not skin.failed:
            time.sleep(_LOOK)
            yield from course.takes(PAUSE)
