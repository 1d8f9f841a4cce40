"""A driver of your own in place of serial_driver: it publishes skin/adc, whatever the board speaks.

Here the readings are simulated; `read` is where yours come from: Bluetooth, CAN, packed bits.

    python examples/own_driver.py        # 8 seconds
    python examples/own_driver.py 20
"""

import sys
from pathlib import Path

import numpy as np

from tactile_skin import Circuit, PressureCurve, forward
from tactile_skin.launch import launch
from tactile_skin.msg import Header, Image, WrenchStamped, image


class OwnDriver:
    """-> skin/adc: ADC steps * 2^(16 - bits), row by row, stamped when they were read."""

    def __init__(self, node):
        self.node, self.rng, self.begun = node, np.random.default_rng(0), node.get_clock().now()
        self.publisher = node.create_publisher(Image, "skin/adc", 10)
        node.create_timer(0.02, self.on_timer)

    def read(self) -> np.ndarray:
        """(8, 8) ADC steps of 10 bits: a finger of 6 N from the third second on."""
        force, circuit = np.zeros((8, 8)), Circuit(8, 8)
        force[2, 5] = 6.0 * ((self.node.get_clock().now() - self.begun).nanoseconds > 3e9)
        rest = np.exp(0.03 * np.random.default_rng(1).standard_normal((8, 8))) * 4e4
        curve = PressureCurve().resting_at(rest)
        return forward(circuit, curve.resistance(force)) * 1023 + self.rng.normal(0, 0.7, (8, 8))

    def on_timer(self) -> None:
        samples = np.rint(self.read() * 2**6).astype(np.uint16)
        header = Header(self.node.get_clock().now().to_msg(), "base_link")
        self.publisher.publish(image(samples, "16UC1", header))


if __name__ == "__main__":
    seconds, forces = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0, []
    with launch(Path(__file__).with_name("own_driver.launch.yaml")) as skin:
        skin.node.create_subscription(WrenchStamped, "skin/wrench", forces.append, 10)
        skin.spin(seconds)
    print(f"{len(forces)} wrenches, at most {max(abs(m.wrench.force.x) for m in forces):.1f} N")
