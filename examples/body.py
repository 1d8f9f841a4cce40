# SPDX-License-Identifier: Apache-2.0
"""Several skins as one body: which of them stops the robot, and what touches it where.

python examples/body.py             # 15 seconds: a chest and a back, both on simulated boards
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from tactile_skin.launch import launch
from tactile_skin.msg import PointCloud2, cloud_columns

FILE = """
skins:
  chest: {{port: {0}/chest, geometry: {{shape: plane, translation: [0.2, 0.0, 0.5]}}}}
  back: {{port: {0}/back, geometry: {{shape: plane, rpy: [0.0, 0.0, 3.1416]}}}}
"""
NAMES = "chest", "back"  # in the order of the file: its number is a contact's `skin`
SIM = sys.executable, "-m", "tactile_skin", "sim", "--once"
seen: set[int] = set()  # touches


def on_contacts(msg: PointCloud2) -> None:
    columns = cloud_columns(msg)
    for touch, skin, force in zip(*(columns[n] for n in ("id", "skin", "force")), strict=True):
        if touch not in seen:
            print(f"touch {touch:.0f} on the {NAMES[int(skin)]}: {force:.0f} N")
            seen.add(touch)


with tempfile.TemporaryDirectory() as folder:
    for name, scene in zip(NAMES, ("idle", "push_left"), strict=True):
        subprocess.Popen([*SIM, "--link", f"{folder}/{name}", "--scene", scene])
    (config := Path(folder) / "robot.yaml").write_text(FILE.format(folder))
    with launch("body.launch.yaml", config=config, wait_for_port=15.0, monitor=False) as body:
        body.on_stop(lambda stop, reason: print(f"stop: {reason}" if stop else "free"))
        body.node.create_subscription(PointCloud2, "skin/contacts", on_contacts, 10)
        body.spin(float(sys.argv[1]) if len(sys.argv) > 1 else 15.0)
