# SPDX-License-Identifier: Apache-2.0
"""Nodes on one driven clock, in one thread."""

from tactile_skin.middleware.bus import (
    Context,
    ManualClock,
    Node,
    Parameter,
    SingleThreadedExecutor,
)
from tactile_skin.msg import Header


class Bench:
    """What a test of nodes stands on; it may be derived from."""

    def __init__(self, seconds: float = 1000.0):
        self.clock, self.executor = ManualClock(seconds), SingleThreadedExecutor()
        self.context = Context(self.clock)

    def node(self, name="node", parameters=None, **given) -> Node:
        """A node that is spun."""
        overrides = [Parameter(*item) for item in (parameters or {}).items()]
        node = Node(name, context=self.context, parameter_overrides=overrides, **given)
        self.executor.add_node(node)
        return node

    def spin(self, seconds: float = 0.0) -> None:
        """Time goes by, and what is due runs."""
        self.clock.advance(seconds)
        self.executor.spin_some()

    def header(self) -> Header:
        return Header(self.clock.now().to_msg(), "base_link")
