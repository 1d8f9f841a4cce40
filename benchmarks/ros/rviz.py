"""What ROS 1's rviz shows of the demo, under Xvfb; docs/rviz.png.

needs apt-get install rviz xvfb, rospy and roscore. The displays are those of config/skin.rviz,
whose classes have other names in ROS 1. The picture is taken while a push is on; without the push's
arrow in it the script fails.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from support.ros_graph import Graph, Player, endless, programs

from tactile_skin import launch
from tactile_skin.middleware.launch_file import NodeAction

from .. import harness

SCREEN = 1200, 800  # pixels
STARTS = 20.0  # s, for rviz to draw
TRIES = 10  # pictures, of which one has the arrow


def for_ros1(source: Path) -> str:
    """config/skin.rviz, for ROS 1's rviz."""
    text = source.read_text().replace("rviz_default_plugins/", "rviz/")
    config = yaml.safe_load(text.replace("rviz_common/", "rviz/"))
    for display in config["Visualization Manager"]["Displays"]:
        if isinstance(display.get("Topic"), dict):
            display["Topic"] = display["Topic"]["Value"]
        if display["Class"] == "rviz/Image":
            display["Image Topic"] = display.pop("Topic")
        if display["Class"] == "rviz/Wrench":
            display["Class"] = "rviz/WrenchStamped"
    tools = config["Visualization Manager"]["Tools"]
    tools[:] = [tool for tool in tools if tool["Class"] == "rviz/MoveCamera"]
    return yaml.safe_dump(config, sort_keys=False)


def main(arguments=None) -> int:
    parser = harness.parser(__doc__, __spec__)
    default = launch.share_dir() / "docs" / "rviz.png"
    parser.add_argument("--out", type=Path, default=default)
    args = parser.parse_args(arguments)
    player = Player()
    with Graph(1) as graph, tempfile.TemporaryDirectory() as folder:
        display = f":{90 + os.getpid() % 100}"
        graph.env |= {"DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1", "HOME": folder}
        size = "x".join(map(str, SCREEN))
        words = ["Xvfb", display, "-screen", "0", f"{size}x24", "-fbdir", folder]
        graph.start("Xvfb", words)
        config = Path(folder) / "skin.rviz"
        config.write_text(for_ros1(launch.share_dir() / "config" / "skin.rviz"))
        for action in programs(player.port, separate=False):
            graph.start_node(action)
        graph.start_node(NodeAction("push_arrow", "push_arrow", "", [], []))
        graph.wait_for(lambda: Path(f"/tmp/.X11-unix/X{display[1:]}").exists(), "Xvfb")
        graph.start("rviz", ["rviz", "-d", str(config)])
        with player.playing(endless("idle", seed=1)):
            time.sleep(STARTS)
        with player.playing(endless("push_left", seed=1)):
            for left in reversed(range(TRIES)):  # a busy machine draws late
                time.sleep(3.0)
                picture = [sys.executable, "-c", PICTURE, f"{folder}/Xvfb_screen0", str(args.out)]
                done = subprocess.run(picture, env=graph.env)
                if not done.returncode:
                    break
                if not left:
                    return done.returncode
        print(graph.said("rviz")[-1500:], file=sys.stderr)
        for name in ("rviz", "Xvfb"):
            graph.stop(name)
    player.close()
    print(f"{args.out}: {args.out.stat().st_size} bytes")
    return 0


# The frame buffer of Xvfb in X's own format, XWD: a header of big-endian words, then the pixels.
PICTURE = """
import struct, sys
import numpy as np
from matplotlib import image
data = open(sys.argv[1], "rb").read()
head = struct.unpack(">25I", data[:100])
size, width, height, line, colours = head[0], head[4], head[5], head[12], head[19]
begin = size + 12 * colours
pixels = np.frombuffer(data, np.uint8, line * height, begin).reshape(height, line // 4, 4)
rgb = pixels[:, :width, 2::-1].copy()
image.imsave(sys.argv[2], rgb)
arrow = (np.abs(rgb - np.array([255, 85, 0])).max(axis=2) < 60).sum()
sys.exit(0 if arrow > 20 else f"no push arrow: {arrow} orange pixels")
"""


if __name__ == "__main__":
    harness.run(main)
