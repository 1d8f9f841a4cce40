# SPDX-License-Identifier: Apache-2.0
"""Recorded readings through compensation, features and stop, one after the other."""

from __future__ import annotations

import tempfile
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..launch import Skin, find, read_plan
from ..middleware.bus import Context, ManualClock, Node, SingleThreadedExecutor, Time
from ..middleware.plan import Plan, parameters_of
from ..msg import DiagnosticArray, Image, image_array
from ..nodes import diagnostics
from ..nodes.stop_on_push import STATUS, STATUS_TOPIC
from ..parameters.nodes import all_names
from ..recording import Recording, cdr, configuration
from ..recording.reader import ADC, EVER
from ..recording.writer import Writer

_NODES = "compensation", "gesture_feature", "stop_on_push"  # of the launch file; no board
_NO_PORT = "loop://"  # the driver is never started
_PATIENT = 10.0  # s for a frame, the most there is: a busy machine is not what is replayed
_LONGEST_WAIT = 10.0  # s that a reading may have waited for compensation: its queue holds 40


@dataclass
class Step:
    """One reading and what the nodes made of it."""

    stamp: int  # arrival of its last byte [ns since 1970]
    force: np.ndarray  # (rows, cols) [N]; NaN: the frame failed
    # total, peak: of all cells, and of the most loaded one [N]
    total: float
    peak: float
    status: str  # "ok", "suspect" or "failed", as of an Estimate
    stop: str  # the reason, empty while the robot is free
    seconds: float  # that compensation, features and stop took on this machine

    def without_picture(self) -> Step:
        """Return it with an empty `force`: an hour of pictures would not fit."""
        return replace(self, force=np.empty((0, 0)))


class Replay:
    """Iterate over it once: a Step for each reading that compensation takes.

    With the recorded parameters each reading comes when the robot took it up (skin/taken): one that
    was late is skipped, or given to the fast method again, and the pressure is the same to the bit,
    but for frames that timed out. With others, or without skin/taken, each comes at its stamp.

    Args:
        source: the recording.
        method: of the compensation, in place of the recorded one.
        config: parameter file, in place of all recorded parameters.
        begin, end: only what was recorded from begin to before end [ns since 1970].

    Attributes:
        driven: the nodes; subscribe with `driven.observer` before the first step.
        cell_area: (rows, cols) [m^2].
        notes: what was left out of the recording, in words.

    Raises:
        ValueError: a parameter that is wrong; the message names it.
    """

    def __init__(
        self,
        source: Recording,
        method: str = "",
        config=None,
        begin: int = 0,
        end: int = EVER,
    ):
        self._source, self._part = source, (begin, end)
        self._as_taken = not (method or config)
        self._folder = tempfile.TemporaryDirectory(prefix="tactile_skin_")
        self.notes: list[str] = []
        self._writer: Writer | None = None
        self._left_out = 0  # readings
        plan = _plan(config)
        for action in plan.nodes:
            values = {} if config else self._recorded(action.executable)
            if action.executable == "compensation":
                values |= {"time_limit": _PATIENT} | ({"method": method} if method else {})
            action.give(values)
        self.driven = Driven(plan, max(begin, source.span[0]))
        self.cell_area = self.driven.nodes["gesture_feature"].geometry.cell_area
        self._unknown = np.full(self.cell_area.shape, np.nan)
        self._force, self._stop = self._unknown, "no decision yet"
        observer = self.driven.observer
        observer.create_subscription(Image, "skin/pressure", self._on_pressure, 10)
        observer.create_subscription(DiagnosticArray, STATUS_TOPIC, self._on_status, STATUS)
        self._adc = observer.create_publisher(Image, ADC, 10)
        self._diagnostics = observer.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)

    def record(self, path) -> None:
        """Write all that the nodes publish to a new recording.

        Raises:
            FileError, OSError: the file cannot be made.
        """
        attachments = configuration.attachments(parameters_of(self.driven.observer.context))
        now = self.driven.now
        self._writer = writer = Writer(path, attachments, now())
        for topic, kind in cdr.new_topics(self.driven.observer, set()):

            def take(message, topic=topic):
                writer.write(topic, type(message), now(), cdr.encode(message))

            self.driven.observer.create_subscription(kind, topic, take, STATUS)

    def _recorded(self, executable: str) -> dict:
        """Return the recorded parameters of a node; those that it does not know are left out."""
        attached, folder = self._source.attachments, Path(self._folder.name)
        values = configuration.unpack(self._source.node_parameters(executable), attached, folder)
        known = all_names(executable)
        unknown = sorted(set(values) - known)
        if unknown:
            self.notes.append(f"{executable}: recorded parameters unknown here: {unknown}")
        return {name: value for name, value in values.items() if name in known}

    def __iter__(self) -> Iterator[Step]:
        compensation = self.driven.nodes["compensation"]
        try:
            for t, message in self._events():
                self.driven.until(t)
                if isinstance(message, DiagnosticArray):
                    self._diagnostics.publish(message)
                    self.driven.run()
                    continue
                if (message.height, message.width) != (shape := compensation.skin.circuit.shape):
                    raise ValueError(
                        f"{self._source.path}: readings of {message.height} x {message.width}, but "
                        f"the circuit is {shape[0]} x {shape[1]}"
                    )
                self._force, begun = self._unknown, time.perf_counter()
                skipped = compensation.skipped
                self._adc.publish(message)
                self.driven.run()
                if compensation.skipped > skipped:
                    self._left_out += 1
                    continue
                seconds = time.perf_counter() - begun
                force = self._force
                total, peak = float(force.sum()), float(force.max())
                stamp = Time.from_msg(message.header.stamp).nanoseconds
                yield Step(stamp, force, total, peak, compensation.skin.status, self._stop, seconds)
            if self._left_out:
                self.notes.append(f"{self._left_out} readings that the robot skipped, being late")
            if self._source.damage:
                self.notes.append(f"{self._source.path}: {self._source.damage}")
        finally:
            if self._writer:
                self._writer.close()
            self.driven.close()
            self._folder.cleanup()

    def _events(self) -> Iterator[tuple[int, Image | DiagnosticArray]]:
        """When [ns since 1970] and what the nodes are given, in that order."""
        begin, end = self._part
        wait = round(_LONGEST_WAIT * 1e9)
        taken = self._source.taken(begin, end + wait) if self._as_taken else {}
        waiting: deque[tuple[int, Image]] = deque()
        for t, message in self._source.readings(begin, end):
            while waiting and waiting[0][0] <= t:
                yield waiting.popleft()
            if not taken or isinstance(message, DiagnosticArray):
                yield t, message
            elif t in taken:
                waiting.append((taken[t], message))
            else:  # compensation's queue dropped it, or the recording ends before
                self._left_out += 1
        yield from waiting

    def _on_pressure(self, message: Image) -> None:
        self._force = image_array(message) * self.cell_area

    def _on_status(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        self._stop = status.message if status.level != diagnostics.OK else ""


def _plan(config) -> Plan:
    """Return the nodes that follow the board."""
    arguments = {"config": str(config)} if config else {}
    plan = read_plan(find("skin.launch.yaml"), arguments | {"port": _NO_PORT, "monitor": "false"})
    return replace(plan, nodes=[a for a in plan.nodes if a.executable in _NODES])


_STEP = 10**14  # ns of which a float holds each


class Driven:
    """The nodes of a plan on a clock that is driven; nothing of the launch file's is started.

    Attributes:
        nodes: executable -> node.
        observer: for subscriptions and publishers of your own.

    Raises:
        ValueError: as Skin.build.
    """

    def __init__(self, plan: Plan, start: int):
        self._clock = ManualClock(0.0)
        context = Context(self._clock)
        self._set(start)
        self._skin = Skin(plan, context)
        self._skin.build()
        kinds = [action.executable for action in plan.nodes]
        self.nodes = dict(zip(kinds, self._skin._nodes, strict=True))
        self.observer = Node("observer", context=context)
        self._executor = SingleThreadedExecutor()
        for handle in (*self._skin._handles, self.observer):
            self._executor.add_node(handle)

    def _set(self, t: int) -> None:
        while (ahead := t - self.now()) > 0:
            self._clock.advance(min(ahead, _STEP) / 1e9)

    def now(self) -> int:
        """Return what the clock shows [ns since 1970]."""
        return self._clock.now().nanoseconds

    def until(self, t: int) -> None:
        """Let the time go by until t [ns since 1970], if it is not over; timers run."""
        self._set(t)
        self.run()

    def run(self) -> None:
        """Carry out what is due now."""
        self._executor.spin_some()

    @property
    def errors(self) -> int:
        """Callbacks that raised."""
        return sum(handle.callback_errors for handle in self._skin._handles)

    def close(self) -> None:
        for handle in (*self._skin._handles, self.observer, self._skin.node):
            handle.destroy_node()
