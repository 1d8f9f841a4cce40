# SPDX-License-Identifier: Apache-2.0
"""A LeRobotDataset of simulated touch: balls fall on a skin in MuJoCo, an episode each.

It holds raw readings, what compensation makes of them, and the true force.

    python examples/mujoco_record.py FOLDER
"""

import sys

import mujoco
import numpy as np
from lerobot.datasets import LeRobotDataset

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.simulation.mujoco import MujocoSkin

WORLD = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="skin" type="box" size="0.12 0.12 0.01"/>
  <body pos="{x} 0.02 0.06"><freejoint/><geom type="sphere" size="0.03" mass="0.5"/></body>
</worldbody></mujoco>"""
FEATURES = {
    f"observation.{name}": {"dtype": "float32", "shape": shape, "names": None}
    for name, shape in (("raw", (16, 16)), ("force", (16, 16)), ("truth", (1,)))
}
circuit = Circuit()
dataset = LeRobotDataset.create("me/touch", 100, FEATURES, root=sys.argv[1], use_videos=False)
for x in (-0.03, 0.03):
    model = mujoco.MjModel.from_xml_string(WORLD.format(x=x))
    data, skin = mujoco.MjData(model), MujocoSkin(model, "skin", circuit, PressureCurve())
    while data.time < 0.5:
        mujoco.mj_step(model, data)
        if skin.step(data):
            force = compensate(skin.raw[0], circuit, skin.curves[0]).force
            values = (np.float32(v) for v in (skin.raw[0], force, [skin.force.sum()]))
            frame = dict(zip(FEATURES, values, strict=True))
            dataset.add_frame(frame | {"task": "fall"})
    dataset.save_episode()
dataset.finalize()
print(f"{dataset.num_frames} frames, {dataset.num_episodes} episodes")
