"""Diagnoses of measured logs, which are not in the repository: planted by nature, known to us.

The cogging of a turning motor is found blind. What noise or a disagreement of logs forbids is not
stated.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.log import read_log
from gimbal_pin.rig import Rig

DATA = Path(__file__).parents[2] / "shared"
COGGING = {*range(12, 193, 12), *range(14, 197, 14)}
"""Harmonics per turn of a motor with twelve slots and fourteen poles."""


def said(urdf: str, files: list[str], columns: list[str]) -> Diagnosis:
    """Return the diagnosis of logs beside a URDF; skip the test where they are missing."""
    place = DATA / urdf
    if not place.exists():
        pytest.skip(f"{place} is missing")
    rig = Rig.load(place)
    logs = [read_log(place.parent / file, rig, columns) for file in files]
    return diagnose(rig, logs)


def test_cogging_of_a_turning_motor_is_found() -> None:
    """One log lost two samples in five; 0.56 A are left without the cogging."""
    columns = ["t=time_s", "q_motor=pos_counts*0.00076699", "tau_motor=iq_a*0.0276"]
    files = [f"slow_{run}.csv" for run in "abcd"]
    found = said("data/odrive_cogging/rotor.urdf", files, columns)
    assert found.verdict == "named"
    assert found.findings[0].alike == ("cogging",)
    assert len({size.value for size in found.findings[0].parameters} & COGGING) >= 5
    assert found.held_out is not None
    assert found.held_out.refitted.torque_rmse["motor"] > 0.55 * 0.0276
    assert found.held_out.extended.torque_rmse["motor"] < 0.22 * 0.0276


def test_logs_of_a_double_pendulum_disagree() -> None:
    columns = ["t=time", "q_shoulder=pos1", "dq_shoulder=vel1", "tau_shoulder=tau1"]
    columns += ["q_elbow=pos2", "dq_elbow=vel2", "tau_elbow=tau2"]
    files = [f"20220812-{run}-PM_measured.csv" for run in ("055640", "060143", "061157")]
    urdf = "data/dfki_double_pendulum/double_pendulum.urdf"
    found = said(urdf, files, columns)
    assert not found.findings
    assert [fault.cause for fault in found.spoiling] == ["logs-disagree"]


def test_a_negative_fitted_inertia_is_not_stated() -> None:
    """The noise of the pendulum's rate makes it so."""
    columns = ["t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque"]
    urdf = "data/dfki_simple_pendulum/pendulum.urdf"
    found = said(urdf, ["system_identification.csv"], columns)
    assert found.verdict == "data"
    assert not any("%" in note for note in found.notes if "inertia about its axis" in note)


@pytest.mark.slow
def test_no_saturation_lies_below_the_torque_that_the_arm_measured() -> None:
    found = said("data/franka_fer_unisa/fer.urdf", ["panda_unisa.db3"], [])
    assert "saturation" not in {finding.cause for finding in found.findings}


@pytest.mark.xfail(strict=True, reason="a base that moves unmeasured is taken for delays")
def test_a_base_that_moves_without_its_imu_is_unknown() -> None:
    found = said("cases/semantic/rig.yaml", ["platform_imu_lost.csv.gz"], [])
    assert found.verdict == "unknown"


@pytest.mark.parametrize(
    "file", ["time_twice_too_fast", "angle_with_gear_twice", "hung_upside_down"]
)
def test_a_unit_or_a_mount_that_the_urdf_lacks_is_stated(file: str) -> None:
    found = said("cases/semantic/rig.yaml", [f"{file}.csv.gz"], [])
    assert found.statements and found.verdict == "unknown"
