# SPDX-License-Identifier: Apache-2.0
"""Real `lerobot-record`, and what LeRobot reads back of it."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tactile_skin.launch import read_skin
from tactile_skin.simulation import simulator

HERE = Path(__file__).parent
AREA = read_skin()[2].cell_area  # m^2
RATE = 30
# s by which a frame is behind its touch: the board's low-pass, and 529 bytes at its baud rate
BEHIND = 0.0043 + 529 * 10 / simulator.BAUD


def recorded(touched, root, video):
    """Record two episodes of four seconds; the dataset, and when `touch.time` begins [s]."""
    link, _, config, _ = touched
    camera = f"{{touch: {{type: tactile_skin, port: {link}, config: {config}}}}}"
    begun = time.perf_counter()
    command = [sys.executable, "-c", "import mock_robot; mock_robot.main()"]
    command += ["--robot.type=mock_touched"]
    command += [f"--robot.cameras={camera}", "--teleop.type=mock_still", "--play_sounds=false"]
    command += ["--dataset.repo_id=us/touch", f"--dataset.root={root}", "--dataset.no_stamp=true"]
    command += ["--dataset.single_task=push", f"--dataset.fps={RATE}", "--dataset.num_episodes=2"]
    command += ["--dataset.episode_time_s=4", "--dataset.reset_time_s=0.5"]
    command += ["--dataset.push_to_hub=false", f"--dataset.video={str(video).lower()}"]
    env = os.environ | {"BEGUN": repr(begun), "HF_HUB_OFFLINE": "1"}
    env["PYTHONPATH"] = os.pathsep.join([str(HERE), *sys.path])
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr[-4000:]
    from lerobot.datasets import LeRobotDataset

    return LeRobotDataset("us/touch", root=root), begun


def read_back(dataset, shape=(16, 16)):
    """(n,) times and forces of the state, total force of depth and of colour [N]."""
    from lerobot_camera_tactile_skin import Depth, Rgb

    state, depth, colour = [], [], []
    for k in range(len(dataset)):
        item = dataset[k]
        state.append(item["observation.state"].numpy())
        depth.append(Depth().pressure(item["observation.images.touch_depth"].numpy(), shape))
        colour.append(Rgb().pressure(item["observation.images.touch"].numpy(), shape))
    totals = [(np.array(p) * AREA).sum((1, 2)) for p in (depth, colour)]
    return *np.array(state).T, *totals


@pytest.mark.live
@pytest.mark.flaky(reruns=2)  # delays are the machine's as well
@pytest.mark.parametrize("video", [True, False], ids=["video", "png"])
def test_recorded_and_read_back(touched, tmp_path, video, capsys):
    """Two episodes: forces within 2 %, times within 5 ms, nothing twice as new."""
    dataset, begun = recorded(touched, tmp_path / "set", video)
    assert dataset.num_episodes == 2 and len(dataset) > 4 * RATE  # a busy machine skips some
    times, force, depth, colour = read_back(dataset)
    scene = touched[1]
    lags = np.arange(-0.03, 0.03, 0.001)  # s; the scene's force moves by 18 N/s
    loaded = scene.at(times + begun) > 5.0
    errors = [np.square(force - scene.at(times + begun - lag))[loaded].mean() for lag in lags]
    lag = lags[np.argmin(errors)]
    truth = scene.at(times + begun - lag)
    shares = {}
    for name, found in (("live", force), ("depth", depth), ("colour", colour)):
        off = np.abs(found - truth)[loaded] / truth[loaded]
        shares[name] = np.median(off), np.percentile(off, 95)
    with capsys.disabled():
        print(f"\nvideo={video}: lag {1e3 * lag:.0f} ms, of {len(times)} frames")
        for name, (median, most) in shares.items():
            print(f"  {name}: median {100 * median:.2f} %, p95 {100 * most:.2f} %")
    assert (np.diff(times) > 0.0).all()  # none twice
    assert abs(lag - BEHIND) <= 0.005
    assert shares["live"][0] < 0.02 and shares["depth"][0] < 0.02
