# SPDX-License-Identifier: Apache-2.0
"""What a person does from the page: detect, the guided calibration, the doctor.

Each runs in a thread of the page's process and survives a reload; its questions are answered by any
page. To detect a board that nobody described the skin lends its port, and takes it back once this
process closes it, or ends. Meanwhile that board is drawn, and may be calibrated.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..board.recognise.listen import BAUDS, listen
from ..board.serial_port import candidates, open_port
from ..calibration.rest import check_all_is_sent
from ..guide.calibrated import known_of, write
from ..guide.calibration import Guide
from ..guide.detection import SECONDS, conclude
from ..guide.notes import notes
from ..guide.sent import GLANCE, check_sent
from ..health.doctor import diagnose
from ..middleware.config import SkinConfig
from ..yaml_files import write_yaml
from .borrowed import Borrowed
from .pictures import Pictures
from .snapshot import Snapshot

_LINES = 40  # that are kept of what was said
_LENDS = 5.0  # s within which the skin has lent its port
_PATIENCE = 10.0  # s without a reading after which the task ends
_FRAMES = 1 << 26  # bytes of readings that a task may keep
_POLL = 0.1  # s between two looks at whether it is given up
# downloads
DETECTED, CALIBRATED, RECORDING = "/mine.yaml", "/calibrated.yaml", "/recording.mcap"
_WAYS = (
    "Take your hands off the skin for 5 s. Then press everywhere with fingers and palm for a "
    "minute, twenty touches or more, some of them hard, with pauses. Then go on: "
)


class _GivenUpError(Exception):
    """A person ended the task."""


class Work:
    """At most one task at a time.

    Args:
        skin: its configuration.
        given: its parameters, name -> value; those in groups begin the file that is written.

    Attributes:
        version: rises with each change of the state.
        files: path of a download -> its content.
    """

    def __init__(self, skin: SkinConfig, given: dict):
        self._skin, self._given = skin, dict[str, dict]()
        for group, _, name in (key.partition(".") for key in given):
            if name:
                self._given.setdefault(group, {})[name] = given[f"{group}.{name}"]
        self.version, self.files = 0, dict[str, bytes]()
        self._task, self._recording = "", False
        self._sections = ""  # of the nodes, for the file that a calibration writes
        self._question: str | None = None
        self._until: float | None = None  # monotonic, of a count-down [s]
        self._lines: deque[str] = deque(maxlen=_LINES)
        self._findings: list[dict] = []
        self._curve: list[list[float]] = []
        self._frames: list[np.ndarray] = []
        self._stamp, self._port = 0.0, ""
        self._borrowed: Borrowed | None = None
        self._goes_back = False  # whether a question may be answered by a step back
        self._answered, self._given_up = threading.Event(), threading.Event()
        self._answer = ""

    # --- for the server's thread ---

    def take(self, snapshot: Snapshot) -> None:
        """Take the readings, while a task runs on them, and the name of the port."""
        for name, status in snapshot.nodes.items():
            if name.rpartition("/")[2] == "serial_driver":
                self._port = status.values.get("port", "")
        if not self._task or self._borrowed or snapshot.adc is None:
            return
        if snapshot.stamp != self._stamp:
            self._stamp = snapshot.stamp
            self._keep(self._skin, snapshot.adc)

    def _keep(self, skin: SkinConfig, adc: np.ndarray) -> None:
        if not self._full:
            self._frames.append(skin.adc.ratio_of(adc))

    def seen(self, snapshot: Snapshot) -> Snapshot:
        """Return what is to be drawn: a board that is borrowed goes first."""
        borrowed = self._borrowed
        return borrowed.seen(snapshot) if borrowed else snapshot

    @property
    def pictures(self) -> Pictures | None:
        """What draws a board that is borrowed; None: the skin is drawn."""
        return self._borrowed.pictures if self._borrowed else None

    @property
    def _full(self) -> bool:
        return bool(self._frames) and len(self._frames) * self._frames[0].nbytes >= _FRAMES

    def ask(self, name: str, text: str) -> None:
        """Do what a page asks for: "detect", "calibrate", "doctor", "answer" or "give up".

        Args:
            text: to "answer", what was typed; to "calibrate", sections that the file begins with
                besides the skin's.

        Raises:
            ValueError: that is not possible now.
        """
        if name == "answer":
            if self._question is None:
                raise ValueError("nothing is asked")
            self._answer = text
            self._question = None
            self._answered.set()
        elif name == "give up":
            self._given_up.set()
        elif self._task:
            raise ValueError(f"{self._task} is at work: answer it, or give it up")
        else:
            self._sections = text
            self._begin(name)
        self._changed()

    def state(self) -> dict:
        """Return what a page shows of it, as JSON's own types."""
        left = None if self._until is None else max(0.0, self._until - time.monotonic())
        return {
            "task": self._task,
            "recording": self._recording,
            "lines": list(self._lines),
            "question": self._question,
            "back": self._goes_back,
            "left": left,
            "findings": self._findings,
            "curve": self._curve,
            "files": list(self.files),
        }

    def _begin(self, name: str) -> None:
        self._task = name
        self._lines.clear()
        self._findings, self._curve = [], []
        self._given_up.clear()
        tasks = {"detect": self._detect, "calibrate": self._calibrate_skin, "doctor": self._doctor}
        steps = tasks[name]
        threading.Thread(target=self._run, args=(steps,), name=name, daemon=True).start()

    def record(self, on: bool, made: Path | None) -> None:
        """Note that a recording is on, or has ended; what was made is downloaded from here."""
        self._recording = on
        if made is not None:
            self.files[RECORDING] = made.read_bytes()
            made.unlink()
            made.parent.rmdir()
        self._changed()

    # --- in the task's thread ---

    def _run(self, steps: Callable[[], None]) -> None:
        try:
            steps()
        except _GivenUpError:
            self._say("given up")
        except Exception as error:  # it is said, whatever it is
            self._say(str(error) or repr(error))
        finally:
            self._task, self._question, self._until = "", None, None
            self._goes_back = False
            self._frames.clear()
            self._changed()

    def _detect(self) -> None:
        with self._lent_port() as line:
            self._say(f"The skin has lent {line.port}: the robot is stopped until this ends.")
            found = listen(line, BAUDS, SECONDS, self._progress)
            text = conclude(found, {"port": line.port}, None, self._asked, self._say)
            if not text:
                return
            self.files[DETECTED] = text.encode()
            self._say("Download mine.yaml, and launch with config:=mine.yaml.")
            with Borrowed(line, text, self._take_borrowed) as self._borrowed:
                try:
                    self._wait_for("Go on to calibrate this board now, or give up: ")
                    self._calibrate(self._borrowed.skin, text)
                finally:
                    self._borrowed = None

    def _lent_port(self):
        """Return the open port of the skin, once that has lent it."""
        ports = candidates() if self._port == "auto" else [self._port]  # auto: it found no board
        if len(ports) != 1 or not ports[0]:
            found = ", ".join(filter(None, ports)) or "none"
            raise ValueError(f"serial ports of this skin: {found}: launch with port:= one of them")
        patience = time.monotonic() + _LENDS
        while True:
            try:
                return open_port(ports[0], BAUDS[0])
            except ValueError:
                if time.monotonic() > patience:
                    raise
            self._unless_given_up()

    def _progress(self, text: str) -> None:
        self._say(text)
        self._unless_given_up()

    def _asked(self, question: str, read: Callable[[str], Any]) -> Any:
        """Return what is read in the answer of a page, which is asked again if it is none."""
        while True:
            try:
                return read(self._wait_for(question).strip())
            except ValueError as error:
                self._say(str(error))

    def _take_borrowed(self, adc: np.ndarray) -> None:
        if self._borrowed:
            self._keep(self._borrowed.skin, adc)

    def _calibrate_skin(self) -> None:
        section = {"/**": {"ros__parameters": self._given}}
        self._calibrate(self._skin, write_yaml(section) + self._sections)

    def _calibrate(self, skin: SkinConfig, text: str) -> None:
        """Lead through the steps; what was learnt is entered in the text of a parameter file."""

        def fitted(_=None) -> None:
            curve = guide.fitted.curve.describe() if guide.fitted else {}
            self._curve = list(curve.values())  # force, resistance
            self._changed()

        ways = self._read, self._wait_for, self._say, self._count_down, fitted
        guide = Guide(skin.circuit, *ways, **known_of(skin))
        check_sent(skin, self._read(GLANCE))
        self._goes_back = True
        guide.run()
        fitted()  # or not: a useless one is dropped
        if not guide.learnt:
            raise ValueError("nothing was learnt: no file is written")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / CALIBRATED[1:]
            path.write_text(text)
            write(path, path, guide, skin)
            self.files[CALIBRATED] = path.read_bytes()
        self._say(
            f"Learnt: {', '.join(guide.learnt)}. Download calibrated.yaml, and launch with "
            "config:=calibrated.yaml; it holds what this skin was launched with, too."
        )

    def _doctor(self) -> None:
        self._frames.clear()
        self._until = time.monotonic() + 65.0  # s that this takes
        self._wait_for(_WAYS)
        self._until = None
        frames, skin = np.array(self._frames), self._skin
        if not frames.size:
            raise ValueError("no reading came")
        first = "the first " if self._full else ""
        self._say(f"{first}{len(frames)} readings: looking ...")
        threshold = skin.adc.threshold(skin.threshold)
        check_all_is_sent(frames, skin.circuit, threshold, skin.threshold)
        found = diagnose(frames, skin.circuit, inverted=skin.adc.inverted, curve=skin.curve)
        self._findings = [
            {"text": str(f), "rows": list(map(int, f.rows)), "cols": list(map(int, f.cols))}
            for f in found
        ]
        for said in (*found, *notes(found, frames, skin.circuit)):
            self._say(str(said))

    def _read(self, seconds: float) -> np.ndarray:
        self._frames.clear()
        until, patience = time.monotonic() + seconds, time.monotonic() + seconds + _PATIENCE
        while time.monotonic() < until or not self._frames:
            trouble = self._borrowed.trouble if self._borrowed else ""
            if trouble or time.monotonic() > patience:
                raise ValueError(trouble or f"no reading came for {_PATIENCE:g} s")
            self._unless_given_up()
        return np.array(self._frames)

    def _wait_for(self, question: str) -> str:
        """Return the answer of a page."""
        self._answered.clear()
        self._question = question
        self._changed()
        while not self._answered.is_set():
            self._unless_given_up()
        self._lines.append(question)
        if self._answer:
            self._lines.append(f"> {self._answer}")
        self._changed()
        return self._answer

    def _count_down(self, seconds: int) -> None:
        self._until = time.monotonic() + seconds
        self._changed()
        while time.monotonic() < self._until:
            self._unless_given_up()
        self._until = None
        self._changed()

    def _unless_given_up(self) -> None:
        """Wait a moment."""
        if self._given_up.wait(_POLL):
            raise _GivenUpError

    def _say(self, text: str) -> None:
        self._lines.append(text)
        self._changed()

    def _changed(self) -> None:
        self.version += 1
