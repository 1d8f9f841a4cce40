"""What every node reports on `diagnostics`: a level, a message, values.

The counts of messages that its queues dropped and of exceptions that its callbacks raised are among
the values of every node.
"""

from __future__ import annotations

from ..msg import DiagnosticArray, DiagnosticStatus, Header, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
TOPIC = "diagnostics"

# key of a status whose ERROR is no fault: what it waits for is in its message
WAITING = "waiting"


def report(node, level: int, message: str, values: dict, header: Header | None = None):
    """A DiagnosticArray of one status, named after the node, its namespace included."""
    values = values | {"dropped": node.dropped, "callback_errors": node.callback_errors}
    pairs = [KeyValue(key, str(value)) for key, value in values.items()]
    status = DiagnosticStatus(level, name_of(node), message, "tactile_skin", pairs)
    header = header or Header(node.get_clock().now().to_msg())
    return DiagnosticArray(header, [status])


def ensure_reported(node) -> None:
    """Report once a second, at level OK, for a node that publishes no diagnostics of its own."""
    topic = node.resolve_topic_name(TOPIC)
    if any(p.topic_name == topic for p in node.publishers):
        return
    publisher = node.create_publisher(DiagnosticArray, TOPIC, 10)
    node.create_timer(1.0, lambda: publisher.publish(report(node, OK, "running", {})))


def name_of(node) -> str:
    """The node's name in diagnostics: with its namespace, so that two skins do not mix."""
    return node.get_fully_qualified_name().lstrip("/")
