# SPDX-License-Identifier: Apache-2.0
"""monitor: a live line on the terminal, of a skin or a body, and a summary at the end."""

from __future__ import annotations

import functools
import os
import shutil
import sys
from collections import deque

import numpy as np

from ...behaviours.stop import may_be
from ...middleware.bus import DurabilityPolicy, QoSProfile, Time
from ...middleware.config import declared
from ...middleware.logs import takes
from ...msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Image,
    PointCloud2,
    String,
    Twist,
    TwistStamped,
    Vector3Stamped,
    cloud_columns,
)
from ...parameters.nodes import Monitor as Parameters
from ...physics.proof import NOT_PROVED, NOTHING
from .. import READING, diagnostics
from ..cmd_vel import kind_of, twist_of
from ..stop_on_push import COUNTS_AS, STATUS_TOPIC
from ..touch import xyz

_FIRST_FRAME_WITHIN = 20.0  # s, before a run of limited duration gives up
_KEPT = 200_000  # latencies
_GESTURE_SHOWN = 2.0  # s
_CLEAR = "\r\x1b[2K"  # to the line's begin, and erase it (ECMA-48)
# colour of the live line's end that begins with the stop, or with "free"; and none (ECMA-48)
_RED, _GREEN, _PLAIN = "\x1b[1;31m", "\x1b[32m", "\x1b[0m"
_EVERY_DECISION = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class _Frames:
    """The frames of one skin, and which of them its stop has decided on."""

    def __init__(self, name: str, now: int):
        self.name = f"{name} " if name else ""
        self.count = 0
        self.dropped = 0  # that reached skin/adc, but no stop decision
        self.latencies: deque[float] = deque(maxlen=_KEPT)  # s
        self.driver: dict[str, str] = {}  # what it reports
        self._pending: deque[int] = deque(maxlen=1000)  # stamps without a decision yet [ns]
        self._decided = 0, 0  # stamp of the last decision that came before its reading, when [ns]
        self._mark = now, 0

    def arrived(self, stamp: int) -> None:
        self.count += 1
        if stamp == self._decided[0]:  # the driver was held up while it called its subscribers
            self.latencies.append((self._decided[1] - stamp) / 1e9)
        else:
            self._pending.append(stamp)

    def decided(self, now: int, stamp: int) -> None:
        """Take a decision of its stop, with the stamp of the reading that it rests on."""
        while self._pending and self._pending[0] < stamp:
            self._pending.popleft()
            self.dropped += 1
        if self._pending and self._pending[0] == stamp:
            self._pending.popleft()
            self.latencies.append((now - stamp) / 1e9)
        elif stamp != self._decided[0]:
            self._decided = stamp, now

    def rate(self, now: int) -> float:
        """Return the frames per second from the last call to now [ns]; begin to count again."""
        since, frames = self._mark
        self._mark = now, self.count
        return (self.count - frames) / max((now - since) / 1e9, 1e-9)


class Monitor:
    """Counts messages as any subscriber could: it uses topics only.

    With a `duration` it ends the launch that many seconds after the first frame. Of a body it shows
    what all skins feel, the rate of the slowest, and the stop of the body.
    """

    def __init__(self, node):
        self.node, self.out = node, sys.stdout
        given = declared(node, Parameters)
        self.duration = given.duration
        self.failed = False
        self.stops: list[tuple[float, float | None, str]] = []  # start, end [s], reason
        self.most_contacts = 0
        self.touched_frames = 0
        self.largest_force = 0.0
        self._first: int | None = None
        self._simulated = False
        self._proof = ""  # of the newtons, as the stop says it
        self._warnings: dict[str, str] = {}  # node -> its message
        self._kinds: dict[str, tuple] = {}  # node -> kind of that and its lines; or its words
        self._warned: dict[str, tuple] = {}  # the same of those that were printed
        self._contacts, self._force, self._most, self._touched = 0, 0.0, 0.0, ""
        self._direction = (0.0, 0.0, 0.0)
        self._gesture, self._named_at = "", 0  # the last one that was named, and when [ns]
        self._cmd_vel: Twist | None = None  # while a node of the skin moves the robot
        self._waiting = "no decision yet"
        self._printed = False  # a live line was printed
        self._last_reason = ""  # the reason of the last one
        self._start = self._now()
        names = [name for name in given.skins if name]
        self.skins = [_Frames(name, self._start) for name in names or ("",)]
        for name, frames in zip(names or ("",), self.skins, strict=True):
            self._listen(f"{name}/" if name else "", frames)
        node.create_subscription(PointCloud2, "skin/contacts", self.on_contacts, 100)
        node.create_subscription(Vector3Stamped, "skin/push_direction", self.on_direction, 100)
        node.create_subscription(String, "skin/gesture", self.on_gesture, 10)
        node.create_subscription(kind_of(given.stamped), "cmd_vel", self.on_cmd_vel, 1)
        node.create_subscription(DiagnosticArray, STATUS_TOPIC, self.on_status, _EVERY_DECISION)
        node.create_timer(0.2 if self.out.isatty() else 1.0, self.live_line)
        if self.duration > 0.0:
            node.create_timer(0.02, self.on_timer)

    def _listen(self, space: str, frames: _Frames) -> None:
        def hear(kind, topic: str, callback, qos) -> None:
            take = functools.partial(callback, frames)
            self.node.create_subscription(kind, f"{space}{topic}", take, qos)

        hear(Image, "skin/adc", self.on_adc, READING)
        hear(DiagnosticArray, STATUS_TOPIC, self.on_decision, _EVERY_DECISION)
        hear(DiagnosticArray, diagnostics.TOPIC, self.on_diagnostics, 100)

    def _now(self) -> int:
        return self.node.get_clock().now().nanoseconds

    def on_adc(self, frames: _Frames, msg: Image) -> None:
        stamp = Time.from_msg(msg.header.stamp).nanoseconds
        self._first = stamp if self._first is None else self._first
        frames.arrived(stamp)

    def on_decision(self, frames: _Frames, msg: DiagnosticArray) -> None:
        frames.decided(self._now(), Time.from_msg(msg.header.stamp).nanoseconds)

    def on_contacts(self, msg: PointCloud2) -> None:
        self._contacts = msg.width
        columns = cloud_columns(msg, "force", "skin")
        self._force = sum(columns["force"].tolist())
        names = [self.skins[k].name.strip() for k in np.unique(columns.get("skin", ())).astype(int)]
        self._touched = f" on {', '.join(names)}" if names else ""  # of a body
        self.most_contacts = max(self.most_contacts, self._contacts)
        self.largest_force = max(self.largest_force, self._force)
        self.touched_frames += self._contacts > 0

    def on_direction(self, msg: Vector3Stamped) -> None:
        self._direction = xyz(msg.vector)

    def on_gesture(self, msg: String) -> None:
        self._gesture, self._named_at = msg.data, self._now()

    def on_cmd_vel(self, msg: Twist | TwistStamped) -> None:
        self._cmd_vel = twist_of(msg)

    def on_status(self, msg: DiagnosticArray) -> None:
        """Take every decision of the robot's stop."""
        now, stamp = self._now(), Time.from_msg(msg.header.stamp).nanoseconds
        if not self.node.context.ok():  # the stop of a shutdown does not count
            return
        status = msg.status[0]
        said = {pair.key: pair.value for pair in status.values}
        self._proof = said.get(diagnostics.PROOF, self._proof)
        self._most = float(said.get(COUNTS_AS, 0.0))  # of the body nobody says it
        reason = status.message if status.level != DiagnosticStatus.OK else ""
        if self._first is None or stamp < self._first:  # stopped, as it must be, before a reading
            self._waiting = reason
            return
        self._waiting = ""
        t = (now - self._first) / 1e9
        if self.stops and self.stops[-1][1] is None:
            start, _, was = self.stops[-1]
            if was == reason:
                return
            self.stops[-1] = (start, t, was)
        if reason:
            self.stops.append((t, None, reason))

    def on_diagnostics(self, frames: _Frames, msg: DiagnosticArray) -> None:
        for status in msg.status:
            values = {pair.key: pair.value for pair in status.values}
            if "crc_errors" in values:
                frames.driver = values
                self._simulated |= values.get(diagnostics.SIMULATED) == "true"
            if status.level == DiagnosticStatus.WARN:  # an ERROR shows as the stop's reason
                self._warnings[status.name] = status.message
                keys = diagnostics.KIND, diagnostics.FORM, diagnostics.ROWS, diagnostics.COLS
                kind = tuple(values.get(key, "") for key in keys)
                self._kinds[status.name] = kind if any(kind) else (status.message,)
            else:
                self._warnings.pop(status.name, None)

    def on_timer(self) -> None:
        now = self._now()
        if not self.node.context.ok():
            return
        if self._first is None:
            over = now - self._start > (_FIRST_FRAME_WITHIN + self.duration) * 1e9
            self.failed = over
        else:
            over = now - self._first >= self.duration * 1e9
        if over:
            self.node.context.try_shutdown()

    def live_line(self) -> None:
        self._printed = True
        if not takes(self.out):  # Ctrl-S, say: the next line will do
            return
        now = self._now()
        push = "no push direction"
        if any(abs(v) > 0.0 for v in self._direction):  # not NaN, of an unknown shape
            push = "push ({:+.2f} {:+.2f} {:+.2f})".format(
                *(round(v, 2) + 0.0 for v in self._direction)
            )
        reason = self._waiting
        if self.stops and self.stops[-1][1] is None:
            reason = self.stops[-1][2]
        slowest, skin = min((skin.rate(now), skin.name) for skin in self.skins)
        rate = f"{'SIMULATED ' * self._simulated}{skin}{slowest:5.1f}/s"
        line = (
            f"{rate}  drops {self.drops}  contacts {self._contacts} {self._force:6.1f} N"
            f"{may_be(self._force, self._most)}{self._touched}  {push:<26} "
            f"{'STOP ' + reason if reason else 'free'}"
            f"{f'  {NOT_PROVED}' * (self._proof == NOTHING)}"
            f"{self._gesture_motion_and_warnings(now)}"
        )
        clear = _CLEAR if self.out.isatty() else ""
        for text in self._new_warnings():
            self._write(f"{clear}{text}\n")
        if clear:
            self._write_over(line, rate, reason)
        else:
            self._write(f"{line}\n")

    def _gesture_motion_and_warnings(self, now: int) -> str:
        """Return the end of the live line at now [ns]; empty where there is none of these."""
        line = ""
        if self._gesture and now - self._named_at < _GESTURE_SHOWN * 1e9:
            line += f"  {self._gesture}"
        if self._cmd_vel is not None:
            linear, turn = self._cmd_vel.linear, self._cmd_vel.angular.z
            # 0.0 is added after rounding, so that nothing reads as -0.00
            x, y, turn = (round(value, 2) + 0.0 for value in (linear.x, linear.y, turn))
            line += f"  cmd_vel ({x:+.2f} {y:+.2f} m/s {turn:+.2f} rad/s)"
        if self._warnings:
            line += f"  warned: {', '.join(self._warnings)}"
        return line

    def _write_over(self, line: str, rate: str, reason: str) -> None:
        """Write the live line over the last one, cut to the terminal's width.

        A reason to stop that does not fit takes its place, and is first printed in full.
        """
        width = shutil.get_terminal_size().columns - 1
        if reason and len(line) > width:
            if reason != self._last_reason:
                self._write(f"{_CLEAR}{reason}\n")  # what to do stands at its end
            line = f"{rate}  STOP {reason}"
        self._last_reason = reason
        line = line if len(line) <= width else f"{line[: width - 1]}…"
        if not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb":
            word, colour = (" STOP ", _RED) if reason else (" free", _GREEN)
            line = f"{line.replace(word, f'{colour}{word}', 1)}{_PLAIN}"
        self._write(f"{_CLEAR}{line}")

    def _write(self, text: str) -> None:
        """Print; without a reader, as after `| head`, the run ends."""
        try:
            print(text, end="", file=self.out, flush=True)
        except BrokenPipeError:
            nobody = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nobody, self.out.fileno())  # else Python reports it once more at its end
            os.close(nobody)
            self.node.context.try_shutdown()

    def _new_warnings(self) -> list[str]:
        """Return those of another kind than before; each is printed once, and in full."""
        now = {name: self._kinds[name] for name in self._warnings}
        new = [name for name, kind in now.items() if self._warned.get(name) != kind]
        self._warned |= now
        return [f"{name} warns: {self._warnings[name]}" for name in new]

    @property
    def drops(self) -> int:
        return sum(skin.dropped for skin in self.skins) + self._lost

    @property
    def _lost(self) -> int:
        return sum(int(skin.driver.get("lost", 0)) for skin in self.skins)

    def close(self) -> None:
        """Print the summary, if there was a run to sum up and somebody takes it."""
        if (self._first is None and not self._printed) or not takes(self.out):
            return
        lines = self.summary()
        self._write("\n" * self.out.isatty() + "\n".join(lines) + "\n")

    def summary(self) -> list[str]:
        if self._first is None:
            return [f"summary: no frame arrived; stopped all the time: {self._waiting}"]
        seconds = (self._now() - self._first) / 1e9
        if self.duration > 0.0:
            seconds = min(seconds, self.duration)
        latency, latencies = "none measured", [x for skin in self.skins for x in skin.latencies]
        if latencies:
            p50, p99, worst = np.percentile(latencies, [50, 99, 100]) * 1e3
            latency = f"p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {worst:.2f} ms"
        lines = [f"summary{' of a simulated board' if self._simulated else ''}"]
        for skin in self.skins:
            rate, corrupt = skin.count / seconds, skin.driver.get("crc_errors", "unknown")
            lines += [
                f"  frames      {skin.name}{skin.count} in {seconds:.1f} s ({rate:.1f}/s)",
                f"  CRC errors  {skin.name}{corrupt}",
            ]
        lost = self._lost
        lines += [
            f"  drops       {self.drops} ({lost} lost on the wire, {self.drops - lost} on the way)",
            f"  latency     last byte to stop hook: {latency}",
            f"  contacts    at most {self.most_contacts} at once, in {self.touched_frames} frames,"
            f" up to {self.largest_force:.1f} N together",
            f"  stops       {len(self.stops)}",
        ]
        lines += [f"  warning     {name}: {text}" for name, text in self._warnings.items()]
        for start, end, reason in self.stops[:20]:
            length = "until the end" if end is None else f"for {end - start:.2f} s"
            lines.append(f'    at {max(start, 0.0):6.2f} s {length}: "{reason}"')
        if len(self.stops) > 20:
            lines.append(f"    and {len(self.stops) - 20} more")
        return lines
