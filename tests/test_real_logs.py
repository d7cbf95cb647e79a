"""What is diagnosed on measured data: the turning motor's cogging, the pendulums' noise and disagreement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.effects import CAUSES
from gimbal_pin.log import read_log
from gimbal_pin.rig import Rig

DATA = Path(__file__).parents[2] / "shared" / "data"
EXPECTED = {12 * k for k in range(1, 17)} | {14 * k for k in range(1, 15)}
"""Of a motor with twelve slots and fourteen poles, per turn."""
RIVALS = ("cogging", "position-dependent-friction", "saturation", "dead-zone")
"""What else explains a part of it."""


def said(
    folder: str, urdf: str, files: list[str], columns: list[str], causes: tuple[str, ...]
) -> Diagnosis:
    place = DATA / folder
    if not place.is_dir():
        pytest.skip(f"../shared/data/{folder} is not there")
    rig = Rig.load(place / urdf)
    logs = [read_log(place / file, rig, columns) for file in files]
    return diagnose(
        rig, logs, {name: CAUSES[name] for name in causes}, rng=np.random.default_rng(0)
    )


def test_the_turning_motors_cogging_is_found_blind() -> None:
    """Slow_a, b, c train; slow_d, which lost two samples in five, is held out: 0.65 A without it, at most 0.22 with.

    Whatever the torque per ampere is taken to be.
    """
    constant = 0.0276
    columns = ["t=time_s", "q_motor=pos_counts*0.00076699", f"tau_motor=iq_a*{constant}"]
    found = said("odrive_cogging", "rotor.urdf", [f"slow_{k}.csv" for k in "abcd"], columns, RIVALS)
    assert found.verdict == "named" and found.findings[0].alike == ("cogging",)
    harmonics = {p.value for p in found.findings[0].parameters if p.name.startswith("harmonic")}
    assert len(harmonics & EXPECTED) >= 5
    before, after = (
        one["torque_rmse"]["motor"] / constant for one in (found.baseline, found.extended)
    )
    assert before > 0.55 and after < 0.22
    assert not found.spoiling and any(
        "44 % of the samples are lost" in note for note in found.notes
    )


def test_the_double_pendulums_logs_disagree() -> None:
    names = [("q", "pos"), ("dq", "vel"), ("tau", "tau")]
    columns = [
        f"{ours}_{joint}={theirs}{k}"
        for k, joint in ((1, "shoulder"), (2, "elbow"))
        for ours, theirs in names
    ]
    files = [f"20220812-{run}-PM_measured.csv" for run in ("055640", "060143", "061157")]
    found = said(
        "dfki_double_pendulum",
        "double_pendulum.urdf",
        files,
        ["t=time", *columns],
        ("load-dependent-friction", "armature"),
    )
    assert found.verdict == "data" and not found.findings
    assert [fault.cause for fault in found.spoiling] == ["logs-disagree"]


def test_no_statement_on_a_noisy_pendulum_is_beyond_what_a_body_can_have() -> None:
    """Its rate's noise makes the fitted inertia negative: that is no figure of the arm."""
    columns = ["t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque"]
    found = said(
        "dfki_simple_pendulum",
        "pendulum.urdf",
        ["system_identification.csv"],
        columns,
        ("stribeck",),
    )
    (note,) = (note for note in found.notes if "inertia about its axis" in note)
    assert "does not determine" in note and "%" not in note


@pytest.mark.xfail(strict=True, reason="both sides of a saturation are clipped: new diagnosis")
def test_no_saturation_lies_below_the_torque_that_the_arm_measured() -> None:
    found = said("franka_fer_unisa", "fer.urdf", ["panda_unisa.db3"], [], ("saturation",))
    assert not found.findings


@pytest.mark.xfail(
    strict=True, reason="a base that moves unmeasured is taken for delays: new diagnosis"
)
def test_a_base_that_moves_without_its_imu_is_unknown() -> None:
    place = DATA.parent / "cases"
    if not place.is_dir():
        pytest.skip("../shared/cases is not there")
    rig = Rig.load(place / "semantic" / "rig.yaml")
    log = read_log(place / "semantic" / "platform_imu_lost.csv.gz", rig)
    found = diagnose(rig, [log], {name: CAUSES[name] for name in ("delay", "presliding")})
    assert found.verdict == "unknown"
