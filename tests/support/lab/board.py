# SPDX-License-Identifier: Apache-2.0
"""A board that can be damaged: its matrix in time, its low-pass, its bytes, its link.

A fault (damage.py) changes attributes of it, at any time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactile_skin.board import protocol as wire
from tactile_skin.physics.circuit import Circuit
from tactile_skin.physics.curve import PressureCurve

from .parts import SCANS, BadConverter, BadMatrix

KNOTS = 100  # a second: the force is given, and the network solved, so often
RATE = 100  # frames a second, at most
BAUD = 1_000_000  # what the link carries limits the frames of a large skin
BINARY, TEXT = "binary", "text"
BOTH = (BINARY, TEXT)
READOUTS = ("low-pass", "single", "mean of 4")  # what a frame is made of: scans
_HISTORY = 100  # frames kept for a board that repeats them: 1 s


@dataclass
class Sent:
    """A frame on its way out of the board; samples in ADC steps * 2**fraction bits."""

    t: float  # s, when its last scan ended
    samples: np.ndarray
    sequence: int
    device_us: int


class FaultBoard:
    """Fabric, wiring, ADC, low-pass and framing of one board, and the link that carries its bytes.

    Args:
        circuit, curve: the skin's configuration; the true cells scatter about it.
        noise: RMS of a sample [ADC steps].
        protocol: "binary" or "text" (whole steps, no checksum).
        readout: one of READOUTS.

    Attributes:
        matrix, converter: as they truly are.
        damaged_at: time at which the damage began [s]; the converter's drift is given the time
            since.
        kept: (rows, cols) bool, samples that are never updated again.
        shift: number of samples by which the frame is off.
        tamper: takes each Sent; gives the one that goes out, or None.
        link: takes (t, bytes); gives what arrives, and when: a list of such pairs.
    """

    def __init__(
        self,
        circuit: Circuit,
        curve: PressureCurve,
        rng,
        noise: float = 1.0,
        protocol: str = "binary",
        readout: str = "low-pass",
    ):
        if readout not in READOUTS:
            raise ValueError(f"readout {readout!r}: must be one of {', '.join(READOUTS)}")
        self.circuit, self.curve, self.rng = circuit, curve, rng
        self.protocol, self.readout = protocol, readout
        self.matrix = BadMatrix.everyday(circuit, curve, rng)
        self.converter = BadConverter(
            circuit.full_scale,
            noise,
            extra_noise=np.zeros(circuit.shape),
            and_mask=circuit.full_scale,
        )
        self.kept = np.zeros(circuit.shape, bool)
        self.shift = 0
        self.tamper: Callable[[Sent], Sent | None] = lambda sent: sent
        self.link: Callable = lambda t, data: [(t, data)]
        self.damaged_at = 0.0  # s
        self.pushes: list[tuple[float, float]] = []  # start and end of those that will come [s]
        self.history: deque[Sent] = deque(maxlen=_HISTORY)
        self.fraction_bits = min(6, 16 - circuit.adc_bits) if protocol == "binary" else 0
        cells = circuit.rows * circuit.cols
        worst = 17 + 2 * cells if protocol == "binary" else 5 * cells + 1  # bytes a frame
        self.rate = min(RATE, BAUD / 10 / worst)
        self.on_the_way = worst * 10 / BAUD  # s, the longest that a frame's bytes take
        self._knots = self._scans = self._frames = 0
        self._last_ratio: np.ndarray | None = None
        self._filtered: np.ndarray | None = None
        self._recent: deque[np.ndarray] = deque(maxlen=4)

    @property
    def t(self) -> float:
        return self._knots / KNOTS

    def ratio(self, force: np.ndarray) -> np.ndarray:
        """(n, rows, cols) [N] -> ADC ratio that the wires carry to the converter, before noise."""
        moving = force.any((1, 2)) | self.matrix.fabric.unsteady
        ratio = np.empty(force.shape)
        for part, scenes in ((moving, force[moving]), (~moving, force[~moving][:1])):
            if part.any():  # rest is solved once
                ratio[part] = self.matrix.ratio(scenes)
        return ratio

    def advance(self, force: np.ndarray) -> list[tuple[float, bytes]]:
        """Take the force at the next knots, (n, rows, cols) [N]: what arrives, and when [s]."""
        ratio = self.ratio(force)
        first = ratio[:1] if self._last_ratio is None else self._last_ratio[None]
        ratio, start = np.concatenate([first, ratio]), self._knots
        self._last_ratio = ratio[-1]
        self._knots += len(force)
        rows = self.circuit.rows
        last = int(self._knots / KNOTS * SCANS)
        scans = np.arange(self._scans, last)
        self._scans = last
        # a row's readings are made when the scan has come to it
        at = (scans[:, None] + np.arange(rows) / rows) / SCANS * KNOTS - start
        knot = np.clip(np.floor(at).astype(int), 0, len(force) - 1)
        part = np.clip(at - knot, 0.0, 1.0)[..., None]
        row = np.arange(rows)
        seen = (1.0 - part) * ratio[knot, row] + part * ratio[knot + 1, row]
        arriving = []
        since = np.maximum(scans / SCANS - self.damaged_at, 0.0)
        samples = self.converter.count(seen, self.rng, since)
        for scan, sample in zip(scans, samples, strict=True):
            arriving += self._take(int(scan), sample)
        return arriving

    def _take(self, scan: int, sample: np.ndarray) -> list[tuple[float, bytes]]:
        """One scan: the low-pass, and the frame if one is due."""
        self._recent.append(sample)
        if self.readout == "low-pass":
            sample = sample << 6  # the fraction of the board's arithmetic
        before = sample if self._filtered is None else self._filtered
        if self.readout == "low-pass":
            sample = before + ((3 * (sample - before)) >> 3)
        if self.kept.any():
            sample = np.where(self.kept, before, sample)
        self._filtered = sample
        due = int((scan + 1) * self.rate / SCANS)
        if due == self._frames:
            return []
        self._frames = due
        if self.readout == "low-pass":
            drop = 6 - self.fraction_bits
            samples = (sample + (1 << drop >> 1)) >> drop
        elif self.readout == "mean of 4":
            samples = sum(self._recent) / len(self._recent) * 2**self.fraction_bits
            samples = np.where(self.kept, sample << self.fraction_bits, np.rint(samples))
        else:
            samples = sample << self.fraction_bits
        if self.shift:
            samples = np.roll(samples.ravel(), self.shift).reshape(samples.shape)
        t = (scan + 1) / SCANS
        sent = Sent(t, samples.astype(np.int64), due - 1, round(t * 1e6))
        self.history.append(sent)
        out = self.tamper(replace(sent))
        return [] if out is None else self.link(out.t + self.on_the_way, self.encode(out))

    def encode(self, sent: Sent) -> bytes:
        """Return the frame's bytes."""
        if self.protocol == "text":
            return b",".join(b"%d" % v for v in sent.samples.ravel().tolist()) + b"\r\n"
        return wire.encode(
            sent.sequence, sent.device_us, sent.samples, self.circuit.adc_bits, self.fraction_bits
        )


@dataclass(frozen=True)
class Fault:
    """One fault, as it is done to a board."""

    # name, about: for tables, and one line for docs
    name: str
    about: str
    # changes the board at the moment of the fault; may draw from board.rng
    damage: Callable[[FaultBoard], None]
    # none of the data that comes can be trusted: the robot must be stopped at once
    must_stop: bool = False
    # the data is good again after a while, so that the robot may be free again
    live_again: bool = False
    protocols: tuple[str, ...] = (BINARY,)  # on which it can happen
    stalls: bool = False  # whether it needs pushes that begin while the link stalls
