# SPDX-License-Identifier: Apache-2.0
"""Topics, services, timers and parameters within one process, with rclpy's signatures.

A node written against this module runs unchanged on rclpy's Node, but for the descriptors of its
parameters, which are `fields.About`. What else differs is chosen for a robot's stop:
queues are bounded and drop the oldest (counted), a callback that raises is logged, counted and
isolated, and `MultiThreadedExecutor` gives each node a thread of its own, so that a slow subscriber
delays nobody but itself.
"""

from .clock import ManualClock, Time
from .context import Context, type_name
from .executors import MultiThreadedExecutor, SingleThreadedExecutor
from .inbox import result_of
from .node import Node
from .parameters import ANYTHING, Parameter, SetParametersResult
from .topics import DurabilityPolicy, Listener, Publisher, QoSProfile, ReliabilityPolicy

__all__ = [
    "ANYTHING",
    "Context",
    "DurabilityPolicy",
    "Listener",
    "ManualClock",
    "MultiThreadedExecutor",
    "Node",
    "Parameter",
    "Publisher",
    "QoSProfile",
    "ReliabilityPolicy",
    "SetParametersResult",
    "SingleThreadedExecutor",
    "Time",
    "result_of",
    "type_name",
]
