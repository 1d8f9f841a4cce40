# SPDX-License-Identifier: Apache-2.0
"""How soon the node reports a fault that lasts.

A fault stays, touches change. Streams at 100 frames a second, of a skin that is tared first and
then pressed or stroked at one place after the other, go through the compensation node on a driven
clock. The fault is there from the start, or begins within the first touch. A frame *fails* as in
`stability`; it is *silent* if the node neither doubts it nor reports a fault.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
from support.troubled import expose

from tactile_skin.bench.measure import moving_touch
from tactile_skin.bench.stability import FAILS, FAILS_SHARE
from tactile_skin.bench.troubles import EVERYDAY, touches
from tactile_skin.middleware.bus import (
    Context,
    ManualClock,
    Node,
    Parameter,
    SingleThreadedExecutor,
)
from tactile_skin.msg import DiagnosticArray, Header, Image, image, image_array
from tactile_skin.nodes import diagnostics
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import GRAM, PressureCurve
from tactile_skin.simulation.textile import Textile

from .. import harness

RATE = 100  # frames a second
_IDLE = 160  # frames, in which the tare is found
_RAMP = 15  # frames that a press takes to come, and to go
_HELD = 50  # frames that it stays
_PAUSE = 30
_TOUCH = 2 * _RAMP + _HELD + _PAUSE  # frames from one touch to the next
_EVEN = replace(EVERYDAY, rest=0.03)  # a good fabric; no fabric's cells are all alike
SKINS = {
    "sound": _EVEN,
    "one short": replace(_EVEN, short=1),
    "two shorts": replace(_EVEN, short=2),
    "R_par -10 %": replace(_EVEN, r_par=0.9),
    "R_par -5 %": replace(_EVEN, r_par=0.95),
    "R_par +10 %": replace(_EVEN, r_par=1.1),
    "ADC saturated at 80 %": replace(_EVEN, ceiling=0.8),
    # a fabric that scatters more, which the tare takes in, and with it what it can of a fault
    "uneven, sound": replace(EVERYDAY, rest=0.05),
    "uneven, one short": replace(EVERYDAY, rest=0.05, short=1),
    "uneven, R_par -10 %": replace(EVERYDAY, rest=0.05, r_par=0.9),
    "uneven, R_par +10 %": replace(EVERYDAY, rest=0.05, r_par=1.1),
}
KINDS = "presses", "strokes"
BEGINS = "from the start", "in a touch"


def stream(kind: str, skin: Textile, early: bool, count: int, seed: int, circuit: Circuit, curve):
    """Frames of one skin, its damage and its scatter the same throughout.

    Args:
        early: whether the fault is there from the start; else it begins within the first touch.

    Yields:
        force (rows, cols) [N] and ADC ratio (rows, cols).
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    now = skin if early else replace(EVERYDAY, rest=skin.rest)
    rest = np.zeros(circuit.shape)

    def read(force):
        return expose(now, circuit, curve, force, np.random.default_rng(seed))

    def untouched(frames):
        ratio = read(rest)
        for _ in range(frames):
            yield rest, now.converter(circuit).frame(ratio, rng)

    yield from untouched(_IDLE)
    for number in range(count):
        if kind == "strokes":
            forces = moving_touch(2 * _RAMP + _HELD, rng)
        else:
            full = touches(2, circuit, rng)[rng.integers(2)]
            coming = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, _RAMP + 1) / _RAMP)
            share = np.concatenate([coming, np.ones(_HELD), coming[::-1]])
            forces = share[:, None, None] * full
        before = None
        for k, force in enumerate(forces):
            if not number and k == _RAMP:
                now, before = skin, None
            if before is None or (force != before).any():
                ratio, before = read(force), force
            yield force, now.converter(circuit).frame(ratio, rng)
        yield from untouched(_PAUSE)


def watched(kind: str, skin: Textile, early: bool, count: int, seed: int, method="auto") -> dict:
    """What the node makes of one stream: arrays of (frames,), from the fault on.

    Returns:
        touched; fails; doubted, by the node in this frame; fault, reported at this time; touch,
        its number, from 0.
    """
    circuit, curve = Circuit(), PressureCurve()
    context, executor, seen = Context(clock := ManualClock()), SingleThreadedExecutor(), {}
    # a busy machine is not what is measured here
    given = [Parameter("method", method), Parameter("time_limit", 10.0)]
    node = Node("compensation", context=context, parameter_overrides=given)
    observer = Node("observer", context=context)
    for topic, kind_of in (("skin/pressure", Image), (diagnostics.TOPIC, DiagnosticArray)):
        keep = partial(seen.__setitem__, topic)
        observer.create_subscription(kind_of, topic, keep, 10)
    for one in (node, observer):
        executor.add_node(one)
    compensation = Compensation(node)
    scale = 2 ** (16 - circuit.adc_bits) * circuit.full_scale
    area, level = compensation.cell_area, diagnostics.OK
    record = {name: [] for name in ("touched", "fails", "doubted", "fault", "touch")}
    for number, (force, adc) in enumerate(stream(kind, skin, early, count, seed, circuit, curve)):
        clock.advance(1.0 / RATE)
        samples = np.rint(adc * scale).astype(np.uint16)
        seen.pop("skin/pressure", None)
        compensation.on_adc(image(samples, "16UC1", Header(clock.now().to_msg())))
        executor.spin_some()
        if diagnostics.TOPIC in seen:
            level = seen[diagnostics.TOPIC].status[0].level
        found = 0.0 * force
        if "skin/pressure" in seen:
            found = image_array(seen["skin/pressure"]) * area
        error, mean = (np.abs(x).mean() / GRAM for x in (found - force, force))
        record["touched"].append(mean > 0.0)
        record["fails"].append(error > max(FAILS, FAILS_SHARE * mean))
        record["doubted"].append(level != diagnostics.OK)
        record["fault"].append(level == diagnostics.ERROR)
        record["touch"].append((number - _IDLE) // _TOUCH)
    for one in (node, observer):
        one.destroy_node()
    onset = _IDLE if early else _IDLE + _RAMP  # until then the node waits for the tare
    return {name: np.array(values[onset:]) for name, values in record.items()}


def measure(kind: str, name: str, early: bool, streams: int, count: int, seed: int) -> dict:
    """Shares of streams in which the fault is reported, and how soon; what slips through."""
    runs = [watched(kind, SKINS[name], early, count, seed + k) for k in range(streams)]
    first = np.array([r["fault"].argmax() if r["fault"].any() else np.inf for r in runs])
    told = np.isfinite(first)
    delay = first[told] / RATE
    fails, doubted, touched, touch = (
        np.concatenate([r[key] for r in runs]) for key in ("fails", "doubted", "touched", "touch")
    )
    lost = [r["fails"].any() and not t for r, t in zip(runs, told, strict=True)]
    return {
        "streams": streams,
        "told": float(told.mean()),
        "told in 1 s": float((first <= RATE).mean()),
        "delay [s], median and longest": [float(np.median(delay)), float(delay.max())]
        if told.any()
        else None,
        "streams with failing frames": int(sum(r["fails"].any() for r in runs)),
        "of them never told": int(sum(lost)),
        "frames that fail": int(fails.sum()),
        "of them silent": int((fails & ~doubted).sum()),
        "silent in each touch": np.bincount(touch[fails & ~doubted], minlength=count).tolist(),
        "share of touched frames doubted": float(doubted[touched].mean()),
        "hours": len(fails) / RATE / 3600,
    }


def main(arguments=None) -> list:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--streams", type=int, default=50)
    parser.add_argument("--touches", type=int, default=4, help="in each stream")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skins", nargs="*", default=list(SKINS), choices=SKINS)
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS)
    parser.add_argument("--begins", nargs="*", default=BEGINS, choices=BEGINS)
    args = parser.parse_args(arguments)
    rows = []
    for name in args.skins:
        for kind in args.kinds:
            for begins in args.begins:
                early = begins == BEGINS[0]
                row = measure(kind, name, early, args.streams, args.touches, args.seed)
                rows.append({"skin": name, "begins": begins, "kind": kind} | row)
                print(f"{name} {begins}, {kind}", json.dumps(row), flush=True)
    return rows


if __name__ == "__main__":
    harness.run(main)
