# SPDX-License-Identifier: Apache-2.0
"""The command line: the demo runs, and a user's mistake is one clear line, never a traceback."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import serial
import yaml
from support import machine
from support.marks import ci

from tactile_skin import Circuit, cli
from tactile_skin.board.terminal import is_simulated
from tactile_skin.commands.launch import read_keys
from tactile_skin.learning import network

pytestmark = pytest.mark.live

# Frames of another process are counted again if the computer stood still.
IN_TIME = pytest.mark.flaky(reruns=3, condition=machine.stood_still)


def run_command(*words, cwd=None, timeout=120) -> subprocess.CompletedProcess:
    """The command in a process of its own, as a user starts it."""
    command = [sys.executable, "-m", "tactile_skin", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=timeout)


# --- help ---


def test_the_help_lists_the_commands(call):
    status, out, _ = call("--help")
    assert status == 0
    listed = re.findall(r"^ {4}(\w+)", out, re.MULTILINE)
    assert set(listed) == set(cli.COMMANDS)
    for command in listed:
        status, out, _ = call(command, "--help")
        assert status == 0 and out.startswith(f"usage: tactile-skin {command}")
        assert "example" in out


def test_the_arguments_of_a_launch_file_are_shown(call):
    status, out, _ = call("launch", "--show-args")
    assert status == 0
    for name in ("scene", "method", "duration", "config"):
        assert re.search(rf"^{name}:=", out, re.MULTILINE)
    status, out, _ = call("launch", "--show-args", "body.launch.yaml")
    assert status == 0 and "config:=... (must be given)\n" in out and "duration:=\n" in out


# --- mistakes ---


def weights_of_another(folder) -> list[str]:
    """A parameter file with the shipped weights, which say they are for another resistance."""
    shipped = network.shipped("paper")
    arrays = dict(np.load(network.SHIPPED / "paper.npz"))
    circuit = Circuit(r_par=100.0).describe()
    meta = shipped.meta | {"circuit": circuit}
    arrays["meta"] = np.array(json.dumps(meta))
    path = folder / "other.npz"
    np.savez(path, **arrays)
    section = {"compensation": {"ros__parameters": {"weights": str(path)}}}
    (folder / "mine.yaml").write_text(yaml.safe_dump(section))
    return [f"config:={folder / 'mine.yaml'}"]


MISTAKES = {  # what is wrong -> (words after `launch`, what the line must hold)
    "weights of another circuit": (weights_of_another, ["other.npz", "r_par"]),
    "value that is no YAML": (lambda folder: ["method:=[x"], ["method", "'[x'"]),
    "two launch files": (lambda folder: ["a.yaml", "b.yaml"], ["one launch file", "a.yaml"]),
}


@pytest.mark.parametrize("wrong", MISTAKES)
def test_a_mistake_at_launch_is_one_clear_line(call, tmp_path, wrong):
    """Exit status 2; the line names what is wrong, and nothing pretends to have run."""
    make, named = MISTAKES[wrong]
    words = make(tmp_path)
    if not words[0].endswith(".yaml") or ":=" in words[0]:
        words = ["skin.launch.yaml", "port:=loop://", *words]
    status, out, err = call("launch", *words)
    assert status == 2
    assert out == ""
    (line,) = [text for text in err.splitlines() if "error" in text]
    assert line.startswith("tactile-skin launch: error: ")
    for text in named:
        assert text in line


SKIN = "launch skin.launch.yaml"
ONE_LINE = [  # words, and what the line must hold
    (f"{SKIN} port:=/dev/ttyNONE0", "port /dev/ttyNONE0: does not exist"),
    (f"{SKIN} port:=ttyNONE0", "port ttyNONE0: does not exist"),
    (f"{SKIN} port:=carrier-pigeon://home", "carrier-pigeon"),
    (f"{SKIN} port:=5", "parameter port"),
    ("flash", "port is missing"),
    ("flash port:=auto", "name the port"),
    ("flash port:=/dev/no-such-port", "does not exist"),
    ("flash prot:=/dev/ttyUSB0", "is unknown"),
    ("flash port:=a port:=b", "given twice"),
    ("flash port:=/dev/null adc_mhz:=4", "adc_mhz:=4: must be 2 or 1"),
    ("detect", "give port:=NAME, or one FILE"),
    ("detect a.bin port:=/dev/ttyUSB0", "give port:=NAME, or one FILE"),
    ("detect port:=/dev/ttyNONE0", "does not exist"),
    ("detect none.bin", "none.bin"),
    ("detect port:=loop:// seconds:=0", "must be from 0.5 to 60"),
    ("detect port:=loop:// rows:=8", "give both, or none"),
    ("detect port:=loop:// bauds:=9600", "did you mean 'baud'"),
    ("calibrate --out=o.yaml touches:=a.npy", "rest:=FILE is missing"),
    (
        "calibrate --out=o.yaml rest:=a.npy port:=/dev/null",
        "files are rest, touches, reference, creep, rate",
    ),
    ("calibrate --out=o.yaml rest:=a.npy 500g:=b.npy reference:=scale.csv", "No such file"),
    ("calibrate --out=o.yaml rest:=none.npy", "none.npy: No such file"),
    ("calibrate --out=o.yaml rest:=a.npy rate:=fast", "rate:=fast: must be a number"),
    ("doctor", "FILE"),
    ("doctor a.npy port:=/dev/null", "FILE"),
    ("doctor a.npy baud:=9600", "live board"),
    ("doctor a.npy size:=3", "is unknown"),
    ("doctor a.npy rows:=x", "whole number"),
    ("doctor a.npy inverted:=yes", "true or false"),
    ("doctor a.npy rows=8", "name:=value"),
    ("doctor a.txt", "No such file"),
    ("replay none.mcap", "none.mcap: No such file"),
    ("replay", "give a FILE, or several"),
    ("replay a.csv b.csv", "a.csv: No such file"),
    ("replay a.mcap b.mcap --out c.mcap", "--out and --export are of one FILE, not of 2"),
    ("replay a.mcap method:=magic", "method 'magic': must be one of"),
    ("replay a.mcap sped:=2", "argument 'sped' is unknown"),
    ("replay a.mcap rate:=fast", "rate:=fast: must be a number"),
    ("replay a.mcap --jobs 2 --out b.mcap", "--jobs = 2: must be 1 or more, and 1"),
    ("replay a.bag", "must be one of .mcap"),
]


@pytest.mark.parametrize(("words", "said"), ONE_LINE)
def test_a_mistake_is_one_clear_line(call, tmp_path, monkeypatch, words, said):
    if words.startswith("replay"):
        pytest.importorskip("mcap", reason="reads recordings")
    monkeypatch.chdir(tmp_path)
    status, out, err = call(*words.split())
    assert (status, out) == (2, "")
    (line,) = err.splitlines()
    assert said in line


@pytest.mark.parametrize("port", ["/dev/ttyNONE0", "auto"])
def test_a_port_that_is_typed_is_no_mistake_of_a_file(call, port, monkeypatch):
    monkeypatch.setattr("tactile_skin.board.serial_port.candidates", lambda serial_number="": [])
    status, _, err = call("record", "x.txt", f"port:={port}")
    assert status == 2 and f"error: port {port}: " in err


OTHERS = {
    "no command": ([], "COMMAND"),
    "unknown command": (["lunch"], "lunch"),
    "sim without link": (["sim"], "--link"),
    "unknown scene": (["sim", "--link", "x", "--scene", "waltz"], "scene 'waltz'"),
    "rate": (["sim", "--link", "x", "--rate", "500"], "frames_per_second = 500.0"),
    "noise": (["sim", "--link", "x", "--noise", "-1"], "noise = -1.0"),
    "no number": (["sim", "--link", "x", "--rate", "fast"], "'fast'"),
    "sim's protocol": (["sim", "--link", "x", "--config", "morse.yaml"], "protocol 'morse'"),
    "a simulated chip": (["sim", "--link", "x", "--board", "firmware"], "'board' is gone: "),
    "another board": (["launch", "board:=firmware"], "argument 'board' is gone: "),
    "link in no folder": (["sim", "--link", "no/folder/skin"], "no/folder"),
    "threads": (["train", "--threads", "0"], "--threads = 0"),
    "a bad training rate": (["train", "--rate", "0"], "rate = 0.0"),
}


@pytest.mark.parametrize("wrong", OTHERS)
def test_a_mistake_in_another_command_is_one_clear_line(call, tmp_path, monkeypatch, wrong):
    monkeypatch.chdir(tmp_path)
    words, named = OTHERS[wrong]
    files = [tmp_path / word for word in words if word in ("morse.yaml", "text.yaml")]
    for file in files:
        section = {"ros__parameters": {"protocol": file.stem}}
        file.write_text(yaml.safe_dump({"/**/serial_driver": section}))
    status, out, err = call(*words)
    assert (status, out) == (2, "")
    (line,) = [text for text in err.splitlines() if "error" in text]
    assert named in line
    assert list(tmp_path.iterdir()) == files


@pytest.mark.ci
@IN_TIME
def test_the_simulated_board_sends_what_the_parameter_file_says(tmp_path):
    config = tmp_path / "mine.yaml"
    section = {"ros__parameters": {"protocol": "text", "baud": 115200}}
    config.write_text(yaml.safe_dump({"serial_driver": section}))
    done = run_command("launch", f"config:={config}", "duration:=2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rate = float(re.search(r"frames .* \((\d+\.\d+)/s\)", done.stdout)[1])
    assert 5.0 < rate < 15.0  # as many lines of 256 numbers as 115,200 baud carry


# --- in processes of their own ---


@pytest.mark.parametrize("loaded", ["numpy", "scipy.linalg._fblas", "tactile_skin.launch"])
def test_an_end_while_it_loads_is_quiet(loaded):
    """Ctrl-C before anything runs, whatever module is being loaded."""
    words = [sys.executable, "-X", "importtime", "-m", "tactile_skin", "launch"]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, start_new_session=True)
    for line in process.stderr:  # a line for each module that was loaded
        if line.split("|")[-1].strip() == loaded:
            break
    process.send_signal(signal.SIGINT)
    try:
        rest = process.communicate(timeout=60)[1]
    finally:
        process.kill()  # where SIGINT is ignored, as by what a shell runs in the background
    assert "Traceback" not in rest
    assert process.returncode in (-signal.SIGINT, 130)


def test_a_launch_file_is_read_without_scipy():
    """The board that it starts is simulated while SciPy loads; Ctrl-C is the skin's by then."""
    code = """
import sys
from tactile_skin import launch
launch.read_plan(launch.find("skin.launch.yaml"), {"port": "loop://"})
print("scipy" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr


def test_the_demo(tmp_path, monkeypatch):
    """Two hundred frames of the skin on a simulated board, started in an empty folder."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = [sys.executable, "-m", "tactile_skin", "launch", "duration:=60"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, **streams) as process:
        frames, line = 0.0, ""
        while not (frames >= 200.0 and "free" in line) and (line := process.stdout.readline()):
            frames += sum(map(float, re.findall(r"(\d+\.\d)/s", line)))  # a line a second
        process.terminate()
        summary, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert re.search(r"^SIMULATED .* free", line)
    assert summary.startswith("summary of a simulated board")
    assert int(re.search(r"frames +(\d+) in", summary)[1]) >= 190
    assert re.search(r"CRC errors +0\b", summary)
    drops = re.search(r"drops +(\d+) \((\d+) lost on the wire, (\d+) on the way\)", summary)
    total, lost, behind = map(int, drops.groups())  # none, unless the computer is busy
    assert total == lost + behind
    assert re.search(r"latency .* p50 \d+\.\d+ ms, p99 \d+\.\d+ ms", summary)
    assert list(tmp_path.iterdir()) == []  # the board and its link are gone


@pytest.mark.ci
def test_a_simulated_board_is_called_so_under_any_launch_file(tmp_path):
    """And a pseudo-terminal of somebody else, of a wireless bridge say, is not."""
    link = tmp_path / "skin"
    words = ("launch", "skin.launch.yaml", f"port:={link}", "duration:=1")
    with subprocess.Popen([sys.executable, "-m", "tactile_skin", "sim", "--link", link]) as board:
        try:
            while not link.exists():
                time.sleep(0.02)
            done = run_command(*words)
        finally:
            board.terminate()
    assert re.search(r"^SIMULATED ", done.stdout, re.MULTILINE), done.stdout
    assert "summary of a simulated board" in done.stdout
    master, slave = os.openpty()
    link.symlink_to(os.ttyname(slave))
    with serial.Serial(str(link)) as port:
        assert not is_simulated(port)
    with serial.serial_for_url("loop://") as port:
        assert not is_simulated(port)
    os.close(master)
    os.close(slave)


@pytest.mark.ci
@IN_TIME
def test_who_reads_only_the_first_line_gets_no_traceback():
    command = f"{shlex.quote(sys.executable)} -m tactile_skin launch duration:=2 | head -1"
    done = subprocess.run(
        command, shell=True, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout.count("\n") == 1
    assert "Traceback" not in done.stderr and "BrokenPipe" not in done.stderr


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&-"])
def test_closed_standard_streams_are_no_mistake(closed):
    """As of a service, or of a job that some job scheduler starts."""
    command = [sys.executable, "-m", "tactile_skin", "launch", "duration:=0.2"]
    shell = ["sh", "-c", f'exec "$0" "$@" {closed}', *command]
    done = subprocess.run(shell, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "Traceback" not in done.stderr


def test_a_board_ends_at_a_signal(tmp_path):
    """And takes its link with it."""
    link = tmp_path / "skin"
    command = [sys.executable, "-m", "tactile_skin", "sim", "--link", str(link)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert f"simulated board on {link}" in process.stderr.readline()
        assert os.readlink(link).startswith("/dev/")
        process.terminate()
        assert process.wait(60) == 0
    assert not link.is_symlink()


@pytest.mark.parametrize("number", [signal.SIGKILL, ci(signal.SIGHUP), ci(signal.SIGTERM)])
def test_no_board_and_no_link_outlive_the_launcher(tmp_path, number):
    command = [sys.executable, "-m", "tactile_skin", "launch"]
    given = os.environ | {"TMPDIR": str(tmp_path)}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **streams, env=given) as process:
        for line in process.stdout:
            if b"free" in line:
                break
        (link,) = tmp_path.glob("skin_*/board")
        assert link.parent.stat().st_mode & 0o777 == 0o700
        board_open = Path(os.readlink(link))
        assert board_open.exists()
        asked = time.monotonic()
        process.send_signal(number)
        process.stdout.read()  # until nobody has it open: the launcher and its board are gone
        status = process.wait()
    assert time.monotonic() - asked < 1.0
    assert status == (-number if number == signal.SIGKILL else 0)
    assert not link.is_symlink() and not link.parent.exists()


@pytest.mark.parametrize("place", ["/dev/ttyUSB7", "/dev/shm/skin", "../../../../../dev/skin"])
def test_a_simulated_board_makes_no_link_among_devices(call, place):
    """Also as root, who might."""
    status, _, err = call("sim", "--link", place)
    assert status == 2
    assert "must not have a link in /dev" in err
    assert not Path(place).is_symlink()


# --- keys on a terminal ---


def left(keyboard) -> None:
    """Leave the terminal by Ctrl-D, which ends who reads it and nothing else."""
    os.write(keyboard, b"\x04")
    for thread in [t for t in threading.enumerate() if t.name == "keys"]:
        thread.join(20.0)
        assert not thread.is_alive()


@pytest.fixture
def terminal(monkeypatch):
    """The keyboard's end of a terminal that is the standard input."""
    keyboard, slave = os.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield keyboard
        left(keyboard)
    os.close(keyboard)


@pytest.mark.parametrize(
    ("answer", "said"),
    [((False, "still stopped: push"), "still stopped: push"), (ValueError("no stop"), "no stop")],
)
def test_r_and_enter_reset_a_latched_stop(terminal, capsys, answer, said):
    """What is refused, as where there is no stop node, is one line, and the next one is heard."""
    asked = threading.Semaphore(0)

    def reset():
        asked.release()
        if isinstance(answer, Exception):
            raise answer
        return answer

    read_keys(reset)
    for _ in range(2):
        for line in (b"x\n", b"r\n"):
            os.write(terminal, line)
        assert asked.acquire(timeout=20.0)
    assert not asked.acquire(blocking=False)
    left(terminal)
    assert capsys.readouterr().err == f"reset: {said}\n" * 2


def test_without_a_terminal_nobody_reads_the_input(monkeypatch):
    with open(os.devnull) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        before = threading.active_count()
        read_keys(None)
        assert threading.active_count() == before
