# SPDX-License-Identifier: Apache-2.0
"""Readings that the skin was late for: a replay takes each as the robot took it."""

import numpy as np
import pytest
from support.bench import Bench

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.msg import Header, Image, Time, TimeReference, image
from tactile_skin.nodes.compensation import Compensation
from tactile_skin.recording import Recording, cdr, configuration
from tactile_skin.recording.writer import Writer
from tactile_skin.replay.replay import Replay
from tactile_skin.simulation import scenes

pytest.importorskip("mcap")
CIRCUIT = Circuit(8, 8)
START = 1_700_000_000_000_000_000  # ns since 1970
FRAME = 10_000_000  # ns
SECONDS = 6.0
LOST = 97  # each so many readings one is lost before compensation has it
TOPICS = {"/skin/adc": Image, "/skin/taken": TimeReference, "/skin/pressure": Image}
CELLS = {"circuit.rows": 8, "circuit.cols": 8}
VALUES = {"/compensation": CELLS | {"method": "auto"}, "/gesture_feature": CELLS}


def write(path, without=()):
    """What a skin published whose machine kept readings waiting for 0 to 70 ms.

    It rests for 2.5 s; then a palm and a finger press in turns.

    Returns:
        The compensation node.
    """
    rng, curve = np.random.default_rng(4), PressureCurve()
    rest = np.exp(0.03 * rng.standard_normal(CIRCUIT.shape))
    palm, finger = (
        scenes.finger(8, 8, 4.0, 3.5, 80.0, 3.0),
        scenes.finger(8, 8, 3.3, 4.1, 20.0, 1.2),
    )
    bench = Bench(START * 1e-9)
    compensation = Compensation(bench.node("compensation", VALUES["/compensation"]))
    observer = bench.node("observer")
    adc = observer.create_publisher(Image, "/skin/adc", 10)
    said = []
    for topic, kind in TOPICS.items():
        if topic != "/skin/adc":
            observer.create_listener(
                kind, topic, lambda m, topic=topic: said.append((now(), topic, m))
            )

    def now():
        return bench.clock.now().nanoseconds

    for k in range(round(SECONDS * 1e9) // FRAME):
        stamp = START + k * FRAME
        touch = int(k * FRAME / 5e8) if k * FRAME >= 2.5e9 else 0
        force = (0.0, palm, 0.0, finger)[touch % 4] * np.ones(CIRCUIT.shape)
        steps = forward(CIRCUIT, curve.resistance(force) * rest) * 1023
        samples = np.rint(64 * (steps + rng.standard_normal(CIRCUIT.shape))).clip(0, 65534)
        message = image(samples, "16UC1", Header(Time(*divmod(stamp, 10**9)), "base_link"))
        said.append((stamp, "/skin/adc", message))
        if k % LOST == LOST - 1:
            continue
        wait = rng.choice([0, 2_000_000, 15_000_000, 70_000_000], p=[0.5, 0.2, 0.2, 0.1])
        bench.clock.advance(max(0, stamp + int(wait) - now()) / 1e9)
        adc.publish(message)
        bench.executor.spin_some()
    writer = Writer(path, configuration.attachments(VALUES), START)
    for t, topic, message in sorted(said, key=lambda entry: entry[0]):
        if topic not in without:
            writer.write(topic, TOPICS[topic], t, cdr.encode(message))
    writer.close()
    return compensation


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    path = tmp_path_factory.mktemp("late") / "a.mcap"
    live = write(path)
    # that there is something to show
    assert live.skipped > 20 and live.skin.taken["fixed_point"] > 50
    return Recording(path)


def test_late_readings_are_replayed_to_the_bit(found):
    stamps, pressure = found.images("/skin/pressure")
    replay = Replay(found)
    steps = list(replay)
    assert [step.stamp for step in steps] == stamps.tolist()
    for step, picture in zip(steps, pressure, strict=True):
        np.testing.assert_array_equal(step.force, picture * replay.cell_area)
    n = len(found.stamps) - len(stamps)
    assert replay.notes == [f"{n} readings that the robot skipped, being late"]


@pytest.mark.ci
def test_another_method_takes_every_reading_in_time(found):
    replay = Replay(found, method="auto")
    assert [step.stamp for step in replay] == found.stamps.tolist()
    assert replay.driven.nodes["compensation"].skin.taken["fixed_point"] == 8  # four touches begin


@pytest.mark.ci
def test_a_recording_that_does_not_say_when_takes_every_reading_in_time(tmp_path):
    write(tmp_path / "a.mcap", without=("/skin/taken",))
    found = Recording(tmp_path / "a.mcap")
    assert len(list(Replay(found))) == len(found.stamps)


def test_a_part_takes_what_waited_at_its_end(found):
    edge = START + 3_000_000_000
    parts = Replay(found, end=edge), Replay(found, begin=edge)
    stamps = {step.stamp for part in parts for step in part}
    assert stamps >= set(found.images("/skin/pressure")[0].tolist())
