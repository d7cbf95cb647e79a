"""Laws of the blind benchmark's plant, and of what it hides and logs.

Its dynamics agree with MuJoCo's, energy is kept, dry friction sticks; an effect leaves what its
formula says; noise has its stated spectrum; a plan is a case to the last bit.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.blind.cases import hide
from tests.blind.draw import sample
from tests.blind.effects import CATALOGUE, PUBLISHED
from tests.blind.effects.base import Effect
from tests.blind.files import write
from tests.blind.ledger import Ledger, settle
from tests.blind.logbook import exchanged_joints
from tests.blind.mjcf import Base, build
from tests.blind.plan import STRATA, DrivePlan, Hidden, Plan
from tests.blind.plant import Stepper, dry_friction
from tests.blind.rig_draw import draw_arm, draw_rig
from tests.blind.rigs import Array, Rig, point_mass
from tests.blind.rnea import inverse_dynamics, regressor
from tests.blind.scene import Scene, calibrate, share_of, trial
from tests.blind.sensors import Colour
from tests.blind.stage import plain_scene
from tests.blind.visibility import Spectrum, rms, size
from tests.blind.world import World

RATE = 250.0
FORMS = [(kind.cause, form) for kind in CATALOGUE.values() for form in (*kind.known, *kind.foreign)]


@cache
def make_scene(seconds: float) -> Scene:
    """Return two axes in motion."""
    streams = defaultdict(lambda: np.random.default_rng(7))
    plan = Plan(7, "clean", excitation="mixture", rate=RATE, seconds=seconds)
    return plain_scene(plan, draw_rig(np.random.default_rng(2), 2), streams)


def draw_effect(scene: Scene, cause: str, form: str, share: float = 0.1) -> Effect:
    context = scene.context(len(scene.rig.links) - 1, share)
    return CATALOGUE[cause].draw(np.random.default_rng(5), context, form)


def play(scene: Scene, *effects: Effect) -> Ledger:
    return settle(*scene.run(effects, 1e-3))


def invert(model: mujoco.MjModel, motion: Array) -> Array:
    """Return MuJoCo's torques for angles, speeds and accelerations, (3, N, n), without friction."""
    data = mujoco.MjData(model)
    torques = []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*motion):
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse - data.qfrc_passive - data.qfrc_constraint)
    return np.array(torques)


# dynamics


@pytest.mark.parametrize(
    "rig", [draw(np.random.default_rng(0), n) for draw, n in ((draw_rig, 3), (draw_arm, 7))]
)
def test_inverse_dynamics_are_mujocos(rig: Rig) -> None:
    motion = np.random.default_rng(1).normal(size=(3, 10, len(rig.links)))
    theirs = invert(build(rig, (), Base.FIXED, point_mass(1.0, np.zeros(3))), motion)
    np.testing.assert_allclose(inverse_dynamics(rig, *motion), theirs, atol=1e-9)
    parameters = np.concatenate([body.vector() for body in rig.bodies])
    np.testing.assert_allclose(regressor(rig, *motion) @ parameters, theirs, atol=1e-9)


def measure_energy_error(substeps: int) -> float:
    """Return how much the energy of a free, frictionless rig changes over half a second, J."""
    rig = draw_rig(np.random.default_rng(3), 3)
    loose = tuple(replace(motor, coulomb=0.0, viscous=0.0) for motor in rig.motors)
    world = World(replace(rig, motors=loose), (), 1.0 / (RATE * substeps), 1.0)
    world.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    stepper = Stepper(world, [0.3, 0.2, 0.4], [1.0, -2.0, 1.5])
    energies = []
    for _ in range(125 * substeps):
        world.data.qpos[:] = stepper.end_q
        world.data.qvel[:] = stepper.end_v
        mujoco.mj_forward(world.model, world.data)
        energies.append(world.data.energy.sum())
        stepper.step([0.0, 0.0, 0.0])
    return float(np.ptp(energies))


def test_energy_is_kept_to_the_second_order_of_the_step() -> None:
    fine = measure_energy_error(8)
    assert fine < 1e-5
    assert measure_energy_error(4) / fine == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("seed", range(30))
def test_dry_friction_opposes_motion_or_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    inverse = np.linalg.inv(root @ root.T + 0.3 * np.eye(3))
    free = rng.normal(size=3)
    plus, minus = rng.uniform(0.0, 2.0, (2, 3))
    friction = np.array(dry_friction(free, inverse, range(3), plus, minus, 0.1, [0.0] * 3))
    ends = free - 0.1 * inverse @ friction
    np.testing.assert_allclose(friction, np.clip(friction + ends, -minus, plus), atol=1e-9)


# effects


@pytest.mark.parametrize(("cause", "form"), FORMS)
def test_every_form_leaves_a_mark_that_grows_with_its_strength(cause: str, form: str) -> None:
    scene = make_scene(1.0)
    effect = draw_effect(scene, cause, form)
    weak, strong = (rms(trial(scene, effect.scaled(k))[1].effect).max() for k in (0.25, 1.0))
    assert strong > max(weak, 1e-6)


def test_what_is_left_is_the_planted_formula() -> None:
    """Nothing, the formula of a spring, of growing friction, and of a delay between two samples."""
    scene = make_scene(2.0)
    ledger = play(scene)
    np.testing.assert_allclose(ledger.effect, 0.0, atol=1e-11)
    assert np.all(np.abs(ledger.dry) <= scene.rig.coulomb + 1e-12)
    spring = draw_effect(scene, "cable-spring", "linear")
    ledger = play(scene, spring)
    pull = spring.stiffness * (ledger.q[:, 1] - spring.rest)
    np.testing.assert_allclose(ledger.effect[:, 1], pull, atol=1e-11)
    ledger = play(scene, CATALOGUE["friction-drift"](1, "linear", 0.1, scene.seconds, 1.0))
    sliding = np.abs(ledger.v[:, 1]) > 0.1
    grown = 0.1 * (scene.reference.t + 0.5 / RATE) / scene.seconds * np.sign(ledger.v[:, 1])
    np.testing.assert_allclose(ledger.effect[sliding, 1], grown[sliding], atol=1e-11)
    ledger = play(scene, CATALOGUE["delay"](1, "fixed", 1.6 / RATE, 0.0))
    command = ledger.command[:, 1]
    late = np.convolve(command, [0.0, 0.4, 0.6])[: len(command)]
    np.testing.assert_allclose(ledger.effect[10:, 1], (command - late)[10:], atol=1e-10)


def test_an_effect_gets_the_wanted_size() -> None:
    scene = make_scene(2.0)
    effect = calibrate(scene, draw_effect(scene, "delay", "fixed", 0.03), 0.03)
    assert share_of(effect, trial(scene, effect)[1], RATE) == pytest.approx(0.03, rel=0.2)


@pytest.mark.parametrize("colour", [Colour("ar1", 0.97, 1.0), Colour("low-pass", 0.9, 15.0)])
def test_noise_of_the_stated_spectrum_is_of_size_one(colour: Colour) -> None:
    """What the model's own columns explain is of size zero."""
    x = colour.series(np.random.default_rng(0), (20_000, 2), 100.0)
    np.testing.assert_allclose(x.std(axis=0), 1.0, rtol=0.1)
    grid = np.linspace(0.0, 20.0, 2001)
    spectrum = Spectrum(grid, np.tile(colour.density(grid, 100.0)[:, None], 2))
    seen = size(x, np.zeros((len(x), 2, 1)), spectrum, 100.0)
    np.testing.assert_allclose(seen, 1.0, rtol=0.05)
    explained = size(x, x[:, :, None] * np.eye(2), spectrum, 100.0)
    np.testing.assert_allclose(explained, 0.0, atol=1e-6)


# plans, cases and files


def test_a_plan_is_a_case_to_the_last_bit_and_so_are_its_files_to_their_digits(
    tmp_path: Path,
) -> None:
    hidden = (Hidden("cogging", "single", 0.3, 0.9),)
    plan = DrivePlan(5, "drive-single", hidden, axes=3, rate=100.0, seconds=2.0, arm=True)
    case = hide(plan)
    again = hide(plan)
    log = list(case.log.values())
    assert again.truth == case.truth
    np.testing.assert_array_equal(list(again.log.values()), log)
    write(case, tmp_path)
    table = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table.T, log, rtol=1e-11, atol=1e-13)
    motion = 0.3 * np.random.default_rng(0).normal(size=(3, 5, 3))
    theirs = invert(mujoco.MjModel.from_xml_path(str(tmp_path / "rig.urdf")), motion)
    np.testing.assert_allclose(inverse_dynamics(case.given, *motion), theirs, atol=1e-8)


def test_to_exchange_joints_twice_is_to_do_nothing() -> None:
    log = {"q_pan": 0, "q_tilt": 1, "tau_pan": 2, "tau_tilt": 3}
    once, _ = exchanged_joints(log, np.random.default_rng(0))
    assert once == {"q_pan": 1, "q_tilt": 0, "tau_pan": 3, "tau_tilt": 2}
    assert exchanged_joints(once, np.random.default_rng(0))[0] == log


@pytest.mark.parametrize("stratum", STRATA)
def test_a_longer_sample_begins_like_a_shorter_one(stratum: str) -> None:
    plans = sample(100, 4, stratum)
    assert plans[:30] == sample(30, 4, stratum) != sample(30, 5, stratum)
    assert len({plan.seed for plan in plans}) == 100


def test_five_blocks_hold_every_form_at_every_size() -> None:
    count = 5 * sum(len(kind.known) + len(kind.foreign) for kind in PUBLISHED)
    hidden = [plan.hidden[0] for plan in sample(count, 0, "single")]
    assert len({(one.cause, one.form, one.share) for one in hidden}) == count


def test_the_benchmark_imports_nothing_of_the_library() -> None:
    for path in (Path(__file__).parent / "blind").rglob("*.py"):
        assert "gimbal_pin" not in path.read_text(encoding="utf-8"), path
