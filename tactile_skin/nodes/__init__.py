# SPDX-License-Identifier: Apache-2.0
"""The nodes: parameters in, callbacks, publish. What they compute stands in the pure modules.

Each is a class that takes a Node handle, so that the same code runs in-process and on real ROS.
"""

from ..middleware.bus import QoSProfile, ReliabilityPolicy, Time
from ..msg import Header

# Frames that a stage may lag behind: 0.1 s, after which the stop calls them stale, of all the scans
# that a board can do, 390 a second. A machine that stutters loses none.
QUEUE = 40
# As sensors publish: from micro-ROS and over radio often by best effort, which a reliable
# subscription does not hear.
READING = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)


def now(node) -> float:
    """Return the time of a node's clock [s]."""
    return node.get_clock().now().nanoseconds / 1e9


def seconds(header: Header) -> float:
    """Return a message's stamp [s]."""
    return Time.from_msg(header.stamp).nanoseconds / 1e9
