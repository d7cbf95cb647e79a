"""MJCF in MuJoCo itself: the torques are the model's, and what has no element there is said."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import ModelError
from gimbal_pin.export import convert_to_mjcf
from tests.exported import modelled
from tests.mujoco_peer import torque
from tests.rigs import VARIETY, bundled, states

WRITTEN = (
    "armature:{0}:inertia=0.004",
    "cable-spring:{1}:stiffness=0.3,rest=0.2",
    "base-tilt:roll=0.1,pitch=-0.2",
    "encoder-offset:{1}:offset=0.05",
    "torque-gain:{0}:gain=0.9",
    "actuator-lag:{0}:time_constant=0.004",
    "saturation:{1}:limit=0.5",
)
"""Causes that MuJoCo has an element for."""
UNWRITTEN = (
    "cogging:{0}:amplitude=0.05,harmonic=42",
    "backlash:{1}:gap=0.01",
    "delay:{0}:time=0.004",
    "torque-bias:{1}:bias=0.02",
)
"""Causes that it has none for."""


@pytest.mark.parametrize(("name", "payload"), VARIETY)
def test_mujoco_asks_for_the_torque_of_the_model(name: str, payload: str) -> None:
    """Between the stops, which push in MuJoCo, and at rates of at least 0.5 rad/s: none is at a standstill."""
    rig = bundled(name, payload)
    model = modelled(rig, WRITTEN)
    text, notes = convert_to_mjcf(model)
    assert notes == ()
    engine = mujoco.MjModel.from_xml_string(text)
    q, v, a = states(rig.n, 1)
    low, high = (np.clip(ends, -3.0, 3.0) for ends in rig.stops)
    q = low + (high - low) * (0.5 + 0.4 * q / np.pi)
    v += 0.5 * np.sign(v)
    asked = torque(engine, rig.joints, q, v, a) / engine.actuator_gainprm[:, 0]
    expected = model.inverse_dynamics(q, v, a)
    assert np.abs(asked - expected).max() < 1e-6 * np.abs(expected).max()


def test_an_actuator_gives_what_the_drive_gives() -> None:
    """Settled: gain times command up to the limit; the lag is its filter's; a geared motor's is on the motor's side."""
    rig = bundled("turret")
    motors = (replace(rig.motors[0], gear_ratio=5.0), *rig.motors[1:])
    model = modelled(replace(rig, motors=motors), WRITTEN)
    engine = mujoco.MjModel.from_xml_string(convert_to_mjcf(model)[0])
    data = mujoco.MjData(engine)
    assert engine.actuator_dynprm[0, 0] == 0.004
    for command, acting in ((0.1, (0.1, 0.1)), (1e3, (model.tau_max[0], 0.5))):
        data.act[:] = command / 5
        data.ctrl[:] = command
        mujoco.mj_forward(engine, data)
        np.testing.assert_allclose(data.qfrc_actuator, np.array(acting) * [0.9, 1.0], rtol=1e-9)


def test_the_camera_looks_where_the_line_of_sight_is() -> None:
    """MuJoCo's cameras look along -z."""
    rig = bundled("thesis", "cinema")
    engine = mujoco.MjModel.from_xml_string(convert_to_mjcf(nominal(rig))[0])
    data = mujoco.MjData(engine)
    mujoco.mj_forward(engine, data)
    sight = data.site(rig.camera_frame).xmat[[0, 3, 6]]
    np.testing.assert_allclose(-data.cam_xmat.reshape(3, 3)[:, 2], sight, atol=1e-12)


def test_what_mujoco_cannot_hold_is_said_and_a_mass_below_zero_refused() -> None:
    rig = bundled("thesis")
    _, notes = convert_to_mjcf(modelled(rig, UNWRITTEN))
    for cause in ("cogging", "backlash", "delay", "a constant torque of +0.02 N m"):
        assert sum(cause in note for note in notes) == 1
    phi = rig.phi
    phi[10] = -1.0
    with pytest.raises(ModelError, match="no mass"):
        convert_to_mjcf(nominal(rig.with_phi(phi)))
