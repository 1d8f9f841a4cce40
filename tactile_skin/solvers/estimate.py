"""What every method returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Estimate:
    """What `compensate` found in one frame.

    Attributes:
        force: (rows, cols) force on each cell [N].
        std: (rows, cols) one standard deviation of `force` [N].
        residual: RMS misfit between the reading and the circuit model of `force`, in ADC steps.
        status: "ok", "suspect" (the circuit model does not explain the reading) or "failed".
        message: why, for a person; empty when ok.
        method: the method that was used ("auto" names its choice).
        iterations: steps that it took; 0 for a closed form.
        r_par: series resistance [ohm] with which `force` explains the reading, where the circuit's
            does not; None: it does, or none was sought.
    """

    force: np.ndarray
    std: np.ndarray
    residual: float
    status: str
    message: str
    method: str
    iterations: int
    r_par: float | None = None
