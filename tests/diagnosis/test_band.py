"""The band of a diagnosis holds the lines of a turning joint's torque, and follows no noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, choose_band, diagnose
from gimbal_pin.effects import CAUSES
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig

ROTOR = """<robot name="rotor"><link name="base"/><link name="disc"><inertial><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="motor" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.fixture
def rotor(tmp_path: Path) -> Rig:
    path = tmp_path / "rotor.urdf"
    path.write_text(ROTOR, encoding="utf-8")
    return Rig.load(str(path))


def turning(amplitude: float, noise: float, turns: float = 0.8, teeth: int = 72) -> Log:
    """A loop holds a rate that wavers; its torque is friction, inertia and teeth, with white noise."""
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(10000)
    rate, waver = 2 * np.pi * turns, 2 * np.pi * 1.3
    q = rate * t + 0.05 * np.sin(waver * t)
    v, a = rate + 0.05 * waver * np.cos(waver * t), -0.05 * waver**2 * np.sin(waver * t)
    tau = 2e-4 * a + 4e-3 + 1e-3 * v + amplitude * np.cos(teeth * q) + noise * rng.standard_normal(len(t))
    return Log("turning", ("motor",), t, q[:, None], v[:, None], tau[:, None])


@pytest.mark.parametrize(("turns", "teeth"), [(0.3, 84), (0.8, 72), (1.0, 18)])
def test_the_band_holds_the_lines_of_the_teeth(rotor: Rig, turns: float, teeth: int) -> None:
    assert choose_band(rotor, [turning(5e-3, 1e-4, turns, teeth)]).cutoff >= turns * teeth


@pytest.mark.parametrize("noise", [1e-5, 1e-3, 1e-1])
def test_the_band_follows_no_noise(rotor: Rig, noise: float) -> None:
    assert choose_band(rotor, [turning(0.0, noise)]) == DIAGNOSIS_BAND


def test_teeth_that_pass_quickly_are_named(rotor: Rig) -> None:
    some = {name: CAUSES[name] for name in ("cogging", "stribeck")}
    found = diagnose(rotor, [turning(5e-3, 1e-3)], some, rng=np.random.default_rng(0))
    assert [(one.cause, one.status) for one in found.findings] == [("cogging", "named")]
    figures = {p.name: p.value for p in found.findings[0].parameters}
    assert figures["harmonic"] == 72 and figures["amplitude"] == pytest.approx(5e-3, rel=0.05)
