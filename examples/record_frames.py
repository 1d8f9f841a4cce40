# SPDX-License-Identifier: Apache-2.0
"""Record the readings of a board to an .npy file, to work on them without the board.

python examples/record_frames.py frames.npy        # 20 seconds of a simulated board
python examples/record_frames.py frames.npy 5
python examples/replay_frames.py frames.npy
"""

import sys

import numpy as np

from tactile_skin.launch import launch, read_skin
from tactile_skin.msg import Image, image_array

path = sys.argv[1] if len(sys.argv) > 1 else "frames.npy"
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 20.0
adc = read_skin().adc  # of the shipped configuration; yours: read_skin("mine.yaml")
frames = []

# On a robot: launch("skin.launch.yaml", port="/dev/ttyUSB0", monitor=False)
with launch(scene="two_fingers", monitor=False) as skin:
    skin.node.create_subscription(
        Image, "skin/adc", lambda message: frames.append(adc.ratio_of(image_array(message))), 10
    )
    skin.spin(seconds)

np.save(path, frames)  # (n, rows, cols), ADC ratios; NaN: a crossing that was not read
print(f"{path}: {len(frames)} frames")
