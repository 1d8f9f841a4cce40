"""Short forms for what every node says on `diagnostics`."""

from __future__ import annotations

from ..msg import DiagnosticArray, DiagnosticStatus, Header, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
TOPIC = "diagnostics"


def report(node, level: int, message: str, values: dict, header: Header | None = None):
    """A DiagnosticArray of one status, named after the node, its namespace included."""
    pairs = [KeyValue(key, str(value)) for key, value in values.items()]
    status = DiagnosticStatus(level, name_of(node), message, "tactile_skin", pairs)
    header = header or Header(node.get_clock().now().to_msg())
    return DiagnosticArray(header, [status])


def name_of(node) -> str:
    """The node's name in diagnostics: with its namespace, so that two skins do not mix."""
    return node.get_fully_qualified_name().lstrip("/")
