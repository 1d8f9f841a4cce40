# SPDX-License-Identifier: Apache-2.0
"""The page's server: what it serves, to whom, and what strangers can do to it."""

import asyncio
import contextlib
import json
import re
import socket
from urllib.parse import quote

import numpy as np
import pytest

pytest.importorskip("websockets", reason="serves the page")

from support.page import unpack
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tactile_skin.middleware.config import read_skin
from tactile_skin.view import server
from tactile_skin.view.log import Log
from tactile_skin.view.pictures import Pictures
from tactile_skin.view.server import Shown, names_this_host, read_wanted, serve
from tactile_skin.view.snapshot import Snapshot
from tactile_skin.view.work import Work

PATIENCE = 20.0  # s, for what must happen


class Source:
    """Snapshots that a test makes."""

    def __init__(self):
        self.number, self.pages, self.asked = 1, [], []
        self.log, self.work = Log(lambda snapshot: None), Work(read_skin(), {})

    def hello(self):
        return {"recording": None, "title": "a test"}

    async def snapshot(self, wanted):
        adc = np.full((16, 16), 20000 + self.number, np.uint16)
        return self.number, Snapshot(stamp=float(self.number), adc=adc)

    def watched(self, pages):
        self.pages.append(pages)

    async def ask(self, name):
        self.asked.append(name)
        return {"answer": name, "success": True, "message": "done"}


def served(scenario, controls=False, names=("",), token=""):
    """Run `scenario(source, address)`, a coroutine function, beside the server.

    Of skins of other names it is given all sources.
    """

    async def run():
        sources, ended = {name: Source() for name in names}, asyncio.Event()
        shown = {name: Shown(source, Pictures(read_skin())) for name, source in sources.items()}
        with socket.create_server(("127.0.0.1", 0)) as listening:
            address = f"127.0.0.1:{listening.getsockname()[1]}"
            serving = asyncio.create_task(serve(listening, shown, ended, controls, "", token))
            try:
                of = sources[""] if len(names) == 1 else sources
                await asyncio.wait_for(scenario(of, address), PATIENCE)
            finally:
                ended.set()
                await serving

    asyncio.run(run())


async def get(address: str, path: str, *headers: str, host: str | None = None) -> str:
    """The whole answer to a request as it stands, dots and all."""
    name, port = address.split(":")
    reader, writer = await asyncio.open_connection(name, int(port))
    lines = [f"GET {path} HTTP/1.1", f"Host: {host or address}", *headers, "", ""]
    writer.write("\r\n".join(lines).encode())
    answer = await reader.read()
    writer.close()
    return answer.decode(errors="replace")


def open_page(address: str, **more):
    given = {"origin": f"http://{address}", "max_size": None, "compression": None} | more
    return connect(f"ws://{address}/snapshots", **given)


async def ask(page, **wanted) -> dict:
    await page.send(json.dumps(wanted))
    return unpack(await page.recv())[0]


# --- what it is for ---


def test_it_serves_the_page_for_itself_only():
    async def scenario(source, address):
        for path, kind in (("/", "text/html"), ("/skin.js", "text/javascript")):
            answer = await get(address, path)
            assert answer.startswith("HTTP/1.1 200") and f"Content-Type: {kind}" in answer
            assert "default-src 'none'" in answer and "Access-Control" not in answer

    served(scenario)


def test_all_that_the_page_names_is_there():
    """It works offline, then: nothing is named that is not served."""
    names = [path.name for path in server._FOLDER.iterdir()]
    for name in names:
        text = (server._FOLDER / name).read_text()
        if not name.startswith("three."):  # it names pages in its comments and messages
            assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
        for named in re.findall(r'(?:from|import\(|src=|href=) ?"(?:\./)?([^"]+)"', text):
            assert named in (*names, "/")


def test_a_page_gets_the_newest_snapshot_however_long_it_slept():
    async def scenario(source, address):
        async with open_page(address) as page:
            hello = json.loads(await page.recv())["hello"]
            assert hello["rows"] == hello["cols"] == 16 and hello["controls"] is False
            assert (await ask(page))["number"] == 1
            source.number = 500
            assert (await ask(page, after=1, drawn=1))["number"] == 500
        async with open_page(address) as page:
            await page.recv()
            assert source.pages[-1] == 1
        while source.pages[-1]:
            await asyncio.sleep(0.01)

    served(scenario)


def test_a_page_that_reads_nothing_has_one_snapshot_on_its_way():
    """It asks once: nothing more is sent, whatever the skin does meanwhile."""

    async def scenario(source, address):
        async with open_page(address) as page:
            await page.recv()
            await page.send("{}")
            for number in range(2, 50):
                source.number = number
                await asyncio.sleep(0)
            assert unpack(await page.recv())[0]["number"] >= 1
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(page.recv(), 0.2)

    served(scenario)


def test_controls_are_off_unless_allowed():
    async def scenario(source, address):
        async with open_page(address) as page:
            await page.recv()
            for name in ("reset", "record", "doctor", "detect", "calibrate", "give up"):
                await page.send(json.dumps({"ask": name}))
                said = json.loads(await page.recv())["said"]
                assert (said["success"], said["message"]) == (False, "controls are off")
            assert not source.asked and not source.work.state()["task"]

    served(scenario)


@pytest.mark.parametrize("token", ["", "wrong", "grüße", "right"])
def test_who_steers_from_another_computer_shows_the_token(token):
    """And only who does so downloads what was made."""

    async def scenario(source, address):
        source.work.files["/recording.mcap"] = b"all topics"
        answer = await get(address, f"/recording.mcap?&{quote(token)}")
        assert answer.endswith("all topics") is (token == "right")
        async with open_page(address) as page:
            await page.recv()
            await page.send(json.dumps({"ask": "reset", "token": token}))
            said = json.loads(await page.recv())["said"]
            assert said["success"] is (token == "right")
            assert ("it has a token" in said["message"]) is (token != "right")
            assert source.asked == (["reset"] if token == "right" else [])

    served(scenario, True, token="right")


def test_sections_of_the_nodes_begin_the_file_of_a_calibration():
    async def scenario(source, address):
        began = []
        source.work._calibrate = lambda skin, text: began.append(text)
        async with open_page(address) as page:
            await page.recv()
            await page.send(json.dumps({"ask": "calibrate"}))
            assert json.loads(await page.recv())["said"]["success"]
            while not began:
                await asyncio.sleep(0.01)
        assert source.asked == ["describe"] and began[0].endswith("done")

    served(scenario, True)


def test_each_skin_of_a_body_has_its_address():
    async def scenario(sources, address):
        sources["back"].number = 5
        for path, what in (("/", "body.js"), ("/?chest", "skin.js"), ("/?back", "skin.js")):
            assert what in await get(address, path)
        for path in ("/?nobody", "/snapshots?nobody", "/skin.js?chest", "/chest"):
            assert "HTTP/1.1 404" in await get(address, path)
        url = f"ws://{address}/snapshots?back"
        async with connect(url, origin=f"http://{address}", max_size=None) as page:
            hello = json.loads(await page.recv())["hello"]
            assert (hello["skin"], hello["skins"]) == ("back", ["chest", "back"])
            assert (await ask(page))["number"] == 5
            await page.send(json.dumps({"ask": "tare"}))
            await page.recv()
        assert [source.asked for source in sources.values()] == [[], [], ["tare"]]
        while sources["back"].pages != [1, 0]:
            await asyncio.sleep(0.01)
        assert not sources[""].pages

    served(scenario, True, ("", "chest", "back"))


@pytest.mark.parametrize("controls", [False, True])
def test_a_download_is_for_those_who_may_steer_and_for_the_page_itself(controls, tmp_path):
    made = tmp_path / "made" / "recording.mcap"
    made.parent.mkdir()
    made.write_text("all topics")

    async def scenario(source, address):
        source.work.record(False, made)
        answer = await get(address, "/recording.mcap")
        assert answer.startswith("HTTP/1.1 200" if controls else "HTTP/1.1 404")
        assert answer.endswith("all topics") is controls and not made.parent.exists()
        assert "HTTP/1.1 403" in await get(
            address, "/recording.mcap", "Origin: http://evil.example"
        )
        assert "HTTP/1.1 421" in await get(address, "/recording.mcap", host="evil.example")
        assert "HTTP/1.1 404" in await get(address, "/calibrated.yaml")

    served(scenario, controls)


# --- strangers ---


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        ("127.0.0.1:80", True),
        ("127.0.0.1", True),
        ("localhost:80", True),
        ("LOCALHOST", True),
        ("localhost:9000", True),  # through a tunnel
        ("robot.fritz.box:80", True),
        ("evil.robot.fritz.box:80", False),
        (":80", False),
        ("evil.example:80", False),
        ("127.0.0.1.evil.example:80", False),
        ("localhost.evil.example", False),
        ("10.0.0.1:80", False),
        ("", False),
        ("[::1]:80", False),
    ],
)
def test_a_host_must_be_this_one(host, ours):
    assert names_this_host(host, "127.0.0.1", "Robot.fritz.box") is ours


def test_a_host_on_the_network_goes_by_its_address_or_name():
    own = socket.gethostname()
    assert names_this_host("192.168.0.7:8321", "192.168.0.7")
    assert names_this_host(f"{own}:8321", "192.168.0.7")
    assert not names_this_host("localhost:8321", "192.168.0.7")
    assert names_this_host("[fe80::1]:8321", "fe80::1")


def test_a_rebound_name_and_another_origin_are_refused():
    async def scenario(source, address):
        port = address.split(":")[1]
        for host in (f"evil.example:{port}", "evil.example"):
            refused = await get(address, "/", host=host)
            assert "HTTP/1.1 421" in refused and f"Host = {host}: not a name of" in refused
            assert f"open http://{address}, or start the page with view_host:=NAME" in refused
        assert "HTTP/1.1 421" in await get(address, "/", f"Host: {address}")  # twice
        for origin in ("http://evil.example", "null", f"https://{address}", "http://localhost"):
            assert "HTTP/1.1 403" in await get(address, "/", f"Origin: {origin}")
        assert "HTTP/1.1 200" in await get(address, "/", f"Origin: http://{address}")

    served(scenario)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", None, "https://{}"])
def test_a_websocket_of_another_origin_is_refused(origin):
    async def scenario(source, address):
        with pytest.raises(InvalidStatus) as refused:
            async with open_page(address, origin=origin and origin.format(address)):
                pass
        assert refused.value.response.status_code == 403 and not source.pages

    served(scenario)


@pytest.mark.parametrize(
    "path",
    [
        *("/../server.py", "/..%2fserver.py", "//etc/passwd", "/skin.js/../../server.py"),
        *("/skin.js?x", "/./skin.js", "/SKIN.JS", "/page", "/..\\server.py"),
        "http://evil.example/skin.js",
    ],
)
def test_nothing_else_is_served(path):
    async def scenario(source, address):
        answer = await get(address, path)
        assert "HTTP/1.1 404" in answer or "HTTP/1.1 400" in answer

    served(scenario)


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{", "null", '{"a": "fastest"}', '{"at": NaN}', '{"at": 1e400}'),
        *('{"ask": "answer", "text": 5}', '{"ask": "finish it"}'),
        *('{"after": true}', '{"after": 1.5}', '{"ask": "shutdown"}', '{"more": 1}'),
        *("[" * 900, '{"a": ["naive"]}'),
    ],
)
def test_what_no_page_says_ends_the_connection(text):
    with pytest.raises((ValueError, TypeError, RecursionError)):
        read_wanted(text)

    async def scenario(source, address):
        async with open_page(address) as page:
            await page.recv()
            await page.send(text)
            with pytest.raises(ConnectionClosed) as closed:
                await page.recv()
            assert closed.value.rcvd.code == 1003

    served(scenario)


def test_huge_messages_and_headers_are_refused():
    async def scenario(source, address):
        async with open_page(address) as page:
            await page.recv()
            with contextlib.suppress(ConnectionClosed):
                await page.send(b"x" * 1_000_000)
            with pytest.raises(ConnectionClosed) as closed:
                await page.recv()
            assert closed.value.rcvd is None or closed.value.rcvd.code == 1009
        for headers in ([f"X: {'x' * 100_000}"], [f"X{k}: x" for k in range(5000)]):
            with contextlib.suppress(ConnectionError):
                assert "HTTP/1.1 200" not in await get(address, "/", *headers)
        assert "HTTP/1.1 200" in await get(address, "/")

    served(scenario)


def test_only_so_many_pages_are_open():
    async def scenario(source, address):
        async with contextlib.AsyncExitStack() as stack:
            for _ in range(server._PAGES):
                await (await stack.enter_async_context(open_page(address))).recv()
            with pytest.raises(InvalidStatus) as refused:
                await stack.enter_async_context(open_page(address))
            assert refused.value.response.status_code == 503

    served(scenario)


def test_a_request_that_dribbles_in_is_cut_off(monkeypatch):
    """Slow loris: a byte now and then keeps no connection open."""
    monkeypatch.setattr(server, "_OPEN_WITHIN", 0.3)

    async def scenario(source, address):
        name, port = address.split(":")
        reader, writer = await asyncio.open_connection(name, int(port))
        writer.write(f"GET / HTTP/1.1\r\nHost: {address}\r\n".encode())

        async def dribble():
            while True:
                writer.write(b"X-a: b\r\n")
                await asyncio.sleep(0.02)

        task = asyncio.create_task(dribble())
        await _end(reader)
        task.cancel()
        writer.close()

    served(scenario)


async def _end(reader) -> None:
    with contextlib.suppress(ConnectionError):
        while await reader.read(4096):
            pass
