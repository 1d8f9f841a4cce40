# SPDX-License-Identifier: Apache-2.0
"""A person who calibrates a board on a serial device by the command, and answers its questions."""

from __future__ import annotations

import contextlib
import os
import re
import select
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import yaml

from support.lab.unknown import Unknown, UnknownDriven
from support.weights import bodies, objects
from tactile_skin.board import protocol
from tactile_skin.launch import launch
from tactile_skin.middleware.config import read_skin
from tactile_skin.msg import Image, image_array
from tactile_skin.physics.curve import GRAM
from tactile_skin.simulation import simulator

OBJECTS, NEW = 10, 15  # that are weighed; that are felt afterwards
PRESSED = 0.8  # s that a touch stands, and then the next
SETTLES = 0.5  # s after which an object lies still
STANDS, PAUSE = 0.6, 0.4  # s of a new thing on the running skin, and between two
PATIENCE = 240.0  # s for the whole of a calibration
FRACTION_BITS = 6
SCANS_A_FRAME = 4
QUESTION = re.compile(
    r"(?P<off>[Hh]ands off(?!: measured)[^:]*: |hands off it. Enter: )|(?P<press>Press here)|"
    r"(?P<on>Enter: on [^\n]*: )|(?P<lay>object \d+: its weight[^\n]*\) )"
)


class Device:
    """A board of `Unknown` as `simulator.serve` wants one; `load` is what lies on it."""

    def __init__(self, board: Unknown):
        self._board, self._lock = board, threading.Lock()
        self.load(np.zeros(board.supposed.shape))
        self.restart()

    def load(self, force: np.ndarray) -> None:
        """(rows, cols) [N] from now on."""
        ratio = self._board.expose(force)
        with self._lock:
            self._ratio = ratio

    def restart(self) -> None:
        self._scans = 0

    def skip(self, scans: int) -> None:
        self._scans += scans

    def scan(self) -> bytes:
        self._scans += 1
        if self._scans % SCANS_A_FRAME:
            return b""
        circuit = self._board.supposed
        with self._lock:
            adc = self._board.sample(self._ratio) * circuit.full_scale
        samples = np.rint(adc * 2**FRACTION_BITS).astype(np.int32)
        microseconds = round(1e6 * self._scans / simulator.SCANS_PER_SECOND)
        number = self._scans // SCANS_A_FRAME
        return protocol.encode(number, microseconds, samples, circuit.adc_bits, FRACTION_BITS)


def calibrate(device: Device, board: Unknown, port: Path, folder: Path, seed: int) -> str:
    """Run the command to its end; all that it said.

    Raises:
        RuntimeError: it failed, or took too long; with its last words.
    """
    circuit = board.supposed
    known = {"rows": circuit.rows, "cols": circuit.cols, "r_ref": circuit.r_ref}
    known |= {"adc_bits": circuit.adc_bits}
    if circuit.readout != "floating":
        known |= {"readout": circuit.readout, "driven": circuit.driven, "r_par": circuit.r_par}
    (folder / "known.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": {
        "circuit": known}}}))  # fmt: skip
    terminal, theirs = os.openpty()
    words = ["--config", folder / "known.yaml", "--out", folder / "mine.yaml", f"port:={port}"]
    command = [sys.executable, "-m", "tactile_skin", "calibrate", *map(str, words)]
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    try:
        said = _answer(device, board, terminal, seed)
        status = process.wait(10.0)
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
    if status:
        raise RuntimeError(f"exit status {status}: {said[-600:]}")
    return said


def _answer(device: Device, board: Unknown, terminal: int, seed: int) -> str:
    """Do what it asks until it ends."""
    shape = board.supposed.shape
    things, weights = objects(OBJECTS, shape, np.random.default_rng([seed, 3]))
    things, touches = list(zip(things, weights, strict=True)), None
    said, read, until, change = "", 0, time.monotonic() + PATIENCE, 0.0
    while time.monotonic() < until:
        if touches is not None and time.monotonic() > change:
            device.load(next(touches))
            change = time.monotonic() + PRESSED
        if not select.select([terminal], [], [], 0.05)[0]:
            continue
        try:
            said += os.read(terminal, 4096).decode()
        except OSError:  # the command has ended
            return said
        while asked := QUESTION.search(said, read):
            read, answer = asked.end(), "\n"
            if asked["press"]:
                touches = iter(bodies(100, shape, np.random.default_rng([seed, 2])))
                continue
            touches = None
            force, weight = np.zeros(shape), 0.0
            if asked["lay"] and things:
                force, weight = things.pop(0)
                answer = f"{weight / GRAM:.0f} g\n"
            device.load(force)
            time.sleep(SETTLES)
            os.write(terminal, answer.encode())
    raise RuntimeError(f"not done in {PATIENCE:g} s: {said[-600:]}")


def felt(device: Device, board: Unknown, port: Path, config: Path, seed: int) -> np.ndarray:
    """(NEW,) relative errors of the totals of new things on the launched skin."""
    shape, totals = board.supposed.shape, []
    area = read_skin(config).geometry.cell_area
    device.load(np.zeros(shape))
    things, weights = objects(NEW, shape, np.random.default_rng([seed, 4]))

    def on_pressure(message: Image) -> None:
        totals.append(float((image_array(message) * area).sum()))

    def play(skin) -> None:
        time.sleep(4.0)
        for force in things:
            device.load(force)
            time.sleep(STANDS)
            found.append(float(np.median(totals[-5:])) if totals else 0.0)
            device.load(np.zeros(shape))
            time.sleep(PAUSE)
        skin.node.context.try_shutdown()

    found: list[float] = []
    with launch("skin.launch.yaml", port=port, config=config, monitor=False) as skin:
        skin.node.create_subscription(Image, "skin/pressure", on_pressure, 10)
        player = threading.Thread(target=play, args=(skin,))
        player.start()
        skin.spin()
        player.join()
    return np.array(found) / weights - 1.0


def run(shape, seed: int, readout: str) -> np.ndarray:
    """(NEW,) relative errors of one board."""
    board = Unknown(shape, seed) if readout == "floating" else UnknownDriven(shape, seed, readout)
    device, over = Device(board), threading.Event()
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        port = folder / "board"
        serving = threading.Thread(
            target=simulator.serve, args=(device, port, lambda: not over.is_set())
        )
        serving.start()
        stack.callback(serving.join)
        stack.callback(over.set)
        while not port.exists():
            time.sleep(0.01)
        said = calibrate(device, board, port, folder, seed)
        circuit = read_skin(folder / "mine.yaml").circuit
        off = felt(device, board, port, folder / "mine.yaml", seed)
    left_out = re.findall(r"[^\n]*(?:left out|off by)[^\n]*", said)
    print(
        f"{seed}: r_par {board.r_par:.1f}, found {circuit.r_par:.1f}; r_line {board.r_line:.1f}, "
        f"found {np.mean(circuit.r_line):.1f}; new things: median error "
        f"{np.median(np.abs(off)):.1%}, worst {np.abs(off).max():.1%}; "
        f"{left_out[-1].strip() if left_out else ''}",
        flush=True,
    )
    return off
