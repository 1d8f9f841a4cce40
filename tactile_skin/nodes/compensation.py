# SPDX-License-Identifier: Apache-2.0
"""compensation: skin/adc -> skin/pressure."""

from __future__ import annotations

import datetime
from collections.abc import Callable

from ..findings.finding import BESIDE_THE_REST, Finding, Kind
from ..health.skin import Follower
from ..learning import network
from ..middleware.bus import DurabilityPolicy, QoSProfile
from ..middleware.config import (
    adc_of,
    circuit_of,
    creep_of,
    curve_of,
    declared,
    geometry_of,
    proof_of,
)
from ..msg import (
    PAIR,
    DiagnosticArray,
    Header,
    Image,
    TimeReference,
    Trigger,
    image,
    image_array,
)
from ..parameters.nodes import Compensation as Parameters
from ..physics.proof import SIMULATED, Proof
from ..solvers.evidence import series_scale
from . import READING, diagnostics, now, seconds
from .gesture_feature import heard

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_MIN_LINES = 3  # rows and columns; with fewer some faults look like touches: docs/reliability.md
_NOT_KNOWN = 0.1  # of its scale, by which r_par may be more, from which on that is said
_HOLD = 1.0  # s for which a reason is kept at least, while the robot is stopped for one
_MORE = "; more: doctor"  # the command sees many frames, and says what to enter
# s that a reading has waited from which on the faster method takes it: less than four frames of the
# fastest boards.
_LATE = 0.01
_FULL_FIT = 0.1  # s after a full fit until the next, however late: only that tests the circuit
_OLD = 0.05  # s from which on a reading is old news: half of `stale_after`
_APART = 0.02  # s apart that old ones are taken, for the stop to know that there are readings


def skin_of(given: Parameters, warn: Callable[[str], None]) -> Follower:
    """Return the skin that the parameters of compensation describe.

    Raises:
        ValueError: values that do not go together.
        OSError: the weights cannot be read.
    """
    circuit = circuit_of(given.circuit)
    curve, adc = curve_of(given.curve, circuit), adc_of(given.circuit, circuit)
    weights = network.load(given.weights) if given.weights else None
    if weights:
        weights.check(circuit, curve)
    return Follower(
        adc,
        curve,
        creep_of(given.curve),
        r_par_std=given.circuit.r_par_std or None,
        # where the board keeps readings to itself, rest cannot be measured
        follows=given.tare and not given.board_threshold,
        noise=adc.share(given.noise) * circuit.full_scale or None,
        threshold=adc.threshold(given.board_threshold),
        time_limit=given.time_limit,
        weights=weights,
        proof=proof_of(given.curve),
        today=datetime.date.today(),
        warn=warn,
    )


class Compensation:
    """Publishes the force picture of each reading, how sure it is, and what is wrong.

    Publishes skin/pressure (32FC1, Pa, row-major) with the reading's stamp; skin/pressure_bound
    (32FC2, Pa), the most that each cell may feel, by the circuit and in all; skin/pressure_std, one
    standard deviation of it; skin/taken, when it took each reading up, from which a replay
    knows which were late; skin/rest (32FC1, the resistance of each cell at rest, ohm) once it was
    measured; and diagnostics once a second and whenever the level changes: WARN for a suspect
    frame, ERROR, which stops the robot, for a failed one and for a fault of the skin. A frame that
    fails is not published.
    What the cells conduct at rest is measured between touches. Until the first time, a second after
    the start, the robot waits, with "measuring rest: hands off", and so it does for a skin of which
    half was loaded from the first frame on, until it is let go. The service `~/reset` forgets
    faults that the last frames no longer show, says so on diagnostics before it answers, and
    forgets the last frame, from which the next one starts; `~/tare` measures the rest anew, as at
    the start, and is refused while something presses or a fault is kept. Behind by 10 ms, `auto`
    hurries: it takes the fixed point under a touch, which says nothing of the circuit; ten frames a
    second are fitted in full all the same. So it does for the first 25 ms of each touch. Behind by
    half of what the stop bears, old frames are skipped to come to the new ones, and diagnostics
    count them.
    What a standing load gains by creep is taken out of what is published, if the curve says how
    much, and of nothing else.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        circuit = circuit_of(given.circuit)
        self.cell_area = geometry_of(given.geometry, circuit).cell_area
        self._stops = given.suspect_stops
        if min(circuit.shape) < _MIN_LINES:
            node.get_logger().warning(
                'on a skin of %d x %d cells some faults look like touches: see "Smallest skin" in '
                "docs/reliability.md",
                *circuit.shape,
            )
        self.skin = skin_of(given, node.get_logger().warning)
        self._proved_by = self.skin.proof  # as the file has it
        self._pressure = node.create_publisher(Image, "skin/pressure", 10)
        self._bound = node.create_publisher(Image, "skin/pressure_bound", 10)
        self._std = node.create_publisher(Image, "skin/pressure_std", 10)
        self._taken_up = node.create_publisher(TimeReference, "skin/taken", 10)
        self._diagnostics = diagnostics.Reporter(node)
        self._rest = node.create_publisher(Image, "skin/rest", LATCHED)
        self._said = -float("inf")  # s, when the message was new
        self._waiting = False  # a stop until the rest was measured
        self._level, self._message = diagnostics.OK, "ok"
        self._finding: Finding | None = None  # that the message says
        self._others = ""  # reasons besides the worst one
        self._taken_at, self.skipped = -float("inf"), 0  # s, when the last frame was taken; frames
        self._fitted_at = -float("inf")  # s, when the last one was that the configured method took
        self.on_parameters({"method": given.method})
        node.on_set_parameters(self.on_parameters)
        node.create_subscription(Image, "skin/adc", self.on_adc, READING)
        node.create_subscription(DiagnosticArray, diagnostics.TOPIC, self.on_diagnostics, 50)
        node.create_service(Trigger, "~/reset", self.on_reset)
        node.create_service(Trigger, "~/tare", self.on_tare)
        node.create_timer(1.0, self.on_second)

    def on_parameters(self, values: dict) -> None:
        """Another method from the next frame on."""
        self.skin.use(values["method"])
        self._method = values["method"]

    def on_adc(self, msg: Image) -> None:
        clock = self.node.get_clock().now()
        if heard(self._taken_up):
            name = diagnostics.name_of(self.node)
            self._taken_up.publish(TimeReference(msg.header, clock.to_msg(), name))
        taken, t = clock.nanoseconds / 1e9, seconds(msg.header)
        if taken - t > _OLD and 0.0 <= taken - self._taken_at < _APART:
            self.skipped += 1
            return
        self._taken_at = taken
        late = taken - t > _LATE and 0.0 <= taken - self._fitted_at < _FULL_FIT
        try:
            samples = image_array(msg)
        except ValueError as error:
            force = self.skin.refuse(str(error))
        else:
            stopped = self._level == diagnostics.ERROR
            force = self.skin.frame(t, samples, late=late, stopped=stopped)
        self._fitted_at = taken if self.skin.fitted else self._fitted_at
        if force is not None:
            self._bound.publish(
                image(self.skin.bound / self.cell_area[..., None], PAIR, msg.header)
            )
            self._pressure.publish(image(force / self.cell_area, "32FC1", msg.header))
        self._update_level()
        if force is not None and heard(self._std):
            self._std.publish(image(self.skin.std / self.cell_area, "32FC1", msg.header))

    def on_diagnostics(self, msg: DiagnosticArray) -> None:
        """Learn that the board is simulated, with the curve of this skin: nothing is unknown."""
        for status in msg.status:
            for pair in status.values:
                if pair.key == diagnostics.SIMULATED:
                    simulated = pair.value == "true"
                    self.skin.proof = Proof(SIMULATED) if simulated else self._proved_by

    def on_reset(self, _, response):
        self.skin.reset()
        self._update_level(past=False)
        self.report()  # the stop must know before it is reset
        response.success, response.message = True, "past faults are cleared"
        return response

    def on_tare(self, _, response):
        refused = self.skin.tare()
        response.success = not refused
        response.message = refused or "measuring rest: hands off for a second"
        return response

    def _update_level(self, *, past: bool = True) -> None:
        skin, found = self.skin, self.skin.findings(past=past)
        self._others = "; ".join(map(str, found[1:]))
        failed = skin.status == "failed"
        level = diagnostics.WARN if found or skin.status != "ok" else diagnostics.OK
        if failed or (skin.fault and self._stops):
            level = diagnostics.ERROR
        before = self._waiting
        self._waiting = skin.waits and level == diagnostics.ERROR and not failed
        if self._waiting:
            found = [f for f in found if f.kind not in BESIDE_THE_REST]
        first = found[0] if found else None
        if not (before == self._waiting and self._holds(level, first)):
            self._say(level, first, "" if failed else _MORE)
        changed, self._level = level != self._level, level
        if changed:
            self.report()

    def _say(self, level: int, finding: Finding | None, more: str) -> None:
        if self._waiting:
            why = f" ({finding})" if finding else ""
            message = f"measuring rest: hands off{why}"
        elif finding:
            message = f"{str(finding).removesuffix('.')}{more}"
        elif level == diagnostics.OK:
            message = "ok"
        else:  # a fault that the last frames do not show goes on
            return
        self._finding, self._message, self._said = finding, message, now(self.node)

    def _holds(self, level: int, finding: Finding | None) -> bool:
        """Whether to keep the last reason: each new reason of a stop calls every hook."""
        if level != diagnostics.ERROR or level != self._level:
            return False
        return finding == self._finding or now(self.node) - self._said < _HOLD

    def on_second(self) -> None:
        self.report()
        rest = self.skin.rest_resistance
        if rest is not None:
            header = Header(self.node.get_clock().now().to_msg())
            self._rest.publish(image(rest, "32FC1", header))

    def _unknown(self) -> list[str]:
        """Return what lets a force be more than is felt, the largest part first."""
        skin, found = self.skin, []
        if not skin.proof.proved:
            found.append(diagnostics.SCALE)
        if skin.unknown_series > _NOT_KNOWN * series_scale(skin.circuit):
            found.append(diagnostics.SERIES)
        if skin.ends:
            found.append(diagnostics.ENDS)
        return found

    def report(self) -> None:
        values = self.skin.values() | {
            "method": self._method,
            diagnostics.WAITING: str(self._waiting).lower(),
            diagnostics.PROOF: self.skin.proof.by,
            diagnostics.UNKNOWN: " ".join(self._unknown()),
            diagnostics.UNKNOWN_SERIES: f"{self.skin.hidden_series:.1f}",
            diagnostics.STANDS: self.skin.stands,
            "skipped": self.skipped,
        }
        if self._finding:
            finding = self._finding
            values[diagnostics.KIND] = finding.kind.value
            values[diagnostics.FORM] = finding.form
            touch = finding.kind is Kind.LOADED or finding == self.skin.unrested
            if not touch:  # no line is at fault
                values |= diagnostics.places(finding.rows, finding.cols)
        if self._others:
            values["also"] = self._others
        self._diagnostics.publish(diagnostics.report(self.node, self._level, self._message, values))
