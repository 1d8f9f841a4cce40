# SPDX-License-Identifier: Apache-2.0
"""`tactile-skin replay`: recorded readings through the nodes again, or to other formats."""

from __future__ import annotations

import functools
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arguments import split
from ..extras import each, track
from ..middleware.config import SkinConfig, part_of
from ..recording import Recording, lerobot
from ..recording.convert import export, to_recording
from ..recording.frames import Frames, is_recording, read_frames, recorded_skin
from ..replay.results import STATUS, Compared, Job, Results, collect, compare, table
from ..replay.sources import RATE, supposed
from ..solvers import METHODS

EXAMPLES = """\
FILES: each a recording (.mcap), or frames of any board: .npy, .npz of (n, rows, cols), or .csv, a
frame a line, with its time in front or not; ADC counts, or ratios from 0 to 1.
examples:
  tactile-skin replay touches.mcap
  tactile-skin replay touches.mcap method:=map
  tactile-skin replay touches.mcap config:=calibrated.yaml --out again.mcap
  tactile-skin replay touches.mcap --compare auto naive
  tactile-skin replay touches.mcap --export touches.npz
  tactile-skin replay monday.mcap tuesday.mcap --export lerobot dataset/ --jobs 2
  tactile-skin replay monday.mcap tuesday.mcap --compare auto naive --jobs 2
  tactile-skin replay foreign.csv config:=foreign.yaml rate:=60 --out foreign.mcap
name:=value:
  method     of the compensation (default: as recorded)
  config     parameter file in place of all recorded parameters, as one that calibrate wrote
  namespace  of the skin, where a recording holds several
  rate       frames a second, of files without times (default 100); rows a second of a
             LeRobotDataset (default 30)
  full_scale what an input at the supply reads, where a file holds no ADC steps: 5.0 of volts"""

_KINDS = {"method": str, "config": str, "namespace": str, "rate": float, "full_scale": float}
_SHOWN = 20  # stops that the summary lists
_track = functools.partial(track, desc="replay")


def register(parser) -> None:
    parser.add_argument("words", nargs="*", metavar="FILES | NAME:=VALUE", help="recordings")
    parser.add_argument(
        "--compare", nargs="+", metavar="METHOD", help="these methods side by side, as a table"
    )
    parser.add_argument(
        "--out", type=Path, help="recording to make of what the nodes publish (.mcap)"
    )
    parser.add_argument(
        "--export",
        nargs="+",
        metavar=("FILE", "lerobot DIR"),
        help="write the readings to .npy, .npz or .csv, or a LeRobotDataset to DIR, and end",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        help="processes, each a file, or a part of one (default 1); a file is to the bit as on the "
        "robot, a part is not",
    )


def run(args) -> int:
    """Return the exit status."""
    to, *rest = args.export or [""]
    dataset = to == "lerobot" and rest.pop(0) if rest else ""
    files, given = split(rest + args.words, _KINDS)
    if not files:
        raise ValueError("give a FILE, or several")
    if to == "lerobot" and not dataset:
        raise ValueError("--export lerobot: give a DIR after it")
    if len(files) > 1 and (args.out or (args.export and not dataset)):
        raise ValueError(f"--out and --export are of one FILE, not of {len(files)}")
    method, config = given.get("method", ""), given.get("config")
    for name in [method] * bool(method) + (args.compare or []):
        if name not in METHODS:
            raise ValueError(f"method {name!r}: must be one of {', '.join(METHODS)}")
    if args.jobs < 1 or (args.out and args.jobs > 1):
        raise ValueError(f"--jobs = {args.jobs}: must be 1 or more, and 1 with --out")
    namespace = given.get("namespace", "")
    if args.export and not dataset:
        skin = recorded_skin(files[0], config, namespace)
        return _export(files[0], Path(to), skin, given)
    with tempfile.TemporaryDirectory(prefix="tactile_skin_") as folder:
        paths = [recording_of(path, Path(folder), config, given)[0] for path in files]
        tasks = [Job(path, namespace, method, config or "") for path in paths]
        if dataset:
            return _dataset(tasks, dataset, given.get("rate", lerobot.RATE), args.jobs)
        if len(files) > 1:
            return _fleet(dict(zip(files, tasks, strict=True)), args.compare or [], args.jobs)
        if args.compare:
            return _compare(tasks[0], args.compare)
        _summarize(collect(replace(tasks[0], out=str(args.out or "")), args.jobs, _track))
    if args.out:
        print(f"{args.out}: all that the nodes published")
    return 0


def _fleet(tasks: dict[str, Job], methods: list[str], jobs: int) -> int:
    """Replay each file; one that cannot be read is reported, and the others go on."""
    status, work = 0, functools.partial(_one, methods)
    for path, found in zip(
        tasks, each(work, _track(tasks.values(), len(tasks)), jobs), strict=True
    ):
        if isinstance(found, Exception):
            status = 1
            print(f"{path}: {found}", file=sys.stderr)
            continue
        print(f"{path}:")
        if isinstance(found, Compared):
            print(table(found))
        else:
            _summarize(found)
    return status


def _one(methods: list[str], job: Job) -> Results | Compared | Exception:
    try:
        return compare(job, methods) if methods else collect(job)
    except (ValueError, OSError) as error:
        return error


def recording_of(
    path: str, folder: Path, config: str | None, given: dict
) -> tuple[str, Frames | None]:
    """Return a recording: the file itself, or one that is made of a foreign file's frames."""
    if is_recording(path):
        return path, None
    skin = recorded_skin(path, config)
    frames = _frames(path, skin, given)
    _say_notes(path, supposed(frames, RATE))
    made = Path(tempfile.mkdtemp(dir=folder)) / f"{Path(path).stem}.mcap"
    to_recording(frames, made, skin, config, given.get("rate") or RATE, time.time_ns())
    return str(made), frames


def _frames(path: str, skin: SkinConfig, given: dict) -> Frames:
    """Read a file as it is said to be, and print what had to be supposed."""
    said = {name: given.get(name) for name in ("rate", "full_scale")}
    part = part_of(skin.board)
    frames = read_frames(path, skin.circuit, given.get("namespace", ""), part=part, **said)
    _say_notes(path, frames.notes)
    return frames


def _export(path: str, out: Path, skin: SkinConfig, given: dict) -> int:
    frames = _frames(path, skin, given)
    source = Recording(path, given.get("namespace", "")) if is_recording(path) else frames
    export(source, frames, out)
    print(f"{out}: {len(frames.values)} frames")
    return 0


def _dataset(tasks: list[Job], out: str, rate: float, jobs: int) -> int:
    """Export recordings; those that hold readings only, or are to be solved again, are replayed."""
    with tempfile.TemporaryDirectory(prefix="tactile_skin_") as folder:
        made = []
        for number, task in enumerate(tasks):
            ready = lerobot.is_ready(Recording(task.path, task.namespace))
            if not ready or task.method or task.config:
                task = replace(task, out=str(Path(folder) / f"{number}.mcap"))
                collect(task, 1, _track)
            made.append(task.out or task.path)
        rows = lerobot.export(made, out, tasks[0].namespace, rate, jobs)
    print(f"{out}: {rows} rows, {len(tasks)} episodes, {rate:g} rows a second")
    return 0


def _say_notes(path: str, notes: list[str]) -> None:
    for note in notes:
        print(f"{path}: {note}", file=sys.stderr)


def _compare(job: Job, methods: list[str]) -> int:
    source = Recording(job.path, job.namespace)
    count = source.topics[source.adc_topic].count
    found = compare(job, methods, lambda steps: _track(steps, count))
    _say_notes(job.path, found.results[0].notes)
    print(table(found))
    return 0


def _summarize(found: Results) -> None:
    n, times = len(found.stamps), found.times
    if not n:
        raise ValueError("no reading was replayed")
    p50, p99 = (1e3 * v for v in np.percentile(found.seconds, (50, 99)))
    counts = ", ".join(f"{int(np.sum(found.status == k))} {s}" for k, s in enumerate(STATUS))
    begins = found.stop_begins
    print(f"readings  {n} of {times[-1]:.1f} s: {counts}")
    print(f"force     up to {_largest(found.total)} in total, {_largest(found.peak)} on a cell")
    print(f"time      p50 {p50:.2f} ms, p99 {p99:.2f} ms a reading")
    print(f"stops     {len(begins)}, stopped {100 * np.mean(found.stops != ''):.1f} % of the time")
    free = np.append(np.flatnonzero(found.stops == ""), n)
    if free[0]:  # not free from the first reading on, whose reason is that there is no decision yet
        why = Counter(found.stops[: free[0]]).most_common(1)[0][0]
        print(f'  not free {_until(times, 0, free[0])}, most of it: "{why}"')
    for k in begins[:_SHOWN]:
        length = _until(times, k, free[np.searchsorted(free, k)])
        print(f'  at {times[k]:8.2f} s {length}: "{found.stops[k]}"')
    if len(begins) > _SHOWN:
        print(f"  and {len(begins) - _SHOWN} more")
    for note in found.notes:
        print(note)


def _until(times: np.ndarray, begin: int, end: int) -> str:
    return f"for {times[end] - times[begin]:.2f} s" if end < len(times) else "until the end"


def _largest(force: np.ndarray) -> str:
    return f"{np.nanmax(force):.1f} N" if np.isfinite(force).any() else "no force"
