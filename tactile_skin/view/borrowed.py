# SPDX-License-Identifier: Apache-2.0
"""A board that the page's process reads itself, while the skin has lent its port."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..board.formats import make_format, make_parser
from ..board.frame import Frame
from ..board.serial_port import SerialReader
from ..middleware.config import read_skin
from ..middleware.parameter_file import ParameterFile
from ..solvers import compensate
from .pictures import Pictures
from .snapshot import NO_CONTACTS, Snapshot

_FORMAT = "format."


class Borrowed:
    """Reads the frames of a board in a thread; use it with `with`.

    Args:
        line: its open serial port.
        text: of its parameter file.
        take: takes each reading, (rows, cols) counts.
    """

    def __init__(self, line, text: str, take: Callable[[np.ndarray], None]):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "detected.yaml"
            path.write_text(text)
            self.skin = read_skin(path)
            given = {p.name: p.value for p in ParameterFile(path).overrides("/serial_driver")}
        forms = {k.removeprefix(_FORMAT): v for k, v in given.items() if k.startswith(_FORMAT)}
        form = make_format(given["protocol"], forms)
        circuit = self.skin.circuit
        self._reader = SerialReader(
            line.port,
            line.baudrate,
            lambda: make_parser(given["protocol"], *circuit.shape, circuit.adc_bits, form),
            self._on_frame,
            say=lambda text: None,
            watchdog=math.inf,
            line=line,
        )
        self.pictures = Pictures(self.skin)
        self._take = take
        self._newest: tuple[float, np.ndarray] | None = None  # when [s], counts

    def __enter__(self) -> Borrowed:
        self._reader.start()
        return self

    def __exit__(self, *_) -> None:
        self._reader.close()

    @property
    def trouble(self) -> str:
        """Why no frame comes any more; empty if they come, or have not come yet."""
        return self._reader.trouble if self._reader.reconnects >= 0 else ""

    def seen(self, said: Snapshot) -> Snapshot:
        """Return what the skin says, with the picture of this board in place of its own."""
        none = replace(said, adc=None, pressure=None, std=None, contacts=NO_CONTACTS, rest=None)
        if self._newest is None:
            return none
        (at, adc), circuit = self._newest, self.skin.circuit
        ratio = np.where(circuit.populated, self.skin.adc.ratio_of(adc), np.nan)
        force = compensate(ratio, circuit, self.skin.curve, missing=True).force
        pressure = (force / self.skin.geometry.cell_area).astype(np.float32)
        stamp = said.stamp + at - (at if said.read_at is None else said.read_at)
        return replace(none, stamp=stamp, read_at=at, adc=adc, pressure=pressure)

    def _on_frame(self, frame: Frame) -> None:
        if frame.samples.shape == self.skin.circuit.shape:
            adc = self.skin.adc.marked(frame.samples, frame.unread)
            self._newest = time.monotonic(), adc
            self._take(adc)
