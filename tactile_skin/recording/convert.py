# SPDX-License-Identifier: Apache-2.0
"""Readings to other formats: NumPy, CSV, and MCAP from a foreign board's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError
from ..middleware.config import SkinConfig
from ..middleware.parameter_file import ParameterFile
from ..msg import Header, Image, Time, image
from . import cdr, configuration
from .frames import Frames
from .reader import ADC, Recording
from .writer import Writer

EXPORTS = (".npy", ".npz", ".csv")
_NODES = "serial_driver", "compensation", "gesture_feature", "stop_on_push"
_PRESSURE = "skin/pressure"


def export(source: Recording | Frames, frames: Frames, path) -> None:
    """Write readings to a new file, for programs that know nothing of ROS.

    .npy: (n, rows, cols) [ADC steps], NaN: not read. .npz: the same as `frames` with `times` [s],
    and, where the source has them, `pressure` [Pa] with `pressure_times`. .csv: a line for each
    frame, its time in front, a header above.

    Raises:
        FileError: another kind of file, or it is there already.
        OSError: it cannot be written.
    """
    path = Path(path)
    if path.suffix not in EXPORTS:
        raise FileError(f"{path}: must be one of {', '.join(EXPORTS)}")
    if path.exists():
        raise FileError(f"{path}: is there already: must be a new file")
    values, times = frames.values, frames.times
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".npz":
        # Any: to NumPy's stub a name may also be one of its options
        arrays: dict[str, Any] = {"frames": values} | ({} if times is None else {"times": times})
        if isinstance(source, Recording):
            topic = source.adc_topic.removesuffix(ADC) + _PRESSURE
            if topic in source.topics:
                stamps, arrays["pressure"] = source.images(topic)
                arrays["pressure_times"] = (stamps - source.stamps[0]) * 1e-9
        np.savez_compressed(path, **arrays)
    else:
        n, rows, cols = values.shape
        names = [f"row{r}_col{c}" for r in range(rows) for c in range(cols)]
        table = values.reshape(n, -1)
        if times is not None:
            names, table = ["time_s", *names], np.column_stack([times - times[0], table])
        np.savetxt(path, table, "%.10g", ",", header=",".join(names), comments="")


def to_recording(frames: Frames, path, skin: SkinConfig, config, rate: float, start: int) -> None:
    """Make a recording of skin/adc from the frames of a foreign board.

    Args:
        config: parameter file to attach; None: none.
        rate: frames a second, of frames without times.
        start: stamp of the first frame [ns since 1970].

    Raises:
        FileError: the file is there already, or numbers are beyond the ADC's range.
        ValueError: the rate is not above 0.
        OSError: it cannot be written.
    """
    if not 0.0 < rate < np.inf:
        raise ValueError(f"rate = {rate!r}: must be above 0")
    values = {}
    if config:
        file = ParameterFile(config)
        values = {f"/{n}": {p.name: p.value for p in file.overrides(f"/{n}")} for n in _NODES}
    times = np.arange(len(frames.values)) / rate if frames.times is None else frames.times
    writer = Writer(path, configuration.attachments(values) if values else {}, start)
    try:
        for t, samples in zip(times - times[0], frames.samples(skin.adc), strict=True):
            stamp = start + round(float(t) * 1e9)
            header = Header(Time(*divmod(stamp, 10**9)), "base_link")
            data = cdr.encode(image(samples, "16UC1", header))
            writer.write(f"/{ADC}", Image, stamp, data)
    finally:
        writer.close()
