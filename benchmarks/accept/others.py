# SPDX-License-Identifier: Apache-2.0
"""Other benchmarks and recordings of others, as numbers and lists that lines add up."""

from __future__ import annotations

import contextlib
import io
import tempfile
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import yaml
from support.chain import Chain

from tactile_skin import Circuit, PressureCurve, compensate, measure_rest
from tactile_skin.bench import speed
from tactile_skin.commands import doctor

from ..accuracy.boards import recordings as feet_of
from ..boards import insole_nodes
from ..boards.text_board import Tally
from ..doctor.in_use import CUSHION
from ..running import touch_to_stop

TIMED = "auto", "map"
NEEDS = 20  # frames that the doctor asks for
INSOLE = 8.0  # frames a second
PACE = 10.0  # the same of the cushion
_LITTLE = "too little"  # is seen: no false finding
NOISE = 3.0  # ADC steps of the cushion's, by its README
BELIEVED = 0.5  # share of a recording's frames that are ok


def _script(module: str, *words) -> dict:
    return import_module(f"benchmarks.{module}").main([str(word) for word in words])


def frame(seed: int, n: int) -> dict:
    """Times of a frame of bodies, by the solvers that run."""
    circuit, curve = Circuit(), PressureCurve()
    found = speed.timed(TIMED, "bodies", "scan", n, (seed, 0), circuit, curve)
    return {f"{method} {k}": v for method, _, errors in found for k, v in errors.items()}


def stop(pushes: int, cuts: int, seed: int) -> dict:
    """Times to the stop hook [ms] of so many pushes of each rise, of so many cuts of each kind."""
    found = touch_to_stop.measure(pushes, cuts, seed)["touch_to_stop"]
    times = [t for rise in found["rises"] for t in rise["seen_ms"]]
    missed = sum(rise["missed"] for rise in found["rises"])
    cut = [np.inf if t is None else t for kind in found["cuts"].values() for t in kind]
    return {"ms": times, "cut": cut, "missed": missed, "pushes": missed + len(times)}


def planted(*words) -> dict:
    found = _script("doctor.faults", *words, "--sound", 0)
    hits = [hit for kind in found["named"].values() for hit in kind]
    false = {"false": len(found["false alarms"]), "boards": words[1]}
    return {"named": sum(hits), "planted": len(hits)} | false


def in_use(*words) -> dict:
    return _script("doctor.in_use", *words)


def identify(*words) -> dict:
    off = np.abs(_script("calibration.identify", *words)["off"])
    beyond = int((off[:, 0] > 0.01 * Circuit().r_par).sum())
    return {"r_par": off[:, 0], "r_line": off[:, 1], "beyond": beyond, "boards": len(off)}


def curve(*words) -> dict:
    found = _script("calibration.curve_fit", *words, "--touches", 20)["fitted"]
    return {"off": 100.0 * np.abs(found).ravel()}


def obey(*words) -> dict:
    found = _script("doctor.obey", *words)
    ends = [end for kind in found["ends"].values() for end in kind.elements()]
    boards = sum(end != "not a board" for end in ends)
    counts = {"right": ends.count("right"), "boards": boards, "free": len(found["free"])}
    return counts | {"on the way": found["free on the way"]}


# --- recordings of others -------------------------------------------------------------------------


def recordings(data: Path, share: float) -> list:
    """Tasks of what lies in a folder; none of what does not."""
    feet = data / "insole_floating"
    n = 2 * len(list(feet.glob("*.npz")))
    tasks: list = [(insole, (feet, k)) for k in range(min(n, max(1, round(n * share))))]
    if list((cushions := data / "cushion_loaded").glob("*.csv")):
        tasks.append((cushion, (cushions,)))
    if (garments := data / "garment_textile" / "frames.npz").exists():
        tasks.append((garment, (garments,)))
    return tasks


def _seconds(name: str, tally: Tally) -> dict:
    """Seconds that were looked at, and those in which a fault stopped; waiting is none."""
    fault = sum(s for reason, s in tally.faults.items() if "fault" in reason)
    return {f"{name} s": tally.seconds, f"{name} fault": fault}


def _doctor(frames: np.ndarray, given: dict) -> list[str]:
    """Return the findings of `tactile-skin doctor` on frames [ADC steps].

    Args:
        given: parameters of compensation.
    """
    shared = {k: v for k, v in given.items() if k.startswith(("circuit.", "curve."))}
    own = {k: v for k, v in given.items() if k not in shared}
    nodes = {"/**": {"ros__parameters": shared}} | (
        {"/**/compensation": {"ros__parameters": own}} if own else {}
    )
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as said:
        file, config = Path(folder) / "frames.npy", Path(folder) / "mine.yaml"
        np.save(file, frames)
        config.write_text(yaml.safe_dump(nodes))
        try:
            doctor.run(SimpleNamespace(words=[str(file), f"config:={config}"]))
        except ValueError as error:  # it refuses the recording
            return [f"- {error}"]
    return [line for line in said.getvalue().splitlines() if line.startswith("- ")]


def insole(folder: Path, foot: int) -> dict:
    _, counts = list(feet_of(folder, 0))[foot]
    given = insole_nodes.parameters(counts)["compensation"]
    false = [line for line in _doctor(np.maximum(counts, 0), given) if _LITTLE not in line]
    tally = insole_nodes.driven(counts, INSOLE)
    return _seconds("insole", tally) | {"false findings": len(false)}


def cushion(folder: Path) -> dict:
    """Recordings of somebody who sits, one after the other, and what is said of another readout."""
    files = [np.loadtxt(p, delimiter=",").reshape(-1, 9, 9) for p in sorted(folder.glob("*.csv"))]
    files, right = [frames.transpose(0, 2, 1) for frames in files], CUSHION
    nodes = {name: {"circuit.inverted": True} for name in ("serial_driver", "compensation")}
    chain, tally = Chain(right, "text", nodes), Tally()
    for k, counts in enumerate(np.concatenate(files)):
        chain.feed((k + 0.1) / PACE, insole_nodes.line(counts.astype(int)))
        if k / PACE >= insole_nodes.START:
            tally.add(1.0 / PACE, chain.stop, chain.reason)
    chain.close()
    floating = Circuit(9, 9, r_ref=right.r_ref, r_par=right.r_par)
    of_floating = {f"circuit.{k}": v for k, v in floating.describe().items() if k != "mask"}
    said = _doctor(np.concatenate(files), of_floating | {"circuit.inverted": True})
    return _seconds("cushion", tally) | {
        "cushions": len(files),
        "cushions ok": sum(_believed(frames, right) for frames in files),
        "cushions as floating": sum(_believed(frames, floating) for frames in files),
        "readout named": any("readout" in line for line in said),
        "readouts": 1,
    }


def _believed(steps: np.ndarray, circuit: Circuit) -> bool:
    """Whether a circuit that rests as the calmest frames do explains most frames of a recording."""
    adc = 1.0 - steps / circuit.full_scale
    with contextlib.suppress(ValueError):  # "frame 1, row 3 ...": it never rests
        rest = measure_rest(adc, circuit)
        curve = PressureCurve().resting_at(1.0 / rest.conductance)
        found = [compensate(frame, circuit, curve, noise=NOISE).status == "ok" for frame in adc]
        return bool(np.mean(found) > BELIEVED)
    return False


def garment(path: Path) -> dict:
    """Whether the doctor names two parts of a garment, whose frames somebody processed."""
    with np.load(path) as found:
        parts = [np.array([found[k] for k in found if k.endswith(p)]) for p in ("cloths", "pants")]
    named = 0
    for frames in parts:
        circuit = Circuit(*frames.shape[1:])
        given = {f"circuit.{k}": v for k, v in circuit.describe().items() if k != "mask"}
        many = np.tile(frames, (-(-NEEDS // len(frames)), 1, 1))
        named += any("not ADC readings" in line for line in _doctor(many, given))
    return {"named processed": named, "garments": len(parts)}
