# SPDX-License-Identifier: Apache-2.0
"""Stop motors on a push, and on everything that makes the skin's data unsafe to use.

The hook is called now and at each change, and with `heartbeat` at least every 0.1 s: motors that
hear nothing for longer must stop by themselves, since a killed process cannot call.

    python examples/stop_hook.py        # 20 seconds on a simulated board: a push from the left
    python examples/stop_hook.py 5
"""

import sys

from tactile_skin.launch import launch

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0


class Motors:
    """Stands in for your robot's."""

    said: tuple | None = None

    def allow(self, running: bool, why: str) -> None:
        if (running, why) != self.said:
            self.said = running, why
            print("motors run" if running else f"motors stand: {why}")


motors = Motors()

# On a robot: launch("skin.launch.yaml", port="/dev/ttyUSB0", monitor=False)
with launch(monitor=False) as skin:
    skin.on_stop(lambda stop, reason: motors.allow(not stop, reason), heartbeat=0.1)
    skin.spin(seconds)
# The last call of an ending skin is a stop.
