# SPDX-License-Identifier: Apache-2.0
"""The page in Chromium, of snapshots that are known: found by role and text."""

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.marks import ci

pytest.importorskip("websockets", reason="serves the page")

from support import chromium
from support.chromium import until
from support.page import served, serving, snapshot

from tactile_skin.middleware.config import skin_of
from tactile_skin.view.snapshot import NodeStatus, Snapshot
from tactile_skin.view.work import Work

pytestmark = pytest.mark.live

if chromium.program() is None:
    pytest.skip("no Chromium here: apt-get install chromium", allow_module_level=True)

AXE = Path(__file__).parents[1] / "axe" / "node_modules" / "axe-core" / "axe.min.js"
SHAPED = skin_of({"geometry.shape": "cylinder"}, "")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
STATUS = "document.querySelector('#stop strong').textContent"
BOX = "JSON.stringify(document.querySelector('{}').getBoundingClientRect())"


def pushed(skin):
    """Nothing, a push of 53 N at most, then a light touch."""
    forces = [0, 20, 53, 33, 10, 10]
    return [snapshot(skin, 0.5 * k, f, stop=f > 30) for k, f in enumerate(forces)]


@contextlib.contextmanager
def free(browser, skin, snapshots, **more):
    """The page of a skin that ends free; its source."""
    with served(skin, snapshots, **more) as (address, source):
        browser.open(address)
        browser.until(f"{STATUS} === '✓ free'")
        yield source


def box(browser, selector) -> dict:
    return json.loads(browser.run(BOX.format(selector)))


def test_a_push_is_said_in_a_line(browser):
    left = skin_of({"geometry.shape": "plane", "geometry.rpy": [0.0, 0.0, np.pi / 2]}, "")
    with served(left, pushed(left)[:3]) as (address, _):
        browser.open(address)
        browser.until(f"{STATUS} === '■ stopped: push 53 N (limit 30) from the left'")
        until(lambda: browser.found("status", ""), "it is announced")
        browser.click("button", "details")
        browser.until("document.getElementById('why').innerText === 'push'")
        name = browser.run("document.getElementById('total').getAttribute('aria-valuetext')")
        assert name == "53.0 N of 30 N" and browser.found("meter", "force of all contacts")
        assert "from the left" in browser.run("document.getElementById('push').innerText")


def test_a_fault_is_not_hidden_behind_the_push_before_it(browser):
    """And a force that counts as more, while r_par is not known, says so."""
    words = "fault: serial_driver: no bytes for 3 s + push"
    unplugged = replace(snapshot(SHAPED, 1.5, 24, stop=True), reason=words, force=37.0)
    unplugged = replace(unplugged, causes=("fault", "push"))
    with served(SHAPED, [*pushed(SHAPED)[:3], unplugged]) as (address, _):
        browser.open(address)
        browser.until(f"{STATUS} === '■ stopped: {words}'")
        name = "document.getElementById('total').getAttribute('aria-valuetext')"
        browser.until(f"{name} === '24.0 N (may be 37) of 30 N'")


@pytest.mark.parametrize(
    ("felt", "words"),
    [(20, "push 20 N (may be 59, limit 30)"), (59, "push 59 N (limit 30)")],
)
def test_a_push_is_said_as_it_is_felt(browser, felt, words):
    entry = f"{{felt: {felt}, force: 59, limit: 30, peak: 1, cell_limit: 9}}"
    with served(SHAPED, [snapshot(SHAPED)]) as (address, _):
        browser.open(address)
        assert browser.run(f"import('/words.js').then(words => words.pushed({entry}))") == words


def test_a_direction_has_words(browser):
    with served(SHAPED, [snapshot(SHAPED)]) as (address, _):
        browser.open(address)
        for direction, words in (
            ([-1, 0, 0], "from the front"),
            ([0.7, 0.7, 0], "from the back right"),
            ([0, 0, -1], "from above"),
            ([0, -0.8, 0.6], "from the left and below"),
        ):
            said = f"import('/words.js').then(words => words.from({direction}))"
            assert browser.run(said) == words


def test_the_pressure_is_large_and_has_a_scale_of_its_own(browser):
    with free(browser, SHAPED, [snapshot(SHAPED, newtons=10)]):
        assert box(browser, "#a canvas")["width"] >= 0.45 * 1400
        legend = "document.querySelector('#a .legend').innerText"
        browser.until(f"{legend}.includes('N per cell') && {legend}.includes('stop at 9')")
        browser.run("(u => { u.value = 'kPa'; u.onchange(); })(document.getElementById('unit'))")
        browser.until(f"{legend}.includes('15') && {legend}.includes('stop at 62.5 kPa')")
        row = "document.querySelector('#contacts tbody').innerText"
        assert browser.run(row).split("\t") == ["3", "10.0 N", "4.5, 14.0", "0.0 cm/s", "pat"]


# what is pressed and smaller than a finger: its name and size; and how much of its card a mat takes
SMALL = """JSON.stringify([...document.querySelectorAll("button, input, select, a[href], summary")]
    .filter(e => e.checkVisibility() && e.getClientRects().length)
    .map(e => [e.id || e.textContent, e.offsetWidth, e.offsetHeight])
    .filter(([, width, height]) => Math.min(width, height) < 40))"""
FILLED = """(card => Math.min(...["Width", "Height"].map(
    side => card.querySelector("canvas")[`client${side}`] / (card[`client${side}`] - 165))))
    (document.getElementById("a"))"""


def test_an_8x8_fills_its_card_and_a_phone_has_room_for_fingers(browser):
    skin = skin_of({"circuit.rows": 8, "circuit.cols": 8}, "")
    with free(browser, skin, pushed(skin), work=Work(skin, {})):
        for width, height in ((1400, 900), (1000, 700), (390, 844)):
            browser.resize(width, height)
            browser.until(f"{FILLED} >= 1")
            assert browser.run("document.documentElement.scrollWidth") <= width
            table, card = box(browser, "#contacts"), box(browser, "#touch")
            assert table["right"] < card["right"], "nothing is over its edge"
        assert json.loads(browser.run(SMALL)) == []
        off = "['tare', 'doctor', 'said'].some(id => document.getElementById(id).checkVisibility())"
        assert not browser.run(off)


@pytest.mark.parametrize(("rows", "cols"), [(32, 10), (64, 64), (8, 22)])
def test_a_mat_of_any_size_fills_its_card(browser, rows, cols):
    skin = skin_of({"circuit.rows": rows, "circuit.cols": cols}, "")
    with free(browser, skin, [snapshot(skin, newtons=10)]):
        for name in ("a", "reading"):
            card, picture = box(browser, f"#{name}"), box(browser, f"#{name} .picture canvas")
            assert picture["width"] >= 0.85 * card["width"] - 30, name
        assert box(browser, "#a .picture canvas")["height"] > (200 if cols > rows else 600)
        assert browser.run("document.documentElement.scrollWidth") <= 1400
        assert browser.run("document.getElementById('flat').hidden"), "its shape is unknown"


def test_explain_opens_what_is_behind_the_picture(browser):
    with free(browser, SHAPED, [snapshot(SHAPED, newtons=10)]):
        assert not browser.found("heading", "uncertainty")
        browser.click("button", "explain")
        for name in ("naive", "uncertainty", "unexplained"):
            until(lambda name=name: browser.found("heading", name), name)
        browser.until("document.querySelector('#misfit .legend').innerText.includes('ADC steps')")
        sentences = "[...document.querySelectorAll('#explained .help')].map(p => p.innerText)"
        assert all(s.endswith(".") for s in browser.run(sentences))


def test_a_picture_is_enlarged_and_made_small_again(browser):
    with free(browser, SHAPED, [snapshot(SHAPED, newtons=10)]):
        small = box(browser, "#reading canvas")["width"]
        browser.click("button", "enlarge raw reading")
        browser.until("document.getElementById('reading').classList.contains('large')")
        assert box(browser, "#reading canvas")["width"] > 2 * small
        browser.press("Escape")
        browser.until("!document.getElementById('reading').classList.contains('large')")
        assert box(browser, "#reading canvas")["width"] == small


def test_a_stop_of_the_log_shows_its_moment(browser):
    with free(browser, SHAPED, pushed(SHAPED)):
        contact = "document.querySelector('#contacts tbody').innerText"
        browser.until(f"{contact}.includes('10.0 N')")
        row = browser.run("document.querySelector('#log tbody').innerText").split("\t")
        assert row[1].strip() == "1.0 s" and row[3] == "row 5, column 14", row
        browser.click("button", row[2].strip())
        browser.until(f"{contact}.includes('53.0 N')")
        assert "stop: push 53 N (limit 30)" in row[2]
        assert "showing" in browser.run("document.getElementById('source').innerText")
        assert browser.run(STATUS) == "✓ free", "the bar goes on"
        browser.click("button", "explain")  # the moment is explained, not what there is now
        browser.until("document.querySelector('#misfit .legend').innerText.includes('ADC steps')")
        assert "53.0 N" in browser.run(contact)
        browser.click("button", "back to now")
        browser.until(f"{contact}.includes('10.0 N')")


def test_what_is_not_allowed_is_off(browser):
    skin = skin_of({}, "")
    with free(browser, skin, pushed(skin), work=Work(skin, {})):
        for name in ("tare", "reset", "record", "doctor", "detect", "calibrate"):
            assert browser.run(f"document.getElementById('{name}').disabled"), name


def test_the_force_of_the_last_minutes_is_drawn_again_after_a_reload(browser):
    """What the server kept, and one reading after another since; a step back in time is none."""
    with served(SHAPED, pushed(SHAPED)) as (address, _):
        browser.open(address)
        points = """import('/history.js').then(({History}) => {
            const h = new History({times: [0, 50, 99.9], force: [1, 2, 3], stop: [0, 0, 1]});
            for (const [t, force] of [[100, 5], [100.02, 6], [100.01, 9], [100.3, 7]])
              h.push({stamp: t, contacts: [{force}], stop: false});
            const of = from => h.of(from).map(p => p.force);
            const found = [of(100.01), of(40), of(-1)];
            h.push({stamp: 5, contacts: [], stop: false});
            return JSON.stringify([...found, of(0)]);
        })"""
        recent, minute, all_of_it, reset = json.loads(browser.run(points))
        assert recent == [5, 6, 7] and minute == [2, 3, 5, 6, 7]
        assert all_of_it == [1, 2, 3, 6, 7] and reset == [0]


def test_a_finding_is_logged_with_its_lines(browser):
    nodes = {"compensation": NodeStatus(1, "column 5 is open", {"cols": "5"})}
    with served(SHAPED, [snapshot(SHAPED, nodes=nodes)]) as (address, _):
        browser.open(address)
        until(lambda: browser.found("button", "compensation: column 5 is open"), "it is listed")
        assert "column 5" in browser.run("document.querySelector('#log tbody').innerText")
        browser.until("document.getElementById('says').innerText.includes('column 5 is open')")


def colours(browser, edges) -> set[tuple[int, ...]]:
    """What is drawn within (left, top, right, bottom) [px]."""
    image = pytest.importorskip("PIL.Image")
    with image.open(io.BytesIO(browser.picture())) as picture:
        return {c for _, c in picture.convert("RGB").crop(edges).getcolors(10**6)}


REST, ARROW = (68, 1, 84), (255, 47, 135)  # of a cell, and of a push


def test_the_cover_is_turned_in_space(browser):
    with served(SHAPED, [snapshot(SHAPED, newtons=10)]) as (address, _):
        browser.open(address)
        browser.click("button", "in space")
        turned = "document.querySelector('#space canvas').dataset.turned"
        browser.until(f"{turned} !== undefined")
        where = box(browser, "#space canvas")
        assert where["width"] >= 0.45 * 1400
        edges = (where["x"], where["y"], where["right"], min(900, where["bottom"]))
        until(lambda: {REST, ARROW} <= colours(browser, edges), "cells at rest, and the arrow")
        dx, dy = 0.3 * where["width"], 0.3 * where["height"]
        edges = (edges[0] + dx, edges[1] + dy, edges[2] - dx, edges[3] - dy)
        floor = {(red, red, red) for red in range(250)}  # white on white is 252 at edges
        found = floor & colours(browser, edges)
        assert not found, "no line of the floor is seen between two cells"
        before = browser.run(turned)
        browser.run("document.querySelector('#space canvas').focus()")
        browser.press("ArrowLeft")
        browser.until(f"{turned} !== '{before}'")
        browser.click("button", "flat")
        assert box(browser, "#a .picture canvas")["width"] >= 0.45 * 1400


# --- several skins ---

OPEN = NodeStatus(2, "row 2 is open", {"rows": "2"})
WARM = NodeStatus(1, "its fabric drifts")
LEGS = skin_of({"circuit.rows": 8, "circuit.cols": 22}, "")
CARDS = (
    "[...document.querySelectorAll('.skin')].map(card => card.innerText.replace(/\\n+/g, ' | '))"
)


def several(**more):
    """A body: its left arm is free, its chest pushed, its back broken, its legs drift."""
    fault = {"reason": "fault: compensation: row 2 is open", "causes": ("fault",)}
    broken = replace(snapshot(SHAPED, stop=True, nodes={"compensation": OPEN}), **fault)
    simulated = {"serial_driver": NodeStatus(0, "", {"simulated": "true"}), "compensation": WARM}
    stop = Snapshot(stop=True, reason="chest: push + back: fault", causes=("push", "fault"))
    skins = {
        "": (SHAPED, [stop]),
        "left_arm": (SHAPED, [snapshot(SHAPED)]),
        "legs": (LEGS, [snapshot(LEGS, newtons=10, nodes=simulated)]),
        "chest": (SHAPED, pushed(SHAPED)[:3]),
        "back": (SHAPED, [broken]),
    }
    return serving(skins, **more)


def test_all_skins_are_on_one_page_the_worst_first(browser):
    with several() as (address, sources):
        browser.open(address)
        browser.until(f"{STATUS} === '■ stopped: chest: push + back: fault'")
        browser.until(f"{CARDS}.length === 4 && !{CARDS}.some(text => text.includes('?'))")
        chest, back, legs, arm = browser.run(CARDS)
        assert chest.startswith("chest | ■ stopped: push 53 N (limit 30) from the front left")
        assert back.startswith("back | ■ stopped: fault: compensation: row 2 is open")
        assert legs.startswith(
            "legs | simulated data | ! free, but its fabric drifts | 10.0 N of 30 N"
        )
        assert arm.startswith("left_arm | ✓ free") and "simulated" not in chest + back + arm
        for name in ("left_arm", "chest"):
            assert browser.found("meter", f"force on {name}") and browser.found("link", name)
        coloured = "(c => c.getContext('2d').getImageData(c.width - 9, c.height / 3, 1, 1).data[1])"
        assert browser.run(f"{coloured}(document.querySelector('.skin canvas'))") > 100
        sources["legs"].silent = True
        browser.until(f"{CARDS}[2].includes('? unknown: nothing was heard for 1 s')")


def test_two_skins_fill_the_width_and_have_a_chart_and_a_log(browser):
    """A stop of the log leads to its moment on the skin's page."""
    stops = [Snapshot(s.stamp, stop=s.stop, reason="chest: push") for s in pushed(SHAPED)]
    skins = {"": (SHAPED, stops), "chest": (SHAPED, pushed(SHAPED))}
    skins["legs"] = LEGS, [snapshot(LEGS, 2.5)]
    with serving(skins) as (address, _):
        browser.open(address)
        browser.until("document.querySelector('#log .stop') !== null")
        chest = "document.querySelector('#skins .picture[href=\"?chest\"] canvas')"
        browser.until(f"{chest}?.clientHeight > 500")
        assert box(browser, "#skins li:last-child")["right"] > 1370
        red = """(c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(
            (v, k, d) => k % 4 === 0 && v > 220 && Math.abs(d[k + 1] - 200) < 9))"""
        browser.until(f"{red}(document.querySelector('#force canvas'))")
        rows = "document.querySelectorAll('#log tbody tr').length"
        browser.until(f"{rows} === 1")  # the body's stop is the chest's
        browser.click("button", "chest: stop: push 53 N (limit 30) from the front left")
        browser.until("document.querySelector('#contacts tbody')?.innerText.includes('53.0 N')")
        assert "showing" in browser.run("document.getElementById('source').innerText")


def test_all_covers_are_in_their_places_in_space(browser):
    front = skin_of({"geometry.shape": "plane"}, "")
    behind = skin_of({"geometry.shape": "plane", "geometry.translation": [-0.5, 0.0, 0.0]}, "")
    flat = skin_of({}, "")  # of a shape that nobody stated
    skins = {"": (front, [Snapshot(stop=False)])}
    for name, skin in {"front": front, "behind": behind, "flat": flat}.items():
        skins[name] = skin, [snapshot(skin, newtons=25 if name == "behind" else 0)]
    with serving(skins) as (address, sources):
        browser.open(address)
        browser.click("button", "in space")
        turned = "document.querySelector('#space canvas').dataset.turned"
        browser.until(f"{turned} !== undefined")
        where = box(browser, "#space canvas")
        middle = where["x"] + where["width"] / 2
        left = (where["x"], where["y"], middle, where["bottom"])
        right = (middle, where["y"], where["right"], where["bottom"])
        until(lambda: {REST, ARROW} <= colours(browser, right), "the one behind, pushed")
        assert REST in colours(browser, left) and ARROW not in colours(browser, left)
        sources["behind"].silent = True
        until(lambda: ARROW not in colours(browser, right), "it is heard no more: nothing is shown")
        assert REST in colours(browser, left)
        browser.click("button", "cards only")
        assert not browser.found("image", "the covers in space")


def test_a_skin_that_becomes_worse_comes_first_and_the_focus_stays(browser):
    with several() as (address, sources):
        sources["chest"].now = 0
        browser.open(address)
        browser.until(f"{CARDS}.length === 4 && {CARDS}[0].startsWith('back | ■')")
        browser.until(f"{CARDS}[2].startsWith('chest') || {CARDS}[3].startsWith('chest')")
        browser.run("document.querySelector('a[href=\"?chest\"]').focus()")
        sources["chest"].last()
        browser.until(f"{CARDS}[0].startsWith('chest | ■')")
        assert browser.run("document.activeElement.textContent") == "chest"


def test_the_page_of_a_skin_is_a_click(browser):
    with several() as (address, _):
        browser.open(address)
        browser.click("link", "chest")
        browser.until("document.title === 'chest, tactile_skin'")
        browser.until(f"{STATUS} === '■ stopped: push 53 N (limit 30) from the front left'")
        browser.until("document.querySelectorAll('#contacts tbody tr').length === 1")
        browser.click("link", "all skins")
        browser.until(
            "document.title === 'tactile_skin' && document.querySelector('.skin') !== null"
        )
        browser.until(f"{STATUS} === '■ stopped: chest: push + back: fault'")


def test_the_stop_of_the_body_is_reset_if_that_is_allowed(browser):
    with several(controls=True) as (address, sources):
        browser.open(address)
        browser.click("button", "reset stop")
        browser.click("button", "reset? then again")
        browser.until("document.getElementById('said').textContent === 'done'")
        assert sources[""].asked == ["reset"] and not sources["chest"].asked
    with several() as (address, _):
        browser.open(address)
        browser.until(f"{STATUS}.startsWith('■')")
        assert not browser.found("button", "reset stop")


def violations(browser) -> list:
    browser.call("Page.setBypassCSP", enabled=True)
    browser.run(AXE.read_text())
    found = browser.run(
        f"axe.run({{runOnly: {RULES}}}).then(r => JSON.stringify(r.violations.map("
        "v => [v.id, v.help, v.nodes.map(n => n.html + n.failureSummary)])))"
    )
    return json.loads(found)


@pytest.mark.skipif(not AXE.exists(), reason="npm ci --prefix tests/axe")
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 360])
def test_axe_finds_no_violation_on_the_page_of_all(browser, scheme, width):
    browser.prefer(scheme)
    browser.resize(width, 900)
    with several(controls=True) as (address, sources):
        sources["left_arm"].silent = True
        browser.open(address)
        browser.until(f"{CARDS}.some(text => text.includes('unknown: nothing was heard for 1 s'))")
        browser.click("button", "details")
        assert violations(browser) == []
        assert browser.run("document.documentElement.scrollWidth") <= width


@pytest.mark.skipif(not AXE.exists(), reason="npm ci --prefix tests/axe")
@pytest.mark.parametrize(
    ("width", "scheme"), [(1400, "light"), (360, "dark"), ci(1400, "dark"), ci(360, "light")]
)
def test_axe_finds_no_violation(browser, width, scheme):
    nodes = {"compensation": NodeStatus(2, "column 5 is open", {"cols": "5"})}
    states = [*pushed(SHAPED)[:3], snapshot(SHAPED, 2.0, 40, stop=True, nodes=nodes)]
    browser.prefer(scheme)
    browser.resize(width, 900)
    with served(SHAPED, states, controls=True) as (address, source):
        browser.open(address)
        browser.until(f"{STATUS}.startsWith('■')")
        browser.click("button", "details")
        browser.click("button", "explain")
        browser.until("document.querySelector('#misfit .legend').innerText.includes('ADC steps')")
        for now in (len(states) - 1, 0):
            source.now = now
            browser.until(f"{STATUS}.startsWith('{'■' if now else '✓'}')")
            assert violations(browser) == []


@pytest.mark.skipif(not AXE.exists(), reason="npm ci --prefix tests/axe")
@pytest.mark.parametrize(("width", "scheme"), [ci(1400, "light"), (360, "dark")])
def test_axe_finds_no_violation_in_guided_steps(browser, width, scheme):
    browser.prefer(scheme)
    browser.resize(width, 900)
    work = Work(SHAPED, {})
    work.files["/mine.yaml"] = b""
    with served(SHAPED, [snapshot(SHAPED)], controls=True, work=work) as (address, _):
        browser.open(address)
        browser.click("button", "doctor")
        browser.until("!document.getElementById('question').hidden")
        assert violations(browser) == []
        assert browser.run("document.documentElement.scrollWidth") <= width
        browser.click("button", "give up")
        browser.until("document.getElementById('leave').innerText === 'close'")
