# SPDX-License-Identifier: Apache-2.0
"""Recordings for the tests, made without a skin."""

import numpy as np

from tactile_skin.msg import Header, Time, image
from tactile_skin.recording import cdr
from tactile_skin.recording.writer import Writer

START = 1_700_000_000_000_000_000  # ns since 1970


def stamp(k: int, rate: float = 100.0) -> int:
    return START + round(k * 1e9 / rate)


def samples(n: int, rows: int = 4, cols: int = 5, seed: int = 0) -> np.ndarray:
    """(n, rows, cols) of skin/adc at 10 bits."""
    return np.random.default_rng(seed).integers(0, 1024, (n, rows, cols), np.uint16) * 64


def adc_image(frame, t: int):
    return image(frame, "16UC1", Header(Time(*divmod(t, 10**9)), "base_link"))


def write(path, frames, attachments=None, topic="/skin/adc", chunk=10, close=True):
    """A recording of readings at 100 Hz, with a chunk for each `chunk` of them."""
    writer = Writer(path, attachments or {}, START)
    for k, frame in enumerate(frames):
        message = adc_image(frame, stamp(k))
        writer.write(topic, type(message), stamp(k), cdr.encode(message))
        if k % chunk == chunk - 1:
            writer.flush()
    if close:
        writer.close()
    return path
