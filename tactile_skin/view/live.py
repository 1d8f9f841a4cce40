# SPDX-License-Identifier: Apache-2.0
"""The snapshots of a running skin, in the page's process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import pickle
import socket
import time
from pathlib import Path

from ..middleware.config import skin_of
from .log import Log
from .pictures import Pictures
from .process import LARGEST
from .server import Shown, Wanted, serve
from .snapshot import Snapshot
from .work import Work

_PATIENCE = 0.5  # s after which a page is told once more what there is
_ANSWER_WITHIN = 5.0  # s


class Live:
    """The newest snapshot only, of the socket to the skin; `ended` is set when that has."""

    def __init__(self, skin: socket.socket, title: str, log: Log, work: Work, ended: asyncio.Event):
        self.log, self.work, self.ended, self._title = log, work, ended, title
        self.newest, self._number = Snapshot(), 0
        self._skin = skin
        self._news = asyncio.Event()
        self._answer: asyncio.Future | None = None
        self._asking = asyncio.Lock()
        skin.setblocking(False)
        asyncio.get_running_loop().add_reader(skin, self._receive)

    def hello(self) -> dict:
        return {"recording": None, "title": self._title, "history": self.log.history()}

    async def snapshot(self, wanted: Wanted) -> tuple[int, Snapshot]:
        """One that is newer than the page's last, or of the time that is asked for."""
        if wanted.at:
            return self.log.moment(wanted.at) or (self._number, self.newest)
        if self._number <= wanted.after:
            with contextlib.suppress(TimeoutError, asyncio.TimeoutError):
                await asyncio.wait_for(self._news.wait(), _PATIENCE)
        return self._number, self.newest

    def watched(self, pages: int) -> None:
        self._tell({"watched": pages > 0})

    async def ask(self, name: str) -> dict:
        """Return what the skin answers to a request."""
        async with self._asking:
            self._answer = asyncio.get_running_loop().create_future()
            self._tell({"ask": name})
            try:
                answer = await asyncio.wait_for(self._answer, _ANSWER_WITHIN)
            except (TimeoutError, asyncio.TimeoutError):
                return {"answer": name, "success": False, "message": "the skin does not answer"}
        if name in ("record", "finish") and answer["success"]:
            path = answer.pop("file", "")
            self.work.record(name == "record", Path(path) if path else None)
        return answer

    def _tell(self, said: dict) -> None:
        with contextlib.suppress(OSError):
            self._skin.send(json.dumps(said).encode())

    def _receive(self) -> None:
        newest = b""
        try:
            while data := self._skin.recv(LARGEST):
                if data[:1] != b"{":  # a snapshot, as pickled by the skin that started this
                    newest = data
                elif self._answer is not None and not self._answer.done():
                    self._answer.set_result(json.loads(data))
            self.ended.set()
        except BlockingIOError:
            pass
        except OSError:
            self.ended.set()
        if newest:
            self._take(pickle.loads(newest))

    def _take(self, newest: Snapshot) -> None:
        self._number += 1
        age = time.monotonic() - newest.read_at if newest.read_at is not None else 0.0
        self.log.take(newest.stamp + age, self._number, newest)
        self.work.take(newest)
        self.newest = self.work.seen(newest)
        self._news.set()
        self._news = asyncio.Event()


async def run(listening: socket.socket, sockets: list[socket.socket]) -> None:
    """Serve until the skin, or one of several, ends."""
    skins, ended, said = {}, asyncio.Event(), {}
    for skin in sockets:
        said = json.loads(skin.recv(LARGEST))
        name, parameters = said["name"], said["parameters"]
        configured = skin_of(parameters, "view")
        pictures, work = Pictures(configured), Work(configured, parameters)
        live = Live(skin, name or "live", Log(pictures.push_of), work, ended)
        skins[name] = Shown(live, pictures)
    await serve(listening, skins, ended, said["controls"], said["host"], said["token"])
