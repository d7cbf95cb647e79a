"""Diagnoses of measured logs, which are not in the repository: planted by nature, known to us.

The cogging of a turning motor is found blind. What noise or a disagreement of logs forbids is not
stated. The coupling of a wrist explains its torques, with the friction that its authors published.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.identification import identify
from gimbal_pin.log import read_log
from gimbal_pin.regression import Filtering
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


def test_the_coupling_of_a_wrist_explains_its_torques(tmp_path: Path) -> None:
    """Its authors found Fsm 2.03 N m and Fvm 0.60 N m s/rad from 9 s, of which these are 4."""
    place = DATA / "data/staubli_tx40"
    if not place.exists():
        pytest.skip(f"{place} is missing")
    ratios = (32, 32, 45, -48, 45, 32)
    gears = "".join(f"  joint_{k}: {{gear_ratio: {x}}}\n" for k, x in enumerate(ratios, 1))
    errors = []
    for coupling in ("", "coupling: {joint_6: {joint_5: 1.0}}\n"):
        path = tmp_path / "arm.yaml"
        path.write_text(f"urdf: {(place / 'tx40.urdf').resolve()}\nmotors:\n{gears}{coupling}")
        rig = Rig.load(path, mend=True)
        log = read_log(place / "tx40_4s.csv.gz", rig)
        found = identify(rig, log, filtering=Filtering(cutoff=20.0), examined="never")
        assert found.held_out is not None
        errors.append([found.held_out.torque_rmse[f"joint_{k}"] for k in (5, 6)])
    assert errors[1][0] < 0.4 * errors[0][0] < 2.41
    assert errors[1][1] < 0.6 * errors[0][1] < 1.58
    values = dict(zip(found.names, found.estimate.theta.tolist()))
    assert values["joint_6.Fsm"] == pytest.approx(2.03, rel=0.2)
    assert values["joint_6.Fvm"] == pytest.approx(0.60, rel=0.2)
