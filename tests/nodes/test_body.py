# SPDX-License-Identifier: Apache-2.0
"""Several skins of one file as one body, on simulated boards at pseudo-terminals."""

import contextlib
import json
import os
import re
import signal
from functools import partial

import numpy as np
import pytest
import yaml
from serial.tools.list_ports_common import ListPortInfo
from support.page import unpack
from support.patience import PATIENCE, spin_until, until
from support.simulated import CIRCUIT, make_board, serving

from tactile_skin import ros
from tactile_skin.board import serial_port
from tactile_skin.errors import FileError, LaunchError
from tactile_skin.launch import Skin, launch, share_dir
from tactile_skin.middleware.package import SKIN_NODES
from tactile_skin.middleware.ros.arguments import split_arguments
from tactile_skin.msg import Image, PointCloud2, WrenchStamped, cloud_columns
from tactile_skin.nodes import frames
from tactile_skin.nodes.observers.view import View
from tactile_skin.simulation import scenes
from tactile_skin.touch.frames import Pose

pytestmark = pytest.mark.live

NAMES = "chest", "back"
FOUR = *NAMES, "left_arm", "right_arm"
GEOMETRY = {"shape": "plane", "pitch": 0.018}
RATE = {"frames_per_second": 50.0}  # four boards share this process


def section(name: str, tmp_path, **more) -> dict:
    side = FOUR.index(name)
    return {
        "port": str(tmp_path / name),
        "circuit": {"rows": CIRCUIT.rows, "cols": CIRCUIT.cols},
        "stop_on_push": {"stale_after": 0.5},  # of a machine that is busy
        "geometry": GEOMETRY | {"rpy": [0.0, 0.0, [0.0, np.pi, np.pi / 2, -np.pi / 2][side]]},
    } | more


@pytest.fixture
def write(tmp_path):
    """Write the body's file, from what each skin is given."""

    def write(skins: dict, **sections):
        path = tmp_path / "robot.yaml"
        path.write_text(yaml.safe_dump({"skins": skins} | sections, sort_keys=False))
        return path

    return write


@pytest.fixture
def body(tmp_path, write):
    """A function that starts skins on boards that play scenes, with what else is given."""
    with contextlib.ExitStack() as stack:

        def start(scenes=(), names=NAMES, back=None, **more):
            scenes = dict(scenes)
            boards = {
                name: stack.enter_context(
                    serving(tmp_path / name, make_board(scenes.get(name, "idle"), **RATE))
                )
                for name in names
            }
            skins = {name: section(name, tmp_path) for name in names}
            skins["back"] |= back or {}
            path = write(skins)
            given = {"config": path, "wait_for_port": 15.0, "monitor": "false"} | more
            skin = stack.enter_context(launch("body.launch.yaml", **given))
            return skin, boards

        yield start


class Heard:
    """What a hook hears, and the messages of some topics."""

    def __init__(self, skin):
        self.reasons: list[tuple[bool, str]] = []
        skin.on_stop(lambda stop, reason: self.reasons.append((stop, reason)))
        self.skin, self.last = skin, {}

    def hear(self, kind, topic: str) -> None:
        take = self.last.__setitem__
        self.skin.node.create_subscription(kind, topic, lambda msg: take(topic, msg), 10)

    def until(self, condition, what: str):
        spin_until(self.skin, condition, lambda: f"{what}: {self.reasons[-3:]}")

    def free(self) -> bool:
        return bool(self.reasons) and not self.reasons[-1][0]

    def said(self, *words: str, since: int = 0) -> bool:
        reasons = self.reasons[since:]
        return any(stop and all(w in reason for w in words) for stop, reason in reasons)

    def pictures_go_on(self, names) -> None:
        topics = [f"{name}/skin/pressure" for name in names]
        before = {topic: self.last[topic] for topic in topics}
        self.until(lambda: all(self.last[t] is not before[t] for t in topics), "pictures")


def test_a_push_on_one_stops_with_its_name_and_has_its_direction(body):
    pushed, other = "back", "chest"
    skin, _ = body({pushed: "push_left"})
    heard = Heard(skin)
    pushes: list[float] = []

    def on_wrench(msg):
        if abs(msg.wrench.force.x) > 10.0:
            pushes.append(msg.wrench.force.x)

    skin.node.create_subscription(WrenchStamped, "skin/wrench", on_wrench, 10)
    hooked: list[float] = []
    skin.on_push(lambda force, centre: hooked.append(force[0]))
    heard.hear(PointCloud2, "skin/contacts")
    heard.until(lambda: heard.said(f"{pushed}: push"), "push")
    heard.until(lambda: hooked, "the hook of pushes")
    assert hooked[0] > 0.0
    assert not heard.said(f"{other}: push")
    heard.until(lambda: pushes, "wrench")
    assert pushes[0] > 0.0  # onto the back
    (number,) = set(cloud_columns(heard.last["skin/contacts"], "skin")["skin"].tolist())
    assert NAMES[int(number)] == pushed


def test_each_of_four_stops_the_body_with_its_name_and_the_others_go_on(body):
    """A push, a frozen board, and a cable that is pulled, on each in turn."""
    skin, boards = body(names=FOUR)
    heard = Heard(skin)
    for name in FOUR:
        heard.hear(Image, f"{name}/skin/pressure")
    heard.until(heard.free, "free")

    def happens(name: str, words: str, change, undo=None) -> None:
        others = [other for other in FOUR if other != name and other not in pulled]
        since = len(heard.reasons)
        change()
        heard.until(lambda: heard.said(f"{name}: ", words, since=since), f"{name}: {words}")
        wrong = (f"{other}: {cause}" for other in others for cause in ("push", "fault"))
        assert not any(heard.said(each, since=since) for each in wrong)
        heard.pictures_go_on(others)
        if undo:
            undo()
            heard.until(heard.free, "free again")

    pulled: list[str] = []
    idle, push = (scenes.script(scene, *CIRCUIT.shape) for scene in ("idle", "push_left"))
    for name, served in boards.items():
        board = served.board
        happens(name, "push", *(partial(setattr, board, "scene", s) for s in (push, idle)))
        happens(name, "frozen", *(partial(setattr, board, "noise", n) for n in (0.0, 1.0)))
    for name, served in boards.items():
        happens(name, "fault", served.unplug)
        pulled.append(name)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="on one core there are no processes")
def test_a_skins_process_that_is_killed_stops_the_body_and_comes_back(body):
    skin, _ = body()
    heard = Heard(skin)
    heard.until(heard.free, "free")
    since = len(heard.reasons)
    processes = {each._handles[0].get_namespace(): each._process for each in skin._skins}
    os.kill(processes["/back"].pid, signal.SIGKILL)
    heard.until(lambda: heard.said("back: fault: its process: ended (-9)", since=since), "a reason")
    heard.until(heard.free, "free again")
    assert not heard.said("chest: fault", since=since)  # a busy machine's may be stale
    skin.__exit__()
    assert all(each._process.poll() is not None for each in skin._skins)


def test_a_skin_in_a_frame_of_its_own_is_placed_by_tf(body, tmp_path):
    skin, _ = body({"back": "push_left"}, back={"frame_id": "arm_link"})
    heard = Heard(skin)
    pushes: list = []

    def on_wrench(msg):
        if abs(msg.wrench.force.y) > 10.0:
            pushes.append(msg)

    skin.node.create_subscription(WrenchStamped, "skin/wrench", on_wrench, 10)
    words = "no transform from arm_link to base_link: publish it on tf, or set one frame_id"
    heard.until(lambda: heard.said(f"back: fault: {words}"), "fault")
    assert not heard.free() and not pushes
    turned = Pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.ones(3))
    frames.publish_static(skin.node, "base_link", "arm_link", turned)
    heard.until(lambda: pushes, "wrench")
    heard.until(lambda: "no transform" not in heard.reasons[-1][1], "another reason")
    message = pushes[0]
    force, torque = message.wrench.force, message.wrench.torque
    assert message.header.frame_id == "base_link" and force.y > 10.0  # +x onto the back, turned
    assert abs(force.x) < 1.0 and np.hypot(torque.x, torque.z) > 0.5 * force.y  # about the origin


def test_the_page_shows_each_skin_and_the_stop_of_the_body(body):
    connect = pytest.importorskip("websockets.sync.client", reason="serves the page").connect
    skin, _ = body({"chest": "push_left"}, view="true", view_port=0)
    (view,) = (node for node in skin._nodes if isinstance(node, View))
    address, found = view._page.address, {}
    heads = dict.fromkeys(("", *NAMES))

    def ask():
        for name, page in pages.items():
            page.send(json.dumps({"after": (heads[name] or {}).get("number", 0)}))
            heads[name], found[name] = unpack(page.recv(PATIENCE))

    with contextlib.ExitStack() as stack:
        pages = {
            name: stack.enter_context(
                connect(
                    f"{address.replace('http', 'ws')}/snapshots?{name}".rstrip("?"),
                    origin=address,
                    max_size=None,
                )
            )
            for name in heads
        }
        hello = {name: json.loads(page.recv(PATIENCE))["hello"] for name, page in pages.items()}
        assert hello[""]["skins"] == [*NAMES] and hello["back"]["skin"] == "back"
        assert (hello["back"]["rows"], hello["back"]["cols"]) == CIRCUIT.shape
        assert hello["chest"]["normal"] != hello["back"]["normal"]
        ask()
        chest = lambda: heads["chest"]["stop"] and "push" in heads["chest"]["reason"]  # noqa: E731
        until(chest, "a push on the chest", ask)
        both = lambda: "chest: push" in heads[""]["reason"] and heads["back"]["stop"] is False  # noqa: E731
        until(both, "a push on the body, and a back that is free", ask)
        assert found["chest"]["a"].shape == found["back"]["a"].shape == CIRCUIT.shape


def test_two_boards_that_nothing_tells_from_each_other_are_refused(tmp_path, write):
    skins = {name: section(name, tmp_path, port="auto") for name in NAMES}
    with pytest.raises(LaunchError, match="chest: port auto without serial_number"):
        launch("body.launch.yaml", config=write(skins))
    for given in skins.values():
        given["serial_driver"] = {"serial_number": "A1"}
    with pytest.raises(LaunchError, match="chest's serial_number A1 and back's serial_number A1"):
        launch("body.launch.yaml", config=write(skins))


def test_a_skin_elsewhere_is_of_the_body_and_has_no_node_here(tmp_path, write):
    """Its port is one of the other computer, which may have the same name as one here."""
    skins = {name: section(name, tmp_path, port="/dev/ttyUSB0") for name in NAMES}
    skins["back"]["elsewhere"] = True
    config = write(skins)
    plan = ros.plan_of("body", split_arguments(["--ros-args", "-p", f"config:={config}"])[1])
    nodes = {a.full_name: a.values() for a in plan.nodes}
    assert nodes.keys() == {"/body", *(f"/chest/{kind}" for kind in SKIN_NODES)}
    assert nodes["/body"]["skins"] == [*NAMES]
    words = ["--ros-args", "-p", f"config:={config}", "-r", "__ns:=/back"]
    there = ros.plan_of("skin", split_arguments(words)[1]).nodes
    assert {a.full_name for a in there} == {f"/back/{kind}" for kind in SKIN_NODES}
    assert there[0].values()["port"] == "/dev/ttyUSB0"
    with pytest.raises(LaunchError, match="skins: back: elsewhere = true: other computers are"):
        launch("body.launch.yaml", config=config)
    skins["back"]["elsewhere"] = "yes, please"
    with pytest.raises(FileError, match="skins: back: elsewhere = 'yes, please': must be true"):
        launch("body.launch.yaml", config=write(skins))


def test_one_board_by_two_names_is_refused_with_both_skins(tmp_path, write, monkeypatch):
    (tmp_path / "by-id").symlink_to(tmp_path / "chest")
    skins = {name: section(name, tmp_path) for name in NAMES}
    skins["back"]["port"] = str(tmp_path / "by-id")
    with pytest.raises(LaunchError, match=r"chest's port .*chest and back's port .*by-id are one"):
        launch("body.launch.yaml", config=write(skins))
    board = ListPortInfo(skins["chest"]["port"])
    board.vid, board.serial_number = 0x1A86, "A1"
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: [board])
    skins["back"] |= {"port": "auto", "serial_driver": {"serial_number": "A1"}}
    with pytest.raises(LaunchError, match=r"chest's port .* and back's serial_number A1 are one"):
        launch("body.launch.yaml", config=write(skins))
    skins["back"]["serial_driver"] = {"serial_number": "B2"}
    launch("body.launch.yaml", config=write(skins))


@pytest.mark.parametrize("separate", [False, True])
def test_what_ros2_launch_gives_the_program_body_is_taken(tmp_path, write, separate):
    """launch_ros writes it into a file; with `separate` launch starts each skin, as this does."""
    config = write({name: section(name, tmp_path) for name in NAMES})
    given = {"config": str(config), "wait_for_port": 5.0, "method": "", "separate": separate}

    def plan(program: str, *words: str):
        path = tmp_path / "launch_params_x"
        path.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
        words = ["--ros-args", "--params-file", str(path), *words]
        return ros.plan_of(program, split_arguments(words)[1])

    nodes = {a.full_name: a.values() for a in plan("body").nodes}
    if separate:
        assert nodes.keys() == {"/body"} and nodes["/body"]["skins"] == list(NAMES)
        del given["separate"]
        for name in NAMES:
            nodes |= {a.full_name: a.values() for a in plan("skin", "-r", f"__ns:=/{name}").nodes}
    Skin(plan("body")).build()
    assert len(nodes) == 4 * len(NAMES) + 1
    assert nodes["/back/serial_driver"]["port"] == str(tmp_path / "back")
    assert nodes["/back/serial_driver"]["wait_for_port"] == 5.0


@pytest.mark.parametrize(
    ("skins", "words"),
    [
        ([1], "must map names to skins"),
        ({"a b": {}}, "must be a name of letters"),
        ({"chest": {"prt": "a"}}, "skins: chest: prt: must be one of .*port"),
        ({"chest": {"threshold": 3.0}}, "skins: chest: threshold: must be one of .*stop_on_push"),
    ],
)
def test_what_is_no_skin_is_refused(write, skins, words):
    with pytest.raises(FileError, match=words):
        launch("body.launch.yaml", config=write(skins))


@pytest.mark.parametrize("above", ["skin: {%s}", "Skins: {%s}", "body: {%s}", "%s"])
def test_skins_under_another_name_are_refused_with_the_right_one(tmp_path, above):
    path = tmp_path / "robot.yaml"
    path.write_text(above % "chest: {port: /dev/ttyUSB0, geometry: {shape: plane}}")
    with pytest.raises(FileError, match=r"chest/port: .*; the skins of a body stand under skins"):
        launch("body.launch.yaml", config=path)


HERE = "robot.yaml: skins: back: "


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            {"geometry": {"shpe": "plane"}},
            f"{HERE}parameter 'geometry.shpe' is unknown; there are: .*shape",
        ),
        ({"circuit": {"mask": "11 1"}}, f"{HERE}circuit.mask = '11 1': must be words"),
        ({"stop_on_push": {"threshold": -4.0}}, f"{HERE}stop_on_push: parameter threshold of node"),
        ({"geometry": {"shape": "unknown"}}, "back.geometry.shape = unknown: a body has to know"),
        ({"geometry": GEOMETRY | {"rpy": [0.0, 0.0, 0.1]}}, "chest and back: geometry: lie at one"),
    ],
)
def test_a_wrong_value_is_refused_with_its_file_and_its_skin(tmp_path, write, wrong, words):
    """And a body that does not know where its skins are."""
    skins = {name: section(name, tmp_path) for name in NAMES}
    skins["back"] |= wrong
    with pytest.raises(ValueError, match=words):
        launch("body.launch.yaml", config=write(skins), wait_for_port=1.0).build()


def test_a_wrong_value_of_a_skins_own_file_is_refused_with_that(tmp_path, write):
    (tmp_path / "mine.yaml").write_text("/**: {ros__parameters: {circuit: {r_par: -1.0}}}")
    skins = {name: section(name, tmp_path) for name in NAMES}
    skins["back"]["config"] = "mine.yaml"
    with pytest.raises(
        ValueError, match=r"skins: back: .*mine.yaml: /\*\*: line 1: parameter circuit.r_par"
    ):
        launch("body.launch.yaml", config=write(skins), wait_for_port=1.0).build()


def test_a_value_that_nobody_gave_is_refused_with_its_skin(tmp_path, write, monkeypatch):
    monkeypatch.setattr(serial_port.list_ports, "comports", list)
    with pytest.raises(LaunchError, match="/chest/serial_driver: port auto: no USB serial port"):
        launch("body.launch.yaml", config=write({"chest": {"geometry": GEOMETRY}})).build()


def test_a_line_of_the_log_names_the_skin(tmp_path, write):
    skin = launch("body.launch.yaml", config=write({n: section(n, tmp_path) for n in NAMES}))
    with contextlib.suppress(ValueError):  # no port is there
        skin.build()
    assert skin._handles[0].get_logger().name == "tactile_skin.chest.serial_driver"


def test_the_live_line_is_of_all_skins_and_ends_after_the_duration(body, capsys):
    skin, _ = body({"back": "push_left"}, monitor="true", duration=3.0)
    skin.spin(PATIENCE)
    skin.__exit__()
    out = capsys.readouterr().out
    assert "STOP back: push" in out and not skin.failed
    for name in NAMES:
        assert re.search(rf"frames      {name} [1-9]\d+ in 3\.\d s", out)
        assert f"CRC errors  {name} 0" in out
    assert re.search(r'at .*: ".*back: push', out) and "up to 6" in out


def test_one_skin_of_a_body_has_a_live_line_of_its_own(tmp_path, write, capsys):
    config = write({name: section(name, tmp_path) for name in NAMES})
    with serving(tmp_path / "back", make_board("idle")):
        given = {"namespace": "back", "config": config, "wait_for_port": 15.0, "duration": 1.0}
        with launch("skin.launch.yaml", **given) as skin:
            skin.spin(PATIENCE)
    assert re.search(r"frames      [1-9]\d+ in 1\.\d s", capsys.readouterr().out)


def test_a_file_without_skins_is_refused(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("/**: {ros__parameters: {frame_id: base_link}}\n")
    with pytest.raises(LaunchError, match="needs config:=FILE, with the skins of the body"):
        launch("body.launch.yaml", config=path)


def test_a_skin_takes_the_file_of_its_own_and_what_the_body_says_wins(tmp_path, write):
    (tmp_path / "mine.yaml").write_text(
        "/**: {ros__parameters: {circuit: {rows: 9, cols: 5, r_ref: 1000.0}}}\n"
        "/**/serial_driver: {ros__parameters: {baud: 115200}}\n"
    )
    skins = {"chest": section("chest", tmp_path, config="mine.yaml")}
    skin = launch("body.launch.yaml", config=write(skins))
    values = {a.full_name: a.values() for a in skin._plan.nodes}
    assert values["/chest/serial_driver"]["baud"] == 115200
    assert values["/chest/compensation"]["circuit.rows"] == CIRCUIT.rows
    assert values["/chest/compensation"]["circuit.r_ref"] == 1000.0
    assert values["/body"]["chest.geometry.shape"] == "plane"


def test_the_guides_example_is_taken_with_what_detect_writes_and_a_simulated_board(tmp_path):
    page = (share_dir() / "docs" / "body.md").read_text()
    text = page.partition("```yaml\n")[2].partition("```")[0]
    (tmp_path / "robot.yaml").write_text(text)
    (tmp_path / "chest.yaml").write_text(
        "/**: {ros__parameters: {circuit: {rows: 8, cols: 8}}}\n"
        "/**/serial_driver: {ros__parameters: {protocol: text, serial_number: A1}}\n"
    )
    plan = launch("body.launch.yaml", config=tmp_path / "robot.yaml")._plan
    values = {a.full_name: a.values() for a in plan.nodes}
    assert values["/chest/serial_driver"]["serial_number"] == "A1"
    assert f"--link {values['/back/serial_driver']['port']} " in page
