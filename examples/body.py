"""Several skins as one body: which of them stops the robot, and what touches it where.

python examples/body.py             # 15 seconds: a chest and a back, both on simulated boards
python examples/body.py robot.yaml  # your own (docs/body.md)
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from tactile_skin.launch import launch
from tactile_skin.msg import PointCloud2, cloud_columns

FILE = """
skins:
  chest:
    port: {folder}/chest
    geometry: {{shape: plane, translation: [0.2, 0.0, 0.5]}}
  back:
    port: {folder}/back
    geometry: {{shape: plane, translation: [-0.2, 0.0, 0.5], rpy: [0.0, 0.0, 3.1416]}}
"""
SIM = sys.executable, "-m", "tactile_skin", "sim", "--once"
SCENES = {"chest": "idle", "back": "push_left"}


seen: set[int] = set()  # touches


def on_contacts(msg: PointCloud2) -> None:
    columns = cloud_columns(msg, "id", "skin", "force")
    touches = zip(*(columns[name].tolist() for name in ("id", "skin", "force")), strict=True)
    for touch, skin, force in touches:
        if touch not in seen:
            print(f"touch {touch:.0f} on skin {skin:.0f} of the file: {force:.0f} N")
            seen.add(touch)


def run(config: Path, seconds: float) -> None:
    with launch("body.launch.yaml", config=config, wait_for_port=15.0) as body:
        body.on_stop(lambda stop, reason: print(f"stop: {reason}" if stop else "free"))
        body.node.create_subscription(PointCloud2, "skin/contacts", on_contacts, 10)
        body.spin(seconds)


if len(sys.argv) > 1 and sys.argv[1].endswith(".yaml"):
    run(Path(sys.argv[1]), 1e9)
else:
    with tempfile.TemporaryDirectory() as folder:
        boards = [
            subprocess.Popen([*SIM, "--link", f"{folder}/{name}", "--scene", scene])
            for name, scene in SCENES.items()
        ]
        config = Path(folder) / "robot.yaml"
        config.write_text(FILE.format(folder=folder))
        try:
            run(config, float(sys.argv[1]) if len(sys.argv) > 1 else 15.0)
        finally:
            for board in boards:
                board.terminate()
                board.wait()
