# SPDX-License-Identifier: Apache-2.0
"""The lines of the table: which streams each plays, and the figures that they come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
from support.chain import Chain

from tactile_skin import Circuit, PressureCurve
from tactile_skin.bench import speed

from .. import harness
from ..accuracy import boards as recorded
from ..boards import insole_nodes
from ..boards.text_board import Tally
from ..doctor.in_use import CUSHION
from ..faults import reliability
from ..running import touch_to_stop
from . import presses
from .boards import WIRED, WRONG

SHAPES = "8x8", "16x16", "8x8-loaded-rows", "8x8-grounded-columns"
STREAM = 8.0  # s of one with a fault
SOUND = 30.0  # s of a sound one
QUICK = 0.1  # share of the streams
_PUSHES = 1000  # seed


class Figure(NamedTuple):
    """One number of the table.

    Attributes:
        of: what it is a share of; None: it is none.
        bound: at most, or with `least` at least; of a share if it is one. None: there is none.
    """

    name: str
    value: float
    of: float | None = None
    bound: float | None = None
    least: bool = False

    @property
    def measured(self) -> float:
        return self.value if self.of is None else self.value / max(self.of, 1)

    @property
    def met(self) -> bool | None:
        if self.bound is None:
            return None
        return self.measured >= self.bound if self.least else self.measured <= self.bound


@dataclass(frozen=True)
class Line:
    """A line.

    Attributes:
        tasks: (seed, share of all streams, folder of recordings) -> list of (function, arguments).
        figures: the tasks' results -> list of Figure.
        alone: whether it measures time, so that nothing may run beside it.
    """

    name: str
    about: str
    tasks: Callable[[int, float, Path], list]
    figures: Callable[[list], list[Figure]]
    alone: bool = False


def _some(n: int, share: float) -> range:
    return range(max(1, round(n * share)))


def script(module: str, *arguments) -> dict:
    """Return what main of another benchmark does."""
    return import_module(f"benchmarks.{module}").main([str(each) for each in arguments])


def _scripts(module: str, each: int, n: int, first: int, *more):
    """Tasks of a benchmark that takes --boards and --seed, `each` boards a task of `n` in all."""

    def tasks(seed: int, share: float, data: Path) -> list:
        boards = len(_some(n, share))
        return [
            (
                script,
                (
                    module,
                    "--boards",
                    min(each, boards - k),
                    "--seed",
                    first + k + 10**5 * (seed - 1),
                    *more,
                ),
            )
            for k in range(0, boards, each)
        ]

    return tasks


def _sum(results: list[dict], *names: str) -> list[float]:
    return [sum(result[name] for result in results) for name in names]


# --- time ---


def frame(seed: int, n: int) -> dict:
    """Times of a frame of bodies, by the solvers that run."""
    circuit, curve = Circuit(), PressureCurve()
    found = speed.timed(("auto", "map"), "bodies", "scan", n, (seed, 0), circuit, curve)
    return {method: errors for method, _, errors in found}


def _of_frame(results: list) -> list[Figure]:
    (found,) = results
    return [
        Figure(f"{method}: {name}", found[method][key])
        for method in ("auto", "map")
        for name, key in (("p50 [y]", "p50_y"), ("p99 [y]", "p99_y"), ("error [g]", "mean_g"))
    ]


def _of_stop(results: list) -> list[Figure]:
    (found,) = (result["touch_to_stop"] for result in results)
    times = np.concatenate([rise["seen_ms"] for rise in found["rises"]])
    cuts = [t for kind in found["cuts"].values() for t in kind]
    missed = sum(rise["missed"] for rise in found["rises"])
    return [
        Figure("p50 [ms]", float(np.percentile(times, 50))),
        Figure("p99 [ms]", float(np.percentile(times, 99)), None, touch_to_stop.LIMIT_MS),
        Figure("pushes missed", missed, missed + len(times), 0.0),
        Figure(
            "cut cable, longest [ms]",
            max(t or np.inf for t in cuts),
            None,
            touch_to_stop.CUT_LIMIT_MS,
        ),
    ]


# --- streams ---


def _faults(seed: int, share: float, data: Path) -> list:
    """A stream of every fault that can be seen, on one shape after the other."""
    faults = reliability.FAULTS
    chosen = [faults[k] for k in range(0, len(faults), max(1, round(1 / share)))]
    found = []
    for k, fault in enumerate(chosen):
        shape = SHAPES[k % len(SHAPES)]
        protocol = fault.protocols[k // len(SHAPES) % len(fault.protocols)]
        key = shape, fault.name, protocol, fault.stalls or k % 2 == 0
        found.append((reliability.run_fault, (*key, STREAM, harness.seed_of(seed, *key))))
    return found


def _of_faults(results: list) -> list[Figure]:
    frames, silent, failing, total, missed, errors = _sum(
        results, "frames", "silent", "failing", "pushes", "missed", "errors"
    )
    return [
        Figure("silent frames", silent, frames, 0.009),
        Figure("failing frames", failing, frames),
        Figure("pushes missed", missed, total, 0.0),
        Figure("pushes let go", sum(r["let_go"] for r in results), total),
        Figure("callbacks that raised", errors, None, 0.0),
    ]


def _sound(seed: int, share: float, data: Path) -> list:
    kinds = [(s, *reliability.SOUND[k % len(reliability.SOUND)]) for k, s in enumerate(SHAPES * 4)]
    return [
        (reliability.run_sound, (*kinds[k], SOUND, harness.seed_of(seed, *kinds[k], k)))
        for k in _some(len(kinds), share)
    ]


def _of_sound(results: list) -> list[Figure]:
    frames, stops, stopped, failing, missed, total = _sum(
        results, "frames", "false_stops", "stopped", "failing", "missed", "pushes"
    )
    return [
        Figure("false stops", stops, None, 0.0),
        Figure("frames stopped without a push", stopped, frames),
        Figure("failing frames", failing, frames),
        Figure("pushes missed", missed, total, 0.0),
    ]


def insole(path: Path, foot: int) -> dict:
    """One foot of an insole: seconds in all and in a fault."""
    name, counts = list(recorded.recordings(path, 0))[foot]
    return _of_tally("insole", insole_nodes.driven(counts, 8.0))


def cushion(path: Path) -> dict:
    """Recordings of a cushion, one after the other."""
    files = [np.loadtxt(p, delimiter=",").reshape(-1, 9, 9) for p in sorted(path.glob("*.csv"))]
    frames = np.concatenate(files).transpose(0, 2, 1)
    given = {"circuit.inverted": True}
    nodes = {"serial_driver": dict(given), "compensation": dict(given)}
    chain, tally = Chain(CUSHION, "text", nodes), Tally()
    for k, counts in enumerate(frames):
        chain.feed(k / 10.0 + 0.01, insole_nodes.line(counts.astype(int)))
        if k / 10.0 >= insole_nodes.START:
            tally.add(0.1, chain.stop, chain.reason)
    chain.close()
    return _of_tally("cushion", tally)


def garment(path: Path) -> dict:
    """What is said of frames that somebody processed: whether they are named so."""
    from tactile_skin import diagnose

    frames = np.load(path)
    said = {}
    for name in frames.files:
        values = np.asarray(frames[name], float)
        if values.ndim == 3:
            circuit = Circuit(*values.shape[1:])
            found = diagnose(values / circuit.full_scale, circuit)
            said[name] = [finding.kind for finding in found]
    return {"of": "garment", "said": said}


def _of_tally(name: str, tally: Tally) -> dict:
    return {"of": name, "s": tally.seconds, "fault": sum(tally.faults.values())} | {
        "reasons": tally.faults.most_common(3)
    }


def _recordings(seed: int, share: float, data: Path) -> list:
    feet, cushions = data / "insole_floating", data / "cushion_loaded"
    worn = data / "garment_textile" / "frames.npz"
    tasks = [(insole, (feet, k)) for k in _some(2 * len(list(feet.glob("*.npz"))), share)]
    tasks = tasks if list(feet.glob("*.npz")) else []
    tasks += [(cushion, (cushions,))] if list(cushions.glob("*.csv")) else []
    return tasks + ([(garment, (worn,))] if worn.exists() else [])


def _of_recordings(results: list) -> list[Figure]:
    found = []
    for name in ("insole", "cushion"):
        mine = [result for result in results if result["of"] == name]
        if mine:
            seconds, fault = _sum(mine, "s", "fault")
            found.append(Figure(f"{name}: s in fault", fault, seconds, 0.02))
    for result in results:
        if result["of"] == "garment":
            named = sum(
                "zeros" in kinds or "processed" in kinds for kinds in result["said"].values()
            )
            found.append(
                Figure(
                    "garment: not named as processed",
                    len(result["said"]) - named,
                    len(result["said"]),
                )
            )
    return found


# --- other benchmarks ---


def _of_planted(results: list) -> list[Figure]:
    named = [hit for result in results for hits in result["named"].values() for hit in hits]
    false = sum(len(result["false alarms"]) for result in results)
    return [
        Figure("faults named", sum(named), len(named), 0.9, least=True),
        Figure("boards with a finding too many", false),
    ]


def _of_use(results: list) -> list[Figure]:
    false, boards = _sum(results, "false", "boards")
    return [Figure("sound boards with a false finding", false, boards)]


def _of_identify(results: list) -> list[Figure]:
    off = np.abs(np.concatenate([result["off"] for result in results]))
    return [
        Figure("r_par, median [ohm]", float(np.median(off[:, 0]))),
        Figure("r_par beyond 1 %", int((off[:, 0] > 0.01 * Circuit().r_par).sum()), len(off)),
        Figure("r_line, median [ohm]", float(np.median(off[:, 1]))),
    ]


def _of_curve(results: list) -> list[Figure]:
    off = np.abs(np.concatenate([result["fitted"] for result in results]))
    return [
        Figure("error of a total, median [%]", 100.0 * float(np.median(off))),
        Figure("error of a total, p95 [%]", 100.0 * float(np.quantile(off, 0.95))),
    ]


def _of_obey(results: list) -> list[Figure]:
    ends: Counter = Counter()
    for result in results:
        ends.update(sum(result["ends"].values(), Counter()))
    boards = sum(ends.values()) - ends["not a board"]
    return [
        Figure("right in the end", ends["right"], boards, 0.88, least=True),
        Figure("free under a palm in the end", ends["FREE UNDER A PALM"], boards, 0.0),
        Figure("free under a palm on the way", sum(r["free on the way"] for r in results)),
    ]


# --- palms and pushes ---


def _entries(seed: int, share: float, data: Path) -> list:
    kinds = [(name, wired) for name, (_, on) in WRONG.items() for wired in on]
    step = max(1, round(1 / share))
    return [
        (presses.palms, (name, wired, k, harness.seed_of(seed, name, wired)))
        for k, (name, wired) in enumerate(kinds)
        if k % step == 0
    ]


def _of_palms(results: list) -> list[Figure]:
    palms, free, missed, early = _sum(results, "palms", "free", "missed", "early")
    return [
        Figure("palms ever free while they stand", free, palms, 0.0),
        Figure("palms missed", missed, palms, 0.0),
        Figure("palms let go early", early, palms, 0.0),
    ]


def _of_entries(results: list) -> list[Figure]:
    found = _of_palms(results)
    for name in WRONG:
        mine = [result for result in results if result["wrong"] == name]
        if mine:
            free, palms = _sum(mine, "free", "palms")
            found.append(Figure(f"ever free: {name}", free, palms))
    return found


def _boards(function: Callable, n: int, *first):
    """Tasks of `n` boards of every readout in turn."""

    def tasks(seed: int, share: float, data: Path) -> list:
        return [
            (
                function,
                (*first, WIRED[k % len(WIRED)], k, harness.seed_of(seed, function.__name__, k)),
            )
            for k in _some(n, share)
        ]

    return tasks


def _of_moving(results: list) -> list[Figure]:
    return [
        Figure("boards held until let go", *_sum(results, "held", "boards"), 1.0, True),
        *_of_palms(results),
    ]


def _of_pushes(results: list) -> list[Figure]:
    within, total, faults = _sum(results, "within", "pushes", "faults")
    true = [force for result in results for force in result["true"]]
    felt = [force for result in results for force in result["felt"]]
    return [
        Figure("stopped within 20 to 45 N true", within, total, *_PROVED[results[0]["proof"]]),
        Figure("stopped by a fault", faults, total),
        Figure("true force that stopped, median [N]", float(np.median(true or [np.nan]))),
        Figure("true force that stopped, most [N]", max(true, default=np.nan)),
        Figure(
            "felt force that stopped, least [N]",
            min(felt, default=np.nan),
            None,
            presses.LEAST,
            True,
        ),
    ]


_PROVED = {"weight": (0.99, True), "none": ()}  # bound of the share that stops within


def _of_bits(results: list) -> list[Figure]:
    return [
        Figure("named or harmless", *_sum(results, "good", "streams"), 1.0, True),
        Figure("named", *_sum(results, "named", "streams")),
        _of_palms(results)[0],
    ]


LINES = (
    Line("frame", "time of a 16x16 frame of bodies, cold, and its error",
         lambda seed, share, data: [(frame, (seed, max(30, round(300 * share))))], _of_frame, True),
    Line("stop", "from the scan that meets a push to the stop hook, in real time",
         lambda seed, share, data: [(touch_to_stop.measure, (len(_some(12, share)), len(_some(3, share)), seed))],
         _of_stop, True),
    Line("faults", "streams with a fault, each of another kind", _faults, _of_faults),
    Line("sound", "sound boards in a day's touches", _sound, _of_sound),
    Line("recordings", "what others recorded, configured rightly", _recordings, _of_recordings),
    Line("planted", "one or two faults that the doctor is to name",
         _scripts("doctor.faults", 6, 24, 5000, "--sound", 0), _of_planted),
    Line("in use", "sound boards on which something always lies, by the doctor",
         _scripts("doctor.in_use", 6, 18, 71000), _of_use),
    Line("identify", "r_par and r_line of unknown boards", _scripts("calibration.identify", 3, 9, 0), _of_identify),
    Line("curve", "newtons by ten objects of known weight",
         _scripts("calibration.curve_fit", 3, 6, 100, "--touches", 20), _of_curve),
    Line("obey", "owners of wrong entries who obey", _scripts("doctor.obey", 3, 18, 1000), _of_obey),
    Line("entries", "palms of 45 N on boards with one wrong entry or fault", _entries, _of_entries),
    Line("moving", "palms of 45 N on boards that move their zero", _boards(presses.moving, 24), _of_moving),
    Line("proved", "pushes on right boards whose newtons were proved",
         _boards(presses.pushes, 12, "weight"), _of_pushes),
    Line("not proved", "pushes on right boards whose newtons nothing proved",
         _boards(presses.pushes, 12, "none"), _of_pushes),
    Line("bits", "a bit of the converter sticks, from the start or later", _boards(presses.bits, 40), _of_bits),
)  # fmt: skip
