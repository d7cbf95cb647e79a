"""Laws of the parameters beside the bodies that a rig states: rotors and constant torques.

A rotor whose rig states a gear comes back, is a sum's where no motion tells it from the bodies, and stays as stated
where the log does not. What is stated is estimated and never a finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import Model, compute_base, nominal
from gimbal_pin.errors import RigError
from gimbal_pin.excitation import ExcitationColumns, excite
from gimbal_pin.identification import (
    ESTIMATORS,
    IdentificationResult,
    identify,
    read_model,
    refittable_effects,
    write_model,
)
from gimbal_pin.log import Log
from gimbal_pin.regression import Block, Estimate, fit_weighted, get_design
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, prescribed
from tests.identification.logs import record
from tests.rigs import bundled

GEARED = bundled("thesis")
TRUE = 0.02


def with_motors(rig: Rig, **stated: float) -> Rig:
    """Return the rig with the same further statements on all motors."""
    return replace(rig, motors=tuple(replace(motor, **stated) for motor in rig.motors))


def parameter(found: IdentificationResult, name: str) -> tuple[float, float, float]:
    """Return a parameter's value, deviation and stated value."""
    k = found.names.index(name)
    return float(found.estimate.theta[k]), float(found.estimate.std[k]), float(found.stated[k])


PLANT = with_motors(GEARED, gear_ratio=10.0, rotor_inertia=TRUE / 100)


@pytest.mark.parametrize("stated", [0.0, 0.5, 3.0])
def test_the_rotor_of_a_stated_gear_comes_back_whatever_is_stated(stated: float) -> None:
    log = prescribed(nominal(PLANT), 1, 12.0, dt=2e-3)
    rig = with_motors(GEARED, gear_ratio=10.0, rotor_inertia=stated * TRUE / 100)
    found = identify(rig, log, filtering=EXACT)
    value, _, given = parameter(found, "tilt.Ia")
    assert value == pytest.approx(TRUE, rel=1e-3)
    assert given == pytest.approx(stated * TRUE) or not stated
    at = log.q[::50], np.asarray(log.v)[::50], np.ones_like(log.q[::50])
    np.testing.assert_allclose(
        found.model.inverse_dynamics(*at),
        nominal(PLANT).inverse_dynamics(*at),
        atol=1e-3 * np.abs(log.tau).max(),
    )


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_holds_it(name: str) -> None:
    log = prescribed(nominal(PLANT), 1, 12.0, dt=2e-3)
    found = identify(PLANT, log, estimator=name, filtering=EXACT)
    assert parameter(found, "tilt.Ia")[0] == pytest.approx(TRUE, rel=2e-2)


def test_the_file_of_a_model_keeps_it(tmp_path: Path) -> None:
    rig = with_motors(GEARED, gear_ratio=10.0, rotor_inertia=2 * TRUE / 100)
    found = identify(rig, prescribed(nominal(PLANT), 1, 12.0, dt=2e-3), filtering=EXACT)
    write_model(found, tmp_path / "m.yaml")
    again: Model = read_model(tmp_path / "m.yaml", rig)
    np.testing.assert_allclose(again.armature, found.model.armature)
    np.testing.assert_allclose(again.rig.armature, found.model.rig.armature)
    np.testing.assert_array_equal(again.rig.armature != 0, [True, True, False])
    assert nominal(again.rig).rig.armature[2] == pytest.approx(2 * TRUE)


def test_it_is_a_sum_s_where_no_motion_tells_it_from_the_bodies() -> None:
    rig = with_motors(GEARED, gear_ratio=10.0)
    names = compute_base(rig).names
    assert [name for name in names if "Ia" in name] == [
        "spine.Iyy + fork.Izz + yaw.Ia",
        "fork.Iyy + cradle.Izz + roll.Ia",
        "tilt.Ia",
    ]
    assert compute_base(with_motors(GEARED, rotor_inertia=1e-3)).names[0] == "spine.Iyy + fork.Izz"
    assert len(compute_base(rig).moving["rotating"]) == 2 + len(
        compute_base(GEARED).moving["rotating"]
    )


def test_it_stays_as_stated_where_the_logs_do_not_tell_it_from_the_bodies() -> None:
    def estimate(blocks: Sequence[Block]) -> Estimate:
        """Return an estimate that knows nothing of the rotor, where it is fitted."""
        found = fit_weighted(blocks)
        names = get_design(blocks).names
        covariance = found.covariance.copy()
        if "tilt.Ia" in names:
            covariance[names.index("tilt.Ia"), names.index("tilt.Ia")] = np.inf
        return replace(found, covariance=covariance)

    log = prescribed(nominal(PLANT), 1, 12.0, dt=2e-3)
    found = identify(PLANT, log, estimator=estimate, filtering=EXACT, examined="never")
    assert "tilt.Ia" not in found.names
    assert "tilt: the logs do not tell its rotor from the bodies: it stays as stated" in found.notes
    np.testing.assert_allclose(found.model.rig.armature, TRUE)


def test_an_excitation_shows_it() -> None:
    """One column more than without gears, and hardly worse conditioned."""
    columns = ExcitationColumns.of(PLANT)
    found = excite(PLANT, starts=1, seconds=10.0, rng=0)
    assert len(columns.scale) == len(ExcitationColumns.of(GEARED).scale) + 1
    assert (
        found.condition_number < 2 * excite(GEARED, starts=1, seconds=10.0, rng=0).condition_number
    )


TABLE = (
    (0.0, 0.0, 0.0),
    (np.pi / 2, 0.0, 0.0),
    (0.0, 0.45, 0.0),
    (-np.pi / 2, 0.0, 0.45),
    (np.pi / 2, 0.0, 0.0),
    (-np.pi / 2, 0.0, 0.0),
)
"""Geometry of the RX-90: modified Denavit-Hartenberg alpha, d and r of its joints."""


def build_arm() -> str:
    """Return the URDF of an arm of this geometry, of bodies that do not matter."""
    body = '<mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    text = '<robot name="arm"><link name="l0"/>'
    for k, (alpha, d, r) in enumerate(TABLE, 1):
        at = f"{d} {-r * np.sin(alpha)} {r * np.cos(alpha)}"
        text += (
            f'<link name="l{k}"><inertial>{body}</inertial></link>'
            f'<joint name="j{k}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="{at}" rpy="{alpha} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
    return text + "</robot>"


def test_the_arm_of_khalil_and_dombre_has_their_count(tmp_path: Path) -> None:
    """SYMORO's RX-90: 36 base parameters of its bodies, and 40 with its rotors."""
    (tmp_path / "arm.urdf").write_text(build_arm())
    rig = Rig.load(tmp_path / "arm.urdf")
    bodies = len(compute_base(rig).terms) - 2 * rig.n
    geared = compute_base(with_motors(rig, gear_ratio=50.0))
    assert (bodies, len(geared.terms) - 2 * rig.n) == (36, 40)
    assert geared.names[-4:] == ("j3.Ia", "j4.Ia", "j5.Ia", "j6.Ia")


OFFSET = 0.3


@pytest.fixture(scope="module")
def offset_log() -> Log:
    """Return a log of the turret whose reported torques at tilt are off by a constant."""
    log = record(bundled("turret"), 3, 30.0)
    assert log.tau is not None
    return replace(log, tau=log.tau + np.array([0.0, OFFSET]))


def test_a_constant_torque_is_a_parameter_where_the_rig_says_so(
    tmp_path: Path, offset_log: Log
) -> None:
    (tmp_path / "rig.yaml").write_text("urdf: turret\nmotors:\n  tilt: {torque_offset: fit}\n")
    rig = Rig.load(tmp_path / "rig.yaml")
    found = identify(rig, offset_log, filtering=EXACT)
    value, std, _ = parameter(found, "tilt.bias")
    assert abs(value - OFFSET) < 4 * std < 0.1 * OFFSET
    assert compute_base(rig).names[-1] == "tilt.bias"
    assert len(ExcitationColumns.of(rig).effects) == 5
    assert refittable_effects(found.model) == ()
    assert "torque-bias" not in str(found.model)
    again = identify(rig, offset_log, ["torque-bias:tilt"], filtering=EXACT)
    assert again.names == found.names


@pytest.mark.parametrize("stated", ["none", "fit"])
def test_it_is_a_finding_where_the_rig_does_not(stated: str, offset_log: Log) -> None:
    rig = bundled("turret")
    rig = replace(rig, motors=(rig.motors[0], replace(rig.motors[1], torque_offset=stated)))
    found = diagnose(rig, offset_log)
    causes = [(one.cause, one.joint) for one in found.stated]
    assert bool(causes) == (stated == "none")
    assert found.verdict == ("nothing" if stated == "fit" else "named")
    if stated == "fit":
        for model in (found.before, found.after):
            assert model.by_joint[1][-1].values[0] == pytest.approx(OFFSET, rel=0.1)


def test_a_rotor_is_a_finding_only_without_a_stated_gear() -> None:
    log = record(PLANT, 3, 30.0)
    for rig in (GEARED, with_motors(GEARED, gear_ratio=10.0), PLANT):
        found = diagnose(rig, log)
        assert [one.cause for one in found.stated] == ["armature"] * (rig is GEARED)
        at = log.q[::50], np.asarray(log.v)[::50], np.ones_like(log.q[::50])
        predicted, true = (model.inverse_dynamics(*at) for model in (found.after, nominal(PLANT)))
        np.testing.assert_allclose(predicted, true, atol=0.03 * np.abs(true).max())


def test_another_word_for_the_offset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("urdf: turret\nmotors:\n  tilt: {torque_offset: yes}\n")
    with pytest.raises(RigError, match="torque_offset"):
        Rig.load(tmp_path / "rig.yaml")
    (tmp_path / "rig.yaml").write_text("urdf: turret\nmotors:\n  tilt: {torque_offset: maybe}\n")
    with pytest.raises(RigError, match="write fit or none"):
        Rig.load(tmp_path / "rig.yaml")
