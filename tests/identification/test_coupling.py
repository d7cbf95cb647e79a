"""Laws of motors that turn with two joints: their rotor and friction act on both, through the coupling alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import Model, compute_base, nominal
from gimbal_pin.effects import CoupledFriction, CoupledRotor, Term
from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.excitation import ExcitationColumns
from gimbal_pin.export import convert_to_mjcf
from gimbal_pin.identification import identify, read_model, write_model
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, fourier, prescribed
from tests.rigs import bundled

RATIO = -0.8
INERTIA = 0.02
DRY = 0.3
VISCOUS = 0.4
YAML = "urdf: thesis\nmotors:\n  tilt: {rotor_inertia: 0.02}\ncoupling: {tilt: {roll: -0.8}}\n"
G = np.array([0.0, RATIO, 1.0])


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """Return the thesis's rig whose tilt motor turns with the roll axis."""
    (tmp_path / "wrist.yaml").write_text(YAML)
    return Rig.load(tmp_path / "wrist.yaml")


def plant(rig: Rig) -> Model:
    """Return the rig with a rotor and friction at the coupled motor."""
    at = ("tilt", ("roll",), (RATIO,))
    motor = {"coupled-rotor": (INERTIA,), "coupled-friction": (DRY, VISCOUS)}
    model = nominal(rig)
    terms = [Term(x.effect, motor.get(x.effect.name, x.values)) for x in model.terms]
    assert {CoupledRotor(*at), CoupledFriction(*at)} < {x.effect for x in terms}
    return Model(rig, tuple(terms))


def test_a_coupled_motor_acts_through_the_transpose_of_its_row(rig: Rig) -> None:
    """``tau = G' (Ia G a + Fsm sign(G v) + Fvm G v)``, and its power is the motor's."""
    motion = fourier(rig, 0, 4.0)
    bodies = nominal(bundled("thesis")).inverse_dynamics(motion.q, motion.v, motion.a)
    added = plant(rig).inverse_dynamics(motion.q, motion.v, motion.a) - bodies
    v, a = motion.v @ G, motion.a @ G
    motor = INERTIA * a + DRY * np.sign(v) + VISCOUS * v
    np.testing.assert_allclose(added, np.outer(motor, G), atol=1e-12)
    power = np.sum(added * motion.v, axis=1)
    np.testing.assert_allclose(power, motor * v, atol=1e-12)


def test_rotor_and_friction_of_a_coupled_motor_come_back(rig: Rig, tmp_path: Path) -> None:
    log = prescribed(plant(rig), 1, 20.0, dt=2e-3)
    found = identify(rig, log, filtering=EXACT)
    values = dict(zip(found.names, found.estimate.theta.tolist()))
    assert values["tilt.Ia"] == pytest.approx(INERTIA, rel=0.02)
    assert values["tilt.Fvm"] == pytest.approx(VISCOUS, rel=0.02)
    assert values["tilt.Fsm"] == pytest.approx(DRY, rel=0.05)
    assert dict(zip(found.names, found.stated))["tilt.Ia"] == pytest.approx(0.02)
    plain = identify(bundled("thesis"), log, filtering=EXACT)
    assert found.held_out is not None
    assert plain.held_out is not None
    for joint in ("roll", "tilt"):
        assert found.held_out.torque_rmse[joint] < 0.1 * plain.held_out.torque_rmse[joint]
    write_model(found, tmp_path / "m.yaml")
    again = read_model(tmp_path / "m.yaml", rig)
    at = log.q[::50], np.asarray(log.v)[::50], np.ones_like(log.q[::50])
    np.testing.assert_allclose(
        again.inverse_dynamics(*at), found.model.inverse_dynamics(*at), atol=1e-9
    )


def test_base_and_excitation_have_its_columns(rig: Rig) -> None:
    names = compute_base(rig).names
    assert names[-3:] == ("tilt.Ia", "tilt.Fsm", "tilt.Fvm")
    columns = ExcitationColumns.of(rig)
    motion = fourier(rig, 0, 4.0)
    shown = columns.compute(motion, np.sign(motion.v))[:, :, -3:]
    v, a = motion.v @ G, motion.a @ G
    for k, basis in enumerate((a, np.sign(v), v)):
        np.testing.assert_allclose(shown[:, :, k], np.outer(basis, G), atol=1e-12)


def test_what_takes_a_motor_for_each_joint_says_so(rig: Rig) -> None:
    with pytest.raises(UsageError, match="couples tilt with roll"):
        bench_run(nominal(rig), rng=0, seconds=2.0)
    with pytest.raises(UsageError, match="couples tilt with roll"):
        tune(nominal(rig))
    _, notes = convert_to_mjcf(nominal(rig))
    assert any("coupled" in note or "rotor" in note for note in notes)


@pytest.mark.parametrize(
    "coupling", ["{wrist: {roll: 1}}", "{tilt: {wrist: 1}}", "{tilt: {tilt: 1}}"]
)
def test_a_coupling_of_no_two_joints_is_refused(coupling: str, tmp_path: Path) -> None:
    (tmp_path / "wrist.yaml").write_text(f"urdf: thesis\ncoupling: {coupling}\n")
    with pytest.raises(RigError, match=r"wrist|tilt"):
        Rig.load(tmp_path / "wrist.yaml")
