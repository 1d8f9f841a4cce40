# SPDX-License-Identifier: Apache-2.0
"""A board in the caller's own loop, on a real pseudo-terminal."""

import time

import numpy as np
import pytest
import yaml
from support.simulated import CIRCUIT, make_board, serving

import tactile_skin
from tactile_skin import opened

pytestmark = pytest.mark.live

LIMIT = 20.0  # s within which what is waited for must come


def config(folder, **circuit):
    given = {"circuit": {"rows": 4, "cols": 5} | circuit, "geometry": {"shape": "plane"}}
    path = folder / "mine.yaml"
    sections = {"/**": given, "stop_on_push": {"threshold": 5.0, "release": 2.0}}
    path.write_text(yaml.safe_dump({k: {"ros__parameters": v} for k, v in sections.items()}))
    return path


def until(skin, what) -> tuple[float, np.ndarray]:
    """Return the first frame after which something holds."""
    begun = time.monotonic()
    for t, force in skin:
        if what(force):
            return t, force
        assert time.monotonic() - begun < LIMIT, (skin.status, skin.reason)


def test_forces_in_newtons_and_a_stop(tmp_path):
    """Stopped until the rest is measured, free, stopped by a push, and when frames cease."""
    link, board = tmp_path / "board", make_board()
    finger = 4.0 * np.isin(np.arange(20), [7, 12]).reshape(4, 5)  # N
    with serving(link, board), tactile_skin.open(str(link), config(tmp_path)) as skin:
        assert skin.simulated and skin.stop
        until(skin, lambda _: "measuring rest: hands off" in skin.reason)
        t, force = until(skin, lambda _: not skin.stop)
        assert (skin.status, skin.reason) == ("ok", "")
        assert 0.0 <= time.monotonic() - t < LIMIT and t - LIMIT < skin.stamp <= t
        assert force.shape == skin.std.shape == (4, 5)
        board.scene = lambda t: finger
        _, force = until(skin, lambda _: skin.reason.startswith("push"))
        _, force = until(skin, lambda force: force.sum() > 7.0)
        assert force.sum() == pytest.approx(8.0, rel=0.2) and force.argmax() in (7, 12)
        board.scene = lambda t: np.zeros((4, 5))
        until(skin, lambda _: not skin.stop)
    assert skin.stop and "board: closed" in skin.reason


def test_without_a_frame_it_stops_and_says_so(tmp_path):
    link = tmp_path / "board"
    with serving(link) as served, tactile_skin.open(str(link), config(tmp_path)) as skin:
        until(skin, lambda _: not skin.stop)
        served.unplug()
        with pytest.raises((TimeoutError, ConnectionError), match="board"):
            while True:
                skin.read(patience=0.5)
        assert skin.stop


def test_a_board_that_the_opening_restarts_has_its_time(tmp_path, monkeypatch):
    """Until its first frame; it was given up after the pause that a running board may make."""
    monkeypatch.setattr(opened, "PATIENCE", 0.2)
    link, board = tmp_path / "board", make_board()
    scan, begins = board.scan, time.monotonic() + 1.0
    board.scan = lambda: scan() if time.monotonic() > begins else b""
    with serving(link, board), tactile_skin.open(str(link), config(tmp_path)) as skin:
        assert np.shape(skin.read()[1]) == (4, 5)


def test_a_frame_of_another_board_is_no_number(tmp_path):
    link = tmp_path / "board"
    with serving(link), tactile_skin.open(str(link), config(tmp_path, rows=5)) as skin:
        _, force = skin.read()
        assert np.isnan(force).all() and skin.stop
        assert "set circuit.rows: 4" in skin.status and skin.status in skin.reason


def test_what_is_wrong_is_refused_by_name(tmp_path):
    path = config(tmp_path, rws=4)
    with pytest.raises(ValueError, match=r"mine.yaml.*'circuit.rws' is unknown"):
        tactile_skin.open("/dev/null", path)
    with pytest.raises(ValueError, match="/dev/absent"), tactile_skin.open("/dev/absent"):
        pass
    assert CIRCUIT.shape == (4, 5)
