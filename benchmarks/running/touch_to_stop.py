# SPDX-License-Identifier: Apache-2.0
"""Time from the scan that meets a push, and from a cut cable, to the stop hook.

One process plays the board in real time, as `tactile-skin sim` does: 390 scans a second, its
low-pass, 100 frames a second at 1 Mbaud on a pseudo-terminal. Another runs launch/skin.launch.yaml
with a stop hook, beside one that hangs and one that raises. Both read one monotonic clock.
"""

from __future__ import annotations

import logging
import multiprocessing
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes, simulator
from tactile_skin.solvers import compensate
from tactile_skin.touch import features
from tactile_skin.touch.geometry import make_geometry

from .. import harness

RISES = (0.0, 0.02, 0.05, 0.1)  # s, from the first touch to the whole force of a push
LIMIT_MS, CUT_LIMIT_MS = 25.0, 150.0
_THRESHOLD, _CELL = 30.0, 0.2  # N, of config/skin.yaml
_LENGTH, _PERIOD = 0.2, 0.5  # s, of a push, and between two
_SILENCE, _BETWEEN = 0.5, 3.0  # s, of a silence, and between two: the robot is free again by then
_START = 2.0  # s, for the skin to come free
_KEPT = 60  # scans of each push that are looked at again
_PATIENCE = 120.0  # s
_SPAWN = multiprocessing.get_context("spawn")  # a fork would copy this process's threads half


def measure(pushes: int, cuts: int, seed: int, track=lambda items: items) -> dict:
    """So many pushes of each rise time, and cut cables of each kind.

    Returns:
        the figure "touch_to_stop" as plain data. `rises`: for each rise time the times to the stop
        hook [ms] of the pushes, `applied_ms` from the first scan made while the force exceeded the
        threshold, `seen_ms` from the first scan whose low-passed samples hold a force above it;
        `missed` pushes brought no stop. `cuts`: `closed_ms` from the moment the board's end of the
        cable closes, `silent_ms` from the moment it sends nothing more.
    """
    rises = [rise for rise in RISES for _ in range(pushes)]
    np.random.default_rng(seed).shuffle(rises)
    log, calls = run(rises, cuts, seed)
    found = {rise: {"rise_ms": 1e3 * rise, "applied_ms": [], "seen_ms": []} for rise in RISES}
    missed = dict.fromkeys(RISES, 0)
    for rise, scans in track(list(zip(rises, log["pushes"], strict=True))):
        applied = next(t for t, force, _ in scans if force >= _THRESHOLD)
        stop = _stop_after(calls, scans[0][0], applied + _LENGTH)
        seen = _seen(scans)
        if stop is None or seen is None:
            missed[rise] += 1
            continue
        found[rise]["applied_ms"].append(1e3 * (stop - applied))
        found[rise]["seen_ms"].append(1e3 * (stop - seen))
    cut = {}
    for kind in ("closed", "silent"):
        stops = [_stop_after(calls, t, t + 1.0) for t in log[kind]]
        times = zip(log[kind], stops, strict=True)
        cut[f"{kind}_ms"] = [None if stop is None else 1e3 * (stop - t) for t, stop in times]
    return {
        "touch_to_stop": {
            "rises": [found[rise] | {"missed": missed[rise]} for rise in RISES],
            "cuts": cut,
        }
    }


def run(rises, cuts: int, seed: int, **stop) -> tuple[dict, list[tuple[float, bool, str]]]:
    """Play pushes of these rise times and so many cuts of each kind.

    Args:
        stop: parameters of stop_on_push.

    Returns:
        what the board did: `pushes`, a list for each of its scans (time, force applied [N], samples
        sent), `closed` and `silent`, times of the cuts; and the hook's calls (time, stop, reason).

    Raises:
        RuntimeError: the board or the skin ended early.
    """
    with tempfile.TemporaryDirectory() as folder:
        link = str(Path(folder) / "skin")
        ends, processes = [], []
        for target, more in ((_board, (rises, cuts, seed)), (_skin, (stop,))):
            mine, theirs = _SPAWN.Pipe()
            ends.append(mine)
            processes.append(_SPAWN.Process(target=target, args=(theirs, link, *more), daemon=True))
            processes[-1].start()
            theirs.close()
        try:
            board_end, skin_end = ends
            length = len(rises) * _PERIOD + 6.0 * cuts + _PATIENCE
            if not board_end.poll(length):
                raise RuntimeError("the skin did not open the simulated board's port")
            log = board_end.recv()
            skin_end.send("end")
            return log, skin_end.recv()
        except EOFError as error:
            raise RuntimeError("the simulated board or the skin ended early") from error
        finally:
            for process in processes:
                process.join(5.0)
                if process.is_alive():
                    process.terminate()
                    process.join()


def _stop_after(calls, start: float, end: float) -> float | None:
    """When the hook heard of a stop that began in this time."""
    free = True
    for t, stop, _ in calls:
        if t < start:
            free = not stop
        elif stop and free:
            return t if t < end else None
    return None


def _seen(scans) -> float | None:
    """Time of the first scan in whose samples the skin finds the threshold exceeded."""
    circuit, curve = Circuit(), PressureCurve()
    geometry = make_geometry("cylinder", *circuit.shape)
    for t, force, samples in scans:
        if force == 0.0:
            continue
        adc = np.minimum(samples / (2 ** (16 - circuit.adc_bits) * circuit.full_scale), 1.0)
        found = features.analyse_frame(compensate(adc, circuit, curve).force, geometry, _CELL)
        if sum(contact.force for contact in found.contacts) >= _THRESHOLD:
            return t
    return None


# --- the board's process -------------------------------------------------------------------------


class _Recorder(simulator.Board):
    """A board that notes when it scanned what; silent while `mute`."""

    def __init__(self, pushes, seed: int):
        self.pushes = pushes  # (start, rise, (rows, cols) force), by start
        self.scans: list[list] = [[] for _ in pushes]
        self.mute, self.silent_since = False, None
        super().__init__(Circuit(), PressureCurve(), self._feel, seed=seed)

    def _feel(self, t: float) -> np.ndarray:
        self._now, self._k, self._total = time.monotonic(), None, 0.0
        for k, (start, rise, force) in enumerate(self.pushes):
            if start <= t < start + _LENGTH:
                share = min(1.0, (t - start) / rise) if rise else 1.0
                level = 0.5 - 0.5 * np.cos(np.pi * share)
                self._k, self._total = k, level * force.sum()
                return level * force
        return np.zeros(self.circuit.shape)

    def scan(self) -> bytes:
        frame = super().scan()
        if self._k is not None and len(self.scans[self._k]) < _KEPT:
            self.scans[self._k].append((self._now, float(self._total), self._filtered))
        if self.mute and self.silent_since is None:
            self.silent_since = self._now
        return b"" if self.mute else frame


def _board(pipe, link: str, rises, cuts: int, seed: int) -> None:
    rng = np.random.default_rng(seed + 1)
    pushes = []
    for k, rise in enumerate(rises):
        start = _START + k * _PERIOD + rng.uniform(0.0, 0.05)  # at any phase of a frame
        place, newtons = rng.uniform(4.0, 11.0, 2), rng.uniform(40.0, 90.0)
        force = scenes.finger(16, 16, *place, newtons, rng.uniform(1.6, 2.0))
        pushes.append((start, rise, force))
    recorder, path = _Recorder(pushes, seed), Path(link)
    silent, closed = [], []

    played = _START + len(pushes) * _PERIOD

    def with_silences() -> bool:
        t = recorder._scans / simulator.SCANS_PER_SECOND - played
        was, recorder.mute = recorder.mute, 0.0 <= t < _BETWEEN * cuts and t % _BETWEEN < _SILENCE
        if was and not recorder.mute:
            silent.append(recorder.silent_since)
            recorder.silent_since = None
        return t < _BETWEEN * cuts

    simulator.serve(recorder, path, with_silences)
    recorder.pushes = []
    for _ in range(cuts):
        time.sleep(0.7)  # closed
        scans = int(rng.uniform(1.5, 1.55) * simulator.SCANS_PER_SECOND)

        def until_the_cut(scans=scans) -> bool:
            closed[-1] = time.monotonic()  # the port closes when this says no
            return recorder._scans < scans

        recorder.restart()
        closed.append(0.0)
        simulator.serve(recorder, path, until_the_cut)
    pipe.send({"pushes": recorder.scans, "silent": silent, "closed": closed})
    pipe.close()


# --- the skin's process --------------------------------------------------------------------------


def _skin(pipe, link: str, stop: dict) -> None:
    from tactile_skin.launch import Skin, find, read_plan

    plan = read_plan(find("skin.launch.yaml"), {"port": link, "wait_for_port": str(_PATIENCE)})
    plan.nodes = [action for action in plan.nodes if action.executable != "monitor"]
    for action in plan.nodes:
        if action.executable == "stop_on_push":
            action.give({"hold": 0.05} | stop)  # free again before the next
    calls: list[tuple[float, bool, str]] = []

    def hang(stop: bool, reason: str) -> None:
        threading.Event().wait()

    def fail(stop: bool, reason: str) -> None:
        raise RuntimeError("as it should")

    logging.getLogger("tactile_skin.hook").setLevel(logging.CRITICAL)
    with Skin(plan) as skin:
        for hook in (hang, fail):  # neither may delay the one that is measured
            skin.on_stop(hook)
        skin.on_stop(lambda stop, reason: calls.append((time.monotonic(), stop, reason)))
        while not pipe.poll(0.25):
            skin.spin(0.0)
        calls = list(calls)
    pipe.send(calls)
    pipe.close()


# --- table and picture ----------------------------------------------------------------------------


def _quantiles(times) -> str:
    """p50 / p99; every push may have been missed on a busy machine."""
    return "{:.1f} / {:.1f}".format(*np.percentile(times, (50, 99))) if len(times) else "-"


def table(data: dict) -> str:
    """p50 / p99 [ms] of each rise time and of all pushes, as Markdown."""
    rows = [(f"{e['rise_ms']:g} ms", e) for e in data["rises"]]
    rows[0] = ("less than a scan", rows[0][1])
    keys = ("seen_ms", "applied_ms")
    everything = {key: np.concatenate([e[key] for _, e in rows]) for key in keys}
    lines = [
        "| the force rises in | from the first scan that shows it above the threshold "
        "| from the first scan made while it was |",
        "|---|---|---|",
    ]
    for name, entry in [*rows, ("all pushes", everything)]:
        cells = [_quantiles(entry[k]) for k in keys]
        lines.append(f"| {name} | {cells[0]} | {cells[1]} |")
    return "\n".join(lines)


def draw(data: dict):
    from matplotlib import pyplot as plt

    figure, (seen, applied, cut) = plt.subplots(
        1, 3, figsize=(9.0, 3.6), layout="constrained", sharey=True
    )
    colours = ("#111111", "#d55e00", "#0072b2", "#009e73")
    dashes = ("-", (0, (3, 1)), (0, (5, 1, 1, 1)), (0, (1, 1)))
    for entry, colour, dash in zip(data["rises"], colours, dashes, strict=True):
        rise = entry["rise_ms"]
        label = f"rises in {rise:g} ms" if rise else "rises within a scan"
        for axis, key in ((seen, "seen_ms"), (applied, "applied_ms")):
            times = entry[key] + [None] * entry["missed"]
            _share(axis, times, color=colour, linestyle=dash, label=label)
    for axis, text in ((seen, "that shows a push"), (applied, "under a push")):
        axis.axvline(LIMIT_MS, color="black", linewidth=0.8, linestyle=(0, (2, 3)))
        axis.set_xlim(0.0, 35.0)
        axis.set_xlabel("to stop hook [ms]", fontsize=10)
        axis.set_title(f"from the first scan {text}", fontsize=9.5)
    seen.legend(fontsize=8, loc="lower right", handlelength=1.8, framealpha=1.0, edgecolor="none")
    seen.set_ylabel("share", fontsize=10)
    for (kind, text), colour in zip(
        (("closed", "the port closes"), ("silent", "no more bytes")), colours, strict=False
    ):
        _share(cut, data["cuts"][f"{kind}_ms"], color=colour, label=text)
    cut.axvline(CUT_LIMIT_MS, color="black", linewidth=0.8, linestyle=(0, (2, 3)))
    cut.set_xlim(0.0, 1.1 * CUT_LIMIT_MS)
    cut.set_xlabel("to stop hook [ms]", fontsize=10)
    cut.set_title("from a cut of the cable", fontsize=9.5)
    cut.legend(fontsize=8, frameon=False, loc="center left", handlelength=1.2)
    for axis in (seen, applied, cut):
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.set_ylim(0.0, 1.02)
    return figure


def _share(axis, values, **look) -> None:
    """Cumulative share of the times; None never came."""
    times = np.sort([v for v in values if v is not None])
    shares = np.arange(len(times) + 1) / max(1, len(values))
    axis.step([0.0, *times], shares, where="post", linewidth=1.4, **look)


DRAW = {"touch_to_stop": draw}


FULL = {"pushes": 40, "cuts": 10}
QUICK = {"pushes": 1, "cuts": 1}


def main(arguments=None) -> None:
    given = harness.picture_parser(__doc__, __spec__).parse_args(arguments)
    found = harness.draw(sys.modules[__name__], QUICK if given.quick else FULL, given)
    print(table(found["touch_to_stop"]))


if __name__ == "__main__":
    harness.run(main)
