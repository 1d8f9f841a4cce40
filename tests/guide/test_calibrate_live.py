# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin calibrate` on a serial device, at a terminal."""

import os
import select
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from support.device import Device, run
from support.lab.unknown import Unknown

from tactile_skin.simulation import simulator

pytestmark = pytest.mark.live


@pytest.fixture
def port(tmp_path):
    """Of an unknown board on which nothing lies."""
    over, link = threading.Event(), tmp_path / "board"
    device = Device(Unknown((4, 4), seed=27))
    serving = threading.Thread(
        target=simulator.serve, args=(device, link, lambda: not over.is_set())
    )
    serving.start()
    while not link.exists():
        time.sleep(0.01)
    yield link
    over.set()
    serving.join()


@pytest.fixture
def terminal(port, tmp_path):
    """On which `calibrate` writes, and is answered."""
    config = tmp_path / "mine.yaml"
    config.write_text("/**: {ros__parameters: {circuit: {rows: 4, cols: 4}}}\n")
    ours, theirs = os.openpty()
    command = [sys.executable, "-m", "tactile_skin", "calibrate", "--config", str(config)]
    command += ["--out", str(tmp_path / "out.yaml"), f"port:={port}"]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        yield ours
        process.kill()
    os.close(ours)


def read_until(terminal: int, enough) -> str:
    said, until = "", time.monotonic() + 60.0
    while not enough(said) and time.monotonic() < until:
        if select.select([terminal], [], [], 0.1)[0]:
            said += os.read(terminal, 4096).decode()
    return said


def asks(said: str) -> bool:
    return said.endswith("Enter: ")


@pytest.mark.ci
def test_the_first_question_stands_below_the_log_and_its_answer_is_counted_down(terminal):
    """The question comes when frames do, and a log line clears what is drawn.

    The countdown is one line; then the rest is measured, and touches are asked for.
    """
    said = read_until(terminal, asks)
    assert asks(said) and not select.select([terminal], [], [], 1.0)[0]
    logged = [line for line in said.splitlines() if "INFO" in line]
    assert logged and all(line.startswith("\x1b[2KINFO") for line in logged)
    os.write(terminal, b"\n")
    said += read_until(terminal, lambda more: "2 of 3" in more)
    (line,) = (line for line in said.split("\n") if "measured in" in line)
    assert [part.split()[-2] for part in line.split("\r") if "measured in" in part] == list("321")
    assert line.index("measured in 1 s") < line.index("measuring")
    assert said.index("measuring") < said.index("ohm at rest") < said.index("2 of 3")


@pytest.mark.slow
@pytest.mark.parametrize("readout", ["floating", "loaded-rows"])
def test_from_what_the_user_knows_to_newtons(readout):
    """Guide, file and launched skin, on new things: within 5 % in the median."""
    off = run((8, 8), 28, readout)
    assert np.median(np.abs(off)) < 0.05
