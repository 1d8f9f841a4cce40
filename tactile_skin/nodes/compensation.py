"""compensation: skin/adc -> skin/pressure."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from ..board.converter import Ceiling, RestPicture, Windows
from ..calibration.creep import Standing
from ..calibration.doctor.running import RunningDoctor
from ..calibration.noise import Noise
from ..calibration.tare import Tare
from ..calibration.tracker import CircuitTracker
from ..calibration.watch.cells import Cells
from ..calibration.watch.doubt import Doubt
from ..calibration.watch.untouched import Untouched
from ..learning import network
from ..middleware.bus import DurabilityPolicy, QoSProfile, Time
from ..middleware.config import adc_of, circuit_of, creep_of, curve_of, describe, geometry_of
from ..msg import Header, Image, TimeReference, Trigger, image, image_array
from ..physics.circuit import forward
from ..physics.curve import GRAM
from ..solvers import METHODS, Estimate, compensate
from ..solvers.reading import ROUNDING_NOISE, SCAN_NOISE, rest_reading
from . import QUEUE, diagnostics
from .gesture_feature import heard

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_IDLE = 15.0 * GRAM  # N on a cell: below it nothing touches; lines shorted at rest read as 13 g
_LIGHT, _STIRRED = 1.0 * GRAM, 3  # N on so many cells: a touch that begins, not noise
_MIN_LINES = 3  # rows and columns; with fewer some faults look like touches: docs/reliability.md
_FULL = 2.0  # s for which half of the cells may be loaded without a warning
_NO_REST = "half of the skin is loaded: too few cells are at rest to check the circuit"
_HOLD = 1.0  # s for which a reason is kept at least, while the robot is stopped for one
_NUMBER = re.compile(r"-?\d+(\.\d+)?")  # in two reasons alike but for their numbers
_LEARNED = "cnn", "physics"  # methods that use weights
_RESTART_AFTER = 4  # suspect or failed frames in a row after which the last one is no start
# s that a reading has waited from which on `auto` takes the fixed point: under a palm it takes a
# tenth of the time, and errs by twice as much. Less than four frames of the fastest boards.
_LATE, _FAST = 0.01, "fixed_point"
_FULL_FIT = 0.1  # s after a full fit until the next, however late: only that tests the circuit
# s from which on a reading is old news, and apart that old ones are taken: half of `stale_after`,
# and often enough for the stop to know that there are readings
_OLD, _APART = 0.05, 0.02
_ASIDE = 3  # times in a second that a reading is set aside: a sound board's is once a minute


class Compensation:
    """Publishes skin/pressure (32FC1, Pa, row-major) with the reading's stamp; skin/taken, when it
    took each reading up, from which a replay knows which were late; skin/rest (32FC1, the
    resistance of each cell at rest, ohm) once it was measured; and diagnostics once a second
    and whenever the level changes: WARN for a suspect frame, ERROR, which stops the robot, for a
    failed one and while they are suspect too often (doubt.py). A frame that fails is not published.
    What the cells conduct at rest is measured between touches (`Tare`). Until the
    first time, a second after the start, what would be a fault is "measuring rest: hands off", and
    so is a skin of which half was loaded from the first frame on, until it is let go. The service
    `~/reset` forgets faults that the last frames no longer show, says so on diagnostics before it
    answers, and forgets the last frame, from which the next one starts; `~/tare` measures the rest
    anew, as at the start, and is refused while something presses or a fault is kept. Behind by
    10 ms, `auto` takes the fixed point, which says nothing of the circuit; ten frames a second are
    fitted in full all the same. Behind by half of what the stop bears, old frames are skipped to
    come to the new ones, and diagnostics count them.
    What a standing load gains by creep is taken out of what is published, if the curve says how
    much, and of nothing else.
    """

    def __init__(self, node):
        self.node = node
        self.circuit = circuit_of(node)
        curve = curve_of(node, self.circuit)
        self._adc = adc_of(node, self.circuit)
        self._curve = curve
        self._tare, self._tracker = Tare(self.circuit, curve), CircuitTracker(self.circuit)
        creep = creep_of(node)
        self._standing = Standing(creep, curve) if creep.share else None
        self.cell_area = geometry_of(node, self.circuit).cell_area

        def value(name, default, *bounds):
            return node.declare_parameter(name, default, describe(*bounds)).value

        described = describe(f"one of {', '.join(METHODS)}", read_only=False)
        method = node.declare_parameter("method", "auto", described).value
        path = value("weights", "", "file of a network's weights; empty: those of the package")
        text = "ADC steps up to which the board sends 0 or no reading"
        threshold = value("threshold", 0.0, text, 0.0, 65535.0)
        noise = value("noise", 0.0, "RMS noise of a reading [ADC steps]; 0: measured", 0.0, 1e3)
        time_limit = value("time_limit", 0.05, "time after which a frame fails [s]", 1e-4, 10.0)
        # Where the board keeps readings to itself, rest cannot be measured.
        self._follows = (
            value("tare", True, "whether to follow what the cells read at rest") and not threshold
        )
        self._stops = value(
            "suspect_stops", True, "whether a lasting fault of the circuit stops the robot"
        )
        if min(self.circuit.shape) < _MIN_LINES:
            node.get_logger().warning(
                'on a skin of %d x %d cells some faults look like touches: see "Smallest skin" in '
                "docs/reliability.md",
                *self.circuit.shape,
            )
        self._weights = network.load(path) if path else None
        if self._weights:
            self._weights.check(self.circuit, curve)
        self._arguments = {
            "threshold": self._adc.threshold(threshold),
            "time_limit": time_limit,
            "noise": self._adc.share(noise) * self.circuit.full_scale or None,
        }
        self._pressure = node.create_publisher(Image, "skin/pressure", 10)
        self._taken_up = node.create_publisher(TimeReference, "skin/taken", 10)
        self._diagnostics = diagnostics.Reporter(node)
        self._rest = node.create_publisher(Image, "skin/rest", LATCHED)
        self._noise = Noise(self.circuit.populated)
        self._cell_count = np.count_nonzero(self.circuit.populated)
        self._last: Estimate | None = None  # the last frame: where the next starts from
        self._doubts = 0
        self._doubt, self._fault, self._why = Doubt(), False, ""
        short_circuit = self._adc.rising_count(float(self.circuit.ratio(0.0)))
        self._windows = Windows(self.circuit.adc_bits)
        top = self.circuit.full_scale if self._adc.inverted else None
        self._ceiling, self._saturated = Ceiling(self.circuit.adc_bits, short_circuit, top), ""
        self._picture, self._dead = RestPicture(), ""
        self._cells, self._odd = Cells(self.circuit.shape), ""
        self._untouched = Untouched(self.circuit)
        self._doctor = RunningDoctor()
        self._full_since = np.inf  # s, since when half of the cells or more have been loaded
        self._said = -np.inf  # s, when the message was new
        self._waits, self._waiting = self._follows, False  # until rest was measured; a stop for it
        self._at_rest = not self._follows  # whether the whole skin was at rest in any frame
        self._loaded = ""  # since the start, where
        self._level, self._message, self._residual = diagnostics.OK, "ok", 0.0
        self.status, self._present = "ok", ""  # of the last frame, and its message
        self._present_force = 0.0  # N, on its strongest cell
        self._taken: Counter[str] = Counter()
        self._taken_at, self.skipped = -np.inf, 0  # s, when the last frame was taken; frames
        self._fitted_at = -np.inf  # s, when the last one was that the configured method took
        self._aside: Counter[tuple[int, int]] = Counter()  # since the last report
        self._bad: tuple[int, int] | None = None  # of these, most often in an earlier second
        self._contact = ""  # a bad one that the last second showed
        self.on_parameters({"method": method})
        node.on_set_parameters(self.on_parameters)
        node.create_subscription(Image, "skin/adc", self.on_adc, QUEUE)
        node.create_service(Trigger, "~/reset", self.on_reset)
        node.create_service(Trigger, "~/tare", self.on_tare)
        node.create_timer(1.0, self.on_second)

    def on_parameters(self, values: dict) -> None:
        """Another method from the next frame on."""
        method = values["method"]
        if method not in METHODS:
            raise ValueError(f"method = {method!r}: must be one of {', '.join(METHODS)}")
        weights, missing = self._weights if method in _LEARNED else None, method in ("map", "auto")
        given = self._arguments | {"weights": weights, "missing": missing}
        # Loads the weights, and says here, not in the callback of a frame, that they do not fit.
        flat = np.full(self.circuit.shape, 0.05)
        compensate(flat, self.circuit, self._tare.curve, method, **given)
        self._method, self._arguments, self._last = method, given, None
        self._hurries = method == "auto" and not given["threshold"]

    def _compensate(self, adc, late: bool = False) -> Estimate:
        given = dict(self._arguments)
        if given["noise"] is None and self._noise.each is not None:
            given["noise"] = np.maximum(self._noise.each, ROUNDING_NOISE)
        method = _FAST if late else self._method
        return compensate(adc, self.circuit, self._tare.curve, method, start=self._last, **given)

    def on_adc(self, msg: Image) -> None:
        clock = self.node.get_clock().now()
        if heard(self._taken_up):
            name = diagnostics.name_of(self.node)
            self._taken_up.publish(TimeReference(msg.header, clock.to_msg(), name))
        now, t = clock.nanoseconds / 1e9, Time.from_msg(msg.header.stamp).nanoseconds / 1e9
        if now - t > _OLD and 0.0 <= now - self._taken_at < _APART:
            self.skipped += 1
            return
        self._taken_at = now
        try:
            samples = image_array(msg)
            adc = self._adc.ratio_of(samples)
            late = (
                now - t > _LATE
                and 0.0 <= now - self._fitted_at < _FULL_FIT
                and self._hurries
                and not np.isnan(adc[self.circuit.populated]).any()
            )
            self._fitted_at = self._fitted_at if late else now
            estimate = self._compensate(adc, late)
        except ValueError as error:
            self.status, self._present = "failed", str(error)
            self._update_level(self.status, self._present)
            return
        # A touch that comes or goes leaves a few suspect frames, as the board's low-pass mixes
        # scans: they are close to the truth. More in a row may be a bad local fit: start anew,
        # unless the fault is known.
        in_doubt = estimate.status != "ok" and estimate.r_par is None and not late
        self._doubts = self._doubts + 1 if in_doubt else 0
        self._last = estimate if self._doubts < _RESTART_AFTER else None
        self._taken[estimate.method] += 1
        self._residual = estimate.residual
        if estimate.status != "failed":
            if self._follows and self._tare.update(
                t, self._fill_unread(adc, estimate), estimate.force
            ):
                self._last = None
            if self._waits and self._tare.measured:  # earlier doubts no longer count
                self._waits, self._doubt, self._doctor = False, Doubt(), RunningDoctor()
            force = estimate.force
            if self._standing:
                force = self._standing.update(t, force)
            pressure = force / self.cell_area
            self._pressure.publish(image(pressure, "32FC1", msg.header))
        self._present_force = float(estimate.force.max())
        touched = self._present_force >= _IDLE
        suspect = estimate.status == "suspect"
        if suspect or not late:
            self._fault = self._doubt.frame(t, suspect, touched)
        self._why = estimate.message if suspect else self._why
        kept = f"{self._why} ({self._doubt.kept})" if self._doubt.kept else ""
        samples = self._adc.rising(samples)
        self._saturated = self._ceiling.frame(samples)
        if (window := self._windows.frame(samples)) is not None:
            self._saturated = self._ceiling.window(window)
            if self._tare.measured:
                rest = rest_reading(self.circuit, self._tare.curve)
                self._dead = self._picture.window(window, rest * self.circuit.full_scale)
        stirs = touched or np.count_nonzero(estimate.force > _LIGHT) >= _STIRRED
        self._noise.frame(t, adc * self.circuit.full_scale, stirs)
        if self._tare.measured:
            noise = (self._noise.rms or SCAN_NOISE) / self.circuit.full_scale
            rest = rest_reading(self.circuit, self._tare.curve)
            self._untouched.frame(t, adc, stirs, rest, noise)
        self._odd = self._noisy_cells() or self._cells.frame(t, estimate.force)
        if estimate.aside is not None:
            self._aside.update(map(tuple, np.argwhere(estimate.aside)))
        self.status, self._present = estimate.status, estimate.message
        half = 2 * np.count_nonzero(estimate.force >= _IDLE) > self._cell_count
        self._full_since = min(self._full_since, t) if half else np.inf
        if not self._at_rest:
            self._at_rest, self._loaded = not touched, _where(estimate.force) if half else ""
        elif t - self._full_since > _FULL:
            self._odd = self._odd or _NO_REST
        self._learn_circuit(t, adc, touched)
        self._update_level(estimate.status, self._join_reasons(estimate.message or kept))
        self._doctor.frame(t, adc, self._level == diagnostics.ERROR)

    def _learn_circuit(self, t: float, adc: np.ndarray, touched: bool) -> None:
        """What touches tell of r_par and r_line; worked out while none is there, or a stop is.

        A network knows the circuit of its training, and no other.
        """
        if not (self._follows and self._tare.measured) or self._method in _LEARNED:
            return
        noise = max(self._noise.rms or SCAN_NOISE, ROUNDING_NOISE)
        if touched:
            self._tracker.offer(t, adc, noise)
        if touched and not self._tracker.overdue(t, self._level == diagnostics.ERROR):
            return
        try:
            if self._tracker.ask(self._tare.curve, noise):
                self._tare.suppose(self._tracker.circuit)
                self.circuit, self._last = self._tracker.circuit, None
                self._untouched.forget()  # it is explained
        except ValueError as error:  # no skin rests so with what was found: begin anew
            self.node.get_logger().warning("r_par and r_line were not found: %s", error)
            self._tracker = CircuitTracker(self.circuit)

    def _fill_unread(self, adc: np.ndarray, estimate: Estimate) -> np.ndarray:
        """The frame with the model's value at crossings that were not read."""
        unread = np.isnan(adc)
        if not unread.any():
            return adc
        model = forward(self.circuit, self._tare.curve.resistance(estimate.force))
        return np.where(unread, model, adc)

    def on_reset(self, _, response):
        self._last = None
        self._doubt.reset()
        self._untouched.forget()
        self._fault, self._saturated = self._doubt.present, self._ceiling.forget()
        self._update_level(self.status, self._join_reasons(self._present))
        self.report()  # the stop must know before it is reset
        response.success, response.message = True, "past faults are cleared"
        return response

    def on_tare(self, _, response):
        if not self._follows:
            response.message = "the tare is off: see `tare` and `threshold`"
        elif self._present_force >= _IDLE:
            response.message = f"something presses with {self._present_force:.2g} N on a cell"
        elif self._doubt.held:
            response.message = f"a fault is kept ({self._why}): reset first"
        else:
            self._tare = Tare(self.circuit, self._curve)
            self._waits, self._at_rest, self._last = True, False, None
            self._untouched.forget()
            response.success, response.message = True, "measuring rest: hands off for a second"
        return response

    def _join_reasons(self, present: str) -> str:
        reasons = (
            self._doctor.message,
            self._loaded,
            self._dead,
            self._saturated,
            self._untouched.message,
            present,
            self._tracker.message,
            self._tare.message,
            self._tare.wiring,
            self._odd,
            self._contact,
        )
        return "; ".join(filter(None, reasons))

    def _update_level(self, status: str, message: str) -> None:
        level = diagnostics.OK if status == "ok" and not message else diagnostics.WARN
        wrong = self._fault or self._saturated or self._loaded or self._dead
        wrong = wrong or self._tracker.impossible or self._untouched.fault or self._tare.half_read
        if status == "failed" or (wrong and self._stops):
            level = diagnostics.ERROR
        before = self._waiting
        self._waiting = self._waits and level == diagnostics.ERROR and status != "failed"
        if self._waiting:
            why = self._doctor.message or self._loaded or self._tare.message or self._odd
            message = f"measuring rest: hands off{f' ({why})' if why else ''}"
        held = before == self._waiting and self._holds(level, message)
        if not held and (message or level == diagnostics.OK):
            self._message, self._said = message or "ok", self._now()
        changed, self._level = level != self._level, level
        if changed:
            self.report()

    def _holds(self, level: int, message: str) -> bool:
        """Whether to keep the last reason: each new reason of a stop calls every hook."""
        if level != diagnostics.ERROR or level != self._level:
            return False
        same = _NUMBER.sub("", message) == _NUMBER.sub("", self._message)
        return same or self._now() - self._said < _HOLD

    def _now(self) -> float:
        return self.node.get_clock().now().nanoseconds / 1e9

    def _noisy_cells(self) -> str:
        if not self._noise.noisy.any():  # the usual case
            return ""
        cells = np.argwhere(self._noise.noisy)
        names = " and ".join(f"row {row}, column {col}" for row, col in cells[:3])
        more = f" and {len(cells) - 3} more" if len(cells) > 3 else ""
        return f"{names}{more}: much noisier than the other cells: is a contact loose?"

    def on_second(self) -> None:
        self._contact = self._bad_contact()
        if not self._arguments["threshold"]:  # else the rest is not known
            self._doctor.look(self.circuit)
        self.report()
        self._aside.clear()
        rest = self._tare.curve.rest_resistance
        if np.ndim(rest):
            header = Header(self.node.get_clock().now().to_msg())
            self._rest.publish(image(rest, "32FC1", header))

    def _bad_contact(self) -> str:
        """The reading that was set aside most often in the last second, and before: no chance."""
        cell, times = next(iter(self._aside.most_common(1)), (None, 0))
        if times < _ASIDE:
            return ""
        again, self._bad = cell == self._bad, cell
        row, col = cell
        text = f"row {row}, column {col}: reads less than the others allow: a bad contact?"
        return text if again else ""

    def report(self) -> None:
        values = {"residual": f"{self._residual:.3f}", "method": self._method}
        values[diagnostics.WAITING] = str(self._waiting).lower()
        values["tare"] = self._tare.message or ("ok" if self._follows else "off")
        if self._noise.rms is not None:
            values["noise"] = f"{self._noise.rms:.2f}"
        values |= self._tracker.values()
        values |= {f"finding_{k}": f for k, f in enumerate(self._doctor.findings, 1)}
        if self._aside:
            (row, col), n = self._aside.most_common(1)[0]
            where = f"row {row}, column {col}: {n} times"
            values["set_aside"] = f"{self._aside.total()} readings, most often {where}"
        values |= {f"frames_{name}": n for name, n in self._taken.items()}
        values["skipped"] = self.skipped
        self._diagnostics.publish(diagnostics.report(self.node, self._level, self._message, values))


def _where(force: np.ndarray) -> str:
    """The message for a skin that has been loaded since its first frame."""
    row, col = np.unravel_index(force.argmax(), force.shape)
    return (
        f"the skin has been loaded since the start, most at row {row}, column {col}: unload it, so "
        "that its rest can be measured"
    )
