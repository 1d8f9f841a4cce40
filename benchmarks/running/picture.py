"""Makes README's picture of the page: a push and two fingers, on a clock that no load disturbs.

The frames of the demo's scene go through the solver, the tracker and the stop's policy, and their
last snapshot is drawn by Chromium. `python -m benchmarks.running.picture docs/view.png`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from support.chromium import Chromium
from support.page import served

from tactile_skin import compensate, forward
from tactile_skin.behaviours.stop import StopConfig, StopPolicy
from tactile_skin.middleware.config import skin_of
from tactile_skin.simulation.scenes import script
from tactile_skin.touch import features
from tactile_skin.touch.tracking import Tracker
from tactile_skin.view.snapshot import CONTACT, NodeStatus, Snapshot

from .. import harness

BEGIN = 1.78e9  # s, of the stamps
STEP = 0.02  # s between two frames
PUSH, FINGERS = (8.6, 13.0), (4.2, 6.4)  # s of the demo's scene, in the order that they are shown
COUNTS = 64  # of skin/adc in an ADC step of 10 bits
SIZE = 1400, 910  # px


def snapshots() -> list[Snapshot]:
    skin, rng = skin_of({"geometry.shape": "cylinder"}, ""), np.random.default_rng(0)
    scene, tracker = script("demo", *skin.circuit.shape), Tracker(skin.geometry.pitch)
    policy, t, found = StopPolicy(StopConfig()), BEGIN, []
    for begin, end in (PUSH, FINGERS):
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


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("picture", type=Path, help="PNG to make")
    args = parser.parse_args(arguments)
    skin = skin_of({"geometry.shape": "cylinder"}, "")
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        served(skin, snapshots()) as (address, _),
        Chromium(Path(folder), *SIZE) as browser,
    ):
        browser.open(address)
        browser.until("document.querySelectorAll('#contacts tbody tr').length === 2")
        browser.until("document.querySelector('#stop strong').innerText.includes('free')")
        browser.until("document.querySelector('#push p').innerText.includes('front')")
        args.picture.write_bytes(browser.picture())


if __name__ == "__main__":
    harness.run(main)
