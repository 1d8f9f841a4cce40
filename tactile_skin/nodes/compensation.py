"""compensation: skin/adc -> skin/pressure."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .. import network
from ..bus import Time
from ..config import circuit_of, curve_of, describe, geometry_of
from ..converter import Ceiling
from ..curve import GRAM
from ..doubt import Doubt
from ..msg import DiagnosticArray, Image, Trigger, image, image_array
from ..solvers import METHODS, Estimate, compensate
from ..tare import Tare
from . import QUEUE, diagnostics

_IDLE = 15.0 * GRAM  # N on a cell: below it nothing touches; lines shorted at rest read as 13 g
_FEWEST = 3  # rows and columns; with fewer some faults look like touches: docs/reliability.md
_CORNER = 4  # suspect or failed frames in a row after which the last one is no start


class Compensation:
    """Publishes skin/pressure (32FC1, Pa, row-major) with the reading's stamp, and diagnostics once
    a second and whenever the level changes: WARN for a suspect frame, ERROR, which stops the
    robot, for a failed one and while they are suspect too often (doubt.py). A frame that fails is
    not published. What the cells conduct at rest is measured between touches (`Tare`). Until the
    first time, a second after the start, a fabric whose cells differ is suspect, and a skin of
    which half was loaded from the first frame on is an ERROR until it is let go. The service
    `~/reset` forgets faults that the last frames no longer show, says so on diagnostics before it
    answers, and forgets the last frame, from which the next one starts.
    """

    def __init__(self, node):
        self.node = node
        self.circuit, curve = circuit_of(node), curve_of(node)
        self._tare = Tare(self.circuit, curve)
        self.cell_area = geometry_of(node, self.circuit).cell_area

        def value(name, default, *bounds):
            return node.declare_parameter(name, default, describe(*bounds)).value

        method = value("method", "auto", f"one of {', '.join(METHODS)}")
        path = value("weights", "", "file of a network's weights; empty: the shipped ones")
        threshold = value(
            "threshold",
            0.0,
            "ADC steps up to which the board sends 0 or nothing true",
            0.0,
            65535.0,
        )
        noise = value(
            "noise", 0.0, "RMS noise of a reading [ADC steps]; 0: told from the readings", 0.0, 1e3
        )
        time_limit = value("time_limit", 0.05, "after which a frame is given up [s]", 1e-4, 10.0)
        # Where the board keeps readings to itself, rest cannot be measured.
        self._follows = (
            value("tare", True, "whether to follow what the cells read at rest") and not threshold
        )
        self._stops = value("suspect_stops", True, "whether lasting suspicion stops the robot")
        if min(self.circuit.shape) < _FEWEST:
            node.get_logger().warning(
                'on a skin of %d x %d cells some faults look like touches: see "Smallest skin" in '
                "docs/reliability.md",
                *self.circuit.shape,
            )
        if method not in METHODS:
            raise ValueError(f"method = {method!r}: must be one of {', '.join(METHODS)}")
        weights = network.load(path) if path else None
        if weights:
            weights.check(self.circuit, curve)
        self._method = method
        self._arguments = {
            "weights": weights,
            "threshold": threshold / self.circuit.full_scale,
            "time_limit": time_limit,
            "noise": noise or None,
        }
        self._pressure = node.create_publisher(Image, "skin/pressure", 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, diagnostics.TOPIC, 10)
        self._last: Estimate | None = None  # the last frame: where the next starts from
        self._doubts = 0
        self._doubt, self._fault, self._why = Doubt(), False, ""
        self._ceiling, self._saturated = Ceiling(self.circuit.adc_bits), ""
        self._at_rest = not self._follows  # whether the whole skin was at rest in any frame
        self._loaded = ""  # since the start, where
        self._level, self._message, self._residual = diagnostics.OK, "ok", 0.0
        self._status, self._present = "ok", ""  # of the last frame, and what is said of it
        self._taken: Counter[str] = Counter()
        self._scale = 2 ** (16 - self.circuit.adc_bits) * self.circuit.full_scale
        # Loads the weights, and says here, not in the first callback, that they do not fit.
        self._compensate(np.full(self.circuit.shape, 0.05))
        node.create_subscription(Image, "skin/adc", self.on_adc, QUEUE)
        node.create_service(Trigger, "~/reset", self.on_reset)
        node.create_timer(1.0, self.report)

    def _compensate(self, adc) -> Estimate:
        return compensate(
            adc, self.circuit, self._tare.curve, self._method, start=self._last, **self._arguments
        )

    def on_adc(self, msg: Image) -> None:
        try:
            # The low-pass may round the largest reading up by less than a step.
            samples = image_array(msg)
            adc = np.minimum(samples / self._scale, 1.0)
            estimate = self._compensate(adc)
        except ValueError as error:
            self._status, self._present = "failed", str(error)
            self._judge(self._status, self._present)
            return
        # A touch that comes or goes leaves a few suspect frames, as the board's low-pass mixes
        # scans: they are next to the truth. More in a row may sit in a corner: start anew, unless
        # it is known what is wrong.
        in_doubt = estimate.status != "ok" and estimate.r_par is None
        self._doubts = self._doubts + 1 if in_doubt else 0
        self._last = estimate if self._doubts < _CORNER else None
        self._taken[estimate.method] += 1
        self._residual = estimate.residual
        t = Time.from_msg(msg.header.stamp).nanoseconds / 1e9
        if estimate.status != "failed":
            if self._follows and self._tare.update(t, adc, estimate.force):
                self._last = None
            pressure = estimate.force / self.cell_area
            self._pressure.publish(image(pressure, "32FC1", msg.header))
        touched = estimate.force.max() >= _IDLE
        suspect = estimate.status == "suspect"
        self._fault = self._doubt.frame(t, suspect, touched)
        self._why = estimate.message if suspect else self._why
        kept = f"{self._why} ({self._doubt.kept})" if self._doubt.kept else ""
        self._saturated = self._ceiling.frame(samples)
        self._status, self._present = estimate.status, estimate.message
        if not self._at_rest:
            half = np.median(estimate.force[self.circuit.populated]) >= _IDLE
            self._at_rest, self._loaded = not touched, _where(estimate.force) if half else ""
        words = self._loaded, self._saturated, estimate.message or kept, self._tare.message
        self._judge(estimate.status, "; ".join(filter(None, words)))

    def on_reset(self, _, response):
        self._last = None
        self._doubt.reset()
        self._fault, self._saturated = self._doubt.present, self._ceiling.forget()
        words = self._saturated, self._present, self._tare.message
        self._judge(self._status, "; ".join(filter(None, words)))
        self.report()  # whoever asks the stop next finds it said
        response.success, response.message = True, "faults that are past are forgotten"
        return response

    def _judge(self, status: str, message: str) -> None:
        level = diagnostics.OK if status == "ok" and not message else diagnostics.WARN
        if status == "failed" or ((self._fault or self._saturated or self._loaded) and self._stops):
            level = diagnostics.ERROR
        if message or level == diagnostics.OK:
            self._message = message or "ok"
        changed, self._level = level != self._level, level
        if changed:
            self.report()

    def report(self) -> None:
        values = {"residual": f"{self._residual:.3f}", "method": self._method}
        values["tare"] = self._tare.message or ("ok" if self._follows else "off")
        values |= {f"frames_{name}": n for name, n in self._taken.items()}
        self._diagnostics.publish(diagnostics.report(self.node, self._level, self._message, values))


def _where(force: np.ndarray) -> str:
    """What to say of a skin that has been loaded from its first frame on."""
    row, col = np.unravel_index(force.argmax(), force.shape)
    return (
        f"the skin is loaded since the start, most at row {row}, column {col}: take the load off, "
        "so that what the cells read at rest can be measured"
    )
