"""Rigs of the shapes that people have: gimbals of two autopilots' simulations and for the hand, an arm of seven joints.

Only what is measured is theirs, the places of axes, masses and stops: the files are ours.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.dynamics import check, compute_base, compute_rnea, reduce_parameters, spread_states
from gimbal_pin.regression import map_phi_to_base
from gimbal_pin.rig import Rig, urdf
from tests.mujoco_peer import rigid_bodies, torque
from tests.rigs import spelled, states


def gimbal(name: str, parts: list[tuple[str, str, str, str, float, float]], sensors: str) -> str:
    """An SDF: the base, then per link its name, its joint's place and axis in it, its centre, mass and inertia."""
    solid = "<inertia><ixx>{0}</ixx><iyy>{0}</iyy><izz>{0}</izz></inertia>"
    out = []
    before = "base"
    for link, place, axis, com, mass, inertia in parts:
        last = sensors if link == parts[-1][0] else ""
        joint = (
            f'<joint name="{link}_joint" type="revolute"><pose>{place} 0 0 0</pose><parent>{before}</parent>'
            f"<child>{link}</child><axis><xyz>{axis}</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint>"
        )
        own = f"<inertial><pose>{com} 0 0 0</pose><mass>{mass}</mass>{solid.format(inertia)}</inertial>"
        out.append(f'<link name="{link}">{own}{last}</link>{joint}')
        before = link
    own = f"<inertial><mass>0.2</mass>{solid.format(1e-4)}</inertial>"
    return f'<sdf version="1.9"><model name="{name}"><link name="base">{own}</link>{"".join(out)}</model></sdf>'


PX4 = gimbal(
    "px4",
    [
        ("vertical_arm", "-0.02552 0 0", "0 0 -1", "0 0 -0.1283", 0.1, 1e-3),
        ("horizontal_arm", "0 0 -0.1619", "-1 0 0", "-0.0213 0 -0.162", 0.1, 1e-3),
        ("camera_link", "-0.0412 0 -0.162", "0 1 0", "-0.0412 0 -0.162", 0.1, 1e-3),
    ],
    '<sensor name="camera" type="camera"><pose>-0.0412 0 -0.162 0 0 3.14</pose></sensor>',
)
"""PX4/PX4-gazebo-models, models/gimbal/model.sdf: the links' frames are all at the mount, the joints are not."""
ARDUPILOT = gimbal(
    "ardupilot",
    [
        ("yaw_link", "0.0105 0.065 -0.002", "0 1 0", "0 0 0", 0.01, 1e-5),
        ("roll_link", "0.0099 0.002 -0.05", "0 0 1", "0 0 0", 0.01, 1e-5),
        ("pitch_link", "0.045 0.0021 0.0199", "1 0 0", "0 0 0", 0.01, 1e-5),
    ],
    '<sensor name="camera" type="camera"><pose>0 0 0 -1.57 -1.57 0</pose></sensor>',
)
"""ArduPilot/ardupilot_gazebo, models/gimbal_small_3d/model.sdf: it lies on its side, its camera looks along z."""
HANDHELD = gimbal(
    "handheld",
    [
        ("core", "0 0 0", "0 0 1", "0 0 0", 0.019, 4e-6),
        ("primary_ring", "0 0 0", "1 0 0", "0 0 0", 0.041, 2e-5),
        ("secondary_ring", "0 0 0", "0 1 0", "0.01 0 0.04", 0.058 + 0.6, 1e-3),
    ],
    '<sensor name="camera" type="camera"/>',
)
"""thomasnordquist/openscad-gimbal, lib/gimbal.scad: octagonal rings 42.5, 71.5 and 99.5 mm wide and 17 mm high on a
handle, their axes meet; here of PLA, with a camera of 0.6 kg on the outer one."""


def panda() -> str:
    """An arm of seven joints, with the axes of Franka's Panda as its documents give them, after Craig.

    Masses as identified by Gaz et al., IEEE RA-L 4(4), 2019; each link is a ball about a point off its axes.
    """
    right = np.pi / 2
    rows = [(0, 0.333, 0), (0, 0, -right), (0, 0.316, right), (0.0825, 0, right)]
    rows += [(-0.0825, 0.384, -right), (0, 0, right), (0.088, 0, right)]
    masses = (4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522)
    out = ['<robot name="panda"><link name="link0"/>']
    for k, ((a, d, alpha), mass) in enumerate(zip(rows, masses), start=1):
        place = pin.SE3(pin.rpy.rpyToMatrix(alpha, 0, 0), np.array([a, 0, 0])) * pin.SE3(
            np.eye(3), np.array([0, 0, d])
        )
        xyz = " ".join(f"{x:.17g}" for x in place.translation)
        turned = " ".join(f'{entry}="{0.01 * mass}"' for entry in ("ixx", "iyy", "izz"))
        out.append(
            f'<link name="link{k}"><inertial><origin xyz="0.02 0.03 -0.04"/><mass value="{mass}"/>'
            f'<inertia {turned} ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="joint{k}" type="revolute">'
            f'<parent link="link{k - 1}"/><child link="link{k}"/><origin xyz="{xyz}" rpy="{alpha:.17g} 0 0"/>'
            '<axis xyz="0 0 1"/><limit lower="-2.8" upper="2.8" effort="87" velocity="2"/></joint>'
        )
    return "".join([*out, "</robot>"])


@cache
def rig(name: str) -> Rig:
    if name == "panda":
        return spelled(panda())
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.sdf"
        path.write_text(
            {"px4": PX4, "ardupilot": ARDUPILOT, "handheld": HANDHELD}[name], encoding="utf-8"
        )
        return Rig.load(path)


# Three axes that meet at right angles, the first upright, show 15; Gaz et al. count 43 of the Panda. ArduPilot's first
# axis lies: gravity shows two more, the first moments about it, which an upright axis hides.
INERTIAL = {"px4": 15, "handheld": 15, "ardupilot": 17, "panda": 43}


@pytest.mark.parametrize("name", INERTIAL)
def test_public_rigs_are_sound_and_known(name: str) -> None:
    own = rig(name)
    assert own.notes == ()
    assert check(own).identifiable == len(compute_base(own).terms) == INERTIAL[name] + 2 * own.n
    q, v, a = states(own.n, 1)
    peer = rigid_bodies(urdf.parse_robot(own.urdf, name))
    ours = compute_rnea(own, q, v, a)
    np.testing.assert_allclose(
        ours, torque(peer, own.joints, q, v, a), rtol=0, atol=1e-12 * np.abs(ours).max()
    )


@pytest.mark.parametrize("name", INERTIAL)
def test_other_bodies_with_the_same_base_parameters_ask_for_the_same_torques(name: str) -> None:
    own = rig(name)
    mixing = map_phi_to_base(own, reduce_parameters(own))
    null = np.linalg.svd(mixing)[2][np.linalg.matrix_rank(mixing) :]
    phi = own.phi + null.T @ np.random.default_rng(2).normal(size=len(null)) * np.abs(own.phi).max()
    q, v, a = spread_states(own, 50)
    ours = compute_rnea(own, q, v, a)
    other = compute_rnea(own.with_phi(phi), q, v, a)
    np.testing.assert_allclose(other, ours, rtol=0, atol=1e-9 * np.abs(ours).max())


@pytest.mark.parametrize(
    ("name", "way"), [("px4", [-1, 0, 0]), ("ardupilot", [0, 0, 1]), ("handheld", [1, 0, 0])]
)
def test_a_simulated_camera_looks_where_its_sensor_does(name: str, way: list[float]) -> None:
    """The files state angles in two and three digits."""
    own = rig(name)
    data = own.model.createData()
    pin.framesForwardKinematics(own.model, data, np.zeros(own.n))
    sight = data.oMf[own.model.getFrameId(own.camera_frame)].rotation[:, 0]
    assert own.camera_frame == "camera" and np.linalg.norm(sight - way) < 3e-3
