# SPDX-License-Identifier: Apache-2.0
"""Recorded readings through the nodes again: the same every time, and other methods beside."""

import numpy as np
import pytest
import yaml

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.msg import DiagnosticArray, DiagnosticStatus, Header, Image, Time, image
from tactile_skin.recording import Recording, cdr, configuration
from tactile_skin.recording.writer import Writer
from tactile_skin.replay.replay import Replay
from tactile_skin.replay.results import Job, collect, compare, table
from tactile_skin.simulation.matrix import resting_curve

pytest.importorskip("mcap")
CIRCUIT = Circuit(6, 7)
START = 1_700_000_000_000_000_000  # ns since 1970
RATE = 100
CELLS = {"circuit.rows": 6, "circuit.cols": 7}
NODES = "compensation", "gesture_feature", "serial_driver"


def write(path, seconds=6.0, parameters=None, gap=None):
    """A skin at rest for 3 s, then a push of 40 N every other second; noise of 1 step."""
    rng, curve = np.random.default_rng(4), resting_curve(PressureCurve(), CIRCUIT.shape, seed=4)
    attached = {f"/{name}": CELLS | (parameters or {}).get(name, {}) for name in NODES}
    writer = Writer(path, configuration.attachments(attached), START)
    shape = np.zeros(CIRCUIT.shape)
    shape[2:4, 3:5] = 10.0
    for k in range(round(seconds * RATE)):
        t = k / RATE
        if gap and gap[0] <= t < gap[1]:
            continue
        force = shape if t >= 3.0 and int(t) % 2 else 0.0 * shape
        steps = forward(CIRCUIT, curve.resistance(force)) * 1023 + rng.standard_normal((6, 7))
        samples = np.clip(np.rint(64 * steps), 0, 65534).astype(np.uint16)
        stamp = START + round(t * 1e9)
        header = Header(Time(*divmod(stamp, 10**9)), "base_link")
        writer.write("/skin/adc", Image, stamp, cdr.encode(image(samples, "16UC1", header)))
    writer.close()
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write(tmp_path_factory.mktemp("recorded") / "a.mcap")


@pytest.fixture(scope="module")
def steps(path):
    """As it was recorded."""
    return list(Replay(Recording(path)))


def forces(steps) -> np.ndarray:
    return np.array([step.force for step in steps])


def test_each_reading_gives_a_step(path, steps):
    assert [s.stamp for s in steps] == Recording(path).stamps.tolist()
    touched = np.array([s.peak > 5.0 for s in steps])
    assert touched[320:400].all() and not touched[:290].any()
    assert all(s.total == pytest.approx(40.0, rel=0.1) for s in steps[320:400])
    assert all(s.stop.startswith("push: ") for s in steps[320:400])
    assert steps[280].stop == ""
    assert {s.status for s in steps} == {"ok"}


def test_each_node_is_made_once(path, caplog):
    """And so what it warns of is read once."""
    Replay(Recording(path))
    assert caplog.text.count("geometry.shape is unknown") == 1


def test_a_replay_is_the_same_to_the_bit(path, steps):
    np.testing.assert_array_equal(forces(Replay(Recording(path))), forces(steps))


def test_another_method(path, steps):
    naive = Replay(Recording(path), method="naive")
    assert np.abs(forces(naive) - forces(steps)).max() > 0.1
    with pytest.raises(ValueError, match=r"method of node .* = .magic.: must be one of"):
        Replay(Recording(path), method="magic")


def test_another_configuration(path, steps, tmp_path):
    config = tmp_path / "other.yaml"
    circuit = {"rows": 6, "cols": 7, "r_par": 300.0}
    sections = {"/**": {"circuit": circuit}, "stop_on_push": {"threshold": 60.0, "peak": 9.0}}
    text = {name: {"ros__parameters": values} for name, values in sections.items()}
    config.write_text(yaml.safe_dump(text))
    assert not np.array_equal(forces(Replay(Recording(path), config=config)), forces(steps))
    circuit["rows"] = 5
    config.write_text(yaml.safe_dump(text))
    replay = Replay(Recording(path), config=config)
    with pytest.raises(ValueError, match="readings of 6 x 7, but the circuit is 5 x 7"):
        list(replay)


def test_a_misspelt_parameter_of_a_configuration_is_refused(path, tmp_path):
    config = tmp_path / "other.yaml"
    config.write_text("compensation: {ros__parameters: {methud: map}}\n")
    with pytest.raises(ValueError, match="methud"):
        Replay(Recording(path), config=config)


def test_parameters_of_a_later_version_are_left_out_with_a_word(tmp_path):
    path = write(tmp_path / "a.mcap", 1.0, {"compensation": {"later": 3}})
    replay = Replay(Recording(path))
    assert replay.notes == ["compensation: recorded parameters unknown here: ['later']"]
    assert len(list(replay)) == 100


def test_a_file_that_a_parameter_names_travels_with_the_recording(tmp_path):
    """Here the table of a cover's cells, which is gone when it is replayed."""
    table = tmp_path / "cells.csv"
    rows = [f"{r},{c},{0.02 * c},{0.02 * r},0,0,0,1" for r in range(6) for c in range(7)]
    table.write_text("\n".join(["row,col,x,y,z,nx,ny,nz", *rows]))
    cover = {"geometry.shape": "table", "geometry.table": str(table)}
    given = {name: cover for name in NODES}
    path = write(tmp_path / "a.mcap", 1.0, given)
    table.unlink()
    assert len(list(Replay(Recording(path)))) == 100


def test_a_gap_stops_the_robot_as_it_did(tmp_path):
    path = write(tmp_path / "a.mcap", 3.0, gap=(2.0, 2.6))
    steps = list(Replay(Recording(path)))
    after = next(s for s in steps if s.stamp >= START + 2.6e9)
    assert "stale" in after.stop


def test_faults_of_the_board_are_replayed(tmp_path):
    """What the driver said; the other nodes say it anew."""
    path = write(tmp_path / "a.mcap", 2.0)
    writer = Writer(tmp_path / "b.mcap", Recording(path).attachments, START)
    for _, t, message in Recording(path).messages():
        writer.write("/skin/adc", Image, t, cdr.encode(message))
        if t == START + 1_500_000_000:
            status = DiagnosticStatus(2, "serial_driver", "unplugged", "tactile_skin")
            other = DiagnosticStatus(2, "compensation", "not this one", "tactile_skin")
            said = DiagnosticArray(message.header, [other, status])
            writer.write("/skin/diagnostics", DiagnosticArray, t, cdr.encode(said))
    writer.close()
    steps = list(Replay(Recording(tmp_path / "b.mcap")))
    assert steps[140].stop == ""
    assert steps[160].stop == "fault: serial_driver: unplugged"


@pytest.mark.ci
def test_a_replay_is_recorded(path, tmp_path):
    replay = Replay(Recording(path), method="map")
    replay.record(tmp_path / "b.mcap")
    pressure = np.array([s.force for s in replay]) / replay.cell_area
    found = Recording(tmp_path / "b.mcap")
    np.testing.assert_allclose(found.images("/skin/pressure")[1], pressure, rtol=1e-6)
    assert found.parameters["/compensation"]["method"] == "map"
    np.testing.assert_array_equal(found.adc, Recording(path).adc)
    assert found.topics["/skin/contacts"].count == len(pressure)


@pytest.mark.ci
def test_methods_side_by_side(path, tmp_path):
    job = Job(str(write(tmp_path / "a.mcap", 3.5)))
    found = compare(job, ["map", "naive", "map"])
    assert found.cell.shape == (3, 350)
    assert found.cell[0].max() == found.cell[2].max() == 0.0 < found.cell[1].max()
    about, lines = table(found).split("\n\n")
    assert "350 readings of 3.5 s" in about and "from map" in about
    assert [line.split()[0] for line in lines.splitlines()] == ["method", "map", "naive", "map"]
    with pytest.raises(ValueError, match="give two or more"):
        compare(Job(str(path)), ["map"])


def test_a_recording_without_readings_is_refused(tmp_path):
    path = write(tmp_path / "a.mcap", 0.0)
    with pytest.raises(ValueError, match="holds no message"):
        collect(Job(str(path)))
