# SPDX-License-Identifier: Apache-2.0
"""The page's process, from the side of the skin: start it, hand it snapshots, hear its requests.

Between the two is a socket of whole messages for each skin. A snapshot that does not fit in its
buffer is dropped; of those that wait, the page's process takes the newest (live.py).
"""

from __future__ import annotations

import contextlib
import importlib.util
import ipaddress
import json
import pickle
import secrets
import socket
import subprocess
from collections.abc import Iterator, Mapping

from ..errors import LaunchError
from ..middleware.process import started
from .snapshot import Snapshot

DESCRIBE = "describe"  # what the skin is asked for before a page calibrates: its nodes' parameters
LARGEST = 1 << 18  # bytes of a message
_TOKEN = 9  # bytes that nobody guesses, 12 characters
_END_WITHIN = 0.05  # s for the process to end by itself


class PageProcess:
    """Serves the page until it is closed, or this process ends.

    Args:
        controls: whether a page may steer.
        address: where it is served; who may steer from other computers has its token from there.
        skins: name -> parameters of the skin; the attribute: name -> the way to what is shown.

    Raises:
        LaunchError: the address cannot be served on, or websockets is not installed.
    """

    def __init__(self, host: str, port: int, controls: bool, skins: Mapping[str, dict]):
        self.skins = {}
        with contextlib.ExitStack() as stack:
            listening, theirs = stack.enter_context(listen(host, port)), []
            self.address = address_of(listening)
            token = ""
            if controls and not ipaddress.ip_address(listening.getsockname()[0]).is_loopback:
                token = secrets.token_urlsafe(_TOKEN)
                self.address += f"/#{token}"
            for name, parameters in skins.items():
                ours, their = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
                theirs.append(stack.enter_context(their))
                self.skins[name] = ToPage(ours)
                of_page = {"host": host, "controls": controls, "token": token}
                first = {"name": name, "parameters": parameters} | of_page
                self.skins[name].send(first)
            self._process = started(("-m", "tactile_skin.view"), [listening, *theirs])

    def close(self) -> None:
        for to_page in self.skins.values():
            to_page.close()
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_WITHIN)


class ToPage:
    """The way of one skin to the page's process."""

    def __init__(self, ours: socket.socket):
        self._ours = ours
        self.watched = False  # whether a page shows it
        self.dropped = 0  # snapshots that the process was too slow for

    def show(self, snapshot: Snapshot) -> None:
        """Never waits."""
        try:
            self._ours.send(pickle.dumps(snapshot), socket.MSG_DONTWAIT)
        except BlockingIOError:
            self.dropped += 1
        except OSError:  # it ended
            self.watched = False

    def requests(self) -> Iterator[str]:
        """Yield what the pages ask for, as it comes, until the process ends."""
        while data := self._receive():
            said = json.loads(data)
            self.watched = said.get("watched", self.watched)
            if "ask" in said:
                yield said["ask"]
        self.watched = False

    def _receive(self) -> bytes:
        with contextlib.suppress(OSError):
            return self._ours.recv(LARGEST)
        return b""

    def answer(self, request: str, success: bool, message: str, file: str = "") -> None:
        """Answer a request; `file` is one to download, which the page's process deletes."""
        self.send({"answer": request, "success": success, "message": message, "file": file})

    def send(self, said: dict) -> None:
        with contextlib.suppress(OSError):  # it ended
            self._ours.send(json.dumps(said).encode())

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._ours.shutdown(socket.SHUT_RDWR)
        self._ours.close()


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens there.

    Raises:
        LaunchError: the address is taken, or none of this computer's, or websockets is missing.
    """
    if not importlib.util.find_spec("websockets"):
        raise LaunchError("the page needs websockets: pip install 'tactile_skin[view]'")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except (OSError, UnicodeError) as error:
        why = (getattr(error, "strerror", None) or str(error)).partition(" (while")[0]
        raise LaunchError(
            f"the page on {host}, port {port}: {why}: set view_port to a free one, 0 for any, and "
            "view_host to an address of this computer"
        ) from error


def address_of(listening: socket.socket) -> str:
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    return url_of(host, port)


def url_of(host: str, port: int) -> str:
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"
