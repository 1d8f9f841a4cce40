# SPDX-License-Identifier: Apache-2.0
"""Recordings as a LeRobotDataset v3: what the robot knew of its skin at each tick.

A tick takes the newest frame that was published by then; nothing is interpolated. Where that is
old, or gives no picture, numbers are NaN and the cause is named.
"""

from __future__ import annotations

import functools
import itertools
import json
from collections import deque, namedtuple
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import msg
from ..errors import FileError
from ..extras import each, load
from ..middleware.bus import Time
from . import cdr
from .reader import ADC, Recording
from .tables import _AT_ONCE

RATE = 30.0  # rows a second, LeRobot's own default
CONTACTS = 4  # touches of a row, the strongest first
OLD = 0.5  # s after which the last frame, or the last word of the stop, is not of this tick
PICTURE, STD = "observation.tactile.pressure", "observation.tactile.std"
STATE, STOP, CAUSE = "observation.state", "tactile.stop", "tactile.cause"
_KINDS: dict[str, type[msg.Message]] = {
    "wrench": msg.WrenchStamped,  # whose stamp the others must have
    "pressure": msg.Image,
    "pressure_std": msg.Image,
    "centre": msg.PointStamped,
    "contacts": msg.PointCloud2,
    "stop_status": msg.DiagnosticArray,
}
_KEPT = 8  # messages of a topic in which those of one frame are looked for
_FILE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EACH = "x", "y", "z", "force", "id"  # of a contact
NAMES = (
    *(f"{what}_{axis}" for what in ("force", "torque", "centre") for axis in "xyz"),
    *(f"contact{k}_{name}" for k in range(CONTACTS) for name in _EACH),
    *("bound", "age", "status"),  # N; s; 0: sound, 1: a fault stops, 2: no picture
)
_Row = tuple[np.ndarray, np.ndarray, np.ndarray, str]  # pressure, std, state, cause
_COLUMNS = {2: "episode_index", 3: "dataset_from_index", 4: "length"}  # of an _Episode
_DESCRIBED = {"data/chunk_index": 0, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
# one recording; begin: index of its first row among those of the dataset
_Episode = namedtuple("_Episode", "path namespace number begin rows rate")


def is_ready(source: Recording) -> bool:
    """Return whether a recording holds what the nodes made of its readings."""
    here = source.adc_topic.removesuffix(ADC)
    return all(f"{here}skin/{name}" in source.topics for name in ("pressure", "wrench"))


def export(paths: Sequence[str], out, namespace: str = "", rate: float = RATE, jobs: int = 1):
    """Write a new folder of recordings, an episode each; return the number of its rows.

    Raises:
        ValueError, FileError: the rate is no whole number, the folder is there, or sizes differ.
        ModuleNotFoundError: pyarrow or pandas is not installed.
    """
    pandas, _ = (load(m, f"a LeRobotDataset needs {m}", "lerobot") for m in ("pandas", "pyarrow"))
    folder, begin = Path(out), 0
    if not 1.0 <= rate < np.inf or rate % 1:
        raise ValueError(f"rate = {rate!r}: must be a whole number above 0, as LeRobot wants it")
    if folder.exists():
        raise FileError(f"{folder}: is there already: must be a new folder")
    sources, episodes = [Recording(path, namespace) for path in paths], []
    if len(shapes := {source.skin.circuit.shape for source in sources}) > 1:
        raise FileError(f"recordings of skins of {sorted(shapes)}: must be of one size")
    for number, source in enumerate(sources):
        rows = 1 + int((source.span[1] - source.span[0]) * 1e-9 * rate)
        episodes.append(_Episode(str(source.path), namespace, number, begin, rows, rate))
        begin += rows
    found = list(each(functools.partial(_write, folder=str(folder)), episodes, jobs))
    meta = folder / "meta"
    (meta / "episodes/chunk-000").mkdir(parents=True)
    frame = pandas.DataFrame({name: [e[k] for e in episodes] for k, name in _COLUMNS.items()})
    frame["tasks"], frame["data/file_index"] = [["touch"]] * len(episodes), frame["episode_index"]
    frame["dataset_to_index"] = frame["dataset_from_index"] + frame["length"]
    frame.assign(**_DESCRIBED).to_parquet(meta / "episodes/chunk-000/file-000.parquet")
    index = pandas.Index(["touch"], name="task")
    pandas.DataFrame({"task_index": [0]}, index=index).to_parquet(meta / "tasks.parquet")
    stats = {name: _listed([sums[name] for sums in found], begin) for name in found[0]}
    (meta / "stats.json").write_text(json.dumps(stats))
    (meta / "info.json").write_text(json.dumps(_info(sources[0], len(episodes), begin, rate)))
    return begin


def _info(source: Recording, episodes: int, rows: int, rate: float) -> dict:
    skin = source.skin
    circuit = {k: np.asarray(v).tolist() for k, v in skin.circuit.describe().items()}
    known = {"circuit": circuit, "curve": skin.curve.describe(), "unit": "Pa"}
    known["cell_area"] = skin.geometry.cell_area.tolist()  # m^2
    picture = {"dtype": "float32", "shape": skin.circuit.shape, "names": ["row", "column"]}
    one = {STOP: "bool", CAUSE: "string", "timestamp": "float32"}
    one |= dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")
    features = {PICTURE: picture | {"info": known}, STD: picture | {"info": {"unit": "Pa"}}}
    features[STATE] = {"dtype": "float32", "shape": [len(NAMES)], "names": NAMES}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in one.items()}
    info = {"codebase_version": "v3.0", "robot_type": "tactile_skin", "fps": int(rate)}
    info |= {"total_episodes": episodes, "total_frames": rows, "total_tasks": 1}
    info |= {"data_path": _FILE, "splits": {"train": f"0:{episodes}"}, "features": features}
    return info


def _write(episode: _Episode, folder: str) -> dict[str, np.ndarray]:
    """Write the file of an episode, some rows at a time; what its statistics need."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    def nested(values: np.ndarray):
        found = pa.array(values.ravel())
        for width in values.shape[:0:-1]:
            found = pa.FixedSizeListArray.from_arrays(found, width).cast(pa.list_(found.type))
        return found

    source = Recording(episode.path, episode.namespace)
    path = Path(folder) / _FILE.format(chunk_index=0, file_index=episode.number)
    path.parent.mkdir(parents=True, exist_ok=True)
    rows, sums = _rows(source, episode), []
    writer: Any = None
    for first in range(0, episode.rows, _AT_ONCE):
        pressure, std, state, causes = zip(*itertools.islice(rows, _AT_ONCE), strict=True)
        number = np.arange(first, first + len(causes))
        given = {PICTURE: pressure, STD: std, STATE: state}
        numbers = {name: np.array(values, np.float32) for name, values in given.items()}
        sums.append({name: _sums(values) for name, values in numbers.items()})
        table = {name: nested(values) for name, values in numbers.items()} | {
            STOP: [cause != "" for cause in causes],
            CAUSE: causes,
            "timestamp": (number / episode.rate).astype(np.float32),
            "frame_index": number,
            "episode_index": np.full(len(causes), episode.number),
            "index": episode.begin + number,
            "task_index": np.zeros(len(causes), int),
        }
        rows_of = pa.table(table)
        writer = writer or parquet.ParquetWriter(path, rows_of.schema)
        writer.write_table(rows_of)
    writer.close()
    return {name: _together([part[name] for part in sums]) for name in sums[0]}


def _rows(source: Recording, episode: _Episode) -> Iterator[_Row]:
    """Return what was known at each tick."""
    here = source.adc_topic.removesuffix(ADC)
    topics = {f"{here}skin/{name}": name for name in _KINDS}
    latest: dict[str, deque] = {name: deque(maxlen=_KEPT) for name in _KINDS}
    start, shape = source.span[0], source.skin.circuit.shape
    raw = source._messages(topics=tuple(topics))
    held = next(raw, None)
    for k in range(episode.rows):
        tick = start + round(k / episode.rate * 1e9)
        while held is not None and held[1] <= tick:
            latest[topics[source._channels[held[0]][0]]].append(held[1:])
            held = next(raw, None)
        yield _row(latest, tick, shape)


def _row(latest: dict[str, deque], tick: int, shape: tuple[int, int]) -> _Row:
    nothing = np.full(shape, np.nan, np.float32)
    state, cause = np.full(len(NAMES), np.nan), "stale: no word of the stop"
    stamp = 0
    frame: dict[str, Any] = {}
    for name, kind in _KINDS.items():
        for at, data in reversed(latest[name]):
            message: Any = cdr.decode(kind, data, like=True)
            if kind is msg.DiagnosticArray:
                if tick - at <= OLD * 1e9:
                    said = message.status[0]
                    cause = (said.message or "stopped") if said.level else ""
                break
            at = Time.from_msg(message.header.stamp).nanoseconds
            stamp = stamp or at
            if at <= stamp:
                frame |= {name: message} if at == stamp else {}
                break
    age = (tick - stamp) * 1e-9
    pressure = msg.image_array(frame["pressure"]) if "pressure" in frame else nothing
    if age > OLD or "wrench" not in frame or not np.isfinite(pressure).all():
        state[-1] = 2.0
        return nothing, nothing, state, cause or "fault: no picture"
    wrench = frame["wrench"].wrench
    vectors = wrench.force, wrench.torque, frame["centre"].point if "centre" in frame else None
    for k, vector in enumerate(filter(None, vectors)):
        state[3 * k : 3 * k + 3] = vector.x, vector.y, vector.z
    if "contacts" in frame:
        columns = msg.cloud_columns(frame["contacts"], *_EACH, "bound")
        order = np.argsort(-columns["force"])[:CONTACTS]
        contacts = np.zeros((CONTACTS, len(_EACH)))
        contacts[: len(order)] = np.column_stack([columns[name][order] for name in _EACH])
        state[9:-3] = contacts.ravel()
        state[-3] = columns["bound"].sum() if "bound" in columns else np.nan
    state[-2:] = age, "fault" in cause or "waiting" in cause
    std = msg.image_array(frame["pressure_std"]) if "pressure_std" in frame else nothing
    return pressure, std, state, cause


# --- statistics of what is no NaN, in one pass: its number, sum, squares, least and most ---


def _sums(values: np.ndarray) -> np.ndarray:
    """(n, ...) numbers -> (5, ...)."""
    known, values = np.isfinite(values), values.astype(float)
    zero, least = np.where(known, values, 0.0), np.where(known, values, np.inf).min(0)
    most = np.where(known, values, -np.inf).max(0)
    return np.array([known.sum(0), zero.sum(0), np.square(zero).sum(0), least, most])


def _together(parts: list[np.ndarray]) -> np.ndarray:
    n = np.array(parts)
    return np.concatenate([n[:, :3].sum(0), n[:, 3:4].min(0), n[:, 4:].max(0)])


def _listed(parts: list[np.ndarray], rows: int) -> dict[str, list]:
    """Return them as LeRobot names them; of what was never known zeros."""
    n, total, squares, *ends = _together(parts)
    mean, square = total / np.maximum(n, 1), squares / np.maximum(n, 1)
    least, most = (np.where(n > 0, end, 0.0) for end in ends)
    std = np.sqrt(np.maximum(square - np.square(mean), 0.0))
    found = {"min": least, "max": most, "mean": mean, "std": std, "count": np.array([rows])}
    return {name: values.tolist() for name, values in found.items()}
