# SPDX-License-Identifier: Apache-2.0
"""A driver of your own in place of serial_driver: python examples/own_driver.py"""

import numpy as np

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.launch import launch
from tactile_skin.msg import Header, Image, WrenchStamped, image

CONFIG = __file__.replace(".py", ".yaml")
RNG = np.random.default_rng(1)
CURVE = PressureCurve().resting_at(4e4 * np.exp(0.03 * RNG.standard_normal((8, 8))))


class OwnDriver:
    """-> skin/adc: ADC steps * 2^(16 - bits), row by row, stamped when they were read."""

    def __init__(self, node):
        self.node, self.frames = node, 0
        self.publisher = node.create_publisher(Image, "skin/adc", 10)
        node.create_timer(0.02, self.on_timer)

    def on_timer(self) -> None:
        self.frames += 1
        samples = np.rint(read(self.frames > 150) * 2**6).astype(np.uint16)
        stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(image(samples, "16UC1", Header(stamp, "base_link")))


def read(touched: bool) -> np.ndarray:
    """(8, 8) ADC steps of 10 bits, here simulated: nothing, or a finger of 6 N."""
    force = 6.0 * touched * (np.arange(64) == 21).reshape(8, 8)
    return forward(Circuit(8, 8), CURVE.resistance(force)) * 1023 + RNG.normal(0.0, 0.7, (8, 8))


if __name__ == "__main__":
    with launch("skin.launch.yaml", config=CONFIG, monitor=False) as skin:
        skin.node.create_subscription(WrenchStamped, "skin/wrench", print, 10)
        skin.spin(8.0)
