"""Laws of inertia under noise in the motion: where it may hide, no difference is told, and elsewhere it is."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, diagnose, explain, gather, is_hidden_by_noise
from gimbal_pin.dynamics import reduce_parameters
from gimbal_pin.effects import Armature, Cogging, Delay, JointFlexibility, TorqueGain
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig

PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="20" velocity="20"/></joint></robot>
"""
INERTIA = 0.1
WEIGHT = 9.80665 * 0.3
"""About the axis, kg m², and what the arm weighs at its radius, N m."""


def swing(seed: int, shaken: float, inertia: float = INERTIA) -> Log:
    """Half a minute of an arm whose joint shakes by so much from 4 to 12 Hz, rad; its controller damps that."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 0.004)
    slow, fast = (2 * np.pi * rng.uniform(*band, 12) for band in ((0.1, 1.0), (4.0, 12.0)))
    phase = rng.uniform(0.0, 2 * np.pi, (2, 12))
    q, v, a = (
        sum(0.2 * w**k * np.sin(w * t + p + k * np.pi / 2) for w, p in zip(slow, phase[0]))
        for k in range(3)
    )
    dq, dv = (
        shaken * sum(w**k * np.sin(w * t + p + k * np.pi / 2) for w, p in zip(fast, phase[1]))
        for k in range(2)
    )
    tau = inertia * a + WEIGHT * np.sin(q) + 0.05 * v + 0.1 * np.tanh(v / 0.01) - 0.5 * dv
    tau = tau + 0.01 * rng.standard_normal(len(t))
    return Log("swing", ("swing",), t, (q + dq)[:, None], tau=tau[:, None])


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    path = tmp_path_factory.mktemp("rig") / "pendulum.urdf"
    path.write_text(PENDULUM, encoding="utf-8")
    return Rig.load(path)


def tell(rig: Rig, log: Log) -> list[str]:
    """Sentences about the inertia."""
    return [note for note in diagnose(rig, [log], {}, rng=0).notes if "inertia" in note]


def test_a_quiet_motion_tells_the_inertia_and_a_shaken_one_does_not(pendulum: Rig) -> None:
    assert tell(pendulum, swing(0, 0.0)) == []
    (told,) = tell(pendulum, swing(0, 0.0, 1.3 * INERTIA))
    assert "30" in told and "more than the URDF's" in told
    for inertia in (INERTIA, 1.3 * INERTIA):
        (told,) = tell(pendulum, swing(0, 0.02, inertia))
        assert told.startswith("swing: noise in the motion may hide inertia") and "URDF" not in told


@pytest.mark.parametrize("shaken", [False, True])
def test_nothing_that_an_inertia_feels_is_named_where_noise_may_hide_it(
    pendulum: Rig, shaken: bool
) -> None:
    log = swing(0, 0.02 if shaken else 0.0)
    joint = pendulum.joints[0]
    first = explain(gather(pendulum, [log], DIAGNOSIS_BAND), reduce_parameters(pendulum), {}).first
    springs = JointFlexibility(joint, 8.0, rotor_share=0.3), Armature(joint), TorqueGain(joint)
    assert [is_hidden_by_noise(first, cause) for cause in springs] == [shaken] * 3
    assert not any(
        is_hidden_by_noise(first, cause) for cause in (Delay(joint, 0.01), Cogging(joint, (7.0,)))
    )
