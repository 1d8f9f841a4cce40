# SPDX-License-Identifier: Apache-2.0
"""A board's newest frame as pictures, never twice as a new one."""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from lerobot.cameras import Camera, CameraConfig
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected
from serial.tools import list_ports

from tactile_skin.launch import read_skin

from . import reader
from .pictures import Depth, Rgb
from .reader import Frame

JOINED = 2.0  # s that the reader may take to end
BLOCK = 10_000  # ms that `read` waits, as LeRobot's own cameras
ON_FAULT = ("raise", "mark")
SMALLEST = 64  # pixels of a picture's side, which LeRobot's video encoders take


@CameraConfig.register_subclass("tactile_skin")
@dataclass(kw_only=True)
class TactileSkinCameraConfig(CameraConfig):
    """A tactile skin; height and width are multiples of its rows and columns, by default 64 up."""

    port: str = "auto"  # device, pyserial URL, or auto: the USB board that `config` names
    config: str | None = None  # parameter file, as `tactile-skin detect` writes it
    use_depth: bool = True  # serve NAME_depth, 16 bits: the picture to learn from
    use_rgb: bool = True  # serve NAME, 8 bits of a logarithm: for eyes and encoders of colours
    step: float = 10.0  # Pa of a step of depth; colour spans 10,000 of them
    on_fault: str = "raise"  # where no picture is to be trusted; or "mark" it
    # "package.module:function", called with (stop, reason) at each change, in the reader's process
    stop_hook: str = ""
    warmup_s: float = 15.0  # that `connect` waits for a rest that is measured: hands off meanwhile
    fps: int | None = 100  # of the board

    def __post_init__(self) -> None:
        if self.on_fault not in ON_FAULT:
            raise ValueError(f"on_fault = {self.on_fault!r}: must be one of {', '.join(ON_FAULT)}")
        if not (self.use_depth or self.use_rgb):
            raise ValueError("use_depth and use_rgb are both false: one must be true")
        if not 0.0 < self.step < float("inf"):
            raise ValueError(f"step = {self.step!r} Pa: must be above 0")
        rows, cols = read_skin(self.config)[0].shape
        pixels = -(-SMALLEST // min(rows, cols))
        self.height, self.width = self.height or rows * pixels, self.width or cols * pixels
        if self.height % rows or self.width % cols or self.height // rows != self.width // cols:
            raise ValueError(
                f"height = {self.height}, width = {self.width}: must be the same multiple of the "
                f"skin's {rows} rows and {cols} columns"
            )


class TactileSkinCamera(Camera):
    """A tactile skin as LeRobot uses a camera; `frame` is the newest one, None before it."""

    def __init__(self, config: TactileSkinCameraConfig):
        super().__init__(config)
        self.config = config
        self.use_rgb, self.use_depth = config.use_rgb, config.use_depth
        self._shape = read_skin(config.config)[0].shape
        self._pixels = (self.height or 0) // self._shape[0]
        self._forms = {"rgb": Rgb(config.step), "depth": Depth(config.step)}
        self._news = threading.Condition()
        self._child: subprocess.Popen | None = None
        self._forget()

    def _forget(self) -> None:
        self.frame: Frame | None = None
        self._error = ""
        self._served = dict.fromkeys(self._forms, -np.inf)  # time of what was given last [s]

    def __str__(self) -> str:
        return f"TactileSkinCamera({self.config.port})"

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return the USB serial boards; `id` is their number in `serial_driver.serial_number`."""
        found = [port for port in sorted(list_ports.comports()) if port.vid is not None]
        return [
            {"type": "tactile_skin", "id": p.serial_number or p.location, "port": p.device}
            | {"name": p.description}
            for p in found
        ]

    @property
    def is_connected(self) -> bool:
        return self._child is not None

    @check_if_already_connected
    def connect(self, warmup: bool = True) -> None:
        """Open the board and, with `warmup`, wait for a picture; ConnectionError: why none came."""
        self._forget()
        given = self.config.port, self.config.config or "", self.config.stop_hook
        command = [sys.executable, "-P", reader.__file__, *given]
        self._child = subprocess.Popen(command, stdout=subprocess.PIPE)
        threading.Thread(target=self._run, args=(self._child,), daemon=True).start()
        if not warmup:
            return
        with self._news:
            self._news.wait_for(lambda: self._error or not self._why(), self.config.warmup_s)
            why = self._why()
        if why:
            self.disconnect()
            raise ConnectionError(f"{self}: {why}")

    def _run(self, child: subprocess.Popen) -> None:
        """Take frames until the reader ends."""
        while True:
            try:
                found = pickle.load(child.stdout)
            except (EOFError, OSError, ValueError, pickle.UnpicklingError):
                found = self._error or "the process that reads it has ended"
            with self._news:
                if child is not self._child:
                    return
                if isinstance(found, str):
                    self._error = found
                else:
                    self.frame = Frame(*found)
                self._news.notify_all()
            if self._error:
                return

    def _why(self) -> str:
        """Why there is no picture to be trusted; empty: there is."""
        if self._error:
            return self._error
        return "has not captured any frames yet" if self.frame is None else self.frame.fault

    @check_if_not_connected
    def read(self) -> np.ndarray:
        """Wait for the next frame; colour, or depth where there is no colour."""
        kind = "rgb" if self.use_rgb else "depth"
        self._served[kind] = self.frame.time if self.frame else -np.inf
        return self._new(kind, BLOCK)

    @check_if_not_connected
    def async_read(self, timeout_ms: float = 200) -> np.ndarray:
        """Return the newest colour frame that was not returned before, waiting for it.

        Unless `on_fault` marks them, ConnectionError: the board is gone, TimeoutError: none came in
        time, RuntimeError: none is to be trusted.
        """
        return self._new("rgb", timeout_ms)

    @check_if_not_connected
    def async_read_depth(self, timeout_ms: float = 200) -> np.ndarray:
        return self._new("depth", timeout_ms)

    @check_if_not_connected
    def read_latest(self, max_age_ms: int = 500) -> np.ndarray:
        """Return the newest colour frame at once, errors as `async_read`: none older than this."""
        return self._latest("rgb", max_age_ms)

    @check_if_not_connected
    def read_latest_depth(self, max_age_ms: int = 500) -> np.ndarray:
        return self._latest("depth", max_age_ms)

    def _new(self, kind: str, timeout_ms: float) -> np.ndarray:
        with self._news:
            last = self._served[kind]
            came = self._news.wait_for(
                lambda: self._error or (self.frame and self.frame.time > last), timeout_ms / 1e3
            )
            if self.frame and came:
                self._served[kind] = self.frame.time
            return self._picture(kind, "" if came else f"no frame in {timeout_ms:g} ms")

    def _latest(self, kind: str, max_age_ms: float) -> np.ndarray:
        with self._news:
            age = 1e3 * (time.perf_counter() - self.frame.time) if self.frame else 0.0
            late = f"latest frame is {age:.0f} ms old, at most {max_age_ms:g} ms"
            return self._picture(kind, late if age > max_age_ms else "")

    def _picture(self, kind: str, late: str) -> np.ndarray:
        """Return the newest frame; where it is wrong or late, raise or mark it."""
        if not getattr(self, f"use_{kind}"):
            raise RuntimeError(f"{self}: use_{kind} is false in its configuration")
        why = self._error or late or self._why()
        if why and self.config.on_fault == "raise":
            error = ConnectionError if self._error else TimeoutError if late else RuntimeError
            raise error(f"{self}: {why}")
        pressure = None if why or self.frame is None else self.frame.pressure
        return self._forms[kind].picture(pressure, self._shape, self._pixels)

    @check_if_not_connected
    def disconnect(self) -> None:
        """Close the board; its stop hook is called."""
        child, self._child = self._child, None
        self._error = "disconnected"
        child.terminate()
        try:
            child.wait(JOINED)
        except subprocess.TimeoutExpired:
            child.kill()
