# SPDX-License-Identifier: Apache-2.0
"""A ball pushes a plate with a skin in MuJoCo: what the policy sees, and when the stop comes.

The fabric creeps under the ball, as real ones do: the force that is found comes out high.

    python examples/mujoco_push.py
"""

import mujoco

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.behaviours.stop import StopConfig, StopPolicy
from tactile_skin.simulation.mujoco import MujocoSkin

WORLD = """<mujoco><option timestep="0.002"/><worldbody>
  <geom name="skin" type="box" size="0.12 0.12 0.01"/>
  <body pos="0.03 -0.02 0.045"><joint name="down" type="slide" axis="0 0 -1"/>
    <geom type="sphere" size="0.03" mass="0.2"/></body>
</worldbody><actuator><motor name="arm" joint="down"/></actuator></mujoco>"""

model = mujoco.MjModel.from_xml_string(WORLD)
data = mujoco.MjData(model)
circuit, stop = Circuit(), StopPolicy(StopConfig(threshold=15.0, release=10.0))
skin = MujocoSkin(model, "skin", circuit, PressureCurve(), creep=0.1)
known = skin.curves[0]  # of a skin that was calibrated; a wrong Circuit below shows what that costs
while data.time < 2.0:
    data.ctrl[0] = 20.0 * max(data.time - 1.0, 0.0)  # N, more and more
    mujoco.mj_step(model, data)
    if not skin.step(data):
        continue
    estimate = compensate(skin.raw[0], circuit, known)
    decision = stop.reading(data.time, estimate.force.sum(), estimate.force.max())
    if decision.stop and data.time > 1.0:
        break
naive = compensate(skin.raw[0], circuit, known, method="naive").force.sum()
print(f"at {data.time:.2f} s: {decision.reason}")
print(f"truth {skin.force.sum():.1f} N, found {estimate.force.sum():.1f} N, naive {naive:.1f} N")
