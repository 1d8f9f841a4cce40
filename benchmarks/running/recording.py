# SPDX-License-Identifier: Apache-2.0
"""What recordings promise, on the demo: equality, kills, a full disk, latency.

equal: read back by another library, frame for frame, and replayed to the bit. kills: SIGKILL while
it records, at random times; what the file then lacks. full: a disk with room for 300 kB (as root: a
tmpfs; else RLIMIT_FSIZE). latency: last byte to stop hook, with and without recording, in turns.
"""

import contextlib
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tactile_skin.recording import Recording
from tactile_skin.replay.replay import Replay

from .. import harness

PATIENCE = 60.0  # s, for a process to begin
LIMIT = 300_000  # bytes


def command(folder: Path, *words: str) -> list[str]:
    common = ["method:=auto"]
    return [sys.executable, "-m", "tactile_skin", *words, *common]


def equal(folder: Path, _) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path = folder / "equal.mcap"
    subprocess.run(
        command(folder, "record", str(path), "demo.launch.yaml", "duration:=20"),
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        timeout=PATIENCE + 30.0,
    )
    found = Recording(path)
    types = {"/skin/adc": "<u2", "/skin/pressure": "<f4"}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        theirs = {topic: [] for topic in types}
        for _, channel, _, m in reader.iter_decoded_messages(list(types)):
            picture = np.frombuffer(m.data, types[channel.topic]).reshape(m.height, m.width)
            theirs[channel.topic].append(picture)
    for topic, pictures in theirs.items():
        same = np.array_equal(found.images(topic)[1], pictures)
        print(f"equal: {topic}: {len(pictures)} frames, by mcap-ros2-support the same: {same}")
    stamps, pressure = found.images("/skin/pressure")
    live = dict(zip(stamps.tolist(), pressure, strict=True))
    replay = Replay(found)
    steps = {step.stamp: step.force for step in replay}
    same = [
        np.array_equal(steps.get(stamp), picture * replay.cell_area)
        for stamp, picture in live.items()
    ]
    taken = found.taken()
    late = sum(taken[stamp] - stamp > 10_000_000 for stamp in steps)
    timed_out = len(steps.keys() - live.keys())
    print(f"equal: replayed to the bit: {sum(same)} of {len(same)}; {late} of them were late")
    print(f"equal: timed out on the skin, not here: {timed_out}; {replay.notes}")


def kills(folder: Path, times: int) -> None:
    rng, lost = random.Random(1), []
    for k in range(times):
        path = folder / f"kill{k}.mcap"
        process = subprocess.Popen(
            command(folder, "record", str(path), "demo.launch.yaml", "monitor:=false"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        begun = time.monotonic()
        try:
            while not (path.exists() and path.stat().st_size > 30_000):
                if time.monotonic() - begun > PATIENCE:
                    raise TimeoutError("no recording begins")
                time.sleep(0.01)
            time.sleep(rng.uniform(0.5, 3.0))
        finally:
            killed = time.time_ns()
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        found = Recording(path)
        lost.append((killed - found.stamps[-1]) * 1e-9)
        steps = np.diff(found.times)
        assert found.damage and steps.max() < 1.0
        print(f"kill {k + 1}: {len(found.adc)} frames, the last {lost[-1]:.2f} s before the kill")
    print(
        f"kills: {sum(t < 1.0 for t in lost)} of {times} lost less than 1 s, most {max(lost):.2f}"
    )


def full(folder: Path, _) -> None:
    disk, limit = folder / "disk", None
    disk.mkdir()
    mounted = (
        os.geteuid() == 0
        and not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={LIMIT}", "tmpfs", str(disk)], check=False
        ).returncode
    )
    if not mounted:
        limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))  # noqa: E731
    try:
        path = disk / "full.mcap"
        run = subprocess.run(
            command(folder, "record", str(path), "demo.launch.yaml", "duration:=16"),
            capture_output=True,
            text=True,
            preexec_fn=limit,
            timeout=PATIENCE + 30.0,
        )
        found = Recording(path)
        said = [line for line in run.stderr.splitlines() if "recording has ended" in line]
        kind = "tmpfs" if mounted else "RLIMIT_FSIZE"
        print(f"full ({kind}): status {run.returncode}, said {len(said)} times: {said[:1]}")
        print(f"full: {len(found.adc)} frames are readable; {found.damage}")
        wanted = ("frames", "drops", "latency", "stops")
        print("\n".join(k for k in run.stdout.splitlines() if k.strip().startswith(wanted)))
    finally:
        if mounted:
            subprocess.run(["umount", str(disk)], check=True)


def latency(folder: Path, times: int) -> None:
    pattern = re.compile(r"p50 ([\d.]+) ms, p99 ([\d.]+) ms, max ([\d.]+) ms")
    for k in range(max(1, times // 4)):
        for name in ("without", "with"):
            words = [f"record:={folder / f'{k}.mcap'}"] if name == "with" else []
            run = subprocess.run(
                command(folder, "launch", "duration:=18", *words),
                capture_output=True,
                text=True,
                timeout=PATIENCE + 30.0,
            )
            p50, p99, most = pattern.search(run.stdout).groups()
            drops = re.search(r"drops +(\d+)", run.stdout)[1]
            print(f"latency {name:>7}: p50 {p50}, p99 {p99}, max {most} ms, {drops} drops")


PARTS = {"equal": equal, "kills": kills, "full": full, "latency": latency}


def main(arguments=None) -> None:
    parser = harness.parser(__doc__, __spec__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--times", type=int, default=20, help="kills (default 20)")
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        for part in args.parts or PARTS:
            PARTS[part](Path(folder), args.times)


if __name__ == "__main__":
    harness.run(main)
