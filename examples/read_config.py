# SPDX-License-Identifier: Apache-2.0
"""From your parameter file to the objects that the pure functions take, and to the robot's frame.

python examples/read_config.py                    # the shipped config/skin.yaml
python examples/read_config.py mine.yaml
"""

import sys

import numpy as np

from tactile_skin import compensate, forward
from tactile_skin.launch import read_skin, share_dir

path = sys.argv[1] if len(sys.argv) > 1 else share_dir() / "config" / "skin.yaml"
circuit, curve, geometry = read_skin(path)

force = np.zeros(circuit.shape)
force[circuit.rows // 2, circuit.cols // 2] = 5.0  # N
found = compensate(forward(circuit, curve.resistance(force)), circuit, curve).force

pushed = -(found[..., None] * geometry.normal).sum((0, 1))  # N on the robot, base frame
pressure = found / geometry.cell_area  # Pa
row, col = np.unravel_index(found.argmax(), found.shape)
print(f"{circuit.rows} x {circuit.cols} cells, {geometry.pitch * 1e3:.0f} mm apart")
print(f"hardest cell: row {row}, column {col}, {pressure.max() / 1e3:.1f} kPa,", end=" ")
print("at x, y, z = {:.3f} {:.3f} {:.3f} m".format(*geometry.position[row, col]))
print("force on the robot: {:+.2f} {:+.2f} {:+.2f} N".format(*pushed))
