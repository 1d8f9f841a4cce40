# SPDX-License-Identifier: Apache-2.0
"""Frames of a board, from the board or from a file as if the board were there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..middleware.bus import Context, MultiThreadedExecutor, Node, Parameter
from ..middleware.config import adc_of, declared
from ..middleware.parameter_file import ParameterFile
from ..msg import Image, image_array
from ..nodes import READING
from ..nodes.serial_driver import SerialDriver
from ..parameters.shared import Shared
from ..physics.adc import Adc
from ..recording.frames import Frames, read_frames

RATE = 100.0  # frames a second, of files without times
# Share of the largest load from which frames bear it: a skin whose rest has drifted by 1 %
# seems to bear 0.01 of a weight, by 9 boards.
_LOADED = 0.2
_PATIENCE = 10.0  # s without a frame after which the board is taken for absent


def supposed(found: Frames, rate: float) -> list[str]:
    """Return that the times of a file's frames are not known, in words; empty: they are."""
    said = f"has no times: {rate:g} frames a second are supposed: give rate:="
    return [said] if found.times is None else []


class Recorded:
    """Frames of a file, as if its board were there: each call takes those that come next."""

    def __init__(self, adc: Adc, rate: float | None, full_scale: float | None = None, part=None):
        self._adc, self._default = adc, rate or RATE
        self._given = {"rate": rate, "full_scale": full_scale, "part": part}

    def open(self, path: str) -> None:
        """Open a file of frames (FileError, OSError: as read_frames)."""
        found = read_frames(path, self._adc.circuit, **self._given)
        for note in found.notes + supposed(found, self._default):
            print(f"  {path}: {note}")
        self._frames, self._at, times = found.ratio(self._adc), 0, found.times
        self._rate, self._times = self._default, times
        if times is not None and len(times) > 1:
            self._rate = 1.0 / float(np.median(np.diff(times)))

    def stream(self, path: str) -> tuple[np.ndarray, np.ndarray]:
        """(n, rows, cols) ADC ratio of a whole file, and (n,) times [s]."""
        if not path:
            raise ValueError("reference:= needs touches:=FILE, the frames of the same time")
        self.open(path)
        times = np.arange(len(self._frames)) / self._rate if self._times is None else self._times
        return self._frames, times

    def __call__(self, seconds: float) -> np.ndarray:
        """At the end of the file its last frames, again and again."""
        n = self._count(seconds)
        self._at = min(self._at + n, len(self._frames))
        return self._frames[self._at - n : self._at]

    def skip_to(self, load: Callable[[np.ndarray], float], seconds: float) -> None:
        """Go on to the first frames of so long that bear about the largest load, if any do."""
        n = self._count(seconds)
        starts = range(self._at, len(self._frames) - n + 1, max(n // 2, 1))
        loads = [load(self._frames[k : k + n]) for k in starts]
        least = _LOADED * max(loads, default=0.0)
        if least > 0.0:
            self._at = next(k for k, of in zip(starts, loads, strict=True) if of >= least)

    def _count(self, seconds: float) -> int:
        return min(max(2, round(seconds * self._rate)), len(self._frames))


class Live:
    """Frames of a board, through the same driver node as on the robot."""

    def __init__(self, source: Path | str | None, overrides: dict):
        self._executor, self._context = MultiThreadedExecutor(), Context()
        # a board that the opening resets is reset once, and has its time
        parameters = [Parameter("watchdog", SerialDriver.longest_start)]
        parameters += ParameterFile(source).overrides("/serial_driver") if source else []
        parameters += [Parameter(name, value) for name, value in overrides.items()]
        node = Node("serial_driver", context=self._context, parameter_overrides=parameters)
        self.driver = SerialDriver(node)
        listener = Node("calibrate", context=self._context, parameter_overrides=parameters)
        self._adc = adc_of(declared(listener, Shared).circuit)
        self._frames: list[np.ndarray] = []
        self._heard = False
        listener.create_subscription(Image, "skin/adc", self._on_adc, READING)
        self._executor.add_node(node, listener)

    def _on_adc(self, msg: Image) -> None:
        self._heard = True
        self._frames.append(self._adc.ratio_of(image_array(msg)))

    def __call__(self, seconds: float) -> np.ndarray:
        """ValueError after 10 s without a frame, or 40 s without a first one."""
        self._frames.clear()
        patience = _PATIENCE + (0.0 if self._heard else SerialDriver.longest_start)
        until = time.monotonic() + seconds
        while time.monotonic() < until or not self._frames:
            if time.monotonic() > until + patience:
                raise ValueError(f"no frame for {patience:g} s: {self.driver.trouble}")
            time.sleep(0.02)
        return np.array(self._frames)

    def close(self) -> None:
        self._executor.shutdown()
        self.driver.close()
