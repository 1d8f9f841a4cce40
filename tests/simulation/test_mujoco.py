# SPDX-License-Identifier: Apache-2.0
"""A skin on a geom of MuJoCo: the forces of its contacts arrive, through the real circuit."""

import time

import numpy as np
import pytest

from tactile_skin import Circuit, PressureCurve, compensate
from tactile_skin.simulation.mujoco import MujocoSkin

mujoco = pytest.importorskip("mujoco", reason="not installed: .ci/learning")

CIRCUIT = Circuit()
WORLD = """<mujoco><option timestep="0.002" cone="{cone}"/><worldbody>
<geom name="skin" type="box" size="0.12 0.12 0.01" pos="0 0 0.01" euler="{tilt} 0 0"/>
<body pos="{x} {y} 0.08"><freejoint/><geom type="sphere" size="{ball}" mass="{mass}"/></body>
<body pos="{u} {y} 0.07"><freejoint/><geom type="box" size="0.02 0.015 0.02" mass="0.6"/></body>
</worldbody></mujoco>"""


def world(rng, cone="pyramidal", tilt=0.0):
    x, u = rng.uniform(-0.08, -0.03), rng.uniform(0.03, 0.07)
    where = {"x": x, "u": u, "y": rng.uniform(-0.07, 0.07)}
    ball = {"ball": rng.uniform(0.02, 0.04), "mass": rng.uniform(0.3, 1.5)}
    model = mujoco.MjModel.from_xml_string(WORLD.format(**where, **ball, cone=cone, tilt=tilt))
    return model, mujoco.MjData(model)


def pressed(model, data, geom=0):
    """MuJoCo's own normal forces on the geom [N], how many, and their moment about its y and x."""
    total, count, moment, wrench = 0.0, 0, np.zeros(2), np.zeros(6)
    for k in range(data.ncon):
        if geom in data.contact[k].geom:
            mujoco.mj_contactForce(model, data, k, wrench)
            total, count = total + wrench[0], count + 1
            moment += wrench[0] * data.contact[k].pos[:2]
    return total, count, moment


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_the_picture_has_mujocos_force(cone, capsys):
    """Within 3 %, over 200 contacts of balls and boxes."""
    rng, off, contacts = np.random.default_rng(3), [], 0
    for seed in range(42):
        model, data = world(rng, cone)
        skin, forces = MujocoSkin(model, "skin", CIRCUIT, PressureCurve(), seed=seed), []
        skin.step(data)
        while data.time < 0.4:
            mujoco.mj_step(model, data)
            force, count, moment = pressed(model, data)
            forces.append(force)
            if skin.step(data):
                last, forces = np.mean(forces), []
        contacts += count
        found = compensate(skin.raw[0], CIRCUIT, skin.curves[0])
        assert found.status == "ok" and last > 5.0
        off.append(abs(found.force.sum() / last - 1.0))
        columns = skin.force[0].sum(0) @ skin._col
        assert columns == pytest.approx(moment[0], abs=0.004 * last)  # N m: 4 mm
    with capsys.disabled():
        print(f"\n{cone}: {contacts} contacts, {100 * np.max(off):.2f} % at most")
    assert contacts >= 200 and max(off) < 0.03


def test_a_wrong_circuit_creep_and_scatter_are_seen():
    model, data = world(np.random.default_rng(1))
    plain = MujocoSkin(model, "skin", CIRCUIT, PressureCurve())
    other = MujocoSkin(model, "skin", CIRCUIT, PressureCurve(), creep=0.2, scatter=0.1)
    while data.time < 1.0:
        mujoco.mj_step(model, data)
        plain.step(data)
        other.step(data)
    truth, known = plain.force.sum(), plain.curves[0]
    right = compensate(plain.raw[0], CIRCUIT, known).force.sum()
    wrong = compensate(plain.raw[0], Circuit(r_par=150.0), known).force.sum()
    crept = compensate(other.raw[0], CIRCUIT, other.curves[0]).force.sum()
    assert abs(right / truth - 1.0) < 0.03 < abs(wrong / truth - 1.0)
    assert crept > 1.05 * truth


def test_worlds_are_those_of_one_alone_and_nothing_is_lost_at_an_edge():
    rng = np.random.default_rng(2)
    model, one = world(rng)
    two = mujoco.MjData(model)
    two.qpos[0] += 0.01
    both = MujocoSkin(model, "skin", CIRCUIT, PressureCurve(), worlds=2)
    alone = MujocoSkin(model, "skin", CIRCUIT, PressureCurve())
    while one.time < 0.3:
        for data in (one, two):
            mujoco.mj_step(model, data)
        assert both.step(one, two) == alone.step(one)
    assert both.force[0] == pytest.approx(alone.force[0]) and both.raw.shape == (2, 16, 16)
    edge = np.array([0.119]), np.array([-0.119]), np.array([7.0]), np.array([0.03])
    assert alone._footprints(*edge).sum() == pytest.approx(7.0)


@pytest.mark.slow
def test_what_a_step_costs(capsys):
    """At most 2 ms for one skin; of 256 worlds the figure is only printed."""
    model, data = world(np.random.default_rng(1))
    worlds = [data, *(mujoco.MjData(model) for _ in range(255))]
    costs = {}
    for n, times in ((1, 400), (256, 40)):
        skin, took = MujocoSkin(model, "skin", CIRCUIT, PressureCurve(), worlds=n), []
        for _ in range(times):
            for each in worlds[:n]:
                mujoco.mj_step(model, each)
            begun = time.thread_time()
            skin.step(*worlds[:n])
            took.append(time.thread_time() - begun)
        costs[n] = np.mean(took)
    with capsys.disabled():
        ratio = 256 * costs[1] / costs[256]
        print(f"\n{1e3 * costs[1]:.2f} ms a step; 256 worlds {ratio:.1f} times one")
    assert costs[1] < 0.002
