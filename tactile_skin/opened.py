# SPDX-License-Identifier: Apache-2.0
"""A board in the caller's own loop: forces in newtons and a stop, without nodes or threads.

with tactile_skin.open("/dev/ttyUSB0", "mine.yaml") as skin:
    for t, force in skin:
        print(force.sum(), skin.stop, skin.status)
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .behaviours.stop import Decision, StopConfig, StopPolicy
from .board import serial_port
from .board.admission import Admission
from .board.formats import make_format, make_parser
from .board.frame import Frame
from .board.serial_port import PORT_ERRORS, candidates, nothing_found, open_port, why_not
from .board.terminal import is_simulated
from .errors import FileError
from .middleware.bus import Context, Node
from .middleware.config import adc_of, circuit_of, declared, geometry_of, part_of
from .middleware.package import COMPOSED, SKIN_NODES
from .middleware.parameter_file import ParameterFile, sources_of
from .nodes.compensation import skin_of
from .parameters import nodes as parameters
from .physics.proof import SIMULATED, Proof
from .touch.features import analyse_frame

PATIENCE = 3.0  # s without a frame after which a read gives up, once one has come
_ASK_AGAIN = 0.2  # s after which a board that sends only on request is asked once more
_BOARD, _SKIN = "board", "skin"  # stages that may be wrong, as the stop names them


class Opened:
    """A skin that the caller reads; use it with `with`.

    Attributes:
        status: "ok", or what is wrong in words.
        std: (rows, cols) of the last picture, one standard deviation of each force [N].
        stamp: when the board sent the last frame, of `time.monotonic` [s]: it may have lain in
            buffers.
        simulated: whether the board is a simulated one.
    """

    def __init__(self, port: str, config: str | Path | None = None):
        """Prepare to read a board.

        Args:
            port: serial device, pyserial URL, or auto: the first USB board.
            config: parameter file; None: the defaults of all parameters.

        Raises:
            ValueError: a value that is not allowed; the message names it, and the file.
            OSError: the file cannot be read.
        """
        file = ParameterFile(config, own=True) if config is not None else None
        if file:
            file.check({name: parameters.all_names(name) for name in SKIN_NODES}, [COMPOSED])
            file.check_skin("/compensation")
        driver, found, feature, stop = (_given(file, name) for name in SKIN_NODES)
        circuit = circuit_of(found.circuit)
        adc = adc_of(found.circuit, circuit)
        self._port_name, self._baud = port, driver.baud
        self._serial_number = driver.serial_number
        self._part = part_of(found.circuit)
        layout = *self._part.shape, circuit.adc_bits
        form = make_format(driver.protocol, dataclasses.asdict(driver.format))
        self._parser = make_parser(driver.protocol, *layout, form)
        self._admission = Admission(adc, driver.frozen_after)
        self.stamp = -np.inf
        self._geometry = geometry_of(found.geometry, circuit)
        self._cell_threshold, self._stops = feature.cell_threshold, found.suspect_stops
        names = {field.name for field in dataclasses.fields(StopConfig)}
        self._policy = StopPolicy(StopConfig(**{n: getattr(stop, n) for n in names}))
        self._skin = skin_of(found, logging.getLogger(__package__).warning)
        self._skin.use(found.method)
        self._port: Any = None
        self._touched = False
        self.status, self.simulated = "no frame yet", False
        self.std = np.full(circuit.shape, np.nan)

    def __enter__(self) -> Opened:
        name = self._port_name
        if name == "auto":
            names = candidates(self._serial_number)
            if not names:
                raise FileError(f"port auto: {nothing_found(self._serial_number)}")
            name = names[0]
        self._port = open_port(name, self._baud)
        self._port_name, self.simulated = name, is_simulated(self._port)
        if self.simulated:  # with the curve of this skin: nothing is unknown
            self._skin.proof = Proof(SIMULATED)
        return self

    def __exit__(self, *_) -> None:
        self._port.close()
        self._policy.fault(_BOARD, "closed")

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        while True:
            yield self.read()

    def read(self, patience: float | None = None) -> tuple[float, np.ndarray]:
        """Wait for the next frame; of several that have come meanwhile take the newest.

        Args:
            patience: s to wait for it; None: PATIENCE, or for the first frame as long as a board
                may need that its opening has reset.

        Returns:
            When it arrived, of `time.monotonic` [s], and (rows, cols) force [N]: NaN where the
            frame gives no picture, as `status` says.

        Raises:
            TimeoutError: no frame came.
            ConnectionError: the port is gone.
        """
        if patience is None:
            patience = PATIENCE if self._parser.counters.frames else serial_port.LONGEST_BOOT
        end = time.monotonic() + patience
        while True:
            frames = self._frames(end)
            t = time.monotonic()
            restarts = self._parser.counters.restarts
            taken = [self._admission.frame(t, frame, restarts) for frame in frames]
            if taken[-1] is not None or self._admission.trouble:
                return t, self._take(t, taken[-1])

    @property
    def stop(self) -> bool:
        """Whether a robot must stop now: a push, old readings, or whatever is not sound."""
        return self._decision.stop

    @property
    def reason(self) -> str:
        """Why it must stop; empty while it may move."""
        return self._decision.reason

    def reset(self) -> str:
        """End a latched stop; what keeps it from ending, empty if nothing does."""
        self._skin.reset()
        self._judge()
        return self._policy.reset(time.monotonic())

    @property
    def _decision(self) -> Decision:
        return self._policy.decide(time.monotonic())

    def _frames(self, end: float) -> list[Frame]:
        """Return at least one frame, until a monotonic time [s]."""
        asked = -np.inf
        try:
            while time.monotonic() < end:
                if self._parser.request and time.monotonic() - asked > _ASK_AGAIN:
                    self._port.write(self._parser.request)
                    asked = time.monotonic()
                wanted = max(self._parser.wanted, self._port.in_waiting, 1)
                if frames := self._parser.feed(self._port.read(wanted)):
                    return [frame.only(self._part.of) for frame in frames]
        except PORT_ERRORS as error:
            self._policy.fault(_BOARD, "is gone")
            raise ConnectionError(why_not(self._port_name, error)) from error
        raise TimeoutError(f"port {self._port_name}: no frame came: is the board running?")

    def _take(self, t: float, samples: np.ndarray | None) -> np.ndarray:
        """Solve a frame, and let the stop know."""
        skin, self.stamp = self._skin, t - self._admission.verdict.lag
        stamp = self.stamp
        force = None if samples is None else skin.frame(stamp, samples, stopped=skin.fault)
        self._judge()
        if force is None:
            self.std = np.full(skin.circuit.shape, np.nan)
            return self.std.copy()
        self.std = skin.std
        given = force, self._geometry, self._cell_threshold, skin.bound
        contacts = analyse_frame(*given, held=self._touched).contacts
        self._touched = bool(contacts)
        most = sum(max(c.bound, c.force) for c in contacts)
        peak = max((max(c.peak, c.peak_bound) for c in contacts), default=0.0)
        felt = sum(c.force for c in contacts), max((c.peak for c in contacts), default=0.0)
        self._policy.reading(t, most, peak, stamp, *felt)
        return force

    def _judge(self) -> None:
        """Say what is wrong with the board and the skin."""
        skin, trouble = self._skin, self._admission.trouble
        found = skin.findings()
        wrong = skin.status == "failed" or (skin.fault and self._stops)
        waits = skin.waits and wrong and skin.status != "failed"
        said = "measuring rest: hands off" if waits else str(found[0]) if found else skin.message
        self._policy.fault(_BOARD, trouble)
        self._policy.fault(_SKIN, said or "not sound" if wrong else "", waits)
        self.status = trouble or (said if wrong or found else "ok")


def open(port: str, config: str | Path | None = None) -> Opened:
    """Return a board to read in a loop of one's own, for `with`: see `Opened`."""
    return Opened(port, config)


def _given(file: ParameterFile | None, name: str) -> Any:
    """Return the parameters of a node, as a file has them."""
    given = file.overrides(f"/{name}", f"/{COMPOSED}") if file else []
    given = [p for p in given if p.name in parameters.all_names(name)]  # `skin` has others' as well
    node = Node(name, context=Context(), parameter_overrides=given)
    try:
        return declared(node, parameters.SECTIONS[name])
    except ValueError as error:
        where = sources_of(given, error)
        raise type(error)(f"{where}: {error}" if where else str(error)) from error
