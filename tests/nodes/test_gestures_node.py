# SPDX-License-Identifier: Apache-2.0
"""The node gestures: names of what simulated hands do, on the topics."""

import threading
import time
from collections import defaultdict

import numpy as np
import pytest
from support.bench import Bench
from support.patience import PATIENCE, until

from tactile_skin.middleware.bus import Context, MultiThreadedExecutor, Node, Parameter
from tactile_skin.msg import Bool, Header, Image, PointCloud2, String, cloud, cloud_columns, image
from tactile_skin.nodes.observers import gestures
from tactile_skin.nodes.observers.gestures import SHIPPED, Gestures
from tactile_skin.nodes.observers.touch_events import GestureListener
from tactile_skin.nodes.stop_on_push import LATCHED, StopOnPush
from tactile_skin.simulation.people.hands import GESTURES, Person, perform
from tactile_skin.simulation.people.mat import Mat
from tactile_skin.touch.episode import FEATURES
from tactile_skin.touch.model import OTHER, load_model

CELL_AREA = 1.44e-4  # m^2
MAT = Mat(16, 16, 0.018)


class Skin(Bench):
    """The node alone, fed with forces a hundred times a second."""

    def __init__(self, **parameters):
        super().__init__()
        self.seen, self.named = defaultdict(list), []
        given = {"model": "shipped"} | parameters
        handle, observer = self.node("gestures", given), self.node("observer")
        topics = {"skin/gesture": String} | dict.fromkeys(
            ("skin/gesture_classes", "skin/gestures"), PointCloud2
        )
        for topic, kind in topics.items():
            observer.create_subscription(kind, topic, self.seen[topic].append, 100)
        GestureListener(observer, lambda event: self.named.append(event.gesture))
        Gestures(handle)
        self.pressure = observer.create_publisher(Image, "skin/pressure", 10)
        self.contacts = observer.create_publisher(PointCloud2, "skin/contacts", 10)

    def feel(self, forces) -> None:
        for force in forces:
            self.clock.advance(0.01)
            self.pressure.publish(image(force / CELL_AREA, "32FC1", self.header()))
            self.executor.spin_some()

    def do(self, gesture: str, person: int = 70, seed: int = 1) -> None:
        self.feel(perform(gesture, Person(person), MAT, seed, 0.01))
        self.feel(np.zeros((60, 16, 16)))


@pytest.mark.ci
def test_what_a_hand_does_is_named_on_the_topics_and_to_hooks():
    """People and performances that the shipped model was not trained on."""
    right = 0
    for k, gesture in enumerate(GESTURES):
        skin = Skin()
        skin.do(gesture, 200 + k, 7)
        names = [message.data for message in skin.seen["skin/gesture"]]
        assert [named.name for named in skin.named] == names
        if not names:  # too light to be felt
            continue
        assert names[-1] in (gesture, OTHER)
        right += names[-1] == gesture
        last = skin.named[-1]
        assert last.id >= 1 and 0.0 < last.duration < 8.0
        assert np.abs(last.position[1:]).max() < 0.15
    assert right >= 8


def test_the_cloud_has_a_column_for_each_class():
    skin = Skin()
    skin.do("tickle")
    columns = cloud_columns(skin.seen["skin/gesture_classes"][-1])
    classes = load_model(SHIPPED).classes
    assert [name for name in columns if name.startswith("p_")] == [f"p_{c}" for c in classes]
    assert sum(columns[f"p_{name}"][0] for name in classes) == pytest.approx(1.0, abs=1e-5)
    assert columns["state"][0] == 3.0 and classes[int(columns["label"][0])] == "tickle"


def test_the_features_that_a_gesture_was_judged_by_are_a_topic():
    skin = Skin()
    skin.do("stroke")
    columns = cloud_columns(skin.seen["skin/gestures"][-1])
    assert list(columns) == ["x", "y", "z", "id", "state", *FEATURES]
    assert columns["duration"][0] != 0.0 and np.isfinite([*columns.values()]).all()


def test_a_gesture_that_a_pause_of_frames_cuts_off_has_ended():
    skin = Skin()
    skin.feel(perform("rub", Person(70), MAT, 1, 0.01)[:60])
    skin.clock.advance(5.0)
    skin.feel(np.zeros((10, 16, 16)))
    clouds = skin.seen["skin/gesture_classes"]
    states = [cloud_columns(message)["state"].tolist() for message in clouds]
    assert states[0] == [0.0] and states[-1] == [3.0] and [3.0] not in states[:-1]
    assert cloud_columns(clouds[-1])["duration"][0] < 1.0


def test_a_gesture_knows_its_touch_by_the_id_of_its_contact():
    skin = Skin()
    spot = np.zeros((16, 16))
    spot[4, 11] = 3.0
    header = skin.header()
    # column 11 is 3.5 pitches along y, row 4 the same up
    place = {"x": [0.0], "y": [3.5 * 0.018], "z": [3.5 * 0.018], "id": [17.0]}
    skin.contacts.publish(cloud({name: np.array(v) for name, v in place.items()}, header))
    skin.feel([spot] * 30)
    columns = cloud_columns(skin.seen["skin/gesture_classes"][-1])
    assert columns["touch"].tolist() == [17.0]


def test_a_model_that_is_none_is_an_error_that_names_the_file(tmp_path):
    path = tmp_path / "mine.npz"
    path.write_text("gestures")
    with pytest.raises(ValueError, match="mine"):
        Skin(model=str(path))


@pytest.mark.parametrize(
    ("model", "said"), [("", "record yours"), ("shipped", "simulated hands: of a real one")]
)
def test_what_is_no_use_on_real_hands_is_said_and_off_by_itself(model, said, caplog):
    skin = Skin(model=model)
    (line,) = (record.getMessage() for record in caplog.records)
    assert said in line
    skin.do("stroke")
    assert bool(skin.named) == any(skin.seen.values()) == bool(model)


def test_what_the_model_is_not_sure_of_is_other():
    skin = Skin(min_probability=1.0)
    skin.do("stroke")
    assert [message.data for message in skin.seen["skin/gesture"]] == ["other"]


class Hangs:
    """Stands for a recogniser that never answers, until it is let go; then it raises."""

    def __init__(self):
        self.asked, self.let_go = threading.Event(), threading.Event()

    def update(self, t, force, std):
        self.asked.set()
        self.let_go.wait(PATIENCE)
        raise RuntimeError("no answer")


@pytest.mark.live
def test_a_recogniser_that_hangs_or_raises_neither_keeps_a_stop_back_nor_ends_one(monkeypatch):
    """On real time, in threads of their own as a launch gives them."""
    hangs, said, executor = Hangs(), [], MultiThreadedExecutor()
    monkeypatch.setattr(gestures, "Recogniser", lambda *_: hangs)
    context = Context()
    feeler = Node("feeler", context=context)
    contacts = feeler.create_publisher(PointCloud2, "skin/contacts", 10)
    pressure = feeler.create_publisher(Image, "skin/pressure", 10)
    for kind in (Gestures, StopOnPush):
        shipped = [Parameter("model", "shipped")] if kind is Gestures else []
        node = Node(kind.__name__.lower(), context=context, parameter_overrides=shipped)
        executor.add_node(node)
        kind(node)
    feeler.create_subscription(Bool, "skin/stop", lambda m: said.append(m.data), LATCHED)
    executor.add_node(feeler)

    def feel(force: float, happened) -> None:
        def frame():
            header = Header(feeler.get_clock().now().to_msg(), "base_link")
            at = {"x": 0.0, "y": 0.0, "z": 0.0, "force": force, "peak": force}
            contacts.publish(cloud({name: [value] for name, value in at.items()}, header))
            pressure.publish(image(np.full((16, 16), force / CELL_AREA / 256), "32FC1", header))
            time.sleep(0.01)

        until(happened, f"{force} N", frame)

    try:
        feel(0.0, lambda: said[-1:] == [False] and hangs.asked.is_set())
        feel(50.0, lambda: said[-1])
        assert not hangs.let_go.is_set()  # the stop came while the recogniser hung
        hangs.let_go.set()
        before, more = len(said), iter(range(30))
        feel(50.0, lambda: next(more, None) is None)
        assert all(said[before:])
    finally:
        hangs.let_go.set()
        context.try_shutdown()
        executor.shutdown()
