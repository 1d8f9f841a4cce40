# SPDX-License-Identifier: Apache-2.0
"""Run the skin on a simulated board and print each contact: its place, force and identity.

python examples/print_contacts.py        # 20 seconds
python examples/print_contacts.py 5
"""

import sys

from tactile_skin.launch import launch
from tactile_skin.msg import PointCloud2, cloud_columns

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
frames = 0


def on_contacts(message: PointCloud2) -> None:
    global frames
    frames += 1
    if frames % 25:  # the board sends 100 frames a second
        return
    contacts = cloud_columns(message)  # field name -> one value per contact
    for k in range(message.width):
        place = "{:+.3f} {:+.3f} {:+.3f}".format(*(contacts[axis][k] for axis in "xyz"))
        print(f"contact {contacts['id'][k]:.0f}: {contacts['force'][k]:5.1f} N at {place} m")


# On a robot: launch("skin.launch.yaml", port="/dev/ttyUSB0", monitor=False)
with launch(scene="two_fingers", method="auto", monitor=False) as skin:
    skin.node.create_subscription(PointCloud2, "skin/contacts", on_contacts, 10)
    skin.spin(seconds)
