# SPDX-License-Identifier: Apache-2.0
"""A behaviour by gestures: a tap wakes the robot, a stroke calms it, a press sends it away.

    python examples/gestures.py [SECONDS] [NAME:=VALUE ...]

Without a port it runs on a simulated board, which plays some gestures.
"""

import sys

from tactile_skin.launch import launch

MOODS = {"tap": "awake", "stroke": "calm", "tickle": "amused", "press": "drives away"}


def hook(gesture) -> None:
    mood = MOODS.get(gesture.name)
    if mood:
        print(f"{gesture.name} ({gesture.probability:.0%}): {mood}", flush=True)


seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
given = dict(word.split(":=") for word in sys.argv[2:]) or {"scene": "gestures"}
with launch(gestures="true", monitor="false", **given) as skin:
    skin.on_gesture(hook)
    skin.spin(timeout=seconds)
