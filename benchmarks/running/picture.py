# SPDX-License-Identifier: Apache-2.0
"""Makes the pictures of the page in docs, on a clock that no load disturbs.

The frames of the demo's scene go through the solver, the tracker and the stop's policy, and their
last snapshot is drawn by Chromium: `python -m benchmarks.running.picture view docs/view.png` a push
and two fingers, `space docs/space.png` the same on the cover in space, in the dark, and
`body docs/body.png` three skins.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.chromium import Chromium
from support.page import served, serving

from tactile_skin import compensate, forward
from tactile_skin.behaviours.stop import StopConfig, StopPolicy
from tactile_skin.middleware.config import SkinConfig, skin_of
from tactile_skin.simulation.scenes import script
from tactile_skin.touch import features
from tactile_skin.touch.tracking import Tracker
from tactile_skin.view.snapshot import CONTACT, NodeStatus, Snapshot

from .. import harness

BEGIN = 1.78e9  # s, of the stamps
STEP = 0.02  # s between two frames
PUSH, FINGERS = (8.6, 13.0), (4.2, 6.4)  # s of the demo's scene, in the order that they are shown
PUSH_NOW, STILL = (8.6, 10.2), (0.0, 0.5)  # s, of three skins
COUNTS = 64  # of skin/adc in an ADC step of 10 bits
SIZES = {"view": (1400, 910), "space": (720, 1010), "body": (1400, 640)}  # px
BROKEN = 6  # row of the back that does not reach the board


def snapshots(skin: SkinConfig, parts=(PUSH, FINGERS)) -> list[Snapshot]:
    """Return those of parts of the demo's scene, from and to so many seconds."""
    rng = np.random.default_rng(0)
    scene, tracker = script("demo", *skin.circuit.shape), Tracker(skin.geometry.pitch)
    policy, t, found = StopPolicy(StopConfig()), BEGIN, []
    for begin, end in parts:
        for at in np.arange(begin, end, STEP):
            t += STEP
            resistance = skin.curve.resistance(scene(at))
            steps = forward(skin.circuit, resistance) * skin.circuit.full_scale
            adc = np.rint(COUNTS * (steps + 0.5 * rng.standard_normal(steps.shape)))
            adc = np.clip(adc, 0, 2**16 - 1).astype(np.uint16)
            force = compensate(skin.adc.ratio_of(adc), skin.circuit, skin.curve, "auto").force
            touches = tracker.update(t, features.analyse_frame(force, skin.geometry, 0.2))
            contacts = np.float32(
                [_row(each) for each in touches if each.state != "released"]
            ).reshape(-1, len(CONTACT))
            total, peak = contacts[:, 3].sum(), contacts[:, -1].max(initial=0.0)
            decision = policy.reading(t, float(total), float(peak))
            found.append(
                Snapshot(
                    stamp=t,
                    adc=adc,
                    pressure=np.float32(force / skin.geometry.cell_area),
                    contacts=contacts,
                    stop=decision.stop,
                    reason=decision.reason,
                    causes=tuple(cause.value for cause in decision.causes),
                    force=float(total),
                    limit=policy.config.threshold,
                    cell_limit=policy.config.peak,
                    nodes={"serial_driver": NodeStatus(0, "", {"simulated": "true"})},
                )
            )
    return found


def _row(touch) -> list[float]:
    contact = touch.contact
    place, velocity = contact.position.tolist(), touch.velocity.tolist()
    return [*place, contact.force, touch.id, *velocity, contact.peak]


def body() -> dict[str, tuple[SkinConfig, list[Snapshot]]]:
    """Return a chest that is pushed, a back with a broken line, and an arm that is touched."""
    chest = skin_of({"geometry.shape": "plane", "geometry.rpy": [0.0, 0.0, np.pi / 2]}, "")
    back = skin_of({"geometry.shape": "plane"}, "")
    arm = skin_of({"geometry.shape": "cylinder", "circuit.rows": 8, "circuit.cols": 22}, "")
    pushed, broken = snapshots(chest, [PUSH_NOW]), snapshots(back, [STILL])
    words = f"row {BROKEN} reads nothing: its wire is broken, or a contact open"
    values = {"kind": "open", "rows": f"{BROKEN}", "cols": ""}
    fault = NodeStatus(2, words, values)
    reason = f"fault: back/compensation: {words}"
    broken = [
        replace(
            each,
            stop=True,
            reason=reason,
            causes=("fault",),
            nodes=each.nodes | {"back/compensation": fault},
        )
        for each in broken
    ]
    both = f"chest: push + back: {reason}"
    stop = Snapshot(stop=True, reason=both, causes=("push", "fault"))
    none = skin_of({}, "")
    return {
        "": (none, [stop]),
        "arm": (arm, snapshots(arm, [FINGERS])),
        "back": (back, broken),
        "chest": (chest, pushed),
    }


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("what", choices=tuple(SIZES), help="what it shows")
    parser.add_argument("picture", type=Path, help="PNG to make")
    args = parser.parse_args(arguments)
    draw = draw_skins if args.what == "body" else draw_one
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        Chromium(Path(folder), *SIZES[args.what]) as browser,
    ):
        args.picture.write_bytes(draw(browser, args.what == "space"))


def draw_one(browser: Chromium, space: bool) -> bytes:
    skin = skin_of({"geometry.shape": "cylinder"}, "")
    browser.prefer("dark" if space else "light")
    with served(skin, snapshots(skin)) as (address, _):
        browser.open(address)
        browser.until("document.querySelectorAll('#contacts tbody tr').length === 2")
        browser.until("document.querySelector('#stop strong').innerText.includes('free')")
        browser.until("document.querySelector('#push p').innerText.includes('front')")
        if space:
            browser.click("button", "in space")
            browser.until("document.querySelector('#space canvas').dataset.turned")
            browser.run("scrollTo(0, 0)")
        return browser.picture()


def draw_skins(browser: Chromium, _) -> bytes:
    with serving(body()) as (address, _):
        browser.open(address)
        browser.until("document.querySelectorAll('.skin.stopped').length === 2")
        browser.until("document.querySelectorAll('.skin.free').length === 1")
        return browser.picture()


if __name__ == "__main__":
    harness.run(main)
