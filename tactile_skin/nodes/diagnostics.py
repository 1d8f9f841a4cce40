# SPDX-License-Identifier: Apache-2.0
"""What every node reports on `skin/diagnostics` and `/diagnostics`: a level, a message, values.

The counts of messages that its queues dropped and of exceptions that its callbacks raised are among
the values of every node.
"""

from __future__ import annotations

from ..msg import DiagnosticArray, DiagnosticStatus, Header, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
TOPIC = "skin/diagnostics"  # of one skin: an ERROR here stops its robot
ALL = "/diagnostics"  # of the whole robot, for diagnostic_aggregator and for people: stops nothing

# key of a status whose ERROR is no fault: what it waits for is in its message
WAITING = "waiting"
# key of a value: ohm by which the series resistance of the readings may be more than is supposed
UNKNOWN_SERIES = "r_par_unknown"
# key of a value: why forces may be more than is felt, separated by spaces: some of these
UNKNOWN = "unknown"
SCALE, SERIES, ENDS = "scale", "series", "ends"
PROOF = "proof"  # key of a value: what showed that the newtons are right, or none
# keys of what was found: its kind and form, and the lines that it is about, separated by spaces
KIND, FORM, ROWS, COLS = "kind", "form", "rows", "cols"
STANDS = "stands"  # key of a value: what a touch that stands without moving may be; or none
SIMULATED = "simulated"  # key of a value, true or false: the readings are of a simulated board


def places(rows, cols) -> dict[str, str]:
    """Return lines as values of a status."""
    return {ROWS: " ".join(map(str, rows)), COLS: " ".join(map(str, cols))}


def report(node, level: int, message: str, values: dict, header: Header | None = None):
    """Return a DiagnosticArray of one status, named after the node, its namespace included."""
    values = values | {"dropped": node.dropped, "callback_errors": node.callback_errors}
    pairs = [KeyValue(key, str(value)) for key, value in values.items()]
    status = DiagnosticStatus(level, name_of(node), message, hardware_id(node), pairs)
    header = header or Header(node.get_clock().now().to_msg())
    return DiagnosticArray(header, [status])


class Reporter:
    """Publishes the reports of a node on the topics for its skin and for the whole robot."""

    def __init__(self, node, topics: tuple[str, ...] = (TOPIC, ALL)):
        self._publishers = [node.create_publisher(DiagnosticArray, topic, 10) for topic in topics]

    def publish(self, report: DiagnosticArray) -> None:
        for publisher in self._publishers:
            publisher.publish(report)


def ensure_reported(node) -> None:
    """Report once a second, at level OK, for a node that publishes no diagnostics of its own."""
    topic = node.resolve_topic_name(TOPIC)
    if any(p.topic_name == topic for p in node.publishers):
        return
    reporter = Reporter(node)
    node.create_timer(1.0, lambda: reporter.publish(report(node, OK, "running", {})))


def hardware_id(node) -> str:
    """Return the skin that a node belongs to: one in each namespace."""
    return f"tactile_skin{node.get_namespace().rstrip('/')}"


def name_of(node) -> str:
    """Return the node's name in diagnostics: with its namespace, so that two skins do not mix."""
    return node.get_fully_qualified_name().lstrip("/")
