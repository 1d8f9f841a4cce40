# SPDX-License-Identifier: Apache-2.0
"""`lerobot-record` with a robot that has nothing but a skin, and a teleoperator that does nothing.

Not run as a program: LeRobot looks for a device next to its configuration, by the module's name.
"""

import os
from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

BEGUN = float(os.environ.get("BEGUN", "0"))  # s: float32 of a dataset holds no `perf_counter`
WAITS = 2000  # ms: a busy machine is not what is tested


@RobotConfig.register_subclass("mock_touched")
@dataclass(kw_only=True)
class MockTouchedConfig(RobotConfig):
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


class MockTouched(Robot):
    """Each observation has a new picture, its depth and, next to them, its time."""

    config_class, name = MockTouchedConfig, "mock_touched"

    def __init__(self, config):
        super().__init__(config)
        self.cameras = make_cameras_from_configs(config.cameras)

    @property
    def observation_features(self):
        camera = self.cameras["touch"]
        size = camera.height, camera.width
        pictures = {"touch": (*size, 3), "touch_depth": (*size, 1)}
        return {"touch.time": float, "touch.force": float} | pictures

    @property
    def action_features(self):
        return {"still.pos": float}

    @property
    def is_connected(self):
        return all(camera.is_connected for camera in self.cameras.values())

    def connect(self, calibrate=True):
        for camera in self.cameras.values():
            camera.connect()

    is_calibrated = True

    def calibrate(self):
        pass

    def configure(self):
        pass

    def get_observation(self):
        camera = self.cameras["touch"]
        while True:  # until both are of one frame
            seen = {"touch": camera.async_read(WAITS)}
            frame = camera.frame
            seen["touch_depth"] = camera.read_latest_depth(WAITS)
            if frame is camera.frame and frame.time == camera._served["rgb"]:
                force = float(frame.force.sum())
                return {"touch.time": frame.time - BEGUN, "touch.force": force} | seen

    def send_action(self, action):
        return action

    def disconnect(self):
        for camera in self.cameras.values():
            camera.disconnect()


@TeleoperatorConfig.register_subclass("mock_still")
@dataclass(kw_only=True)
class MockStillConfig(TeleoperatorConfig):
    pass


class MockStill(Teleoperator):
    config_class, name = MockStillConfig, "mock_still"
    is_connected = is_calibrated = True
    feedback_features: dict = {}  # noqa: RUF012
    action_features: dict = {"still.pos": float}  # noqa: RUF012

    def connect(self, calibrate=True):
        pass

    def calibrate(self):
        pass

    def configure(self):
        pass

    def get_action(self):
        return {"still.pos": 0.0}

    def send_feedback(self, feedback):
        pass

    def disconnect(self):
        pass


def main():
    """Run `lerobot-record`, which knows these two now."""
    from lerobot.scripts import lerobot_record

    lerobot_record.main()
