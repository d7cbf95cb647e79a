"""The blind set's plant obeys its laws: two dynamics agree, energy is kept, friction sticks, logs are as run."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.blind.calibrate import calibrate, share_of, trial
from tests.blind.cases import Case, hide
from tests.blind.corruption import CORRUPTIONS, exchanged_joints, late_torque
from tests.blind.draw import sample
from tests.blind.effects import CATALOGUE, PUBLISHED, Effect
from tests.blind.files import read_csv, write, write_truth
from tests.blind.ledger import settle
from tests.blind.mjcf import Base, build
from tests.blind.motion import handheld, profile_s
from tests.blind.plan import STRATA, Hidden, Plan
from tests.blind.plant import Stepper, simulate
from tests.blind.rig_draw import draw_rig, nominal
from tests.blind.rigs import Array, Rig, point_mass
from tests.blind.rnea import inverse_dynamics, regressor
from tests.blind.scene import Scene, draw_scene
from tests.blind.sensors import draw_sensors
from tests.blind.stick import dry_friction
from tests.blind.visibility import projected, rms
from tests.blind.world import World

FORMS = [(kind.cause, form) for kind in CATALOGUE.values() for form in kind.known + kind.foreign]
RATE = 250.0


def rig_of(seed: int, axes: int = 3) -> Rig:
    return draw_rig(np.random.default_rng(seed), axes)


def frictionless(rig: Rig) -> Rig:
    return replace(
        rig, motors=tuple(replace(motor, coulomb=0.0, viscous=0.0) for motor in rig.motors)
    )


@cache
def scene_of(seed: int, axes: int, excitation: str, seconds: float = 3.0) -> Scene:
    streams = {
        name: np.random.default_rng([seed, i])
        for i, name in enumerate(("motion", "control", "noise", "sensors"))
    }
    plan = Plan(seed, "clean", axes=axes, excitation=excitation, rate=RATE, seconds=seconds)
    return draw_scene(
        streams, rig_of(seed, axes), draw_sensors(streams["sensors"], "clean", RATE), plan
    )


@cache
def small_case(seed: int, level: str = "dirty") -> Case:
    hidden = (Hidden("cogging", "steep", 0.1, 0.9),)
    return hide(Plan(seed, "single", hidden, axes=2, level=level, rate=RATE, seconds=4.0))


def effect_of(scene: Scene, cause: str, form: str, share: float = 0.1, joint: int = -1) -> Effect:
    joint = joint % len(scene.rig.links)
    return CATALOGUE[cause].draw(np.random.default_rng(5), scene.context(joint, share), form)


# dynamics ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_two_inverse_dynamics_agree(seed: int) -> None:
    rig = rig_of(seed, 1 + seed % 3)
    model = build(rig, (), Base.FIXED, point_mass(1.0, np.zeros(3)))
    data = mujoco.MjData(model)
    q, v, a = np.random.default_rng(seed).normal(size=(3, 20, len(rig.links)))
    theirs = []
    for row in zip(q, v, a, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        theirs.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(inverse_dynamics(rig, q, v, a), theirs, atol=1e-10)


def test_the_regressor_times_the_parameters_is_the_inverse_dynamics() -> None:
    rig = rig_of(3)
    q, v, a = np.random.default_rng(0).normal(size=(3, 10, 3))
    theta = np.concatenate([body.vector() for body in rig.bodies])
    np.testing.assert_allclose(
        regressor(rig, q, v, a) @ theta, inverse_dynamics(rig, q, v, a), atol=1e-12
    )


def energy_error(substeps: int) -> float:
    """Largest change of a free, frictionless rig's energy over a second, J."""
    rig = frictionless(rig_of(11))
    world = World(rig, (), 1.0 / (RATE * substeps), 1.0)
    world.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    stepper = Stepper(world, [0.3, 0.2, 0.4], [1.0, -2.0, 1.5])
    energies = []
    for _ in range(int(RATE) * substeps):
        world.data.qpos[:], world.data.qvel[:] = stepper.q, stepper.v
        mujoco.mj_forward(world.model, world.data)
        energies.append(world.data.energy.sum())
        stepper.step([0.0, 0.0, 0.0])
    return float(np.ptp(energies))


def test_energy_is_kept_to_the_second_order_of_the_step() -> None:
    coarse = energy_error(4)
    fine = energy_error(8)
    assert fine < 1e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_a_command_acts_from_its_own_sample_to_the_next() -> None:
    rig = frictionless(rig_of(2, 1))
    rig = replace(
        rig, links=(replace(rig.links[0], axis=np.array([0.0, 0.0, 1.0]), rotation=np.eye(3)),)
    )
    inertia = float(
        inverse_dynamics(rig, np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)))[0, 0]
    )
    commands = np.random.default_rng(0).normal(size=50)
    trace = simulate(
        World(rig, (), 1e-3, 1.0),
        lambda k, q, v: (q, v, [float(commands[k])]),
        ([0.0], [0.0]),
        50,
        4,
    )
    np.testing.assert_allclose(np.diff(trace.v[:, 0]), commands[:-1] * 4e-3 / inertia, atol=1e-12)


def test_a_driven_base_follows_its_path_and_its_imu_tells_it() -> None:
    motion = profile_s(np.random.default_rng(1), 1.0)
    t = np.arange(0.0, 2.0, 1e-4)
    value, rate, second = motion.at(t)
    np.testing.assert_allclose(np.gradient(value, 1e-4, axis=0)[5:-5], rate[5:-5], atol=1e-4)
    np.testing.assert_allclose(np.gradient(rate, 1e-4, axis=0)[5:-5], second[5:-5], atol=1e-2)
    path = motion.sampled(2.5e-4, 2.0)
    np.testing.assert_allclose(
        np.array(path(1.0)).ravel(),
        np.hstack([x[10_000] for x in (value, rate, second)]),
        atol=1e-6,
    )
    still = handheld(np.random.default_rng(1), 0.0)
    gyro, force = still.imu(t[:3])
    np.testing.assert_allclose(
        np.hstack([gyro, force]), np.tile([0, 0, 0, 0, 0, 9.81], (3, 1)), atol=1e-12
    )


def test_a_moving_base_costs_the_torque_that_mujoco_says() -> None:
    scene = scene_of(4, 2, "multisine", 2.0)
    effect = effect_of(scene, "platform-motion", "sines", 1.0)
    world, trace = scene.run([effect], 8)
    ledger = settle(world, trace)
    model = world.model
    data = mujoco.MjData(world.model)
    dofs = world.dof
    base = world.base_dofs
    model.dof_armature[base] = 0.0
    left = []
    path = world.base_path
    assert path is not None
    for row in range(0, len(trace.step_q), 97):
        position, rate, second = path((row + 0.5) * world.dt)
        data.qpos[base], data.qvel[base], data.qacc[base] = position, rate, second
        data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = (
            trace.step_q[row],
            trace.step_v[row],
            trace.step_a[row],
        )
        mujoco.mj_inverse(model, data)
        friction = world.rig.viscous * trace.step_v[row] + trace.step_dry[row]
        left.append(trace.command[row // 8] - data.qfrc_inverse[dofs] - friction)
    assert rms(ledger.effect).max() > 0.05
    assert np.abs(left).max() < 2e-3 * rms(ledger.effect).max()


# dry friction --------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1))
def test_dry_friction_opposes_motion_or_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    inverse = np.linalg.inv(root @ root.T + 0.3 * np.eye(3))
    free, plus, minus = rng.normal(size=3), *rng.uniform(0.0, 2.0, (2, 3))
    dt = 0.1
    friction = np.array(
        dry_friction(
            free.tolist(),
            inverse.tolist(),
            [0, 1, 2],
            (plus.tolist(), minus.tolist()),
            dt,
            [0.0] * 3,
        )
    )
    ends = free - dt * inverse @ friction
    assert (friction <= plus).all() and (friction >= -minus).all()
    for v, f, high, low in zip(ends, friction, plus, minus, strict=True):
        assert abs(v) < 1e-9 or f == pytest.approx(high if v > 0.0 else -low)


def breakaway(effects: list[Effect], rig: Rig) -> tuple[float, float]:
    """The torque at which a slowly pulled joint lets go, and how far it had crept before, rad."""
    ramp = np.linspace(0.0, 0.2, 2000)
    world = World(rig, effects, 1e-3, 2.0)
    trace = simulate(world, lambda k, q, v: (q, v, [float(ramp[k])]), ([0.1], [0.0]), 2000, 1)
    first = int(np.flatnonzero(trace.q[:, 0] != 0.1)[0])
    return float(ramp[first - 1]), float(np.abs(trace.q[:first, 0] - 0.1).max())


def upright() -> Rig:
    rig = rig_of(2, 1)
    rig = replace(
        rig, links=(replace(rig.links[0], axis=np.array([0.0, 0.0, 1.0]), rotation=np.eye(3)),)
    )
    return rig.with_motor(0, replace(rig.motors[0], coulomb=0.05))


def test_a_joint_stands_truly_still_until_its_breakaway() -> None:
    torque, crept = breakaway([], upright())
    assert torque == pytest.approx(0.05, abs=2e-4)
    assert crept == 0.0


@pytest.mark.parametrize("form", ["gaussian", "exponential", "lorentzian"])
def test_stribeck_raises_the_breakaway_by_its_extra(form: str) -> None:
    kind = CATALOGUE["stribeck"]
    torque, _ = breakaway([kind(0, form, 0.03, 0.1)], upright())  # type: ignore[call-arg]
    assert torque == pytest.approx(0.08, abs=2e-4)


def test_bristles_creep_before_they_slide() -> None:
    kind = CATALOGUE["presliding"]
    _, crept = breakaway([kind(0, "dahl", 0.05, 0.002, 0.01)], upright())  # type: ignore[call-arg]
    world = World(upright(), [kind(0, "dahl", 0.05, 0.002, 0.01)], 1e-3, 2.0)  # type: ignore[call-arg]
    trace = simulate(world, lambda k, q, v: (q, v, [0.03]), ([0.0], [0.0]), 2000, 1)
    assert crept == 0.0
    assert 0.0 < np.abs(trace.q).max() < 0.02
    assert np.abs(trace.v[-1]).max() < 0.05


# effects -------------------------------------------------------------------------------------------------------------


def test_without_an_effect_nothing_is_left_over() -> None:
    for axes, excitation in ((1, "staircase"), (2, "reversals"), (3, "mixture")):
        scene = scene_of(axes, axes, excitation)
        ledger = settle(*scene.run((), 2))
        assert np.abs(ledger.effect).max() < 1e-11
        assert (np.abs(ledger.dry) <= scene.rig.coulomb + 1e-12).all()


@pytest.mark.parametrize(("cause", "form"), FORMS[::3])
def test_every_form_leaves_a_mark_that_grows_with_its_strength(cause: str, form: str) -> None:
    scene = scene_of(7, 2, "mixture", 1.0)
    effect = effect_of(scene, cause, form)
    sizes = []
    for k in (0.25, 1.0):
        _, ledger = trial(scene, effect.scaled(k))
        sizes.append(rms(ledger.effect).max())
        assert np.isfinite(ledger.effect).all()
    assert sizes[1] > 1e-6
    assert sizes[1] > sizes[0]
    assert all(np.isfinite(value) for value in effect.parameters().values())


def test_the_effect_series_is_the_planted_formula() -> None:
    scene = scene_of(7, 2, "multisine")
    joint = 1
    bias = effect_of(scene, "torque-bias", "constant")
    spring = effect_of(scene, "cable-spring", "linear")
    gain = effect_of(scene, "torque-gain", "constant")
    ledger = settle(*scene.run([bias], 4))
    np.testing.assert_allclose(ledger.effect[:, joint], -bias.parameters()["bias"], atol=1e-11)
    ledger = settle(*scene.run([spring], 4))
    pull = spring.parameters()["stiffness"] * (ledger.q[:, joint] - spring.parameters()["rest"])
    np.testing.assert_allclose(ledger.effect[:, joint], pull, atol=1e-11)
    ledger = settle(*scene.run([gain], 4))
    np.testing.assert_allclose(
        ledger.effect[:, joint], -gain.parameters()["gain"] * ledger.command[:, joint], atol=1e-11
    )


@pytest.mark.parametrize("delay", [0.004, 0.0063])
def test_a_delay_is_exact_also_between_steps(delay: float) -> None:
    scene = scene_of(7, 2, "multisine")
    effect = CATALOGUE["delay"](1, "fixed", delay, 0.0)  # type: ignore[call-arg]
    ledger = settle(*scene.run([effect], 4))
    command = ledger.command[:, 1]
    period = 1.0 / RATE
    whole = int(delay / period)
    rest = delay / period - int(delay / period)
    late = np.convolve(command, [*([0.0] * whole), 1.0 - rest, rest])[: len(command)]
    np.testing.assert_allclose((command - late)[10:], ledger.effect[10:, 1], atol=1e-10)


def test_lags_settle_to_their_command_and_take_their_time() -> None:
    for form in ("first-order", "second-order"):
        lag = CATALOGUE["actuator-lag"](0, form, 0.02, 1.0)  # type: ignore[call-arg]
        world = World(upright(), [lag], 1e-3, 1.0)
        stepper = Stepper(world, [0.0], [0.0])
        outputs = []
        for _ in range(300):
            stepper.step([1.0])
            outputs.append(stepper.state.u[0])
        assert outputs[-1] == pytest.approx(1.0, abs=1e-4)
        assert np.sum(1.0 - np.array(outputs)) * 1e-3 == pytest.approx(0.02, rel=0.02)


def test_a_stiff_joint_is_a_rigid_joint() -> None:
    scene = scene_of(7, 2, "multisine")
    effect = effect_of(scene, "joint-flexibility", "linear")
    soft, stiff = (share_of(effect, trial(scene, effect.scaled(k))[1], RATE) for k in (1.0, 0.02))
    assert stiff < 0.1 * soft


@pytest.mark.parametrize(
    ("cause", "form"), [("cogging", "several"), ("saturation", "smooth"), ("delay", "fixed")]
)
def test_calibration_reaches_the_wanted_size(cause: str, form: str) -> None:
    scene = scene_of(7, 2, "multisine")
    effect = calibrate(scene, effect_of(scene, cause, form, 0.03), 0.03)
    assert share_of(effect, trial(scene, effect)[1], RATE) == pytest.approx(0.03, rel=0.2)


def test_what_a_refit_absorbs_is_not_visible() -> None:
    scene = scene_of(5, 1, "multisine")
    for cause, form, hidden in (("torque-gain", "constant", True), ("cogging", "single", False)):
        world, ledger = trial(scene, effect_of(scene, cause, form))
        smoothed, left = projected(world.reference, ledger, RATE, trusted=False)
        assert bool(left.max() < 1e-3 * smoothed.max()) is hidden


# rigs and files ------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_rigs_and_their_nominal_twins_are_real_bodies(seed: int, axes: int) -> None:
    rng = np.random.default_rng(seed)
    rig = draw_rig(rng, axes)
    for body in (*rig.bodies, *nominal(rng, rig, 0.2).bodies):
        moments = np.linalg.eigvalsh(body.tensor)
        assert body.mass > 0.0 and moments[0] > 0.0 and moments[0] + moments[1] >= moments[2]
    assert len({*rig.joints}) == axes


def urdf_torque(path: Path, motion: tuple[Array, Array, Array]) -> Array:
    """MuJoCo's own reading of a URDF file."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    torques = []
    for row in zip(*motion, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse - data.qfrc_passive - data.qfrc_constraint)
    return np.array(torques)


def test_the_urdf_is_the_given_rig(tmp_path: Path) -> None:
    case = small_case(1)
    files = write(case, tmp_path)
    motion = 0.3 * np.random.default_rng(0).normal(size=(3, 10, 2))
    np.testing.assert_allclose(
        urdf_torque(files.urdf, tuple(motion)), inverse_dynamics(case.given, *motion), atol=1e-8
    )
    overlay = yaml.safe_load(files.rig.read_text())
    assert (tmp_path / overlay["urdf"]).exists()
    names = [
        joint.get("name")
        for joint in ElementTree.parse(files.urdf).getroot().iter("joint")
        if joint.find("limit") is not None
    ]
    assert list(overlay["motors"]) == list(overlay["limits"]) == names
    assert {key for motor in overlay["motors"].values() for key in motor} == {
        "torque_constant", "tau_max", "slots", "poles", "encoder_bits",
    }  # fmt: skip


def test_a_written_log_reads_back_as_what_was_simulated(tmp_path: Path) -> None:
    case = small_case(1)
    log = read_csv(write(case, tmp_path / "seen").log)
    assert list(log) == list(case.log)
    for name, values in case.log.items():
        np.testing.assert_allclose(log[name], values, rtol=1e-11, atol=1e-13)
    hidden = write_truth(case, tmp_path / "unseen")
    assert sorted(path.name for path in (tmp_path / "seen").iterdir()) == [
        "log.csv",
        "rig.urdf",
        "rig.yaml",
    ]
    with np.load(hidden.oracle) as oracle:
        assert {"t", "q", "v", "a", "tau_total", "tau_effect"} <= set(oracle.files)
        perfect = read_csv(hidden.perfect_log)
        for i, joint in enumerate(case.given.joints):
            np.testing.assert_allclose(
                perfect[f"tau_{joint}"], oracle["tau_total"][:, i], rtol=1e-11, atol=1e-13
            )
            np.testing.assert_allclose(
                perfect[f"q_{joint}"], oracle["q"][:, i], rtol=1e-11, atol=1e-13
            )


def test_a_plan_is_a_case_to_the_last_bit() -> None:
    first = small_case(1)
    again = hide(first.plan)
    other = hide(replace(first.plan, seed=99))
    assert again.truth == first.truth
    for name, values in first.log.items():
        assert np.array_equal(again.log[name], values)
    assert not np.array_equal(other.oracle["tau_total"], first.oracle["tau_total"])


def test_sensors_blur_no_more_than_they_say() -> None:
    case = small_case(1)
    rows = case.oracle["rows"].astype(int)
    sensors = case.truth["sensors"]
    assert isinstance(sensors, dict)
    step = 2.0 * np.pi / 2 ** sensors["encoder_bits"]
    t = case.log["t"]
    assert (np.diff(t) > 0.0).all()
    assert len(rows) == len(t) and (len(rows) < 1000 or sensors["lost"] == 0.0)
    for i, joint in enumerate(case.given.joints):
        q = case.log[f"q_{joint}"]
        np.testing.assert_allclose(q / step, np.round(q / step), atol=1e-6)
        assert (
            np.abs(q - case.oracle["q"][rows, i]).max()
            < 0.51 * step + 6.0 * sensors["encoder_noise"]
        )
        error = case.log[f"tau_{joint}"] - case.oracle["tau_total"][rows, i]
        assert (
            rms(error)
            < 1.5
            * np.hypot(sensors["torque_white"], sensors["torque_coloured"])
            * rms(case.oracle["tau_total"])[i]
        )


@pytest.mark.parametrize(
    ("cause", "form"), [(cause, form) for cause, forms in CORRUPTIONS.items() for form in forms]
)
def test_corruption_stays_in_its_window(cause: str, form: str) -> None:
    log = small_case(1, "clean").log
    damage = CORRUPTIONS[cause][form](log, np.random.default_rng(3), (0.4, 0.6))
    n = len(log["t"])
    kept = [
        len(damage.columns[name]) == n and np.array_equal(damage.columns[name], log[name])
        for name in log
    ]
    assert not all(kept) or set(damage.columns) != set(log)
    assert (np.diff(damage.columns["t"]) > 0.0).all()
    for name in log:
        np.testing.assert_array_equal(
            damage.columns[name][: int(0.38 * n)], log[name][: int(0.38 * n)]
        )
        if name != "t" and form != "gaps":
            np.testing.assert_array_equal(
                damage.columns[name][int(0.62 * n) :], log[name][int(0.62 * n) :]
            )


def test_late_torque_is_the_torque_of_before() -> None:
    log = small_case(2, "clean").log
    damage = late_torque(log, np.random.default_rng(0), (0.0, 1.0))
    late = damage.parameters["late"]
    t = damage.columns["t"]
    assert 0.05 <= late <= 0.2
    for name, values in damage.columns.items():
        earlier = t - late if name.startswith("tau_") else t
        np.testing.assert_allclose(values, np.interp(earlier, log["t"], log[name]), rtol=1e-12)


def test_to_exchange_joints_twice_is_to_do_nothing() -> None:
    log = small_case(2, "clean").log
    once = exchanged_joints(log, np.random.default_rng(0), (0.0, 1.0)).columns
    again = exchanged_joints(once, np.random.default_rng(0), (0.0, 1.0)).columns
    assert list(once) == list(log)
    for name, values in log.items():
        np.testing.assert_array_equal(again[name], values)
        assert np.array_equal(once[name], values) is (name == "t")


# sampling ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stratum", STRATA)
def test_a_longer_sample_begins_like_a_shorter_one(stratum: str) -> None:
    assert sample(100, 4, stratum)[:30] == sample(30, 4, stratum)
    assert sample(30, 4, stratum) != sample(30, 5, stratum)
    assert {plan.stratum for plan in sample(30, 4, stratum)} == {stratum}


def test_five_blocks_hold_every_form_at_every_size() -> None:
    forms = [(kind.cause, form) for kind in PUBLISHED for form in kind.known + kind.foreign]
    plans = sample(5 * len(forms), 0, "single")
    seen = {(plan.hidden[0].cause, plan.hidden[0].form, plan.hidden[0].share) for plan in plans}
    assert len(seen) == 5 * len(forms)
    assert {plan.axes for plan in plans} == {1, 2, 3}
    assert len({plan.seed for plan in plans}) == len(plans)


def test_trusted_urdfs_are_exact_and_others_are_not() -> None:
    shift = hide(
        Plan(
            3,
            "single",
            (Hidden("payload-shift", "rigid", 0.1, 0.5),),
            axes=2,
            rate=RATE,
            seconds=4.0,
            trusted=True,
        )
    )
    other = small_case(2)
    for case, exact in ((shift, True), (other, False)):
        twin = draw_rig(
            np.random.default_rng(np.random.SeedSequence(case.plan.seed).spawn(1)[0]),
            case.plan.axes,
        )
        same = all(
            np.array_equal(a.vector(), b.vector())
            for a, b in zip(twin.bodies, case.given.bodies, strict=True)
        )
        assert same is exact


def test_the_blind_set_knows_nothing_of_the_library() -> None:
    for path in (Path(__file__).parent / "blind").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] in ("gimbal_pin", "pinocchio") for name in names), (
                path
            )
