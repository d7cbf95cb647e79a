"""Devices of public repositories without a rig, whose files lack names or times.

The files are turned into CSV with a header, and first guesses of the rigs are written beside them. A clone of each
repository is expected in one folder, under the repository's name:

- WPI-AIM/dvrk_dynamics_identification, commit 7697d3a6c90866c1846f0d3054d7f78384ab1ef9;
- malik-robert/HSM150-data, commit 35c3b1be8a4c2215ff981eb00bb3ed439e9f524b;
- nielsSkov/masterThesisMatlab, commit 0e2c7253fe6e740c36da872508a71c0d1f66a965.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from gimbal_pin.log.log import Array
from real_data.cases import Case

PSM = """<robot name="psm"><link name="base"/>
<link name="yaw_link"><inertial><origin xyz="0 0 0.1"/><mass value="3"/>
<inertia ixx="0.1" iyy="0.1" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="pitch_link"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"><inertial><origin xyz="0 0 0.1"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="yaw" type="revolute"><parent link="base"/><child link="yaw_link"/><axis xyz="0 -1 0"/>
<limit lower="-1.6" upper="1.6" effort="20" velocity="5"/></joint>
<joint name="pitch" type="revolute"><parent link="yaw_link"/><child link="pitch_link"/><axis xyz="-1 0 0"/>
<limit lower="-1" upper="1" effort="20" velocity="5"/></joint>
<joint name="insertion" type="prismatic"><parent link="pitch_link"/><child link="tool"/><axis xyz="0 0 -1"/>
<limit lower="0" upper="0.24" effort="30" velocity="1"/></joint></robot>
"""
"""A surgical arm's three large axes, which meet in one point; axes by the authors' geometry, masses by guess.

The wrist, some ten grams, is left out, and so is the parallelogram. A counterweight moves against the tool: its weight
takes the tool's away, its inertia does not, which a chain of bodies can only show as a rotor's inertia.
"""
PSM_LOGS = {
    "one": "one_results",
    "two": "two_results",
    "no_weight": "one_no_weight_results",
    "105_g": "one_105_grams_parallel_results",
    "205_g": "one_205_grams_parallel_results",
}
PSM_RATE = 200.0
"""Samples per second, by the authors' notebooks; the files hold no time."""

ROTOR = """<robot name="hsm150"><link name="stator"/>
<link name="rotor"><inertial><mass value="1"/>
<inertia ixx="0.0001" iyy="0.0001" izz="0.00012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shaft" type="continuous"><parent link="stator"/><child link="rotor"/><axis xyz="0 0 1"/>
<limit effort="0.39" velocity="420"/></joint></robot>
"""
"""Two coupled motors, one of them idle: inertia and rated torque as the authors state them in every file."""
ROTOR_LOGS = ("neg_0.045_1", "pos_0.065_1", "neg_0.04_1", "pos_0.06_1")

CART = """<robot name="cart_pendulum"><link name="rail"/>
<link name="cart"><inertial><mass value="6.28"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="bob"><inertial><origin xyz="0 0 0.317"/><mass value="0.2235"/>
<inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="belt" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-0.4" upper="0.45" effort="60" velocity="3"/></joint>
<joint name="pivot" type="continuous"><parent link="cart"/><child link="bob"/><axis xyz="0 -1 0"/>
<limit effort="1" velocity="30"/></joint></robot>
"""
"""A cart on a belt and a pendulum that nobody drives, upright at zero: masses and length as the author states them."""
CART_FORCE = 0.0934 / 0.028
"""N per A: torque constant by the motor's data sheet over the pulley's radius, both as the author states them."""
CART_LOGS = ("swing1_p006", "swing1_p007")


def devices(folder: Path, made: Path) -> list[Case]:
    """Return the cases of the repositories that have a clone in a folder; `made` gets rigs and logs."""
    return [
        *surgical_arm(
            folder / "dvrk_dynamics_identification" / "data" / "psm" / "measured_trajectory", made
        ),
        *motors_coupled(folder / "HSM150-data" / "Data" / "Identification", made),
        *cart(folder / "masterThesisMatlab" / "testResults" / "data" / "swingUp", made),
    ]


def write(path: Path, columns: Mapping[str, Array]) -> Path:
    """Write columns with their names as the header, and return the path."""
    names = ",".join(columns)
    np.savetxt(
        path, np.column_stack(list(columns.values())), "%.9g", ",", header=names, comments=""
    )
    return path


def written(urdf: str, name: str, made: Path) -> Path:
    """Write a URDF, and return its path."""
    path = made / f"{name}.urdf"
    path.write_text(urdf, encoding="utf-8")
    return path


def each_and_all(
    name: str, rig: Path, logs: Mapping[str, Path], alone: Sequence[str], all_of: Sequence[str]
) -> list[Case]:
    """Return a case per log, and one with several together."""
    return [
        *(Case(f"{name}_{log}", rig, (logs[log],), ()) for log in alone),
        *(
            [Case(f"{name}_together", rig, tuple(logs[log] for log in all_of), ())]
            if all_of
            else []
        ),
    ]


def surgical_arm(place: Path, made: Path) -> list[Case]:
    """Patient-side arm of a da Vinci research kit: seven angles, seven rates, seven torques, no header, 30 s."""
    joints = ("yaw", "pitch", "insertion")
    logs = {}
    for name, file in PSM_LOGS.items():
        if not (place / f"{file}.csv").is_file():
            return []
        table = np.loadtxt(place / f"{file}.csv", delimiter=",")
        columns = {"t": np.arange(len(table)) / PSM_RATE}
        for k, joint in enumerate(joints):
            columns |= {
                f"{x}_{joint}": table[:, k + 7 * i] for i, x in enumerate(("q", "dq", "tau"))
            }
        logs[name] = write(made / f"psm_{name}.csv", columns)
    rig = written(PSM, "psm", made)
    return each_and_all("psm", rig, logs, ("one", "two"), ("no_weight", "105_g", "205_g"))


def motors_coupled(place: Path, made: Path) -> list[Case]:
    """A motor that turns at a constant torque, and at another from the tenth second on; the torque is its current's."""
    logs = {}
    for name in ROTOR_LOGS:
        if not (place / f"idf_{name}.mat").is_file():
            return []
        t, _, angle, _, _, torque, _ = loadmat(place / f"idf_{name}.mat")["data"].T
        columns = {"t": t, "q_shaft": angle, "tau_shaft": torque}
        logs[name] = write(made / f"hsm150_{name}.csv", columns)
    rig = written(ROTOR, "hsm150", made)
    return each_and_all("hsm150", rig, logs, ROTOR_LOGS[:2], ROTOR_LOGS)


def cart(place: Path, made: Path) -> list[Case]:
    """A cart that swings its pendulum up: angle, way and the current that the controller asked for."""
    logs = {}
    for name in CART_LOGS:
        if not (place / f"{name}.csv").is_file():
            return []
        table = np.loadtxt(place / f"{name}.csv", delimiter=",")
        columns = {
            "t": table[:, 0],
            "q_belt": table[:, 4],
            "q_pivot": table[:, 1],
            "tau_belt": CART_FORCE * table[:, 11],
            "tau_pivot": np.zeros(len(table)),
        }
        logs[name] = write(made / f"cart_{name}.csv", columns)
    return each_and_all("cart", written(CART, "cart", made), logs, CART_LOGS, ())
