# SPDX-License-Identifier: Apache-2.0
"""The page in Chromium: what is drawn, read and pressed there."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading

import pytest
from support.marks import ci

pytest.importorskip("websockets", reason="serves the page")

from support import chromium
from support.chromium import until

pytestmark = pytest.mark.live

if chromium.program() is None:
    pytest.skip("no Chromium here: apt-get install chromium", allow_module_level=True)

TEXT = "document.getElementById('{}').innerText"
SEEK = "(at => {{ at.value = {}; at.oninput(); }})(document.getElementById('at'))"
# the colour of the middle of each cell of a picture, and how many colours there are in all cells
COLOURS = """
(() => {
  const canvas = document.querySelector("#NAME canvas"), ctx = canvas.getContext("2d");
  const [left, top] = [Math.round(20 * devicePixelRatio), Math.round(16 * devicePixelRatio)];
  const cell = Math.floor((canvas.width - left) / 16);
  const cells = [], all = new Set();
  const bytes = ctx.getImageData(left, top, 16 * cell, 16 * cell).data;
  const at = (x, y) => bytes.slice(4 * (y * 16 * cell + x), 4 * (y * 16 * cell + x) + 3).join();
  for (let r = 0; r < 16; r++) for (let c = 0; c < 16; c++)
    cells.push(at(c * cell + (cell >> 1), r * cell + (cell >> 1)));
  for (let y = 0; y < 16 * cell; y++) for (let x = 0; x < 16 * cell; x++) all.add(at(x, y));
  return [cells, all.size];
})()
"""


@contextlib.contextmanager
def running(*words):
    """A command that serves the page; yields its address, and a function that ends it or sends it
    another signal."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tactile_skin", *words, "view_port:=0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    said = []
    reader = threading.Thread(target=lambda: said.extend(process.stdout), daemon=True)

    def line():
        assert process.poll() is None, "".join(said)
        found = re.search(r"http://[\d.]+:\d+", "".join(said))
        return found and found[0]

    def end(number=signal.SIGINT):
        process.send_signal(number)
        if number == signal.SIGINT:
            process.wait(chromium.PATIENCE)

    reader.start()
    try:
        until(line, "the address is printed")
        yield line(), end
    finally:
        if process.poll() is None:
            end()
        reader.join(chromium.PATIENCE)


@pytest.fixture(scope="module")
def skin():
    words = ("launch", "scene:=two_fingers", "method:=auto", "monitor:=false", "view:=true")
    with running(*words) as found:
        yield found


@pytest.fixture
def live(skin):
    return skin[0]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Three seconds of the demo."""
    pytest.importorskip("mcap", reason="reads recordings")
    path = tmp_path_factory.mktemp("recording") / "demo.mcap"
    words = ["launch", "duration:=3", f"record:={path}", "method:=auto"]
    subprocess.run([sys.executable, "-m", "tactile_skin", *words], check=True, timeout=60)
    return path


def drawn(browser) -> int:
    """Snapshots drawn in the last second."""
    found = re.search(r"drawn\n(\d+)/s", browser.run(TEXT.format("numbers")) or "")
    return int(found[1]) if found else 0


def noisy(browser):
    """The colours of the misfit, in which each cell has noise of its own."""
    found = []

    def there():  # a busy computer's skin may be behind, and have no picture of a reading
        found[:] = browser.run(COLOURS.replace("NAME", "misfit"))
        return len(set(found[0])) > 20

    until(there, "a picture of the misfit")
    return found


def test_a_running_skin_is_drawn(live, browser):
    browser.open(live)
    until(lambda: drawn(browser) > 5, "snapshots are drawn")
    browser.until("document.querySelectorAll('#contacts tbody tr').length === 2")
    browser.until("document.getElementById('stop').innerText.includes('free')")
    assert "N per cell" in browser.run("document.querySelector('#a .legend').innerText")
    assert "along x" in browser.run(TEXT.format("push"))
    assert browser.run("document.getElementById('old').hidden")
    assert browser.run("document.getElementById('tare').disabled")  # not allowed
    assert all(url.startswith(live) for url in browser.requested if url != "about:blank")


def test_cells_are_exact_and_pointed_at(live, browser):
    """One colour a cell, and none between two: the misfit has noise in each."""
    browser.open(live)
    until(lambda: drawn(browser) > 5, "snapshots are drawn")
    browser.press("e")
    cells, colours = noisy(browser)
    assert colours == len(set(cells))
    box = "document.querySelector('#a canvas').getBoundingClientRect()"
    cell = browser.run("Math.floor((document.querySelector('#a canvas').width - 20) / 16)")

    def point() -> None:  # again and again: a message above it may move it
        x, y = (browser.run(f"{box}.{name}") for name in "xy")
        browser.move(x + 20 + 5.5 * cell, y + 16 + 4.5 * cell)

    said = f"{TEXT.format('cell')}.startsWith('row 4, column 5: pressure')"
    until(lambda: browser.run(said), said, point)
    assert re.search(r"pressure [\d.]+ ± [\d.]+ N, reading", browser.run(TEXT.format("cell")))


@pytest.mark.ci
def test_it_is_used_by_keyboard(live, browser):
    browser.open(live)
    until(lambda: drawn(browser) > 5, "snapshots are drawn")
    browser.run("document.getElementById('a').focus()")
    browser.press("ArrowDown")
    browser.press("ArrowRight")
    browser.until(f"{TEXT.format('cell')}.startsWith('row 9, column 9')")
    browser.press("b")
    browser.until("document.getElementById('method-b').value !== 'naive'")


@pytest.mark.parametrize("scheme", ["light", ci("dark")])
def test_it_fits_a_phone(live, browser, scheme):
    browser.prefer(scheme)
    browser.resize(360, 740, 3.0)
    browser.open(live)
    until(lambda: drawn(browser) > 2, "snapshots are drawn")
    assert browser.run("document.documentElement.scrollWidth") <= 360
    page = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (int(re.search(r"\d+", page)[0]) > 128) is (scheme == "light")
    browser.press("e")
    cells, colours = noisy(browser)
    assert colours == len(set(cells))


@pytest.mark.ci
def test_a_recording_is_scrubbed(recording, browser):
    with running("view", str(recording)) as (address, _):
        browser.open(address)
        browser.until("document.getElementById('at').max > 2.6")
        browser.press(" ")
        browser.until("document.getElementById('pause').innerText === 'play'")
        browser.run(SEEK.format(2.6))
        browser.until("/time\\n2.60 s/.test(" + TEXT.format("numbers") + ")")
        browser.until("document.querySelectorAll('#contacts tbody tr').length === 1")
        browser.press(",")
        browser.until("/time\\n2.59 s/.test(" + TEXT.format("numbers") + ")")
        browser.run(SEEK.format(0.2))
        browser.until("document.querySelectorAll('#contacts tbody tr').length === 0")
        assert "recorded" in browser.run(TEXT.format("stop"))
        browser.press("e")
        browser.until("document.querySelector('#b .legend').innerText.includes('N per cell')")
        before, _ = browser.run(COLOURS.replace("NAME", "b"))  # it stands: another method is drawn
        browser.press("b")
        until(lambda: browser.run(COLOURS.replace("NAME", "b"))[0] != before, "another picture")


def test_it_does_not_call_a_robot_free_whose_skin_hangs_or_ended(skin, browser):
    """The last test: it ends the skin of the others."""
    address, end = skin
    browser.open(address)
    browser.until(f"{TEXT.format('stop')}.includes('free')")
    end(signal.SIGSTOP)
    browser.until(f"{TEXT.format('stop')}.includes('unknown')")
    browser.until(f"{TEXT.format('old')}.includes('s old')")
    end(signal.SIGCONT)
    browser.until(f"{TEXT.format('stop')}.includes('free')")
    end()
    browser.until(f"{TEXT.format('old')}.includes('old')")
    browser.until("document.body.classList.contains('old')")
    browser.until(f"{TEXT.format('stop')}.includes('unknown')")
    browser.errors.clear()  # that nobody answers any more
