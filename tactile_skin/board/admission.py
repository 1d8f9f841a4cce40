# SPDX-License-Identifier: Apache-2.0
"""Whether a frame is a measurement of the configured board: its size, its life, what it reads."""

from __future__ import annotations

import numpy as np

from ..physics.adc import Adc
from .absent import Absent, Unread
from .frame import Frame
from .liveness import Liveness, Verdict

_NEW = Verdict(0.0, True, "")  # before the first frame


class Admission:
    """Judges the frames of a board, connection by connection.

    Args:
        adc: the board's converter, with its circuit.
        frozen_after: how long frames may repeat [s], as `Liveness` has it.

    Attributes:
        trouble: why the last frame is no measurement; empty if it is one.
        verdict, unread: what was found of the last frame.
    """

    def __init__(self, adc: Adc, frozen_after: float):
        self._adc, self._circuit, self._frozen_after = adc, adc.circuit, frozen_after
        self.forget()
        self.connect(0)

    def connect(self, restarts: int) -> None:
        """Begin with another connection; `restarts`: of the board, counted so far."""
        circuit, scanned = self._circuit, self._adc.scanned
        named = np.zeros(circuit.shape, bool) if scanned is None else ~scanned
        self._liveness = Liveness(circuit.shape, self._frozen_after)
        self._absent, self._restarts = Absent(named, circuit.populated), restarts

    def forget(self) -> None:
        """Forget the last frame."""
        self.trouble, self.verdict, self.unread = "", _NEW, Unread()

    def frame(self, t: float, frame: Frame, restarts: int) -> np.ndarray | None:
        """Take a frame.

        Args:
            t: when it arrived, of a monotonic clock [s].
            restarts: of the board, counted so far.

        Returns:
            (rows, cols) of skin/adc; None: it is no measurement, or may be old.
        """
        self.trouble = self.refuse(frame)
        if not self.trouble:
            before, self._restarts = self._restarts, restarts
            self.verdict = self._liveness.frame(t, frame, restarts > before)
            self.unread = self._absent.frame(frame.samples, frame.unread)
            self.trouble = self.verdict.trouble or (self.unread.text if self.unread.blind else "")
        if self.trouble or not self.verdict.settled:
            return None
        return self._adc.marked(frame.samples, frame.unread)

    def refuse(self, frame: Frame) -> str:
        """Return why the frame is not of the configured board; empty if it is."""
        circuit, (rows, cols) = self._circuit, frame.samples.shape
        sent = {"rows": rows, "cols": cols, "adc_bits": frame.adc_bits}
        wrong = {k: v for k, v in sent.items() if v != getattr(circuit, k)}
        if not wrong:
            return ""
        settings = ", ".join(f"circuit.{k}: {v}" for k, v in wrong.items())
        return (
            f"the board sends {rows} x {cols} at {frame.adc_bits} bits, the configuration says "
            f"{circuit.rows} x {circuit.cols} at {circuit.adc_bits} bits: set {settings}"
        )
