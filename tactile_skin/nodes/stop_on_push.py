# SPDX-License-Identifier: Apache-2.0
"""stop_on_push: skin/contacts and skin/diagnostics -> skin/stop, skin/stop_status."""

from __future__ import annotations

import dataclasses
import math
import threading

import numpy as np

from ..behaviours.stop import (
    MAX_AHEAD,
    TRANSPORT,
    Cause,
    Decision,
    StopConfig,
    StopMessage,
    StopPolicy,
)
from ..errors import concerning
from ..middleware.bus import DurabilityPolicy, QoSProfile
from ..middleware.config import declared
from ..msg import (
    Bool,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    PointCloud2,
    Trigger,
    cloud_columns,
)
from ..parameters.nodes import StopOnPush as Parameters
from ..physics.proof import NOTHING
from . import QUEUE, diagnostics, now, seconds

HEARTBEAT = 0.02  # s, between decisions when no reading comes
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# who asks for no later a message is informed of one that is late; an old "free" reaches nobody
_STOP = dataclasses.replace(LATCHED, deadline=5 * HEARTBEAT, lifespan=50 * HEARTBEAT)
STATUS_TOPIC = "skin/stop_status"
# deep enough for a stop that lasts one decision not to be pushed out by the next
STATUS = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
COUNTS_AS = "counts_as"  # key of a value: the force that the stop compares [N]
PUSH = "push"  # key of a value: whether a push is on, whatever else stops the robot
CAUSES = "causes"  # key of a value: what stops the robot, separated by spaces
# N, the largest quasi-static contact force that ISO/TS 15066 (2016), table A.2, permits: at thighs
_BODY = 220.0
_END = 0.95  # of the curve's last force, which noise keeps a cell from reading quite
_UNKNOWN = {  # what compensation does not know -> in words
    diagnostics.SCALE: "newtons are not proved",
    diagnostics.SERIES: "r_par is not known yet",
    diagnostics.ENDS: "readings are at the end of the converter",
}
_NOT_PROVED = (
    "not proved: nothing has shown that these newtons are right. A touch counts with the most that "
    "it may be: threshold = %g N stops from a quarter of it on. Lay a known weight: "
    "tactile-skin calibrate --gain 1.0"
)


def stop_message_of(msg: DiagnosticArray, t: float) -> StopMessage:
    """Return the decision in a message of skin/stop_status at t, and until when it is valid.

    "Free" without `good_for`, or with a stamp ahead of t, is not valid at all.
    """
    status = msg.status[0]
    if status.level != DiagnosticStatus.OK:
        return StopMessage(True, status.message, causes=causes_of(status))
    stamp = seconds(msg.header)
    try:
        good_for = float({pair.key: pair.value for pair in status.values}["good_for"])
    except (KeyError, ValueError):
        return StopMessage(False, "", -math.inf)
    return StopMessage(
        False, "", stamp + good_for + TRANSPORT if stamp <= t + MAX_AHEAD else -math.inf
    )


def causes_of(status: DiagnosticStatus) -> tuple[Cause, ...]:
    """Return what stops the robot; a fault where that is not said."""
    said = next((pair.value for pair in status.values if pair.key == CAUSES), "")
    try:
        causes = tuple(Cause(cause) for cause in said.split())
    except ValueError:  # of another version
        causes = ()
    return causes or (Cause.FAULT,)


def answered(response, causes: str):
    """Return the answer to a reset after which the causes are left."""
    response.success = not causes
    response.message = f"still stopped: {causes}" if causes else "free"
    return response


class Decisions:
    """Publishes the decisions of a stop, and how it is once a second and when the reason changes.

    Attributes:
        last: the last decision; None: there was none yet.
    """

    def __init__(self, node):
        self._node = node
        self.last: Decision | None = None
        self._closed = threading.Lock()  # never released once the final stop is published
        self._stop = node.create_publisher(Bool, "skin/stop", _STOP)
        self._status = node.create_publisher(DiagnosticArray, STATUS_TOPIC, LATCHED)
        self._to_all = diagnostics.Reporter(node, (diagnostics.ALL,))
        self._to_skin = diagnostics.Reporter(node, (diagnostics.TOPIC,))
        node.create_timer(1.0, self._on_second)

    def publish(self, decision: Decision, values: dict, header: Header, final: bool) -> None:
        """Publish a decision, with values of its status; after the final one no other."""
        if not self._closed.acquire(blocking=final):
            return
        try:
            changed, self.last = decision != self.last, decision
            self._stop.publish(Bool(decision.stop))
            values |= {CAUSES: " ".join(cause.value for cause in decision.causes)}
            level = diagnostics.ERROR if decision.stop else diagnostics.OK
            status = diagnostics.report(self._node, level, decision.reason, values, header)
            self._status.publish(status)
            if changed:
                self._on_second()
        finally:
            if not final:
                self._closed.release()

    def _on_second(self) -> None:
        """Report; a stop is no fault of this node."""
        if (last := self.last) is None:
            return
        level = diagnostics.ERROR if last.stop else diagnostics.OK
        level = diagnostics.WARN if last.for_push_alone else level
        self._to_all.publish(diagnostics.report(self._node, level, last.reason or "free", {}))
        self._to_skin.publish(diagnostics.report(self._node, diagnostics.OK, "running", {}))


class StopOnPush:
    """Publishes whether the robot must stop, and why.

    Publishes skin/stop (Bool, latched, with every decision: a heartbeat) and skin/stop_status
    (DiagnosticArray with the stamp of the reading that it is based on; ERROR and the reason while
    stopped; `threshold` and `peak` in force [N];
    `good_for`, how long after its stamp "free" is valid [s], the stale_after in force;
    `interval`, usual between readings [s]).

    The sum of the contacts' forces decides, so that a squeeze from both sides, whose wrench is
    zero, stops as well. Each counts with the most that it may be, `bound` and `peak_bound` of
    skin/contacts. The service `~/reset` frees a latched stop, and refuses while its cause lasts.
    """

    def __init__(self, node):
        self.node = node
        given = declared(node, Parameters)
        self.policy = StopPolicy(given)
        self._largest = _END * given.curve.force[-1] * min(given.curve.gain)
        with concerning("peak", "curve"):
            self._check(self.policy.config)
        self._warn_of_threshold(self.policy.config.threshold)
        self._decisions = Decisions(node)
        self._header = Header()
        self._force = self._most = 0.0
        self._simulated = False  # the driver says that its board is
        self._proof = ""  # of the newtons, as compensation says it
        node.on_set_parameters(self.on_parameters)
        node.create_subscription(PointCloud2, "skin/contacts", self.on_contacts, QUEUE)
        node.create_subscription(DiagnosticArray, diagnostics.TOPIC, self.on_diagnostics, 50)
        node.create_service(Trigger, "~/reset", self.on_reset)
        self._heartbeat = node.create_timer(HEARTBEAT, self.on_timer)
        self.on_timer()

    def _check(self, config: StopConfig) -> None:
        if config.peak > self._largest:
            raise ValueError(
                f"stop: peak = {config.peak:g} N: the curve ends at {self._largest / _END:g} N, so "
                f"that no cell would ever reach it: must be at most {self._largest:.3g} N"
            )

    def _warn_of_threshold(self, threshold: float) -> None:
        if threshold > _BODY:
            self.node.get_logger().warning(
                "threshold = %g N: above %.3g N, what any part of a body bears (ISO/TS 15066): no "
                "push will stop the robot",
                threshold,
                _BODY,
            )

    def on_parameters(self, values: dict) -> None:
        """Limits that change while the robot moves."""
        config = dataclasses.replace(self.policy.config, **values)
        self._check(config)
        self._warn_of_threshold(config.threshold)
        self.policy.configure(config)

    def on_contacts(self, msg: PointCloud2) -> None:
        columns = cloud_columns(msg, "force", "peak", "bound", "peak_bound")
        force, peak = columns["force"], columns["peak"]
        self._header = msg.header  # not of one that cannot be read: "free" rests on its stamp
        self._force = _unless_negative(force, np.sum)
        self._most = self._force
        largest = highest = _unless_negative(peak, np.max)
        if self._force >= 0.0 and largest >= 0.0:
            highest = _unless_negative(columns.get("peak_bound", peak), np.max)
            self._most, highest = most_of(columns), max(largest, highest)
        stamp = seconds(msg.header)
        self._watch_clock()  # with readings that come often the timer is never due
        t, felt = now(self.node), (max(self._force, 0.0), max(largest, 0.0))
        self._publish(self.policy.reading(t, self._most, highest, stamp, *felt))
        self._heartbeat.reset()

    def on_diagnostics(self, msg: DiagnosticArray) -> None:
        """Take diagnostics: a stage that reports ERROR stops the robot; WARN and OK do not."""
        for status in msg.status:
            if status.name != diagnostics.name_of(self.node):
                bad = status.level >= DiagnosticStatus.ERROR
                values = {v.key: v.value for v in status.values}
                waiting = values.get(diagnostics.WAITING) == "true"
                message = (status.message or "error") if bad else ""
                self.policy.fault(status.name, message, waiting)
                self._learn(values)
                self.policy.stands = values.get(diagnostics.STANDS, self.policy.stands)
                if simulated := values.get(diagnostics.SIMULATED):
                    self._simulated = simulated == "true"
        decision = self.policy.decide(now(self.node))
        if decision != self._decisions.last:  # a fault need not wait for the timer
            self._publish(decision)

    def _learn(self, values: dict[str, str]) -> None:
        """Take what compensation says of the newtons."""
        if (proof := values.get(diagnostics.PROOF)) is None:
            return
        unknown = values.get(diagnostics.UNKNOWN, "").split()
        self.policy.unknown = "; ".join(_UNKNOWN[why] for why in unknown if why in _UNKNOWN)
        if proof == NOTHING and self._proof != NOTHING:
            self.node.get_logger().warning(_NOT_PROVED, self.policy.config.threshold)
        self._proof = proof

    def on_reset(self, _, response):
        causes = self.policy.reset(now(self.node))
        self.on_timer()
        return answered(response, causes)

    def on_timer(self) -> None:
        self._watch_clock()
        self._publish(self.policy.decide(now(self.node)))

    def _watch_clock(self) -> None:
        still = self.node.get_clock().stands_still
        self.policy.fault("clock", "stands still: no age of a reading is known" if still else "")

    def _publish(self, decision: Decision, final: bool = False) -> None:
        interval = self.policy.interval
        values = {
            "force": f"{self._force:.2f}",
            COUNTS_AS: f"{self._most:.2f}",
            diagnostics.PROOF: self._proof,
            "threshold": f"{self.policy.config.threshold:g}",
            "peak": f"{self.policy.config.peak:g}",
            PUSH: str(self.policy.pushed).lower(),
            diagnostics.SIMULATED: str(self._simulated).lower(),
            "good_for": f"{self.policy.stale_after:g}",
            "interval": "unknown" if interval is None else f"{interval:.4f}",
        }
        self._decisions.publish(decision, values, self._header, final)

    def absent(self, why: str, waiting: bool) -> None:
        """Publish a stop for the node of another process, which this one stands for.

        Args:
            why: its process does not answer.
            waiting: it has not run yet.
        """
        self.policy.fault("its process", why, waiting)
        self._publish(self.policy.decide(now(self.node)))

    def resume(self, why: str) -> None:
        """Go on for one whose process `why`: it has ended, while the robot may have been free."""
        self.policy.resume("its process", why)

    def close(self) -> None:
        """Publish a final stop: nothing monitors the skin from here on."""
        self.policy.fault(diagnostics.name_of(self.node), "the skin shuts down")
        self._publish(self.policy.decide(now(self.node)), final=True)


def most_of(columns: dict[str, np.ndarray]) -> float:
    """Return the most that the contacts of a skin/contacts may have together [N].

    Without `bound`, of somebody who publishes forces of his own, that is what they have.
    """
    force = columns["force"]
    return _unless_negative(np.maximum(columns.get("bound", force), force), np.sum)


def _unless_negative(newtons: np.ndarray, together) -> float:
    """Add up the contacts' forces; the lowest if it is negative: others must not hide it."""
    lowest = float(newtons.min(initial=0.0))
    return lowest if lowest < 0.0 else float(together(newtons, initial=0.0))
