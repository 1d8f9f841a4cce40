# SPDX-License-Identifier: Apache-2.0
"""A skin on real ROS: a graph of processes, the bytes that are played to it, a plain subscriber."""

from __future__ import annotations

import contextlib
import itertools
import os
import pickle
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import yaml

from tactile_skin import launch
from tactile_skin.board.protocol import BinaryParser, encode
from tactile_skin.middleware.parameter_file import ParameterFile
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve
from tactile_skin.simulation import scenes, simulator
from tactile_skin.simulation.matrix import Fabric, resting_curve

PATIENCE = 60.0  # s, for what must happen
WARM_UP = 1.0  # s, not counted
AHEAD = 1e-3  # s by which a stamp may lie before the last byte: the link's jitter is taken out
DECIDED = ("skin/pressure", "skin/contacts", "skin/wrench", "skin/push_direction")


# One fabric for every scene, as one skin has.
FABRIC = resting_curve(PressureCurve(), Circuit().shape, seed=0)


def endless(scene: str = "demo", seed: int = 0, curve: PressureCurve = FABRIC) -> Iterator[bytes]:
    """The frames of a simulated board, a string of bytes per frame."""
    circuit = Circuit()
    played = simulator.Board(
        circuit, PressureCurve(), scenes.script(scene, *circuit.shape), seed=seed
    )
    rest = np.broadcast_to(1.0 / curve.rest_resistance, circuit.shape)
    played.matrix.fabric = Fabric(curve, circuit.populated, np.ones(circuit.shape), rest)
    while True:
        if frame := played.scan():
            yield frame


def record(
    frames: int, scene: str = "demo", seed: int = 0, curve: PressureCurve = FABRIC
) -> list[bytes]:
    """So many of them."""
    return list(itertools.islice(endless(scene, seed, curve), frames))


class Player:
    """Plays frames on a pseudo-terminal, numbered and timed anew as if one board had sent them all.

    Attributes:
        port: what a serial driver opens.
        rate: frames a second.
        written: when each frame's last byte was written [s, time of day].
    """

    def __init__(self, rate: float = simulator.FRAMES_PER_SECOND):
        self.rate = rate
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.written: list[float] = []
        self._number = 0

    def play(self, frames: Iterable[bytes], going: Callable[[], bool] = lambda: True) -> None:
        """Write all of them, or as many as there are while `going`."""
        tick = time.monotonic()
        for frame in frames:
            if not going():
                return
            tick += 1.0 / self.rate
            time.sleep(max(0.0, tick - time.monotonic()))
            self._write(self._anew(frame))
            self.written.append(time.time())

    def _anew(self, frame: bytes) -> bytes:
        (read,) = BinaryParser().feed(frame)
        now, bits = round(time.monotonic() * 1e6), read.adc_bits
        self._number += 1
        return encode(self._number, now, read.samples, bits, 16 - bits)

    def _write(self, frame: bytes) -> None:
        """Whole, if a reader that is late makes room within a second."""
        deadline = time.monotonic() + 1.0
        while frame and time.monotonic() < deadline:
            try:
                frame = frame[os.write(self._master, frame) :]
            except BlockingIOError:
                select.select([], [self._master], [], 0.1)

    @contextlib.contextmanager
    def playing(self, frames: Iterable[bytes]):
        """Play them in a thread."""
        over = threading.Event()
        thread = threading.Thread(
            target=self.play, args=(frames, lambda: not over.is_set()), name="player"
        )
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class Graph:
    """ROS on this machine alone, and processes on it; use it with `with`.

    Attributes:
        env: the environment of its processes.
        folder: of its own, removed at the end.
        processes: those that run, by name.
    """

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="tactile_skin_ros_"))
        self.processes: dict[str, subprocess.Popen] = {}
        self._count = 0
        self._ends: dict[str, int] = {}  # launch -> SIGINT: SIGTERM leaves its processes
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.env = os.environ | {
            "ROS_HOME": str(self.folder / "ros"),
            "ROS_LOG_DIR": str(self.folder / "ros"),
            "ROS_DOMAIN_ID": str(port % 100),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "OMP_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
        }

    def __enter__(self) -> Graph:
        return self

    def __exit__(self, *_) -> None:
        for name, process in self.processes.items():
            if name not in self._ends:  # a second SIGINT would hurry it
                process.send_signal(signal.SIGTERM)
        for name in tuple(self.processes):
            self.stop(name, self._ends.get(name, signal.SIGTERM))
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, name: str, words: list[str]) -> None:
        with open(self.log(name), "ab") as log:
            self.processes[name] = subprocess.Popen(
                words,
                env=self.env,
                stdout=log,
                stderr=log,
                start_new_session=True,
                # who runs the tests in the background may ignore it
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )

    def launch(self, name: str, *words) -> None:
        """Start `ros2 launch` with these words, which starts its own processes."""
        self._ends[name] = signal.SIGINT
        self.start(name, ["ros2", "launch", *map(str, words)])

    def processes_of(self, name: str) -> dict[str, int]:
        """Return those that a launch has started: namespace/program -> its number."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                words = (folder / "cmdline").read_text().split("\0")
                status = (folder / "stat").read_text().rpartition(")")[2].split()
                if int(status[1]) == self.processes[name].pid and len(words) > 1:
                    spaces = [w.partition(":=/")[2] for w in words if w.startswith("__ns:=/")]
                    found["/".join([*filter(None, spaces), Path(words[1]).name])] = int(folder.name)
        return found

    def end_launch(self, name: str, killed: int = 0) -> None:
        """Send Ctrl-C to a launch: all that it has started ends by itself, with status 0.

        Args:
            killed: how many of its processes were, before, and have started again.
        """
        status, said = self.stop(name, signal.SIGINT), self.said(name)
        assert status == 0, said
        assert "Traceback" not in said and "escalating" not in said, said
        started, clean = said.count("process started with pid"), said.count("finished cleanly")
        assert said.count("process has died") == killed and started == clean + killed > 0, said

    def start_node(self, action: launch.NodeAction) -> None:
        self.start(action.name, command(action))

    def log(self, name: str) -> Path:
        """What a process has printed."""
        return self.folder / f"{name}.log"

    def said(self, name: str) -> str:
        return self.log(name).read_text(errors="replace")

    def stop(self, name: str, number: int = signal.SIGTERM) -> int:
        """Send the signal and wait; the exit status."""
        process = self.processes.pop(name)
        process.send_signal(number)
        try:
            return process.wait(15.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return process.wait()

    def wait_for(self, happened: Callable[[], bool], what: str) -> None:
        """Raises:
        RuntimeError: it did not happen, or a process ended; with what the processes said.
        """
        deadline = time.monotonic() + PATIENCE
        while not happened():
            ended = [n for n, p in self.processes.items() if p.poll() is not None]
            if ended or time.monotonic() > deadline:
                said = "\n".join(f"--- {n}\n{self.said(n)[-2000:]}" for n in self.processes)
                raise RuntimeError(f"not: {what}; ended: {ended}\n{said}")
            time.sleep(0.02)

    def listen(self, *topics: str) -> str:
        """Start a plain subscriber, to all topics if none are named; its name."""
        self._count += 1
        name = f"listener_{self._count}"
        path = self.folder / f"{name}.pickle"
        words = [
            sys.executable,
            str(Path(__file__).with_name("listen_rclpy.py")),
            str(path),
            *topics,
        ]
        self.start(name, words)
        return name

    def hears(self, name: str, *words: str) -> bool:
        """Whether the subscriber has said each of these."""
        said = self.said(name)
        return all(word in said for word in words)

    def wait_until_heard(self, name: str, *topics: str) -> None:
        topics = topics or (
            *DECIDED,
            "skin/adc",
            "skin/stop",
            "skin/stop_status",
            "skin/diagnostics",
        )
        self.wait_for(
            lambda: self.hears(name, *(f"heard {t}\n" for t in topics)), f"{name} hears {topics}"
        )

    def heard(self, name: str) -> list[tuple]:
        """End the subscriber; what it noted: (topic, arrival [s], stamp [ns], values)."""
        path = self.folder / f"{name}.pickle"
        self.stop(name)
        with path.open("rb") as file:
            return pickle.load(file)  # our own file


_STAND_IN = """#!/bin/sh
trap 'exit 0' INT
echo "$@" > $0.said
while :; do sleep 0.1; done
"""


def stand_in(graph, folder, package: str) -> Path:
    """Install a package with a program of its name; where that writes its arguments, and waits."""
    index = folder / "share" / "ament_index" / "resource_index" / "packages"
    for made in (index, folder / "share" / package, folder / "lib" / package):
        made.mkdir(parents=True, exist_ok=True)
    (index / package).touch()
    program = folder / "lib" / package / package
    program.write_text(_STAND_IN)
    program.chmod(0o755)
    graph.env["AMENT_PREFIX_PATH"] = f"{folder}:{graph.env['AMENT_PREFIX_PATH']}"
    return program.with_suffix(".said")


class Status:
    """What a stop says last, of a skin or of a body.

    Attributes:
        causes, skins: what stops it, and which of a body's.
    """

    def __init__(self, plain, topic: str = "skin/stop_status"):
        from diagnostic_msgs.msg import DiagnosticArray

        self._plain, self._topic = plain, topic
        plain.hear(DiagnosticArray, topic)

    def __getattr__(self, key: str) -> list[str]:
        values = self._plain.last(self._topic).status[0].values
        return next(pair.value for pair in values if pair.key == key).split()

    @property
    def message(self) -> str:
        return self._plain.last(self._topic).status[0].message

    def free(self) -> bool:
        return self._said() and not self.causes

    def forget(self) -> None:
        """Count only what comes from here on."""
        del self._plain.heard[self._topic][:]

    def _said(self) -> bool:
        return self._plain.last(self._topic) is not None

    def pushed(self) -> bool:
        return self._said() and "push" in self.causes


def plan_of(port: str, **parameters) -> dict[str, launch.NodeAction]:
    """The nodes of skin.launch.yaml without the monitor, by name; more parameters for any."""
    plan = launch.read_plan(launch.find("skin.launch.yaml"), {"port": port})
    nodes = {a.name: a for a in plan.nodes if a.executable != "monitor"}
    for name, values in parameters.items():
        nodes[name].give(values)
    return nodes


def command(action: launch.NodeAction) -> list[str]:
    """The command line that starts a node of a launch file, as `ros2 launch` would."""
    words = []
    for item in action.parameters:
        if isinstance(item, ParameterFile):
            words += ["-p", f"config:={item.path.resolve()}"]
        else:
            value = yaml.safe_dump(item.value, default_flow_style=True, width=sys.maxsize)
            words += ["-p", f"{item.name}:={value.splitlines()[0]}"]
    return program(action.executable, *words)


def program(name: str, *words: str) -> list[str]:
    """A program of `ros2 run tactile_skin`, with ROS's arguments."""
    return [sys.executable, "-m", "tactile_skin.ros", name, "--ros-args", *words]


def skin(*words: str) -> list[str]:
    """The program that runs all nodes of a skin."""
    return program("skin", *words)


@contextlib.contextmanager
def board():
    """A player, for as long as it is needed."""
    player = Player()
    try:
        yield player
    finally:
        player.close()
