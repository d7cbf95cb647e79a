"""Laws of links that swing behind a spring: what every joint feels of one, and that a fit finds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from gimbal_pin.diagnosis import BAND
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.heldout import torque_error
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.linked import linked
from gimbal_pin.diagnosis.links import axes, moved, swung
from gimbal_pin.diagnosis.loosened import loosened
from gimbal_pin.diagnosis.restart import sparser
from gimbal_pin.diagnosis.state import Problem, solved
from gimbal_pin.effects.joint_flexibility import JointFlexibility
from gimbal_pin.effects.torque_ripple import TorqueRipple
from gimbal_pin.log import Array, Log
from gimbal_pin.reduction import reduce
from gimbal_pin.regressor import inertia, rnea
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier

RIG = Rig.load("handheld")
HARDENING = dict(zip(RIG.joints[1:], (3.0, 60.0)))
HARD = 3.0
FILTERING = replace(BAND, alignment=0.0)


def sprung(rig: Rig, joint: str, rotor: float) -> pin.Model:
    """A rig whose joint turns a round rotor, and that by one more joint of its axis the link, as Pinocchio has it.

    The bodies that follow stand on the link; the new joint comes last.
    """
    model, old, at = pin.Model(), rig.model, rig.model.getJointId(joint)
    model.gravity = old.gravity
    ids = {0: 0}
    for k in range(1, old.njoints):
        parent = ids[old.parents[k]]
        ids[k] = model.addJoint(parent, old.joints[k], old.jointPlacements[k], old.names[k])
        if k == at:
            round_ = pin.Inertia(1e-12, np.zeros(3), rotor * np.eye(3))
            model.appendBodyToJoint(ids[k], round_, pin.SE3.Identity())
            ids[k] = model.addJoint(ids[k], old.joints[k], pin.SE3.Identity(), "link")
            whole = old.inertias[k].toDynamicParameters()
            whole[4:] -= np.array([1.0, 0.0, 1.0, 0.0, 0.0, 1.0]) * rotor
            model.appendBodyToJoint(ids[k], pin.Inertia.FromDynamicParameters(whole), pin.SE3.Identity())
        else:
            model.appendBodyToJoint(ids[k], old.inertias[k], pin.SE3.Identity())
    return model


def log_of(rig: Rig, joint: str, spring: JointFlexibility, seconds: float, dt: float = 1e-3) -> tuple[Log, Array]:
    """A log of prescribed motor angles, the link integrated on its spring with Pinocchio; and the link's angle."""
    motion = fourier(rig, 3, seconds, dt)
    j = rig.joint_index(joint)
    q, v, a = map(np.array, (motion.q, motion.v, motion.a))
    for w in 2 * np.pi * np.linspace(1.1, 6.0, 9):
        phase = w * motion.t + 0.7 * w
        for x, y in zip((q, v, a), (np.sin(phase), w * np.cos(phase), -w * w * np.sin(phase))):
            x[:, j] += 0.25 / w**1.5 * y
    own = float(np.mean(inertia(rig, motion.q, j)[:, j]))
    r, w = spring.rotor_share, 2 * np.pi * spring.frequency
    k, d = (x * r * (1 - r) * own for x in (w * w, 2 * spring.damping * w))
    model = sprung(rig, joint, r * own)
    data, p = model.createData(), model.joints[model.getJointId("link")].idx_v
    mine = [model.joints[model.getJointId(name)].idx_v for name in rig.joints]

    def felt(i: int, bend: float, rate: float) -> tuple[Array, float]:
        """Torque of the motors, and the acceleration of the bend."""
        whole = np.zeros((3, model.nv))
        whole[:, mine] = q[i], v[i], a[i]
        whole[:2, p] = bend, rate
        mass = pin.crba(model, data, whole[0])[p, p]
        held = k * bend * (1 + spring.hardening * (k * bend) ** 2)
        whole[2, p] = (-held - d * rate - pin.rnea(model, data, *whole)[p]) / mass
        return pin.rnea(model, data, *whole)[mine], whole[2, p]

    x, tau, bends = np.zeros(2), [], []
    for i in range(0, len(q) - 2, 2):  # Runge and Kutta over two samples
        tau.append(felt(i, *x)[0])
        bends.append(x[0])
        slopes = [np.array([x[1], felt(i, *x)[1]])]
        for at, share in ((i + 1, dt), (i + 1, dt), (i + 2, 2 * dt)):
            y = x + share * slopes[-1]
            slopes.append(np.array([y[1], felt(at, *y)[1]]))
        x = x + 2 * dt / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    half = slice(0, len(q) - 2, 2)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(tau), rig.n))
    return Log("sprung", rig.joints, motion.t[half], q[half], v[half], np.array(tau) + noise), np.array(bends)


def problem_of(log: Log) -> Problem:
    return Problem.of(gather(RIG, [log], FILTERING, {log.name: 0.0}), reduce(RIG))


@pytest.mark.parametrize(("joint", "hardening"), [*((joint, 0.0) for joint in RIG.joints[1:]), *HARDENING.items()])
def test_every_joint_feels_a_link_where_it_swings(joint: str, hardening: float) -> None:
    """Torque by inverse dynamics of a rig with one more joint, and the rigid rig's at the encoder's angle beside it."""
    spring = JointFlexibility(joint, 7.0, 0.15, 0.2, hardening)
    log, bends = log_of(RIG, joint, spring, 12.0)
    part = problem_of(log).evidence.parts[0]
    link = swung(RIG, part, spring, np.zeros(2))
    assert link is not None
    assert not hardening or np.max(spring.grown(link.soft)) > 0.5, "or it is as good as linear"
    c, late = part.channels, slice(len(part.gate) // 3, -len(part.gate) // 10)
    beyond = c.tau - rnea(RIG, c.q, c.v, c.a)
    wrong = (beyond - link.asked)[late]
    assert np.all(np.std(wrong, axis=0) < 0.05 * np.std(beyond[late], axis=0) + 1e-3)
    told = np.interp(c.t, log.t, bends)[late]
    assert np.std(told) > 0.01, "or the law says nothing"
    assert np.std(link.motion.q[late] - told) < 0.05 * np.std(told)


def test_a_link_that_stands_where_its_encoder_does_asks_for_nothing_more() -> None:
    log, _ = log_of(RIG, RIG.joints[-1], JointFlexibility(RIG.joints[-1], 400.0, 0.4, 0.2), 6.0)
    part = problem_of(log).evidence.parts[0]
    stiff = swung(RIG, part, JointFlexibility(RIG.joints[-1], 400.0, 0.4, 0.2), np.zeros(2))
    assert stiff is not None
    asked = moved(RIG, part, RIG.n - 1)
    assert np.max(np.abs(stiff.asked)) < 2e-3 * np.max(np.abs(asked))


def test_a_round_rotor_is_felt_along_the_axes_of_what_carries_it() -> None:
    q = np.random.default_rng(0).uniform(-1, 1, (20, RIG.n))
    for j in range(RIG.n):
        found, data = axes(RIG, q, j), RIG.model.createData()
        for angles, row in zip(q, found):
            jacobian = pin.computeJointJacobians(RIG.model, data, angles)[3:]
            np.testing.assert_allclose(row[: j + 1], (jacobian.T @ jacobian[:, j])[: j + 1], atol=1e-9)
            np.testing.assert_allclose(row[j + 1 :], 0.0, atol=1e-9)


@pytest.mark.parametrize(("frequency", "share"), [(5.5, 0.25), (9.0, 0.15)])
def test_a_fit_with_the_link_where_it_swings_leaves_noise_and_finds_the_spring(frequency: float, share: float) -> None:
    """From shapes well off; at the encoder's angle even the true ones leave thousands of times the noise."""
    joint = RIG.joints[-2]
    true = JointFlexibility(joint, frequency, 0.12, share)
    problem = problem_of(log_of(RIG, joint, true, 20.0)[0])
    off = replace(true, frequency=1.15 * frequency, damping=0.2)
    plain = solved(problem, (off,), solved(problem, (), solved(problem, ())))
    found = linked(linked(plain), again=True)
    (spring,) = found.causes
    assert isinstance(spring, JointFlexibility)
    assert spring.hardening == 0
    assert spring.frequency == pytest.approx(frequency, rel=0.02)
    assert spring.rotor_share == pytest.approx(share, rel=0.05)
    assert spring.damping == pytest.approx(0.12, rel=0.05)
    assert np.max(found.fit.dispersion) < 2.0
    assert np.max(solved(problem, (true,), plain).fit.dispersion) > 1e3
    without_it = solved(problem, (), found)
    assert np.max(without_it.fit.dispersion) > 1e3, "what was worked out goes with its spring"
    model, held = extended(found), problem.evidence
    error = np.concatenate([torque_error(part, model) for part in held.parts])
    quiet = np.abs(np.concatenate([part.gate for part in held.parts])) > 0.99
    assert all(np.std(error[quiet[:, j], j]) < 5e-3 for j in range(RIG.n)), "the held-out part is judged by the same"


def test_a_fit_finds_that_a_spring_hardens_and_by_how_much() -> None:
    """From a linear spring, and none of those explains the log."""
    joint = RIG.joints[-2]
    true = JointFlexibility(joint, 7.0, 0.12, 0.2, HARD)
    problem = problem_of(log_of(RIG, joint, true, 12.0)[0])
    found = linked(solved(problem, (replace(true, hardening=0.0),), solved(problem, (), solved(problem, ()))))
    (spring,) = found.causes
    assert isinstance(spring, JointFlexibility)
    assert np.max(found.fit.dispersion) < 2.0
    assert spring.hardening == pytest.approx(HARD, rel=0.05)
    assert spring.frequency == pytest.approx(7.0, rel=0.02)
    model, held = extended(found), problem.evidence
    error = np.concatenate([torque_error(part, model) for part in held.parts])
    quiet = np.abs(np.concatenate([part.gate for part in held.parts])) > 0.99
    assert all(np.std(error[quiet[:, j], j]) < 5e-3 for j in range(RIG.n)), "the held-out part is judged by the same"


def test_a_spring_that_hardens_is_looked_for_where_others_stand_for_it() -> None:
    """In place of harmonics that are none it leaves noise, from the coarse grid and by fewer parameters."""
    joint = RIG.joints[-2]
    true = JointFlexibility(joint, 7.0, 0.12, 0.2, HARD)
    problem = problem_of(log_of(RIG, joint, true, 12.0)[0])
    false = solved(problem, (TorqueRipple(joint, (1.0, 2.0, 3.0)),), solved(problem, (), solved(problem, ())))
    shelf = Library(problem, JointFlexibility.tried(joint, problem.evidence.seen[RIG.joint_index(joint)]))
    alone = next(one for one in loosened(false, joint, shelf) if len(one.causes) == 1)
    (spring,) = alone.causes
    assert isinstance(spring, JointFlexibility) and spring.hardening == pytest.approx(HARD, rel=0.1)
    assert np.max(alone.fit.dispersion) < 2.0 and sparser(alone, false)


def test_what_a_spring_that_hardens_holds_bends_it_back() -> None:
    spring, torque = JointFlexibility("pan", 8.0, hardening=HARD), np.linspace(-3.0, 3.0, 601)
    z = spring.soft(torque)
    np.testing.assert_allclose(z * (1 + spring.grown(z)), torque, atol=1e-12)
    np.testing.assert_allclose(np.gradient(torque, z)[1:-1], spring.slope(z)[1:-1], rtol=0.02)
    assert np.array_equal(replace(spring, hardening=0.0).soft(torque), torque)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_spring_that_hardens_steps_as_its_equation_says(share: float) -> None:
    """``z'' = ω² (x - z - h z³) - 2 ζ ω z'`` by a solver, its momentum passed on, and at rest what it bends to."""
    spring, dt, w = JointFlexibility("pan", 3.0, 0.3, share, HARD), 1e-3, 6 * np.pi
    command = np.sin(7.0 * dt * np.arange(1000))
    memory, passed = spring.start(), []
    for x in command.tolist():
        memory, y = spring.step(memory, x, dt)
        passed.append(y)

    def rates(t: float, z: Array) -> list[float]:
        x = command[min(int(t / dt), len(command) - 1)]
        return [z[1], w * w * (x - z[0] * (1 + HARD * z[0] ** 2)) - 0.6 * w * z[1]]

    end = solve_ivp(rates, (0.0, dt * len(command)), [0.0, 0.0], rtol=1e-6, max_step=dt).y[:, -1]
    np.testing.assert_allclose(memory, end, atol=2e-3 * w)
    kept = 1 - 1 / share if share else 1.0
    assert np.sum(passed) * dt == pytest.approx(np.sum(command) * dt - kept * memory[1] / w**2)
    for _ in range(5000):
        memory, y = spring.step(memory, 2.0, dt)
    assert memory[0] == pytest.approx(spring.soft(np.array([2.0]))[0]) and y == pytest.approx(2.0)
