# SPDX-License-Identifier: Apache-2.0
"""Every example runs, says what it shows, and is short enough to be copied."""

import ast
import importlib.util
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytestmark = pytest.mark.live
ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LINES = 41  # with its license
AT_ONCE = 3  # most of them wait; more would keep the skins from the processor
# name -> its arguments, the longest first
ARGUMENTS = {
    "touch_events": ["16"],  # s: the demo's push comes after 9 s, its stroke after 12.5 s
    "stop_hook": ["13"],
    "gestures": ["10"],
    "body": ["7"],
    "print_contacts": ["4"],
    "subscribe_pressure": ["2"],
    "find_circuit": [],
    "own_node": ["4"],
    "own_driver": [],
    "record_frames": ["FRAMES", "3"],
    "replay_frames": ["FRAMES"],
    "compensate_frame": [],
    "doubt_a_frame": [],
    "read_config": [],
    "mujoco_push": [],
    "mujoco_record": ["DATASET"],
}
# name -> what it needs that not every installation has: .ci/learning
NEEDS = {"mujoco_push": "mujoco", "mujoco_record": "lerobot"}
# name -> what it prints
SAYS = {
    "compensate_frame": ["naive  sum", "auto   sum 20.0", " 0 ghosts, ok"],
    "doubt_a_frame": ["sound: ok", "broken: suspect row 9"],
    "mujoco_push": ["push: 15 N, limit 15 N", "truth 1"],
    "mujoco_record": ["102 frames, 2 episodes"],
    "own_driver": ["WrenchStamped", "x=-5.9"],
    "own_node": [" levels, the largest 1.00"],
    "gestures": ["stroke ("],
    "body": ["stop: back: push", "touch 1 on the back: 6"],
    "find_circuit": ["r_par = 3", "r_line = ", "nine of ten within "],
    "print_contacts": ["contact 1: ", "contact 2: ", " N at +0."],
    "read_config": ["16 x 16 cells, 18 mm apart", "hardest cell: row 8, column 8"],
    "record_frames": [" frames"],
    "replay_frames": [", 0 in doubt, sum of force 2", "p99"],
    "stop_hook": ["motors run", "motors stand: push", "the skin shuts down"],
    "subscribe_pressure": ["largest pressure of each cell"],
    "touch_events": ["pushed with ", "released after ", "stroked at "],
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Name -> (stdout, stderr, status) of each example."""
    folder = tmp_path_factory.mktemp("examples")
    made = {"FRAMES": str(folder / "frames.npy"), "DATASET": str(folder / "dataset")}
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}

    def run(name: str) -> tuple[str, str, int]:
        if name in NEEDS and not importlib.util.find_spec(NEEDS[name]):
            return "", "", 0
        words = [made.get(word, word) for word in ARGUMENTS[name]]
        command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), *words]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=120, check=False
        )
        return done.stdout, done.stderr, done.returncode

    last = "replay_frames"  # of what record_frames has recorded
    with ThreadPoolExecutor(AT_ONCE) as pool:
        running = {name: pool.submit(run, name) for name in ARGUMENTS if name != last}
    return {name: done.result() for name, done in running.items()} | {last: run(last)}


def test_every_example_is_run():
    assert {path.stem for path in EXAMPLES} == set(SAYS)


@pytest.mark.ci
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_runs(finished, path):
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem], reason="not installed: .ci/learning")
    out, err, status = finished[path.stem]
    assert status == 0, err
    assert "Traceback" not in err
    for text in SAYS[path.stem]:
        assert text in out, f"{out}\n{err}"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_short_and_says_what_it_shows(path):
    text = path.read_text()
    assert len(text.splitlines()) < LINES
    about = ast.get_docstring(ast.parse(text))
    assert about and f"python examples/{path.name}" in about
