"""Several skins as one body on rclpy: one program, one stop whose reason names the skin."""

import pytest
import yaml
from support.ros_graph import board, endless, program

NAMES = "chest", "back"


@pytest.mark.ros
def test_a_push_on_each_skin_stops_the_body_with_its_name(graph, plain, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import PointCloud2

    plain.hear(DiagnosticArray, "skin/stop_status")
    plain.hear(PointCloud2, "skin/contacts")

    def says(stop: bool, *words: str) -> bool:
        heard = plain.heard["skin/stop_status"][-5:]
        messages = [status.message for m in heard for status in m.status]
        return bool(messages) and all(
            bool(text) == stop and all(word in text for word in words) for text in messages
        )

    with board() as chest, board() as back:
        players = dict(zip(NAMES, (chest, back), strict=True))
        skins = {
            name: {
                "port": player.port,
                "geometry": {"shape": "plane"},
                "stop_on_push": {"stale_after": 0.5},
            }
            for name, player in players.items()
        }
        config = tmp_path / "robot.yaml"
        config.write_text(yaml.safe_dump({"skins": skins}))
        graph.start("body", program("body", "-p", f"config:={config}"))
        for pushed in NAMES:
            scenes = {name: "push_left" if name == pushed else "idle" for name in NAMES}
            with chest.playing(endless("idle", 1)), back.playing(endless("idle", 2)):
                plain.until(lambda: says(False), "free", graph)
            with (
                chest.playing(endless(scenes["chest"], 1)),
                back.playing(endless(scenes["back"], 2)),
            ):
                plain.until(lambda name=pushed: says(True, f"{name}: push"), pushed, graph)
        with chest.playing(endless("idle", 1)):
            plain.until(lambda: says(True, "back: ", "stale"), "a silent board", graph)
