"""What a page reads of a message, as wire.js does; and a page of snapshots that a test made."""

import asyncio
import contextlib
import json
import socket
import threading
import time
from dataclasses import replace

import numpy as np

from tactile_skin.view.log import Log
from tactile_skin.view.pictures import Pictures
from tactile_skin.view.server import serve


def unpack(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """The head, and the arrays by their names."""
    at = 4 + int.from_bytes(data[:4], "little")
    head, arrays = json.loads(data[4:at]), {}
    for name, dtype, shape in head.pop("arrays"):
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, dtype, count, at).reshape(shape)
        at += count * np.dtype(dtype).itemsize
        at += -at % 4
    return head, arrays


class Played:
    """Snapshots that a test plays, in place of a running skin; `now` is the one that is shown."""

    def __init__(self, snapshots, push_of, work=None):
        self.log, self._snapshots, self.now, self.work = Log(push_of), snapshots, 0, work
        self.asked: list[str] = []
        for number, snapshot in enumerate(snapshots, 1):
            self.log.take(snapshot.stamp, number, snapshot)
        self.last()

    def last(self) -> None:
        self.now = len(self._snapshots) - 1

    def hello(self):
        return {"recording": None, "title": "live", "history": self.log.history()}

    async def snapshot(self, wanted):
        if wanted.at:
            return self.log.moment(wanted.at)
        await asyncio.sleep(0.02)
        snapshot = self._snapshots[self.now]
        return self.now + 1, replace(snapshot, read_at=time.monotonic())

    def watched(self, pages):
        pass

    async def ask(self, name):
        self.asked.append(name)
        return {"answer": name, "success": True, "message": "done"}


@contextlib.contextmanager
def served(skin, snapshots, controls=False, work=None):
    """A page of snapshots of a skin: yields its address and its source."""
    pictures = Pictures(skin)
    source = Played(snapshots, pictures.push_of, work)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        loop = asyncio.new_event_loop()
        ended = asyncio.Event()
        serving = threading.Thread(
            target=lambda: loop.run_until_complete(
                serve(listening, source, pictures, ended, controls)
            )
        )
        serving.start()
        try:
            yield f"http://127.0.0.1:{port}", source
        finally:
            loop.call_soon_threadsafe(ended.set)
            serving.join()
            loop.close()
