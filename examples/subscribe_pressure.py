# SPDX-License-Identifier: Apache-2.0
"""Subscribe to the pressure picture and keep the largest value of each cell.

python examples/subscribe_pressure.py        # 20 seconds on a simulated board
python examples/subscribe_pressure.py 5
"""

import sys

import numpy as np

from tactile_skin.launch import launch
from tactile_skin.msg import Image, image_array

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
largest = np.zeros((1, 1))


def on_pressure(message: Image) -> None:
    global largest
    pressure = image_array(message)  # (rows, cols) [Pa], read-only: copy it before you change it
    largest = np.maximum(largest, pressure)


# On a robot: launch("skin.launch.yaml", port="/dev/ttyUSB0", monitor=False)
with launch(scene="stroke", method="auto", monitor=False) as skin:
    skin.node.create_subscription(Image, "skin/pressure", on_pressure, 10)
    skin.spin(seconds)

print("largest pressure of each cell [kPa], row 0 on top:")
for row in largest / 1e3:
    print(" ".join(f"{value:4.0f}" for value in row))
