# SPDX-License-Identifier: Apache-2.0
"""Recordings as a LeRobotDataset: what was known at each tick, faults marked, nothing between."""

import json
import time

import numpy as np
import pytest

from tactile_skin.cli import main
from tactile_skin.msg import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Point,
    PointStamped,
    Time,
    Vector3,
    Wrench,
    WrenchStamped,
    cloud,
    image,
)
from tactile_skin.recording import cdr, configuration, lerobot
from tactile_skin.recording.writer import Writer

parquet = pytest.importorskip("pyarrow.parquet", reason="not installed: .ci/learning")

START = 1_790_000_000 * 10**9  # ns since 1970
AREA = 1.44e-4  # m^2 of a cell, the default
SHAPE = 16, 16
HERE = "/skin"


def record(path, seconds, rate=100.0, gap=(np.inf, np.inf), fault=(np.inf, np.inf)):
    """A recording whose force is 10 N + 1 N a second; in `gap` no frame came, in `fault` one did.

    Returns (n,) times of its frames [s].
    """
    writer = Writer(path, configuration.attachments({}), START)
    times = np.arange(0.0, seconds, 1.0 / rate)
    for t in times:
        stamp = START + round(t * 1e9)
        header = Header(Time(*divmod(stamp, 10**9)), "base_link")

        def put(name, message, late=2_000_000, stamp=stamp):
            topic = f"{HERE}/{name}"
            writer.write(topic, type(message), stamp + late, cdr.encode(message))

        broken = fault[0] <= t < fault[1]
        why = "fault: skin: row 3 is open" if broken else ""
        status = DiagnosticStatus(2 if broken else 0, "stop_on_push", why)
        put("stop_status", DiagnosticArray(header, [status]))
        put("adc", image(np.zeros(SHAPE), "16UC1", header))
        if gap[0] <= t < gap[1] or broken:
            continue
        force = np.zeros(SHAPE)
        force[4:6, 7:9] = (10.0 + t) / 4.0
        put("pressure", image(force / AREA, "32FC1", header))
        put("pressure_std", image(np.full(SHAPE, 5.0), "32FC1", header))
        names = ("x", "y", "z", "force", "id", "bound")
        columns = {name: np.array([float(k)]) for k, name in enumerate(names)}
        put("contacts", cloud(columns | {"force": np.array([10.0 + t])}, header), 2_500_000)
        put(
            "wrench",
            WrenchStamped(header, Wrench(Vector3(0.0, 0.0, -10.0 - t), Vector3())),
            2_600_000,
        )
        put("centre", PointStamped(header, Point(0.1, 0.2, 0.3)), 2_700_000)
    writer.close()
    return times


def rows(folder, number=0):
    table = parquet.read_table(folder / f"data/chunk-000/file-{number:03d}.parquet")
    return {name: table.column(name).to_pylist() for name in table.column_names}


def test_each_tick_has_what_was_known_then(tmp_path):
    record(tmp_path / "a.mcap", 3.0)
    assert lerobot.export([str(tmp_path / "a.mcap")], tmp_path / "set") == 90
    got = rows(tmp_path / "set")
    total = np.array(got[lerobot.PICTURE]).sum((1, 2)) * AREA
    age = np.array(got[lerobot.STATE])[:, lerobot.NAMES.index("age")]
    told = np.arange(90) / 30.0
    assert total[1:] == pytest.approx(10.0 + told[1:] + 0.002 - age[1:], abs=1e-3)
    assert (age[1:] < 0.015).all()
    state = dict(zip(lerobot.NAMES, got[lerobot.STATE][50], strict=True))
    assert state["force_z"] == pytest.approx(-total[50], rel=1e-5)
    assert (state["centre_x"], state["contact0_y"], state["contact1_force"]) == pytest.approx(
        (0.1, 1.0, 0.0)
    )
    assert (state["bound"], state["status"]) == (5.0, 0.0)
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    assert np.array(stats[lerobot.PICTURE]["max"]).max() == pytest.approx(
        np.nanmax(total) / 4 / AREA, rel=1e-3
    )


def test_a_fault_and_a_gap_are_marked_and_nothing_is_put_between(tmp_path):
    record(tmp_path / "a.mcap", 6.0, gap=(1.0, 3.0), fault=(4.0, 5.5))
    lerobot.export([str(tmp_path / "a.mcap")], tmp_path / "set")
    got = rows(tmp_path / "set")
    times, status = np.array(got["timestamp"]), np.array(got[lerobot.STATE])[:, -1]
    picture = np.isfinite(np.array(got[lerobot.PICTURE], float)).all((1, 2))
    old = lerobot.OLD + 0.05
    inside = ((times > 1.0 + old) & (times < 3.0)) | ((times > 4.0 + old) & (times < 5.5))
    assert not picture[inside].any() and (status[inside] == 2.0).all()
    during = (times > 4.05) & (times < 5.45)
    assert (status[during] > 0.0).all()
    assert {got[lerobot.CAUSE][k] for k in np.flatnonzero(during)} == {"fault: skin: row 3 is open"}
    assert all(got[lerobot.STOP][k] for k in np.flatnonzero(inside))
    sound = (times > 3.1) & (times < 3.95)
    assert picture[sound].all() and (status[sound] == 0.0).all()


def test_the_command_takes_several_and_names_what_is_wrong(
    joblib_keeps_no_process, tmp_path, capsys
):
    paths = [tmp_path / f"{k}.mcap" for k in range(2)]
    for path in paths:
        record(path, 2.0)
    words = [
        "replay",
        *map(str, paths),
        "--export",
        "lerobot",
        str(tmp_path / "set"),
        "--jobs",
        "2",
    ]
    assert main([*words, "rate:=10"]) == 0
    assert "40 rows, 2 episodes, 10 rows a second" in capsys.readouterr().out
    assert rows(tmp_path / "set", 1)["index"][0] == 20
    assert main(words) == 2 and "is there already" in capsys.readouterr().err
    assert main(["replay", str(paths[0]), "--export", "lerobot"]) == 2
    assert "give a DIR" in capsys.readouterr().err


def test_readings_alone_are_replayed_first(tmp_path):
    """As a foreign board's file, or `ros2 bag record` of skin/adc alone."""
    frames = tmp_path / "frames.npy"
    np.save(frames, np.full((400, *SHAPE), 45.0) + np.arange(400)[:, None, None] % 2)
    assert main(["replay", str(frames), "--export", "lerobot", str(tmp_path / "set")]) == 0
    assert len(rows(tmp_path / "set")["index"]) == pytest.approx(120, abs=2)


def test_lerobot_reads_it_back(tmp_path):
    """Forces as floats, circuit and curve next to them."""
    pytest.importorskip("lerobot", reason="not installed: .ci/learning")
    from lerobot.datasets import LeRobotDataset

    times = record(tmp_path / "a.mcap", 3.0, fault=(2.0, 3.0))
    lerobot.export([str(tmp_path / "a.mcap")] * 2, tmp_path / "set")
    dataset = LeRobotDataset("me/touch", root=tmp_path / "set")
    assert (dataset.num_episodes, len(dataset)) == (2, 180) and times.size == 300
    item = dataset[90 + 45]
    total = float(item[lerobot.PICTURE].sum()) * AREA
    assert total == pytest.approx(11.5, abs=0.02) and float(item["timestamp"]) == 1.5
    assert item[lerobot.CAUSE] == "" and "row 3 is open" in dataset[85][lerobot.CAUSE]
    info = dataset.meta.features[lerobot.PICTURE]["info"]
    assert info["circuit"]["r_par"] == 326.0 and len(info["curve"]["force"]) == 9


@pytest.mark.slow
def test_an_hour_is_exported_faster_than_real_time(tmp_path, capsys):
    """20 times, in memory that does not grow with it."""
    import resource

    record(tmp_path / "a.mcap", 600.0)
    most, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    lerobot.export([str(tmp_path / "a.mcap")] * 6, tmp_path / "set")
    took = time.process_time() - begun
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - most) / 1024
    with capsys.disabled():
        print(
            f"\nan hour in {took:.0f} s of the processor: {3600 / took:.0f} times; {grown:.0f} MB"
        )
    assert took < 180.0 and grown < 200.0
