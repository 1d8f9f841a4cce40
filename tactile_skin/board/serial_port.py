# SPDX-License-Identifier: Apache-2.0
"""A serial port that is found, opened, read, watched, and opened again after any failure."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import stat
import sys
import termios
import threading
import time
from collections.abc import Callable

import serial
from serial.tools import list_ports

from .frame import Frame, Parser
from .recognise import explain, sample
from .terminal import is_simulated

_TIMEOUT = 0.05  # s that a read waits for a byte
_LENT = 2.0  # s in which another program may open a port that is lent to it
LONGEST_BOOT = 30.0  # s that a board may need after its port was opened: Wi-Fi, self-calibration
_SLOWER = 1.5  # times what it took to its first frame last time
_EARLY = 1.0  # s of bytes without a frame after which the message says what they are, if known
_ASK_AGAIN = 0.5  # s without an answer after which a board is asked again
_IN_USE = "is in use by another program (two programs cannot read one board)"
_LENT_TO = "is lent to another program, and read again when that ends"
_NOT_ALLOWED = "may not be opened by this user: is it in the group dialout?"
_GONE = "is gone: was the board unplugged?"
# of a lock, which this driver takes as well; opened by a program that asked to be alone
_BUSY = (errno.EAGAIN, errno.EBUSY)
_TROUBLES = dict.fromkeys(_BUSY, _IN_USE) | {
    errno.EACCES: _NOT_ALLOWED,
    errno.EPERM: _NOT_ALLOWED,
    errno.ENOENT: "does not exist",
    errno.EISDIR: "is a directory, not a serial device",
    errno.EIO: _GONE,
    errno.ENODEV: _GONE,
    errno.ENXIO: _GONE,
}

PORT_ERRORS = (serial.SerialException, OSError, termios.error)  # what a vanished port raises


def candidates(serial_number: str = "") -> list[str]:
    """Return the serial ports that may be a board: those on USB; of one number, if it is given."""
    ports = [p for p in list_ports.comports() if p.vid is not None]
    wanted = [p for p in ports if serial_number in ("", p.serial_number or p.location)]
    return sorted(p.device for p in wanted)


def devices(port: str, serial_number: str = "") -> list[str]:
    """Return what the port of a `SerialReader` stands for now, links followed; none: not there."""
    names = candidates(serial_number) if port == "auto" else [port]
    return [name if "://" in name else os.path.realpath(name) for name in names]


def nothing_found(serial_number: str = "") -> str:
    """Say that no board is there, and how to find it."""
    if not serial_number:
        return "no USB serial port found"
    there = [p.serial_number or p.location for p in list_ports.comports() if p.vid is not None]
    found = ", ".join(map(str, there)) or "none"
    return f"no USB board has serial_number {serial_number}; there are: {found}"


def identity(device: str) -> tuple:
    """Return what a board is known by when it is plugged in again.

    These are its USB ids, and its serial number or, where it has none, its USB socket; the
    device's name where it is not on USB.
    """
    for port in list_ports.comports():
        if port.device == os.path.realpath(device) and port.vid is not None:
            return port.vid, port.pid, port.serial_number or port.location
    return (device,)


def check_port(port: str, serial_number: str = "", absent: bool = True) -> None:
    """Raise ValueError, saying what there is, if the port is not there or no serial device.

    Without `absent` a port that is not there is right: it may come.
    """
    found = ", ".join(candidates()) or "none"
    if port == "auto":
        if absent and not candidates(serial_number):
            raise ValueError(
                f"port auto: {nothing_found(serial_number)}; plug the board in or give a port"
            )
    elif "://" in port:
        serial.serial_for_url(port, do_not_open=True)  # ValueError names an unknown protocol
    elif not os.path.exists(port):
        if not absent:
            return
        raise ValueError(f"port {port}: does not exist; USB serial ports found: {found}")
    elif wrong := _not_serial(port):
        raise ValueError(f"port {port}: {wrong}; USB serial ports found: {found}")


def open_port(name: str, baud: int):
    """Return an open serial port that nobody else reads meanwhile.

    Raises:
        ValueError: it cannot be opened, and why.
    """
    try:
        return _opened(name, baud)
    except PORT_ERRORS as error:
        raise ValueError(why_not(name, error)) from error


def _opened(name: str, baud: int):
    # two readers of one port would each get half of the bytes
    alone = {} if "://" in name else {"exclusive": True}
    return serial.serial_for_url(name, baud, timeout=_TIMEOUT, **alone)


def _not_serial(port: str) -> str:
    """Why what is there cannot be a serial device; empty if it may be one."""
    try:
        mode = os.stat(port).st_mode
    except OSError:
        return ""
    if stat.S_ISCHR(mode):
        return ""
    kinds = ((stat.S_ISDIR, "is a directory"), (stat.S_ISREG, "is a regular file"))
    kind = next((name for holds, name in kinds if holds(mode)), "is not a device")
    return f"{kind}, not a serial device"


class SerialReader:
    """Reads frames in a thread of its own until it is closed.

    Args:
        port: device, pyserial URL, or "auto": the first USB port on which a frame arrives that
            `refuse` does not refuse. From then on it is that board, on whatever port: another one
            may sit elsewhere on the robot.
        make_parser: gives a new parser; called for each connection.
        on_frame: takes each frame, in the reader's thread.
        say: takes a line of text whenever the connection comes or goes. What it raises is reported
            on stderr, and ends nothing.
        watchdog: seconds without a frame after which the port is opened anew. A board may restart
            whenever it is opened: after an opening it has the time that it took before, and twice
            as long after each that gave no frame, up to 30 s.
        wait: seconds in which a port that is not there yet is not reported.
        refuse: says why a frame is not of the board that is looked for; empty if it is.
        serial_number: of the USB board that "auto" looks for, or its socket; empty: any.
        line: the port, where it is open already; whoever opened it closes it.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        make_parser: Callable[[], Parser],
        on_frame: Callable[[Frame], None],
        say: Callable[[str], None],
        watchdog: float = 3.0,
        wait: float = 0.0,
        refuse: Callable[[Frame], str] = lambda frame: "",
        serial_number: str = "",
        line=None,
    ):
        self.port, self.baud, self.watchdog = port, baud, watchdog
        self.connected_to: str | None = None
        self.reconnects = -1  # the first connection is none
        self.simulated = False  # the port is that of a simulated board
        self.trouble = f"waiting for {port}"
        self._quiet_until = time.monotonic() + wait
        self.parser = make_parser()
        self._make_parser, self._on_frame, self._say = make_parser, on_frame, say
        self._refuse, self._serial_number = refuse, serial_number
        self._line = contextlib.nullcontext(line) if line else None
        self._board: tuple | None = None  # identity of the board that "auto" found
        self._patience: dict[str, float] = {}  # port -> s that its board has after an opening
        self._reported: dict[str, str] = {}  # port -> why it gave no frame, since one last did
        self._seen = "", ""  # why there is no frame, and what arrived when that was new
        self._lent_until = -math.inf  # monotonic [s], until when it stays closed
        self._lent = False  # and has not been opened since
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"serial {port}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def lend(self) -> None:
        """Close the port, so that another program may open it; read it again once that is done."""
        self._lent_until, self._lent = time.monotonic() + _LENT, True

    @property
    def _away(self) -> bool:
        return time.monotonic() < self._lent_until

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._away:
                self._lost(f"port {self.port} {_LENT_TO}", self.port)
                self._stop.wait(0.25)
                continue
            try:
                ports = self._ports()
            except Exception as error:  # a port that goes while the system lists them
                self._lost(f"the serial ports cannot be listed: {error!r}")
                self._stop.wait(0.25)
                continue
            for name in ports:
                try:
                    with self._line or _opened(name, self.baud) as port:
                        self._read(port)
                except (*PORT_ERRORS, ValueError) as error:  # ValueError: a baud it cannot do
                    lent = self._lent and _number(error) in _BUSY
                    self._lost(f"port {name} {_LENT_TO}" if lent else why_not(name, error), name)
                except Exception as error:  # of a subscriber's: reading goes on
                    self._lost(f"port {name}: {error!r}", name)
                if self._stop.is_set():
                    return
            if not ports:
                known = self._board is not None
                self._lost(
                    "the board is unplugged; other boards are not used"
                    if known
                    else nothing_found(self._serial_number)
                )
            self._stop.wait(0.25)

    def _ports(self) -> list[str]:
        """Where to look for the board now."""
        if self.port != "auto":
            return [self.port]
        return [
            name
            for name in candidates(self._serial_number)
            if self._board is None or identity(name) == self._board
        ]

    def _read(self, port) -> None:
        """Read until the port fails, goes silent, or the reader is closed."""
        counters = self.parser.counters
        self.parser = self._make_parser()  # half a frame of before is worth nothing
        self.parser.counters = counters
        self.simulated, self._lent = is_simulated(port), False
        port.reset_input_buffer()
        opened = last_frame = time.monotonic()
        heard, look_at, asked = 0, 1, -math.inf
        patience = max(self._patience.get(port.name, 0.0), self.watchdog)
        while not (self._stop.is_set() or self._away):
            if self.parser.request and time.monotonic() - asked > _ASK_AGAIN:
                port.write(self.parser.request)
                asked = time.monotonic()
            # the rest of a frame at once: each read costs more than the parsing of one
            wanted = self.parser.wanted
            data = port.read(wanted if wanted > 1 else max(1, port.in_waiting))
            frames = self.parser.feed(data) if data else []
            heard += len(data)
            if frames:
                last_frame, heard, look_at, asked = time.monotonic(), 0, 1, -math.inf
                if self.connected_to is None:
                    if self.port == "auto" and (why := self._refuse(frames[0])):
                        self._lost(f"{port.name}: {why}", port.name)
                        return
                    self._found(port.name or port.portstr)
                    took = _SLOWER * (last_frame - opened)
                    self._patience[port.name], patience = took, self.watchdog
                for frame in frames:
                    self._on_frame(frame)
                continue
            silence = time.monotonic() - last_frame
            if silence > patience:
                self._lost(self._unusable(port, heard, patience), port.name)
                if last_frame == opened and len(self._ports()) == 1:  # others wait for their turn
                    self._patience[port.name] = max(patience, LONGEST_BOOT)
                return
            early = silence > _EARLY and self.connected_to is None and self.port != "auto"
            if early and heard >= look_at:  # to look costs more than to read: seldom
                look_at = 2 * heard
                if why := explain(self.parser):
                    self._lost(self._unusable(port, heard, patience, why), port.name)

    def _unusable(self, port, heard: int, patience: float, why: str = "") -> str:
        """Why there is no frame, in a text that stays the same while the cause does."""
        if not heard:
            return f"{port.name}: no bytes for {patience:g} s, reopening it"
        why = why or explain(self.parser) or "check serial_driver.baud and serial_driver.protocol"
        if why != self._seen[0]:
            self._seen = why, sample(self.parser)
        shown = f' ("{self._seen[1]}")' if self._seen[1] else ""
        return (
            f"{port.name} at {self.baud} baud: bytes arrive, but no frame: {why}{shown}. More: "
            f"tactile-skin detect port:={self.port} [config:=FILE]"
        )

    def _found(self, name: str) -> None:
        self.connected_to, self.trouble = name, ""
        self._board = identity(name)
        self.reconnects += 1
        self._reported.clear()
        self._tell(f"frames arrive on {name}")

    def _lost(self, why: str, name: str = "") -> None:
        """No frame comes from the port of this name, or from any."""
        if self.connected_to is None and time.monotonic() < self._quiet_until:
            return
        self.trouble = why  # the reason first: others read both
        self.connected_to = None
        if self._reported.get(name) != why:  # once for each of several ports that take turns
            self._reported[name] = why
            self._tell(why)

    def _tell(self, text: str) -> None:
        try:
            self._say(text)
        except (Exception, SystemExit) as error:  # of a log handler: the reading goes on
            with contextlib.suppress(Exception):
                print(f"{text}, and {error!r} while that was reported", file=sys.stderr)


def _number(error: BaseException) -> int | None:
    """Return the errno behind an error of pyserial's, which gives some in a text alone."""
    for each in (error, error.__context__):
        number = getattr(each, "errno", None) or (each.args[0] if each and each.args else None)
        if isinstance(number, int):
            return number
    return None


def why_not(port: str, error: Exception) -> str:
    """Return what is wrong with a port, for a person who can mend it."""
    number = _number(error)
    if number is None and "device disconnected" in str(error):  # pyserial: it reads as if at an end
        number = errno.EIO
    if number == errno.ENOTTY:
        return f"port {port} {_not_serial(port) or 'is not a serial device'}"
    if number in _TROUBLES:
        return f"port {port} {_TROUBLES[number]}"
    return f"port {port}: {os.strerror(number) if number else error}"
