"""`tactile-skin calibrate`: from a board that is wired up to a parameter file with its newtons."""

from __future__ import annotations

import datetime
import os
import shutil
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import yaml

from .. import __version__
from ..calibration.creep import as_it_comes
from ..calibration.guide import Guide
from ..middleware.bus import Context, Node, Parameter, SingleThreadedExecutor
from ..middleware.config import ParameterFile, SkinConfig, adc_of, circuit_of, read_skin
from ..msg import Image, image_array
from ..nodes import QUEUE
from ..nodes.serial_driver import SerialDriver
from ..physics.creep import Creep
from ..physics.curve import PressureCurve
from ..yaml_files import read_yaml

_OF_BOARD = {"port": str, "baud": int, "protocol": str}
_PATIENCE = 10.0  # s without a frame after which the board is taken for absent


def run(out: Path, config: Path | None, board: dict, creep: bool = False) -> int:
    """Guide through the steps on a live board, and write what was learnt.

    Args:
        out: parameter file to write.
        config: parameter file with what is known of the board; None: the defaults.
        board: parameters of the serial driver that take the place of the file's: port, baud.
        creep: measure only how much a standing load gains, of a board that is calibrated.
    """
    check_writable(out)
    skin, live = read_skin(config), Live(config, board)
    guide = Guide(skin.circuit, live, _ask, print)
    try:
        guide.measure_creep(skin.curve) if creep else guide.run()
    finally:
        live.close()
    write(out, config, guide, skin)
    print(f"{out} is written. Use it: tactile-skin launch skin.launch.yaml config:={out}")
    return 0


def check_writable(out: Path) -> None:
    """Before the work begins, not after it: ValueError says why `out` cannot be written."""
    if not out.parent.is_dir():
        raise ValueError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise ValueError(f"--out {out}: is a folder, must be a file")
    try:
        with tempfile.NamedTemporaryFile(dir=out.parent, prefix=f".{out.name}."):
            pass
    except OSError as error:
        raise ValueError(f"--out {out}: {out.parent}: {error.strerror}") from error


def board_parameters(words: list[str]) -> dict:
    """["port:=/dev/ttyUSB0", "baud:=115200"] -> parameters of the serial driver."""
    found = {}
    for word in words:
        name, given, value = word.partition(":=")
        if not given or name not in _OF_BOARD:
            raise ValueError(f"{word!r}: must be NAME:=VALUE, NAME one of {', '.join(_OF_BOARD)}")
        try:
            found[name] = _OF_BOARD[name](value)
        except ValueError as error:
            raise ValueError(f"{word!r}: {value!r} must be a whole number") from error
    return found


def _ask(text: str) -> str:
    try:
        return input(text)
    except EOFError:
        return ""


def write(path: Path, source: Path | None, guide: Guide, skin: SkinConfig) -> None:
    """The configuration with what was learnt, as a parameter file; the old one is kept as .bak.

    A crash at any point leaves the old file or the new one.
    """
    data = {} if source is None else (read_yaml(source) or {})
    shared = data.setdefault("/**", {}).setdefault("ros__parameters", {})
    circuit = shared.setdefault("circuit", {})
    said = guide.circuit.describe()
    for name in ("rows", "cols", "r_ref", "adc_bits"):
        circuit.setdefault(name, said[name])
    if guide.found:
        circuit["r_par"] = round(guide.circuit.r_par, 1)
        circuit["r_line"] = round(float(np.mean(guide.circuit.r_line)), 1)
    notes = [
        f"made by tactile-skin calibrate {__version__}, {datetime.datetime.now():%Y-%m-%d %H:%M}"
    ]
    notes.append(f"noise of a reading: {guide.rest.noise:.2f} ADC steps")
    notes += [f"row {row}, column {col} is noisy" for row, col in guide.rest.noisy]
    if guide.found:
        notes.append(guide.found.message)
    creep = guide.creep or skin.creep
    share, seconds = round(creep.share, 4), round(creep.time, 2)
    if guide.fitted or guide.creep:
        by_file = skin.curve, skin.creep
        curve, known = (guide.fitted.curve, None) if guide.fitted else by_file
        shared["curve"] = _points(as_it_comes(curve, Creep(share, seconds), known))
        if share:
            shared["curve"] |= {"creep": share, "creep_time": seconds}
    if guide.fitted:
        notes.append(guide.fitted.message)
    if guide.creep:
        notes.append(
            f"a standing load gains {share:.1%} +- {guide.creep.std:.1%} in a decade of time"
        )
    comment = "".join(f"# {line}\n" for note in notes for line in note.splitlines())
    replace_file(path, comment + yaml.safe_dump(data, sort_keys=False))


def _points(curve: PressureCurve) -> dict:
    described = curve.describe()
    return {
        "force": [round(float(v), 5) for v in described["force"]],
        "resistance": [round(float(v), 2) for v in described["resistance"]],
    }


def replace_file(path: Path, text: str) -> None:
    """Write a file in one step; one that was there is kept beside it, as NAME.bak."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            old = Path(f"{name}.bak")
            shutil.copy2(path, old)
            os.replace(old, f"{path}.bak")
        os.replace(name, path)
    except BaseException:
        for left in (name, f"{name}.bak"):
            Path(left).unlink(missing_ok=True)
        raise


# --- a live board, or files -----------------------------------------------------------------------


class Live:
    """Frames of a board, through the same driver node as on the robot."""

    def __init__(self, source: Path | None, overrides: dict):
        self._executor, self._context = SingleThreadedExecutor(), Context()
        parameters = ParameterFile(source).overrides("/serial_driver") if source else []
        parameters += [Parameter(name, value) for name, value in overrides.items()]
        node = Node("serial_driver", context=self._context, parameter_overrides=parameters)
        self._driver = SerialDriver(node)
        listener = Node("calibrate", context=self._context, parameter_overrides=parameters)
        self._adc = adc_of(listener, circuit_of(listener))
        self._frames: list[np.ndarray] = []
        listener.create_subscription(Image, "skin/adc", self._on_adc, QUEUE)
        for each in (node, listener):
            self._executor.add_node(each)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def _on_adc(self, msg: Image) -> None:
        self._frames.append(self._adc.ratio_of(image_array(msg)))

    def __call__(self, seconds: float) -> np.ndarray:
        """ValueError after 10 s without a frame."""
        self._frames.clear()
        until, patience = time.monotonic() + seconds, time.monotonic() + seconds + _PATIENCE
        while time.monotonic() < until or not self._frames:
            if time.monotonic() > patience:
                raise ValueError(
                    "no frame for 10 s: is the board connected, are port, baud and protocol right? "
                    "`tactile-skin launch` names what arrives"
                )
            time.sleep(0.02)
        return np.array(self._frames)

    def close(self) -> None:
        self._executor.shutdown()
        self._driver.close()
