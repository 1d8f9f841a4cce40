# SPDX-License-Identifier: Apache-2.0
"""Act on a touch: a function each for a push, its release, and a stroke along the skin.

python examples/touch_events.py        # 20 seconds on a simulated board
python examples/touch_events.py 5
"""

import sys

from tactile_skin.launch import launch

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0


def on_push(force, centre):  # (3,) N on the robot, (3,) m; both in the base frame
    print("pushed with {:+.0f} {:+.0f} {:+.0f} N".format(*force), end=" ")
    print("at {:+.2f} {:+.2f} {:+.2f} m".format(*centre))


def on_release(duration):  # s
    print(f"released after {duration:.1f} s")


def on_stroke(velocity, confidence):  # (3,) m/s, 0 to 1
    print("stroked at {:+.2f} {:+.2f} {:+.2f} m/s".format(*velocity), f"({confidence:.0%} sure)")


# On a robot: launch("skin.launch.yaml", port="/dev/ttyUSB0", monitor=False)
with launch(method="auto", monitor=False) as skin:
    skin.on_push(on_push)
    skin.on_release(on_release)
    skin.on_stroke(on_stroke)
    skin.spin(seconds)
