# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window, driven over its DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import urllib.request
from pathlib import Path

from support.patience import PATIENCE, until

NAMES = ("chromium", "chromium-browser", "google-chrome")


def program() -> str | None:
    """Chromium's path, where there is one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """One page of a Chromium of its own; use it with `with`.

    Attributes:
        errors: exceptions and error messages of the page.
        requested: addresses that the page asked for.
    """

    def __init__(self, folder: Path, width: int = 1280, height: int = 860):
        self._folder, self._size = folder, (width, height)
        self._numbers, self._open = itertools.count(1), contextlib.ExitStack()
        self.errors: list[str] = []
        self.requested: list[str] = []

    def __enter__(self) -> Chromium:
        from websockets.sync.client import connect

        words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        words += ["--remote-debugging-port=0", f"--user-data-dir={self._folder}", "about:blank"]
        self._process = subprocess.Popen(
            [program(), *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        port = self._folder / "DevToolsActivePort"
        until(lambda: port.exists() and len(port.read_text().split()) == 2, "Chromium starts")
        address = f"http://127.0.0.1:{port.read_text().split()[0]}/json"
        with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
            pages = [target for target in json.load(answer) if target["type"] == "page"]
        address = pages[0]["webSocketDebuggerUrl"]
        self._socket = self._open.enter_context(
            connect(address, max_size=None, max_queue=None)  # what nobody waits for is no obstacle
        )
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.resize(*self._size)
        return self

    def __exit__(self, *_) -> None:
        self._open.close()
        self._process.terminate()
        self._process.wait(PATIENCE)

    def call(self, method: str, **parameters) -> dict:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            said = json.loads(self._socket.recv(PATIENCE))
            if said.get("id") == number:
                if "error" in said:
                    raise RuntimeError(f"{method}: {said['error']['message']}")
                return said["result"]
            self._note(said)

    def _note(self, said: dict) -> None:
        kind, values = said.get("method"), said.get("params", {})
        if kind == "Runtime.exceptionThrown":
            thrown = values["exceptionDetails"]
            self.errors.append(thrown.get("exception", {}).get("description", str(thrown)))
        elif kind == "Log.entryAdded" and values["entry"]["level"] == "error":
            self.errors.append(values["entry"]["text"])
        elif kind == "Network.requestWillBeSent":
            self.requested.append(values["request"]["url"])

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )

    def prefer(self, scheme: str) -> None:
        """light or dark."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", features=features)

    def open(self, address: str) -> None:
        self.call("Page.navigate", url=address)
        loaded = "location.href !== 'about:blank' && document.readyState === 'complete'"
        self.until(loaded)

    def empty(self) -> None:
        """Leave the page, and forget what it said and asked for."""
        self.call("Page.navigate", url="about:blank")
        self.until("location.href === 'about:blank'")
        self.errors.clear()
        self.requested.clear()

    def run(self, script: str):
        """The value of a JavaScript expression."""
        found = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(f"{script}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def until(self, script: str) -> None:
        """Wait until the expression is true, also on the page that a link leads to."""

        def happens():
            try:
                return self.run(script)
            except RuntimeError as error:
                if "navigated" not in str(error):
                    raise

        until(happens, script)

    def found(self, role: str, name: str) -> list[int]:
        """Elements of an accessible role and name that are shown."""
        root = self.call("DOM.getDocument", depth=0)["root"]["backendNodeId"]
        nodes = self.call(
            "Accessibility.queryAXTree", backendNodeId=root, role=role, accessibleName=name
        )["nodes"]
        return [node["backendDOMNodeId"] for node in nodes if not node["ignored"]]

    def click(self, role: str, name: str) -> None:
        """Click the one element of an accessible role and name, once it is there."""
        until(lambda: len(self.found(role, name)) == 1, f"one {role} {name!r}")
        (node,) = self.found(role, name)
        there = self.call("DOM.resolveNode", backendNodeId=node)["object"]["objectId"]
        script = "function() { this.scrollIntoView(); this.focus(); this.click(); }"
        self.call("Runtime.callFunctionOn", objectId=there, functionDeclaration=script)

    def press(self, key: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, text=key if key == " " else "")

    def move(self, x: float, y: float) -> None:
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def picture(self) -> bytes:
        """A PNG of what is seen."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
