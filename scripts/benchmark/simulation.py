"""Our closed loop against MuJoCo's RK4: one URDF, one controller, one reference, one torque limit, exact sensors."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import mujoco
import numpy as np
from lxml import etree

from benchmark.data import DT, exciting
from benchmark.figure import Figure
from benchmark.timing import alternating
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.model import nominal
from gimbal_pin.rig import GRAVITY, Rig
from gimbal_pin.simulation import Controller, Reference, Sensors, simulate
from gimbal_pin.tuning import tune

ROUNDS = 9
DELAY = 1
"""Samples between measurement and torque."""
BARE = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT


def measure() -> Iterator[Figure]:
    """Yield real-time factors, their ratio, and how far the two trajectories are apart."""
    rig = Rig.load("thesis")
    plant, reference = nominal(rig), exciting(rig, np.random.default_rng(2))
    controller = tune(plant, dt=DT).controller
    world = mujoco_model(rig)

    def ours() -> Log:
        rng, sensors = np.random.default_rng(0), Sensors.exact(rig.n)
        return simulate(plant, controller, reference, rng=rng, sensors=sensors, delay=DELAY)

    def theirs() -> Array:
        return in_mujoco(world, rig, controller, reference)

    apart = np.sqrt(np.mean((ours().q - theirs()) ** 2, axis=0)).max()
    times = alternating({"ours": ours, "mujoco": theirs}, ROUNDS, "simulation")
    seconds = DT * len(reference)
    yield Figure("closed loop, MuJoCo's RK4: simulated time / time", seconds / times.median("mujoco"), "x")
    yield Figure("closed loop, ours: simulated time / time", seconds / times.median("ours"), "x")
    yield Figure("closed loop, real-time factor of ours / MuJoCo's", times.ratio("mujoco", "ours"), at_least=0.8)
    yield Figure("closed loop, rms angle between the two, worst joint", 1e3 * float(apart), "mrad", at_most=0.1)


def mujoco_model(rig: Rig) -> mujoco.MjModel:
    """The rig's URDF in MuJoCo: friction from ``<dynamics>``, no collisions, no joint limits, RK4 at `DT`."""
    robot = etree.fromstring(rig.urdf.encode())
    compiler = {"discardvisual": "true", "fusestatic": "false", "balanceinertia": "false"}
    etree.SubElement(etree.SubElement(robot, "mujoco"), "compiler", compiler)
    model = mujoco.MjModel.from_xml_string(etree.tostring(robot).decode())
    model.opt.timestep = DT
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.gravity[:] = 0, 0, -GRAVITY
    model.opt.disableflags |= BARE
    for j, joint in enumerate(rig.joints):
        assert model.joint(joint).dofadr[0] == model.joint(joint).qposadr[0] == j, "the joints' order differs"
    model.dof_frictionloss[:], model.dof_damping[:] = rig.friction.T
    return model


def in_mujoco(model: mujoco.MjModel, rig: Rig, controller: Controller, reference: Motion) -> Array:
    """Angles of the closed loop in MuJoCo, rad, (N, n): the same samples, delay, limits and controller as ours."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = reference.q[0], reference.v[0]
    q, tau = np.empty(reference.q.shape), np.empty(reference.q.shape)
    pending: deque[Array] = deque([np.zeros(rig.n)] * DELAY)
    limit, memory = rig.tau_max, controller.start()
    rows = zip(reference.t.tolist(), reference.q, reference.v, reference.a)
    for k, (t, *wished) in enumerate(rows):
        q[k] = data.qpos
        wanted, memory = controller.torque(t, q[k], data.qvel.copy(), Reference(*wished), memory)
        pending.append(wanted)
        tau[k] = np.minimum(np.maximum(pending.popleft(), -limit), limit)
        data.qfrc_applied[:] = tau[k]
        mujoco.mj_step(model, data)
    return q
