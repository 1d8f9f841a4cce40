# SPDX-License-Identifier: Apache-2.0
"""The page's server: a few files, and one WebSocket for each page.

A page asks for each snapshot when it has drawn the one before: one that is slow, or asleep, has
nothing queued. A request must name the host that it reached, by address, by this computer's name
or by that of `view_host` (a foreign name may be a rebound one), and its origin must be that host.
Of several skins each has the addresses of one, its name behind a question mark; the one without a
name is the page of all.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import secrets
import socket
import time
from collections import Counter, OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as serve_websockets
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from ..solvers import METHODS
from .pictures import PUBLISHED, Pictures
from .process import DESCRIBE, url_of

if TYPE_CHECKING:
    from .live import Live
    from .recorded import Recorded

_logger = logging.getLogger("tactile_skin.view")
_PAGES = 16  # of a skin that may be open at once
_OPEN_WITHIN = 5.0  # s for a request to be complete
_LARGEST = 1024  # bytes that a page may say at once
_LATEST = 1e11  # s, of a time that is asked for
_SENT = 8  # snapshots of which is known when their readings arrived
# what a page may ask for, if it may
OF_SKIN = ("tare", "reset", "record", "finish")
OF_PAGE = ("detect", "calibrate", "doctor", "answer", "give up")
_LEND = "lend"  # what the skin is asked for then, before a page detects
ASKS = OF_SKIN + OF_PAGE
_WEBSOCKET = "/snapshots"
# in the frame of a page, and in what is particular
_PARTICULAR, _EVENTS = "<!-- what is particular -->\n", "<!-- force and log -->\n"
_FOLDER = Path(__file__).parent / "page"
_TYPES = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Connection": "close",
}


@dataclass(frozen=True)
class Wanted:
    """What a page asks for."""

    # a, b: the method of the large picture, and the one to compare it with, if it is explained
    a: str = PUBLISHED
    b: str = ""
    after: int = 0  # number of the snapshot that it has
    drawn: int = 0  # number of the one that it drew last
    # of a recording, the time [s] from its start; of a running skin, the stamp of a moment [s], 0:
    # now
    at: float = 0.0
    ask: str = ""  # one of ASKS; empty: a snapshot
    text: str = ""  # what was typed, to "answer"
    token: str = ""  # that the address had, with what it asks for


def read_wanted(text: str | bytes) -> Wanted:
    """Read what a page wants (ValueError: not what a page says)."""
    said = json.loads(text)
    if not isinstance(said, dict) or not said.keys() <= Wanted.__dataclass_fields__.keys():
        raise ValueError("must be an object of known keys")
    wanted = Wanted(**said)
    methods = (PUBLISHED, *METHODS)
    if not (
        wanted.a in methods
        and wanted.b in ("", *methods)
        and type(wanted.after) is type(wanted.drawn) is int
        and type(wanted.at) in (int, float)
        and abs(wanted.at) < _LATEST
        and wanted.ask in ("", *ASKS)
        and isinstance(wanted.text, str)
        and isinstance(wanted.token, str)
    ):
        raise ValueError("a value out of range")
    return wanted


def names_this_host(host: str, address: str, named: str = "") -> bool:
    """Whether a request's Host names this computer: DNS rebinding comes under a foreign name.

    Its port is not compared: that of a tunnel may be another.

    Args:
        address: that the connection was made to.
        named: what the user calls the host.
    """
    name = host if host.endswith("]") else host.rpartition(":")[0] or host
    name = name.strip("[]").lower()
    own = socket.gethostname().lower()
    try:
        return ipaddress.ip_address(name) == ipaddress.ip_address(address)
    except ValueError:
        loopback = ipaddress.ip_address(address).is_loopback
        names = {"localhost"} if loopback else {own, own + ".local", f"{own}.lan"}
        return bool(name) and name in {*names, named.lower()}


class Shown(NamedTuple):
    """A skin, as it is shown."""

    source: Live | Recorded
    pictures: Pictures


class Server:
    """Serves the page's files and its WebSockets.

    Args:
        skins: name -> what is shown of it; the name of one alone, and of the body, is empty.
        controls: whether pages may ask for "tare" and "reset".
        host: what it was asked to listen on, a name or an address.
        token: that who steers has from the address; empty: none is needed.
    """

    def __init__(self, skins: Mapping[str, Shown], controls: bool, host: str = "", token: str = ""):
        self._token = token
        self._skins, self._controls, self._host = skins, controls, host
        self._names = [name for name in skins if name]  # of a body
        self._pages: Counter[str] = Counter()
        self._files = {
            f"/{path.name}": (path.read_bytes(), _TYPES[path.suffix])
            for path in _FOLDER.iterdir()
            if path.suffix in _TYPES
        }
        self._files["/"] = _page("body" if self._names else "skin")
        for name in self._names:
            self._files[f"/?{name}"] = _page("skin")

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file, or a refusal; None: a page that may have its WebSocket."""
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        address, port = connection.local_address[:2]
        address = address.removeprefix("::ffff:")
        if len(hosts) != 1 or not names_this_host(hosts[0], address, self._host):
            return _text(
                HTTPStatus.MISDIRECTED_REQUEST,
                f"Host = {', '.join(hosts)}: not a name of this computer: open "
                f"{url_of(address, port)}, or start the page with view_host:=NAME",
            )
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return _text(HTTPStatus.FORBIDDEN, "not for pages of another origin")
        path, _, query = request.path.partition("?")
        name, _, token = query.partition("&")
        skin = self._skins.get(name)
        if path == _WEBSOCKET and skin:
            if not origins:
                return _text(HTTPStatus.FORBIDDEN, "for the page only")
            if self._pages[name] >= _PAGES:
                return _text(HTTPStatus.SERVICE_UNAVAILABLE, f"{_PAGES} pages are open already")
            return None
        work = skin.source.work if skin else None
        if self._may(token) and work and (found := work.files.get(path)):
            return _response(HTTPStatus.OK, found, "application/octet-stream")
        if request.path not in self._files:
            return _text(HTTPStatus.NOT_FOUND, "no such file")
        return _response(HTTPStatus.OK, *self._files[request.path])

    def _may(self, token: str) -> bool:
        """Whether who shows this token may steer."""
        right = secrets.compare_digest(token.encode(), self._token.encode())
        return self._controls and (right or not self._token)

    async def page(self, connection: ServerConnection) -> None:
        """Talk with one page until it leaves."""
        assert connection.request is not None  # it has been answered
        name = connection.request.path.partition("?")[2]
        skin = self._skins[name]
        self._pages[name] += 1
        skin.source.watched(self._pages[name])
        try:
            with contextlib.suppress(ConnectionClosed):
                await self._talk(connection, name, skin)
        except Exception:
            _logger.exception("a page was given up")
            raise
        finally:
            self._pages[name] -= 1
            skin.source.watched(self._pages[name])

    async def _talk(self, connection: ServerConnection, name: str, skin: Shown) -> None:
        source, pictures = skin
        await connection.send(self._hello(name, skin, pictures))
        sent: OrderedDict[int, float | None] = OrderedDict()
        log, work = source.log, source.work
        known, worked = -1, -1  # versions of the log and of the work
        async for text in connection:
            try:
                wanted = read_wanted(text)
            except (ValueError, TypeError, RecursionError):
                await connection.close(1003, "not understood")
                return
            if wanted.ask:
                await connection.send(json.dumps({"said": await self._ask(wanted, source)}))
                continue
            more: dict = {}
            if (read_at := sent.get(wanted.drawn)) is not None:
                more["latency"] = time.monotonic() - read_at
            number, snapshot = await source.snapshot(wanted)
            now = (work and work.pictures) or skin.pictures
            if now is not pictures:  # another board is drawn
                pictures, known, worked = now, -1, -1
                await connection.send(self._hello(name, skin, pictures))
            if snapshot.read_at is not None:
                more["age"] = max(0.0, time.monotonic() - snapshot.read_at)
            more |= {"number": number, "at": wanted.at}
            if log.version != known:
                known, more["log"] = log.version, log.entries()
            if work and work.version != worked:
                worked, more["work"] = work.version, work.state()
            await connection.send(pictures.message(snapshot, wanted.a, wanted.b, more))
            sent[number] = snapshot.read_at
            while len(sent) > _SENT:
                sent.popitem(last=False)

    def _hello(self, name: str, skin: Shown, pictures: Pictures) -> str:
        ours = {"controls": self._controls, "skin": name, "skins": self._names}
        return json.dumps({"hello": pictures.hello() | skin.source.hello() | ours})

    async def _ask(self, wanted: Wanted, source: Live | Recorded) -> dict:
        answer = {"answer": wanted.ask, "success": False, "message": "controls are off"}
        if not self._controls:
            return answer
        if not self._may(wanted.token):
            return answer | {"message": "open the address that launch printed: it has a token"}
        if wanted.ask not in OF_PAGE:
            return await source.ask(wanted.ask)
        if source.work is None:
            return answer | {"message": "no running skin"}
        text = wanted.text
        if wanted.ask == "calibrate":
            described = await source.ask(DESCRIBE)
            text = described["message"] if described["success"] else ""
        try:
            source.work.ask(wanted.ask, text)
        except ValueError as error:
            return answer | {"message": str(error)}
        if wanted.ask == "detect" and not (lent := await source.ask(_LEND))["success"]:
            source.work.ask("give up", "")
            return answer | {"message": lent["message"]}
        return answer | {"message": "", "success": True}


def _page(name: str) -> tuple[bytes, str]:
    """Return what is particular to a page within what all have in common, and its type."""
    frame, particular, events = (
        (_FOLDER / f"{part}.html").read_text() for part in ("frame", name, "events")
    )
    text = frame.replace("skin.js", f"{name}.js").replace(_PARTICULAR, particular)
    return text.replace(_EVENTS, events).encode(), "text/html; charset=utf-8"


def _response(status: HTTPStatus, body: bytes, kind: str) -> Response:
    headers = _HEADERS | {"Content-Type": kind, "Content-Length": str(len(body))}
    return Response(status.value, status.phrase, Headers(headers), body)


def _text(status: HTTPStatus, text: str) -> Response:
    return _response(status, f"{text}\n".encode(), "text/plain; charset=utf-8")


async def serve(
    listening: socket.socket,
    skins: Mapping[str, Shown],
    ended: asyncio.Event,
    controls: bool,
    host: str = "",
    token: str = "",
) -> None:
    """Serve the page on a listening socket until `ended`; the others are those of `Server`."""
    server = Server(skins, controls, host, token)
    strangers = logging.getLogger("tactile_skin.view.strangers")
    strangers.setLevel(logging.CRITICAL)  # what they send is no news
    async with serve_websockets(
        server.page,
        sock=listening,
        process_request=server.answer,
        compression=None,
        open_timeout=_OPEN_WITHIN,
        max_size=_LARGEST,
        max_queue=2,
        close_timeout=1.0,
        logger=strangers,
        server_header=None,
    ):
        await ended.wait()
