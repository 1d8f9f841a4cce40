# SPDX-License-Identifier: Apache-2.0
"""The nodes: parameters in, callbacks, publish. What they compute stands in the pure modules.

Each is a class that takes a Node handle, so that the same code runs in-process and on real ROS.
"""

from ..middleware.bus import QoSProfile, ReliabilityPolicy

# Frames that a stage may lag behind: 0.1 s, after which the stop calls them stale, of all the scans
# that a board can do, 390 a second. A machine that stutters loses none.
QUEUE = 40
# As sensors publish: from micro-ROS and over radio often by best effort, which a reliable
# subscription does not hear.
READING = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
