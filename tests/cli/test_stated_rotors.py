"""A rotor's inertia that a rig states: a known part of the model for every verb, and never a finding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gimbal_pin.dynamics import Plant, State, compute_regressor, compute_rnea, nominal
from gimbal_pin.excitation import excite
from gimbal_pin.identification import read_model
from gimbal_pin.log import Platform
from gimbal_pin.log.io import write_log
from gimbal_pin.rig import GRAVITY, Rig
from tests.bench_logs import prescribed
from tests.command_line import Run, refused, result
from tests.rigs import states

MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="fork">
<inertial pos="0.01 0 0.05" mass="0.6" diaginertia="0.004 0.003 0.002"/>
<joint name="pan" axis="0 0 1" armature="0.006" damping="0.02" frictionloss="0.03" range="-2 2"/>
<body name="head" pos="0 0 0.1"><inertial pos="0.02 0 0.01" mass="0.4" diaginertia="0.001 0.002 0.0015"/>
<joint name="tilt" axis="0 1 0" armature="0.003" damping="0.01" frictionloss="0.02" range="-1 1"/>
</body></body></worldbody><actuator><motor joint="pan" ctrlrange="-2 2"/><motor joint="tilt" ctrlrange="-2 2"/>
</actuator></mujoco>"""
RIGS = {
    "rotor.yaml": "urdf: turret\nmotors:\n  pan: {rotor_inertia: 0.01}\n",
    "gear.yaml": "urdf: turret\nmotors:\n  tilt: {rotor_inertia: 2.0e-5, gear_ratio: -30}\n",
    "armature.xml": MJCF,
}
ARMATURE = {"rotor.yaml": [0.01, 0.0], "gear.yaml": [0.0, 0.018], "armature.xml": [0.006, 0.003]}
VERBS = [
    "check RIG",
    "base RIG",
    "inspect log.csv --rig RIG",
    "excite RIG -o x.csv --starts 1 --seconds 12",
    "simulate RIG --seconds 2 -o s.csv",
    "rehearse RIG x.csv",
    "identify RIG log.csv -o m.yaml --urdf identified.urdf",
    "tune RIG m.yaml -o c.yaml --plants 2",
    "track RIG c.yaml --plants 2",
    "export c.yaml --rig RIG --c c --mjcf m.xml --ros2 ros",
    "animate RIG log.csv -o log.html",
    "studio RIG log.csv --check -o studio",
    "montecarlo RIG m.yaml -o rigs --count 2 --seconds 1 --workers 1",
]


@pytest.fixture(scope="module", params=RIGS)
def stated(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig's file beside a log of 8 s whose torque has noise of a thousandth."""
    path = tmp_path_factory.mktemp("rig") / request.param
    path.write_text(RIGS[request.param])
    write_log(prescribed(nominal(Rig.load(path)), 1, 8.0, 1e-3, 2e-3), path.with_name("log.csv"))
    return path


def drop_rotors(rig: Rig) -> Rig:
    """The same rig with rotors of no inertia."""
    return replace(rig, motors=tuple(replace(motor, rotor_inertia=0.0) for motor in rig.motors))


def test_a_stated_rotor_is_inertia_of_its_joint_alone(stated: Path) -> None:
    """``tau = Y phi + I_a a``, on a base that stands or moves; the plant moves as the inverse dynamics ask."""
    rig = Rig.load(stated)
    expected = ARMATURE[stated.name]
    q, v, a = states(rig.n, 3, 5)
    np.testing.assert_allclose(rig.armature, expected, rtol=1e-12)
    assert (drop_rotors(rig).armature == 0).all()
    tau = compute_rnea(rig, q, v, a)
    np.testing.assert_allclose(
        tau, compute_regressor(rig, q, v, a) @ rig.phi + a * expected, atol=1e-12
    )
    none = np.zeros((5, 3))
    upright = Platform(1.0 * np.arange(5), np.tile([0.0, 0.0, GRAVITY], (5, 1)), none, none)
    np.testing.assert_allclose(compute_rnea(rig, q, v, a, upright), tau, atol=1e-12)
    model = nominal(rig)
    given = model.inverse(q, v, a)
    for platform in (None, upright):
        plant = Plant(model, platform)
        moved = [plant.acceleration(0.0, State(*state), u) for state, u in zip(zip(q, v), given)]
        np.testing.assert_allclose(moved, a, atol=1e-9)


def test_mujoco_asks_for_the_torque_of_its_armature_too(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(MJCF)
    peer = mujoco.MjModel.from_xml_string(MJCF)
    peer.opt.gravity[2], peer.dof_damping[:], peer.dof_frictionloss[:] = -GRAVITY, 0.0, 0.0
    peer.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(peer)
    motion = states(2, 3, 5)
    for q, v, a, tau in zip(*motion, compute_rnea(Rig.load(tmp_path / "m.xml"), *motion)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(peer, data)
        np.testing.assert_allclose(data.qfrc_inverse, tau, atol=1e-9)


def test_every_verb_takes_a_stated_rotor(
    stated: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(stated.parent)
    for verb in VERBS:
        code, _, err = run(*verb.replace("RIG", stated.name).split())
        assert code == 0, (verb, err)
    rig = Rig.load(stated)
    expected = pytest.approx(ARMATURE[stated.name])
    assert read_model("m.yaml", rig).rig.armature == expected
    peer = mujoco.MjModel.from_xml_path("m.xml")
    assert [float(peer.joint(joint).armature[0]) for joint in rig.joints] == expected
    checked = result(run, "check", stated.name)
    assert [checked["joints"][joint]["armature"] for joint in rig.joints] == expected


def test_auto_takes_a_stated_rotor(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("gimbal.xml").write_text(MJCF)
    write_log(prescribed(nominal(Rig.load("gimbal.xml")), 1, 8.0, 1e-3, 2e-3), "log.csv")
    code, out, err = run("auto", "gimbal.xml", "log.csv", "-o", "all", "--plants", "2")
    assert (code, err) == (0, "") and "armature" not in out


def test_the_bodies_are_identified_beside_a_stated_rotor(stated: Path, run: Run) -> None:
    for estimator in ("weighted", "physical"):
        found = result(
            run, "identify", stated, stated.with_name("log.csv"), "--estimator", estimator
        )
        for row in found["base_parameters"]:
            assert (
                abs(row["value"] - row["urdf"]) < 4 * row["std"] + 1e-4 * abs(row["urdf"]) + 1e-6
            ), row


def test_nothing_is_missing_where_the_rotor_is_stated(stated: Path, run: Run) -> None:
    found = result(run, "diagnose", stated, stated.with_name("log.csv"))
    assert (found["verdict"], found["findings"]) == ("nothing", [])
    for joint, stated_inertia in zip(("pan", "tilt"), ARMATURE[stated.name]):
        hidden = [
            one
            for one in found["untestable"]
            if (one["cause"], one["joint"]) == ("armature", joint)
        ]
        assert not (stated_inertia and hidden)


def test_a_motion_shows_as_much_with_a_stated_rotor_as_without(
    stated: Path, run: Run, tmp_path: Path
) -> None:
    rig = Rig.load(stated)
    one, other = (excite(x, seconds=12.0, starts=1, rng=0) for x in (rig, drop_rotors(rig)))
    assert one.condition_number < 1.2 * other.condition_number


WRONG = {
    "rotor": "pan: {rotor_inertia: 1}",
    "gear": "pan: {rotor_inertia: 1.0e-4, gear_ratio: 100}",
    "both": "pan: {rotor_inertia: 0.3}\n  tilt: {rotor_inertia: 1}",
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_rotor_larger_than_all_inertia_is_refused_by_its_name(
    kind: str, run: Run, tmp_path: Path
) -> None:
    (tmp_path / "rig.yaml").write_text(f"urdf: turret\nmotors:\n  {WRONG[kind]}\n")
    log = tmp_path / "log.csv"
    write_log(prescribed(nominal(Rig.load("turret")), 1, 8.0, 1e-3, 2e-3), log)
    said = run("identify", tmp_path / "rig.yaml", log)
    refused(said, 2, "pan", "rotor_inertia")
    assert "--map" not in said[2]


def test_a_torque_of_the_wrong_sign_is_refused_beside_a_stated_rotor(
    stated: Path, run: Run
) -> None:
    said = run("identify", stated, stated.with_name("log.csv"), "--map", "tau_pan=-tau_pan")
    refused(said, 2, "tau_pan has the wrong sign")
