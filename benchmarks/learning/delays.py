# SPDX-License-Identifier: Apache-2.0
"""From a push to the stop hook: a skin alone, and the plugin while LeRobot records with it.

Needs lerobot and the plugin (.ci/learning). Rounds alternate; a push is 60 N from one scan of the
simulated board to the next.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from tactile_skin import Circuit, PressureCurve
from tactile_skin.simulation import simulator
from tactile_skin.simulation.scenes import finger

from .. import harness

HERE = Path(__file__).parent
PATIENCE = 150.0  # s for what must come
PLUGIN = "lerobot_camera_tactile_skin"
RECORDS = """
import sys, tempfile, time
from lerobot.datasets import LeRobotDataset
from lerobot.utils.feature_utils import hw_to_dataset_features
from lerobot_camera_tactile_skin import TactileSkinCamera, TactileSkinCameraConfig
port, config, hook = sys.argv[1:]
given = TactileSkinCameraConfig(port=port, config=config, stop_hook=hook, on_fault="mark",
                                warmup_s=120.0)
camera = TactileSkinCamera(given)
size = camera.height, camera.width
features = hw_to_dataset_features({"touch": (*size, 3), "touch_depth": (*size, 1)}, "observation")
dataset = LeRobotDataset.create("me/x", 30, features, root=tempfile.mkdtemp() + "/x",
                                image_writer_threads=8)
camera.connect()
while True:
    begun = time.perf_counter()
    seen = {"touch": camera.read_latest(5000), "touch_depth": camera.read_latest_depth(5000)}
    dataset.add_frame({f"observation.images.{k}": v for k, v in seen.items()} | {"task": "x"})
    time.sleep(max(0.0, 1 / 30 + begun - time.perf_counter()))
"""


def hook(stop: bool, reason: str) -> None:
    """Note when the robot was to stop; a line is whole."""
    with open(os.environ["STOPS"], "a") as file:
        file.write(f"{time.perf_counter()} {int(stop)} {reason}\n")


def delays(
    program: list[str], board: simulator.Board, given: list[str], pushes: int
) -> list[float]:
    """Delays [s] of some pushes on a skin that a program reads."""
    stops, begun = Path(os.environ["STOPS"]), 0.0
    stops.write_text("")
    palm = finger(*board.circuit.shape, 8.0, 8.0, 60.0, 2.0)
    child = subprocess.Popen([sys.executable, *program, *given], stdout=subprocess.DEVNULL)

    def pushing(t):
        nonlocal begun
        begun = begun or time.perf_counter()
        return palm

    def said(stop: int) -> float:
        end = time.perf_counter() + PATIENCE
        while time.perf_counter() < end and child.poll() is None:
            lines = [line.split() for line in stops.read_text().splitlines()]
            if lines and int(lines[-1][1]) == stop:  # on a busy machine it may be stopped already
                return float(lines[-1][0]) if float(lines[-1][0]) > begun else np.nan
            time.sleep(0.005)
        raise TimeoutError(f"the hook did not say {stop}: {stops.read_text()}")

    found = []
    try:
        for _ in range(pushes):
            board.scene = lambda t: 0.0 * palm
            said(0)
            time.sleep(random.uniform(0.4, 0.9))
            begun, board.scene = 0.0, pushing
            while not begun:
                time.sleep(0.001)
            found += [late] if np.isfinite(late := said(1) - begun) else []
    finally:
        board.scene = lambda t: 0.0 * palm
        child.terminate()
        child.wait()
    return found


def main(arguments=None):
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--pushes", type=int, default=6, help="of each, a round")
    args = parser.parse_args(arguments)
    import threading

    folder = Path(tempfile.mkdtemp())
    os.environ["STOPS"] = str(folder / "stops")
    given = {"/**": {"ros__parameters": {"geometry": {"shape": "plane"}}}}
    (folder / "mine.yaml").write_text(yaml.safe_dump(given))
    board, done = simulator.Board(Circuit(), PressureCurve(), lambda t: np.zeros((16, 16))), []
    work = threading.Thread(
        target=simulator.serve, args=(board, folder / "board", lambda: not done)
    )
    work.start()
    words = [str(folder / "board"), str(folder / "mine.yaml"), f"{__spec__.name}:hook"]
    (place,) = importlib.util.find_spec(PLUGIN).submodule_search_locations
    programs = {"alone": ["-P", f"{place}/reader.py"], "recording": ["-c", RECORDS]}
    found: dict[str, list[float]] = {"alone": [], "recording": []}
    try:
        time.sleep(0.5)
        for _ in range(args.rounds):
            for name, program in programs.items():
                with contextlib.suppress(BrokenPipeError):
                    found[name] += delays(program, board, words, args.pushes)
    finally:
        done.append(True)
        work.join()
    figures = {}
    for name, of in found.items():
        p50, p99 = np.percentile(of, (50, 99)) * 1e3
        figures[name] = {"n": len(of), "p50_ms": p50, "p99_ms": p99}
        print(f"{name}: {len(of)} pushes, p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    return figures


if __name__ == "__main__":
    harness.run(main)
