# SPDX-License-Identifier: Apache-2.0
"""What a page reads of a message, as wire.js does; and a page of snapshots that a test made."""

import asyncio
import contextlib
import json
import socket
import threading
import time
from dataclasses import replace

import numpy as np

from tactile_skin import forward
from tactile_skin.view.log import Log
from tactile_skin.view.pictures import Pictures
from tactile_skin.view.snapshot import CONTACT, Snapshot

NOW = 1.7e9  # s, of the first snapshot


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


def snapshot(skin, t=0.0, newtons=0.0, stop=False, nodes=None):
    """A touch of rows 4 and 5, in the last three columns, or none."""
    circuit = skin.circuit
    force, contacts = np.zeros(circuit.shape), np.zeros((0, len(CONTACT)), np.float32)
    rows, cols = slice(4, 6), slice(circuit.cols - 3, circuit.cols)
    if newtons:
        force[rows, cols] = newtons / 6
        x, y, z = skin.geometry.position[rows, cols].mean((0, 1))
        contacts = np.float32([[x, y, z, newtons, 3, 0, 0, 0, newtons / 6]])
    adc = forward(circuit, skin.curve.resistance(force)) * circuit.full_scale * 64
    return Snapshot(
        stamp=NOW + t,
        adc=np.rint(adc).astype(np.uint16),
        pressure=np.float32(force / skin.geometry.cell_area),
        contacts=contacts,
        gestures={3: "pat"},
        stop=stop,
        reason="push" if stop else "",
        causes=("push",) if stop else (),
        force=newtons,
        limit=30.0,
        cell_limit=9.0,
        nodes=nodes or {},
    )


class Played:
    """Snapshots that a test plays, in place of a running skin.

    `now` is the one that is shown, again and again unless the skin is `silent`.
    """

    def __init__(self, snapshots, push_of, work=None):
        self.log, self._snapshots, self.now, self.work = Log(push_of), snapshots, 0, work
        self.asked: list[str] = []
        self.silent, self._number = False, 0
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
        self._number += not self.silent
        snapshot = replace(snapshot, read_at=time.monotonic())
        return self._number, self.work.seen(snapshot) if self.work else snapshot

    def watched(self, pages):
        pass

    async def ask(self, name):
        self.asked.append(name)
        said = "/**/stop_on_push: {ros__parameters: {debounce: 0.01}}\n"
        message = said if name == "describe" else "done"
        return {"answer": name, "success": True, "message": message}


@contextlib.contextmanager
def served(skin, snapshots, controls=False, work=None):
    """A page of snapshots of a skin: yields its address and its source."""
    with serving({"": (skin, snapshots)}, controls, work) as (address, sources):
        yield address, sources[""]


@contextlib.contextmanager
def serving(skins, controls=False, work=None):
    """The same of several, name -> skin and snapshots; without a name: the body's."""
    from tactile_skin.view.server import Shown, serve  # needs websockets

    shown = {}
    for name, (skin, snapshots) in skins.items():
        pictures = Pictures(skin)
        shown[name] = Shown(Played(snapshots, pictures.push_of, work), pictures)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        loop = asyncio.new_event_loop()
        ended = asyncio.Event()
        thread = threading.Thread(
            target=lambda: loop.run_until_complete(serve(listening, shown, ended, controls))
        )
        thread.start()
        try:
            yield f"http://127.0.0.1:{port}", {name: each.source for name, each in shown.items()}
        finally:
            loop.call_soon_threadsafe(ended.set)
            thread.join()
            loop.close()
