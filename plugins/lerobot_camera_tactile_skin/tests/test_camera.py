# SPDX-License-Identifier: Apache-2.0
"""What LeRobot gets of a skin that is sound, pushed, faulty and gone."""

import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = pytest.mark.live

SOON = 30.0  # s within which what is waited for must come


@pytest.fixture
def opened(touched):
    """Make a connected camera of the board."""
    from lerobot_camera_tactile_skin import TactileSkinCamera, TactileSkinCameraConfig

    link, _, config, _ = touched
    made = []

    def make(**given):
        camera = TactileSkinCamera(
            TactileSkinCameraConfig(port=str(link), config=str(config), **given)
        )
        made.append(camera)
        camera.connect()
        return camera

    yield make
    for camera in made:
        if camera.is_connected:
            camera.disconnect()


def test_lerobot_finds_it_by_name_and_by_type():
    from lerobot.cameras import CameraConfig
    from lerobot.utils.import_utils import register_third_party_plugins

    register_third_party_plugins()
    assert CameraConfig.get_choice_class("tactile_skin").__module__.startswith("lerobot_camera_")


def test_boards_are_listed_by_their_numbers(monkeypatch):
    from types import SimpleNamespace

    from lerobot_camera_tactile_skin import TactileSkinCamera, camera

    usb = SimpleNamespace(vid=1, serial_number="A1", location="", device="/dev/ttyX")
    usb.description = "a board"
    monkeypatch.setattr(camera.list_ports, "comports", lambda: [usb])
    (found,) = TactileSkinCamera.find_cameras()
    assert (found["id"], found["port"], found["type"]) == ("A1", "/dev/ttyX", "tactile_skin")
    listed = [sys.executable, "-m", "lerobot_camera_tactile_skin"]
    said = subprocess.run(listed, capture_output=True, text=True, timeout=60)
    assert said.returncode == 0 and said.stdout.strip()


def test_no_frame_is_new_twice(opened):
    camera = opened()
    times = []
    for _ in range(20):
        assert camera.async_read(2000).shape == (camera.height, camera.width, 3)
        times.append(camera.frame.time)
    assert (np.diff(times) > 0.0).all()
    assert camera.read_latest_depth(2000).dtype == np.uint16


def test_a_board_that_is_gone_raises(opened, touched):
    camera = opened()
    touched[-1].unplug()
    begun = time.perf_counter()
    with pytest.raises((ConnectionError, TimeoutError, RuntimeError)):
        while time.perf_counter() - begun < SOON:
            camera.async_read(1000)
    with pytest.raises((ConnectionError, TimeoutError)):
        camera.read_latest(0)


def test_a_board_that_is_gone_is_marked_where_asked(opened, touched):
    from lerobot_camera_tactile_skin import Depth, Rgb

    camera = opened(on_fault="mark")
    touched[-1].unplug()
    begun = time.perf_counter()
    while not np.isnan(Depth().pressure(camera.read_latest_depth(200), (16, 16))).all():
        assert time.perf_counter() - begun < SOON
        time.sleep(0.05)
    assert np.isnan(Rgb().pressure(camera.read_latest(200), (16, 16))).all()


def test_the_stop_hook_is_called_where_the_board_is_read(opened, touched, tmp_path, monkeypatch):
    (tmp_path / "noting.py").write_text(
        "def note(stop, reason):\n"
        f"    print(stop, reason, file=open({str(tmp_path / 'said')!r}, 'a'))\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    camera, said = opened(stop_hook="noting:note"), tmp_path / "said"
    begun = time.perf_counter()
    for wanted in ("False", "True push"):
        while wanted not in said.read_text():
            assert time.perf_counter() - begun < SOON
            time.sleep(0.05)
        touched[-1].board.scene = lambda t: np.full((16, 16), 0.3)  # N, 77 in all
    assert not camera.frame.fault
    camera.disconnect()
    assert said.read_text().splitlines()[-1] == "True the skin is closed"


def test_a_readout_that_is_wrong_raises_its_reason(opened, touched):
    camera = opened()
    touched[-1].board.matrix.full_scale = [3, 20]
    begun = time.perf_counter()
    with pytest.raises(RuntimeError, match=r"skin|board"):
        while time.perf_counter() - begun < SOON:
            camera.async_read(2000)
    assert camera.frame.stop and camera.frame.fault


def test_what_is_entered_wrong_is_named(touched):
    from lerobot_camera_tactile_skin import TactileSkinCamera, TactileSkinCameraConfig

    config = str(touched[2])
    with pytest.raises(ValueError, match="on_fault = 'skip': must be one of raise, mark"):
        TactileSkinCameraConfig(config=config, on_fault="skip")
    with pytest.raises(ValueError, match="width = 100: must be the same multiple"):
        TactileSkinCameraConfig(config=config, width=100)
    camera = TactileSkinCamera(TactileSkinCameraConfig(port="/dev/absent", config=config))
    with pytest.raises(ConnectionError, match="/dev/absent"):
        camera.connect()
    assert not camera.is_connected


def test_pictures_hold_pressure_and_marks():
    from lerobot_camera_tactile_skin import Depth, Rgb

    pressure = np.linspace(0.0, 90e3, 20).reshape(4, 5)  # Pa
    for form, off in ((Depth(), 0.0), (Rgb(), 0.012)):
        picture = form.picture(pressure, (4, 5), 3)
        assert form.pressure(picture, (4, 5)) == pytest.approx(pressure, abs=5.0, rel=off)
        assert np.isnan(form.pressure(form.picture(None, (4, 5), 3), (4, 5))).all()
