# SPDX-License-Identifier: Apache-2.0
"""The port of a board that is simulated: a pseudo-terminal that any serial program can open."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import select
import struct
import termios
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

_LEFT_FOR = 2.0  # s after which nobody opens the port again: the driver does so at once
_DIGITS = "0123456789"
_MARK = struct.pack("4H", 0x736B, 0x696E, 0, 0)  # a pty's window size; that of a serial port is 0
_DEVICES = Path("/dev")


class Terminal:
    """The board's end of a pty; `open_terminal` makes it."""

    def __init__(self, master: int):
        self._master = master
        self._poller = select.poll()
        self._poller.register(master, select.POLLIN)
        self._events = 0
        self._last = math.inf  # monotonic time at which somebody had the port open [s]

    def connected(self) -> bool:
        """Whether somebody has the port open now."""
        self._events = dict(self._poller.poll(0)).get(self._master, 0)
        connected = not self._events & select.POLLHUP
        if connected:
            self._last = time.monotonic()
        return connected

    def left(self) -> bool:
        """Whether who had the port open has closed it, and nobody has opened it again since."""
        return time.monotonic() - self._last > _LEFT_FOR

    def read(self) -> bytes:
        """Return what was sent to the board until `connected` was called last; empty if nothing."""
        if not self._events & select.POLLIN:
            return b""
        try:
            return os.read(self._master, 4096)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            return b""

    def write(self, data: bytes | bytearray) -> int:
        """Send; how many bytes are gone: like a UART, all that nobody takes are."""
        try:
            return os.write(self._master, data)
        except OSError as error:  # the reader lags, or left between poll and write
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            return len(data)


@contextlib.contextmanager
def open_terminal(link: Path) -> Iterator[Terminal]:
    """Open a pty whose name is the symbolic link `link`, while the context lasts.

    A folder of its own, which is not there yet, is made and removed again.

    Raises:
        ValueError: `link` is among the devices, where it would pass for a real board.
        FileNotFoundError: there is no place for that folder.
        FileExistsError: `link` is there; only the link of a board that is gone is replaced.
    """
    folder = link.parent.resolve()
    if _DEVICES in (folder, *folder.parents):
        raise ValueError(f"{link}: a simulated board must not have a link in {_DEVICES}")
    if not folder.parent.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder for a link to a simulated board")
    made = not folder.is_dir()
    if made:
        folder.mkdir(0o700)
    master, slave = os.openpty()
    try:
        tty.setraw(slave)
        fcntl.ioctl(slave, termios.TIOCSWINSZ, _MARK)
        name = os.ttyname(slave)
        os.close(slave)  # from here on the master's end tells whether somebody has the port open
        os.set_blocking(master, False)
        _make_link(link, name)
        try:
            yield Terminal(master)
        finally:
            if link.is_symlink() and os.readlink(link) == name:
                link.unlink()
    finally:
        os.close(master)
        if made:
            folder.rmdir()


def serve(
    link: Path,
    running: Callable[[], bool],
    tick: float,
    restart: Callable[[], None],
    turn: Callable[[Terminal, float], float],
    on_ready: Callable[[], None] = lambda: None,
    once: bool = False,
) -> None:
    """Put a board behind a pty whose name is the symbolic link `link`, in real time.

    As on a USB board, opening the port restarts it, and what nobody reads is lost. Returns when
    `running()` is no longer true, or with `once` when whoever read the port has left.

    Args:
        tick: from one turn to the next [s].
        turn: of the board: takes its port, and by how much it is late [s]; returns the time that
            is left out for that [s].

    Raises:
        ValueError, FileNotFoundError, FileExistsError: as `open_terminal`.
    """
    with open_terminal(link) as terminal:
        on_ready()
        connected, due = False, time.monotonic()
        while running() and not (once and terminal.left()):
            due += tick
            late = time.monotonic() - due
            time.sleep(max(0.0, -late))
            was, connected = connected, terminal.connected()
            if connected and was:
                due += turn(terminal, late)
                continue
            due = time.monotonic()
            if connected:
                restart()
                turn(terminal, 0.0)


def is_simulated(port) -> bool:
    """Return whether an open serial port is that of a simulated board, by whatever name."""
    try:
        return fcntl.ioctl(port.fileno(), termios.TIOCGWINSZ, bytes(len(_MARK))) == _MARK
    except (AttributeError, OSError, ValueError):  # socket:// and the like have no such thing
        return False


def _make_link(link: Path, name: str) -> None:
    """Link to the pty of this name; what is there and no dead board's stays as it is."""
    target = os.readlink(link) if link.is_symlink() else ""
    # The pty of a board that was killed is gone, or a later one has its number, perhaps this: it
    # is newer than the link. A link to an unplugged device dangles as well, but leads elsewhere.
    if target.rstrip(_DIGITS) == name.rstrip(_DIGITS):
        made = os.lstat(link).st_mtime
        if target == name or not os.path.exists(target) or os.stat(target).st_ctime > made:
            link.unlink()
    try:
        link.symlink_to(name)
    except FileExistsError:
        what = f"is a link to {target}, made by somebody else" if target else "is no link"
        raise FileExistsError(
            f"{link} exists and {what}: remove it, or give the simulated board another link"
        ) from None
