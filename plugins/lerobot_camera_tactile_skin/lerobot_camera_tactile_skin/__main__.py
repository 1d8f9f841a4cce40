# SPDX-License-Identifier: Apache-2.0
"""List the boards that are plugged in, as `lerobot-find-cameras` lists cameras of its own kinds."""

from . import TactileSkinCamera

if __name__ == "__main__":
    found = TactileSkinCamera.find_cameras()
    for number, camera in enumerate(found):
        print(f"Camera #{number}:", *(f"{k}: {v}" for k, v in camera.items()), sep="\n  ")
    print("" if found else "no USB serial board found")
