"""compensation: skin/adc -> skin/pressure."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .. import network
from ..config import circuit_of, curve_of, describe, geometry_of
from ..msg import DiagnosticArray, Image, image, image_array
from ..solvers import METHODS, compensate
from . import QUEUE, diagnostics


class Compensation:
    """Publishes skin/pressure (32FC1, Pa, row-major) with the reading's stamp, and diagnostics once
    a second and whenever the status changes. A frame that fails is not published.
    """

    def __init__(self, node):
        self.node = node
        self.circuit, self.curve = circuit_of(node), curve_of(node)
        self.cell_area = geometry_of(node, self.circuit).cell_area
        self.method = node.declare_parameter(
            "method", "auto", describe(f"one of {', '.join(METHODS)}")
        ).value
        path = node.declare_parameter(
            "weights", "", describe("file of the networks' weights")
        ).value
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}: must be one of {', '.join(METHODS)}")
        self.weights = network.load(path) if path else None
        if self.weights:
            self.weights.check(self.circuit, self.curve)
        self._pressure = node.create_publisher(Image, "skin/pressure", 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)
        # Loads the weights, and says here, not in the first callback, that they do not fit.
        self._compensate(np.full(self.circuit.shape, 0.05))
        self._last = None  # the last sound frame: where the next one starts from
        self._status, self._message, self._residual = "ok", "", 0.0
        self._taken: Counter[str] = Counter()
        self._scale = 2 ** (16 - self.circuit.adc_bits) * self.circuit.full_scale
        node.create_subscription(Image, "skin/adc", self.on_adc, QUEUE)
        node.create_timer(1.0, self.report)

    def _compensate(self, adc, start=None):
        return compensate(
            adc, self.circuit, self.curve, self.method, weights=self.weights, start=start
        )

    def on_adc(self, msg: Image) -> None:
        try:
            # The low-pass may round the largest reading up by less than a step.
            adc = np.minimum(image_array(msg) / self._scale, 1.0)
            estimate = self._compensate(adc, self._last)
        except ValueError as error:
            self._judge("failed", str(error), 0.0)
            return
        self._last = estimate if estimate.status == "ok" else None
        self._taken[estimate.method] += 1
        if estimate.status != "failed":
            pressure = estimate.force / self.cell_area
            self._pressure.publish(image(pressure, "32FC1", msg.header))
        self._judge(estimate.status, estimate.message, estimate.residual)

    def _judge(self, status: str, message: str, residual: float) -> None:
        changed = status != self._status
        self._status, self._message, self._residual = status, message, residual
        if changed:
            self.report()

    def report(self) -> None:
        levels = {"ok": diagnostics.OK, "suspect": diagnostics.WARN, "failed": diagnostics.ERROR}
        values = {"residual": f"{self._residual:.3f}", "method": self.method}
        values |= {f"frames_{name}": n for name, n in self._taken.items()}
        message = self._message or self._status
        self._diagnostics.publish(
            diagnostics.report(self.node, levels[self._status], message, values)
        )
