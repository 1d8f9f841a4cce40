# SPDX-License-Identifier: Apache-2.0
"""A subscriber with plain rclpy, as a user would write it: it knows nothing of tactile_skin.

    python listen_rclpy.py FILE [TOPIC ...]

Notes what arrives until SIGTERM, then pickles [(topic, arrival [s], stamp [ns], values), ...].
Says at once which topic it hears for the first time, or again after a silence.
"""

import os
import pickle
import signal
import sys
import threading
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Bool

SILENCE = 0.4  # s
sys.setswitchinterval(0.0005)


def image(m):
    return m.header.frame_id, m.height, m.width, m.encoding, m.is_bigendian, m.step, bytes(m.data)


def cloud(m):
    fields = [(f.name, f.offset, f.datatype, f.count) for f in m.fields]
    return m.height, m.width, fields, m.point_step, m.row_step, m.is_dense, bytes(m.data)


def vector(v):
    return v.x, v.y, v.z


def report(m):
    return [
        (s.name, s.level[0], s.message, s.hardware_id, {p.key: p.value for p in s.values})
        for s in m.status
    ]


TOPICS = {
    "skin/adc": (Image, image),
    "skin/pressure": (Image, image),
    "skin/contacts": (PointCloud2, cloud),
    "skin/wrench": (WrenchStamped, lambda m: vector(m.wrench.force) + vector(m.wrench.torque)),
    "skin/push_direction": (Vector3Stamped, lambda m: vector(m.vector)),
    "skin/stop": (Bool, lambda m: m.data),
    "skin/stop_status": (DiagnosticArray, report),
    "skin/diagnostics": (DiagnosticArray, report),
    "/diagnostics": (DiagnosticArray, report),
}
done = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: done.set())
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node(f"plain_listener_{os.getpid()}")
seen, arrived, reason = [], {}, [None]


def listener(topic, values):
    def on_message(m):
        now = time.time()
        stamp = None
        if hasattr(m, "header"):
            stamp = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
        seen.append((topic, now, stamp, values(m)))
        if now - arrived.get(topic, 0.0) > SILENCE:
            print(f"heard {topic}\n", end="", flush=True)
        arrived[topic] = now
        if topic == "skin/stop_status" and m.status[0].message != reason[-1]:
            reason.append(m.status[0].message)
            print(f"stop {reason[-1] or 'free'}\n", end="", flush=True)

    return on_message


for name in sys.argv[2:] or TOPICS:
    kind, values = TOPICS[name]
    node.create_subscription(kind, name, listener(name, values), QoSProfile(depth=100))
executor = EventsExecutor()  # the ordinary one is slow: 850 messages a second
executor.add_node(node)
while not done.is_set():
    executor.spin_once(timeout_sec=0.1)
rclpy.shutdown()
with open(sys.argv[1], "wb") as file:
    pickle.dump(list(seen), file)
