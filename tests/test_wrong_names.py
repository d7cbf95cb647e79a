"""Laws against wrong names: what mends a form is no cause, slow noise is noise, a gain that cannot show is told."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.audit import CHECKS
from gimbal_pin.cli.diagnose import diagnose as verb
from gimbal_pin.diagnosis import BAND, Diagnosis, diagnose
from gimbal_pin.diagnosis.bodies import Bodies, Kind
from gimbal_pin.diagnosis.composed import chosen
from gimbal_pin.diagnosis.confirmed import LENT, asked, confirmation
from gimbal_pin.diagnosis.contenders import contenders, explains_others, falls, holds_fast, hushes, lines, signs_only
from gimbal_pin.diagnosis.difference import Difference
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.finding import Finding, Rival, Untestable
from gimbal_pin.diagnosis.heldout import CONFIRMED
from gimbal_pin.diagnosis.leftover import ACCURATE, MUCH, NOISY, Residual, judge
from gimbal_pin.diagnosis.library import Library, library
from gimbal_pin.diagnosis.mending import KEPT, keeps, mended
from gimbal_pin.diagnosis.nearness import nearness, span
from gimbal_pin.diagnosis.noiselike import uneven
from gimbal_pin.diagnosis.reported import rough, untold
from gimbal_pin.diagnosis.score import NOTHING, silences
from gimbal_pin.diagnosis.search import polished
from gimbal_pin.diagnosis.searched import Searched, echoes, outlines, shaken, swings
from gimbal_pin.diagnosis.shapes import measure
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.diagnosis.together import once
from gimbal_pin.diagnosis.trusted import Case, confirmed
from gimbal_pin.diagnosis.verdict import goes_on, judged, leans, loudness, misses, sketches
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.actuator_lag import ActuatorLag
from gimbal_pin.effects.backlash import Backlash
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.cogging import Cogging
from gimbal_pin.effects.dead_zone import DeadZone
from gimbal_pin.effects.encoder_offset import EncoderOffset
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.effects.joint_flexibility import JointFlexibility
from gimbal_pin.effects.off_diagonal_inertia import OffDiagonalInertia
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.effects.payload_shift import PayloadShift
from gimbal_pin.effects.position_dependent_friction import PositionDependentFriction
from gimbal_pin.effects.quadratic_drag import QuadraticDrag
from gimbal_pin.effects.rig_effect import RigEffect
from gimbal_pin.effects.saturation import Saturation
from gimbal_pin.effects.signal import Borne
from gimbal_pin.effects.stribeck import Stribeck
from gimbal_pin.effects.torque_bias import TorqueBias
from gimbal_pin.effects.torque_gain import TorqueGain
from gimbal_pin.effects.torque_ripple import TorqueRipple
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.parameter import Parameter
from gimbal_pin.reduction import reduce
from gimbal_pin.report.sections.diagnosis import said as page
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with
from gimbal_pin.text import wrong
from tests.bench_logs import prescribed
from tests.rigs import BODY, spelled

ALIGNED = replace(BAND, alignment=0.0)
ALONE = (
    f'<robot name="alone"><link name="base"/>{BODY.format("arm", 1)}<joint name="tilt" type="revolute">'
    '<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>'
    '<limit lower="-1.5" upper="1.5" effort="9" velocity="3"/></joint></robot>'
)
"""A rig of one joint, to whose torque nothing else holds the rigid model."""
HELD = ALONE.replace('"-1.5"', '"1"').replace('"1.5"', '"1.6"').replace('velocity="3"', 'velocity="1"')
"""The same with its arm held out, so that its weight is all but a constant."""
BODIES = {name: kind for name, kind in CAUSES.items() if issubclass(kind, RigEffect)}
RNG = np.random.default_rng


def recorded(rig: Rig, *planted: str, seed: int = 0) -> Log:
    model = plant_with(nominal(rig), [parse_effect(one, rig) for one in planted]).plant
    return prescribed(model, seed, seconds=16.0, torque_noise=2e-3, dt=2e-3)


@pytest.mark.parametrize(("share", "fast"), [(0.9, False), (1.1, True)])
def test_no_friction_holds_a_joint_that_moved(share: float, fast: bool) -> None:
    """As of Stribeck's beyond the largest torque, whose tail alone the gate leaves to be fitted."""
    rig = Rig.load("thesis")
    log = recorded(rig)
    problem = Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce(rig))
    beta = np.array([share * problem.evidence.seen[0].peak])
    cause = Stribeck(rig.joints[0], 0.03)
    assert holds_fast(solved(problem, ()), NOTHING._replace(beta=beta), cause) == fast


def fitted(rig: Rig, log: Log, *causes: Cause) -> State:
    problem = Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce(rig))
    return solved(problem, causes, solved(problem, ()))


def slow(rng: np.random.Generator, shape: tuple[int, ...], corner: float, dt: float) -> Array:
    """First-order noise of unit size."""
    keep = np.exp(-2 * np.pi * corner * dt)
    path = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=(shape[0] + 2000, *shape[1:])), axis=0)
    return np.asarray(path[2000:])


def noisy(log: Log, size: float, corner: float, seed: int) -> Log:
    """A log with slow noise on its torque, of a size over the torque's own."""
    assert log.tau is not None
    level = size * np.sqrt(np.mean(log.tau**2, axis=0))
    return replace(log, tau=log.tau + level * slow(RNG(seed), log.tau.shape, corner, log.dt))


# what is left


@pytest.mark.parametrize("corner", [0.7, 6.0])
def test_slow_noise_of_a_torque_sensor_is_noise(corner: float) -> None:
    """However far above what the torque's third differences show, if it is no larger than such a sensor's error."""
    rig = Rig.load("thesis")
    left = judge(fitted(rig, noisy(recorded(rig), 0.7 * ACCURATE, corner, 0)), RNG(0))
    assert [one.where for one in left] == [""] * rig.n
    assert max(one.dispersion for one in left) > MUCH


def test_more_than_a_torque_sensors_noise_is_not() -> None:
    rig = Rig.load("thesis")
    left = judge(fitted(rig, noisy(recorded(rig), 3 * ACCURATE, 2.5, 0)), RNG(0))
    assert all(one.state == "structured" for one in left)


def test_noise_that_swells_and_fades_is_no_sensors() -> None:
    even = [slow(RNG(seed), (900,), 3.0, 1 / 24) for seed in range(50)]
    swelling = np.where(np.arange(900) % 300 < 60, 3.0, 0.3)
    assert not any(uneven([x], [np.ones(900)]) for x in even)
    assert all(uneven([x * swelling], [np.ones(900)]) for x in even[:10])
    shut = np.where(swelling > 1, 1.0, 0.0)
    assert not any(uneven([x * shut], [shut]) for x in even), "where the gate is shut there is no silence"


# what mends another's form


def shelf(state: State) -> Library:
    kinds: dict[str, type[Cause]] = {"stribeck": Stribeck, "quadratic-drag": QuadraticDrag}
    return Library(state.problem, library(state.problem, kinds))


def test_what_mends_the_form_of_a_drag_is_no_cause() -> None:
    """The nearest power leaves a little that falls with the rate, as Stribeck's friction does; a mixture of powers
    does not."""
    rig = Rig.load("thesis")
    log = recorded(rig, "quadratic-drag:tilt:drag=0.2,power=2.38")
    drag, more = QuadraticDrag("tilt", 2.75), Stribeck("tilt", 0.3, 1)
    state = fitted(rig, log, drag, more)
    assert mended(state, shelf(state)) == {more: drag}


def test_two_causes_are_two() -> None:
    rig = Rig.load("thesis")
    log = recorded(rig, "quadratic-drag:tilt:drag=0.2,power=2", "stribeck:tilt:extra=0.05,speed=0.2")
    drag, more = QuadraticDrag("tilt", 2.0), Stribeck("tilt", 0.2, 2)
    state = fitted(rig, log, drag, more)
    assert not mended(state, shelf(state))
    assert keeps(state, more, drag, shelf(state)) > 2 * KEPT
    elsewhere = Stribeck("roll", 0.3, 1)
    assert elsewhere not in mended(fitted(rig, log, drag, elsewhere), shelf(state))


def driven(rig: Rig, log: Log, joint: str, lost: Callable[[Array], Array]) -> Log:
    """A log with the commands of a drive that loses a part of each, which grows with the command."""
    assert log.tau is not None
    j, commands = rig.joint_index(joint), np.linspace(-2.0, 2.0, 400_001) * np.abs(log.tau).max()
    tau = log.tau.copy()
    tau[:, j] = np.interp(tau[:, j], commands - lost(commands), commands)
    return replace(log, tau=tau)


@pytest.mark.parametrize("more", [TorqueRipple("tilt", (1.0,)), TorqueGain("tilt")])
def test_what_scales_the_torque_beside_a_gap_of_another_form_is_a_part_of_it(more: Cause) -> None:
    rig = Rig.load("thesis")
    width = 0.1 * float(np.abs(recorded(rig).tau[:, rig.joint_index("tilt")]).max())
    log = driven(rig, recorded(rig), "tilt", lambda x: width * np.tanh(x / (2 * width)))
    start = DeadZone("tilt", width / 2)
    state = polished(fitted(rig, log, start, more), only=start)
    (gap,) = (cause for cause in state.causes if isinstance(cause, DeadZone))
    assert mended(state, Library(state.problem, ())) == {more: gap}


@pytest.mark.parametrize("planted", ["friction", "ripple"])
def test_a_ripple_that_is_friction_over_the_angle_is_a_part_of_it(planted: str) -> None:
    """Friction in peaks has many harmonics: found by two of them, it leaves the others, and its torque carries a ripple
    over the angle. All of them together do not, unless the motor's torque has one."""
    rig = Rig.load("thesis")
    log, j = recorded(rig), rig.joint_index("tilt")
    assert log.tau is not None and log.v is not None
    tau, q, more = log.tau.copy(), log.q[:, j], 0.05 * np.cos(4 * log.q[:, j])
    peaks = 0.5 + 0.2 * np.cos(q) + 0.15 * np.cos(2 * q)
    tau[:, j] += np.sign(log.v[:, j]) * (peaks + more if planted == "friction" else peaks)
    tau[:, j] *= 1.0 if planted == "friction" else 1.0 + more
    friction, ripple = PositionDependentFriction("tilt", (1.0, 2.0)), TorqueRipple("tilt", (4.0,))
    state = fitted(rig, replace(log, tau=tau), friction, ripple)
    assert mended(state, Library(state.problem, ())) == ({ripple: friction} if planted == "friction" else {})


def test_a_limit_that_leaves_a_constant_of_all_commands_is_none() -> None:
    """The weight may be so much less, and nothing else is left to tell the limit from any other."""
    rig = spelled(HELD)
    log = recorded(rig)
    assert log.tau is not None
    least, most = float(np.abs(log.tau).min()), float(np.abs(log.tau).max())
    assert abs(np.sign(log.tau).mean()) == 1.0
    state = fitted(rig, log)
    for limit in np.linspace(0.8, 0.99, 3) * least:
        assert signs_only(state, NOTHING, Saturation("tilt", limit))
    assert not signs_only(state, NOTHING, Saturation("tilt", 0.98 * most))


@pytest.mark.parametrize("load", [lambda: Rig.load("thesis"), lambda: spelled(ALONE)])
def test_a_gap_and_a_ripple_are_two(load: Callable[[], Rig]) -> None:
    """And so are a gap and a constant, which is a function of the torque, too, and scales nothing."""
    rig = load()
    width = 0.1 * float(np.abs(recorded(rig).tau[:, rig.joint_index("tilt")]).max())
    for planted, more in (
        ("torque-ripple:tilt:amplitude=0.1,harmonic=8,phase=0.5", TorqueRipple("tilt", (8.0,))),
        (f"torque-bias:tilt:bias={width}", TorqueBias("tilt")),
    ):
        log = driven(rig, recorded(rig, planted), "tilt", lambda x: np.clip(x, -width, width))
        state = fitted(rig, log, DeadZone("tilt", width), more)
        assert not mended(state, Library(state.problem, ()))


# bodies


def difference(rig: Rig, log: Log) -> Difference:
    state = fitted(rig, log)
    return Difference.of_fit(rig, state.problem.reduction, state.fit)


def test_a_far_shift_is_found_where_a_direction_hardly_shows() -> None:
    """Slopes at the given place point too far: only a part of such a step leaves less."""
    rig = Rig.load("turret")
    found = chosen(Bodies(difference(rig, recorded(rig, "payload-shift:x=0.012,y=-0.01,z=0.02"))), BODIES)[0]
    assert [kind.of for kind in found.kinds] == [PayloadShift]
    assert found.values[0][0] == pytest.approx(0.012, abs=2e-4) and found.values[0][2] == pytest.approx(0.02, abs=2e-4)


def test_what_no_body_makes_is_not_laid_on_further_ones() -> None:
    """A change of the base parameters that no body explains, thirty deviations in each: the shift stays alone."""
    rig = Rig.load("thesis")
    apart = difference(rig, recorded(rig, "payload-shift:x=0.01,y=0.005,z=-0.004"))
    strange = np.linalg.solve(apart.whitener, 30.0 * RNG(0).normal(size=len(apart.change)))
    found = chosen(Bodies(replace(apart, change=apart.change + strange)), BODIES)[0]
    assert [kind.of for kind in found.kinds] == [PayloadShift]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_causes_that_hide_each_other_are_found_together_and_random_directions_make_no_set(seed: int) -> None:
    """Products of two links and a shift that change the model alike, hundreds of deviations each; as much of none."""
    rig, rng = Rig.load("thesis"), RNG(seed)
    apart = difference(rig, recorded(rig))
    kinds = [*(Kind(OffDiagonalInertia, joint) for joint in rig.joints[1:]), Kind(PayloadShift, rig.joints[0])]
    other = rig
    for kind, way in zip(kinds, rng.normal(size=(3, 3))):
        change, _ = Bodies(apart).response(kind.at(1e-4 * way).apply(rig))
        other = kind.at(0.03 * way / np.linalg.norm(apart.whitener @ change)).apply(other)
    change, _ = Bodies(apart).response(other)
    strange = np.linalg.solve(apart.whitener, 100.0 * rng.normal(size=len(change)))
    found, none = (chosen(Bodies(replace(apart, change=apart.change + x)), BODIES)[0] for x in (change, strange))
    assert {(kind.of, kind.joint) for kind in found.kinds} == {(kind.of, kind.joint) for kind in kinds}
    assert not none.kinds


# what is told


def test_a_gain_that_this_log_cannot_show_is_told() -> None:
    rig = Rig.load("turret")
    log = recorded(rig)
    assert log.tau is not None
    halved = replace(log, tau=log.tau / np.array([0.8, 1.0]))
    only: dict[str, type[Cause]] = {"torque-gain": TorqueGain, **BODIES}
    found = diagnose(rig, [halved], only, rng=RNG(0), filtering=ALIGNED)
    assert ("torque-gain", "pan") in {(row.cause, row.joint) for row in found.untestable}
    (note,) = (note for note in found.notes if "inertia about its axis" in note)
    assert note.startswith("pan: the inertia about its axis is 25") and "more" in note and "torque-gain" in note
    right = diagnose(rig, [log], only, rng=RNG(0), filtering=ALIGNED)
    assert not any("inertia about its axis" in note for note in right.notes)


def test_what_is_found_is_none_of_what_is_hidden() -> None:
    """One motor's gain shows by what it spares all others, however little it shows by itself."""
    rows = [Untestable("torque-gain", joint, "") for joint in ("pan", "tilt")]
    found = [cast(Finding, SimpleNamespace(cause="torque-gain", joint="tilt"))]
    assert untold(rows, found) == tuple(rows[:1]) and untold(rows, []) == tuple(rows)


def test_the_help_lists_every_cause() -> None:
    said = inspect.getdoc(verb) or ""
    assert {*CAUSES, *CHECKS, "platform-motion"} <= set(re.findall(r"[a-z]+(?:-[a-z]+)*", said))


def test_a_rival_that_is_worse_and_alike_has_its_reason() -> None:
    rivals = (Rival("actuator-lag", 40.0, 4.9), Rival("armature", 80.0, 9.0), Rival("cogging", 3.0, 1.0))
    gain = {"torque_rmse_before": 1.0, "torque_rmse_after": 0.5, "rollout_rmse_before": 1.0, "rollout_rmse_after": 0.5}
    alike = ("delay", "actuator-lag", "cogging")
    found = Finding("delay", "pan", "ambiguous", alike, (), gain, 0.001, 1.0, 0.5, 1.0, rivals, "pan: delay", "a chirp")
    one, other = found.open.split("; ")
    assert one == "this log cannot tell it from cogging" and "armature" not in other
    assert other.startswith("actuator-lag fits these logs less well, by 4.9 standard deviations, but adds nearly")
    assert f"  {found.open}; try a chirp" in wrong.told(found)
    assert replace(found, rivals=rivals[2:]).open == "this log cannot tell it from actuator-lag, cogging"
    assert not replace(found, alike=("delay",)).open


# how large a cause is


def test_a_cause_is_as_large_at_a_joint_that_then_stands() -> None:
    """Time at rest, of which nothing is judged, makes neither a cause smaller nor what is left larger."""
    rig, cause = Rig.load("thesis"), Stribeck("tilt", 0.1)
    log, j = recorded(rig, "stribeck:tilt:speed=0.1,extra=0.05"), rig.joint_index("tilt")
    moving = gather(rig, [log], ALIGNED, {log.name: 0.0})
    resting = [part._replace(gate=0.0 * part.gate) for part in moving.parts]
    states = []
    for evidence in (moving, replace(moving, parts=(*moving.parts, *resting, *resting, *resting))):
        problem = Problem.of(evidence, reduce(rig))
        states.append(solved(problem, (), solved(problem, ())))
    loud = [loudness(state, measure(state, cause))[j] for state in states]
    size = [measure(state, cause).size[j] for state in states]
    assert size[1] < 0.6 * size[0]
    assert loud[1] == pytest.approx(loud[0], rel=0.05) and loud[0] > 3.0


# a drive that only silences


def test_a_limit_that_always_bites_is_none() -> None:
    """Of most commands but their sign would be left, which friction explains, or bodies as light as it takes."""
    rig = Rig.load("thesis")
    log = recorded(rig)
    state = fitted(rig, log)
    assert log.tau is not None
    *often, seldom = np.quantile(np.abs(log.tau[:, rig.joint_index("tilt")]), [0.02, 0.1, 0.3, 0.8])
    assert not signs_only(state, NOTHING, Saturation("tilt", float(seldom)))
    assert all(signs_only(state, NOTHING, Saturation("tilt", float(x))) for x in often)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_what_takes_any_torque_off_silences_and_what_explains_it_does_not(share: float) -> None:
    """Of ``(1 - share) target`` as little is unexplained in proportion; what was lost alone leaves nothing at all.

    Where all is taken nothing is left to explain, and what is left is the rest of the model's.
    """
    target, residual = RNG(0).normal(size=(2, 500))
    taken, after = share * target, (1.0 - share) * residual
    loud = float(np.sum(residual**2) - np.sum(after**2))
    assert silences(target, residual, taken, after, loud)
    assert not silences(target, taken, taken, 0.0 * taken, float(np.sum(taken**2)))
    assert silences(target, taken, target, 1e-3 * taken, float(np.sum(taken**2)))


def test_a_lag_in_less_than_the_sensors_noise_only_takes_that_away() -> None:
    """However much it gains: a fit can leave less than the noise by luck, and a signal then leaves less still."""
    rig, lag = Rig.load("thesis"), ActuatorLag("tilt", 0.02)
    state, found = fitted(rig, recorded(rig)), NOTHING._replace(gain=1e9)
    assert not hushes(state, found, lag)
    assert hushes(replace(state, unexplained=[0.3 * x for x in state.unexplained]), found, lag)


def test_a_gap_in_less_than_the_sensors_noise_is_one_where_the_models_torque_shows_it() -> None:
    """That torque has no noise which a gap could take away; a log without one shows it in the measured torque alone."""
    rig, gap = Rig.load("thesis"), DeadZone("tilt", 0.1, 3.0)
    log, asked = recorded(rig), np.linspace(-20.0, 20.0, 200001)
    assert log.tau is not None
    torque = log.tau.copy()
    torque[:, rig.joint_index("tilt")] = np.interp(torque[:, rig.joint_index("tilt")], gap.passed(asked), asked)
    lost, whole = (fitted(rig, one) for one in (replace(log, tau=torque), log))
    quiet = [replace(state, unexplained=[1e-3 * x for x in state.unexplained]) for state in (lost, whole)]
    found = measure(lost, gap)
    assert found.gain > 100.0
    assert [hushes(state, found, gap) for state in quiet] == [False, True]


def test_a_drag_on_friction_that_pushes_is_none() -> None:
    """Friction that falls with the rate before it grows is Stribeck's; a drag stands on friction that brakes."""
    rig, drag = Rig.load("thesis"), QuadraticDrag("tilt", 1.75)
    falling = fitted(rig, recorded(rig, "stribeck:tilt:extra=0.3,speed=0.6"))
    growing = fitted(rig, recorded(rig, "quadratic-drag:tilt:drag=0.2,power=1.75"))
    for state, wrong_ in ((falling, True), (growing, False)):
        found = measure(state, drag)
        assert found.gain > 0.0 and falls(state, found, drag) == wrong_


# what is told beside something else


def test_beside_structure_a_further_cause_must_gain_much() -> None:
    rig = Rig.load("thesis")
    drag, more = QuadraticDrag("tilt", 2.0), Stribeck("tilt", 0.2, 2)
    state = fitted(rig, recorded(rig), drag, more)

    def least(where: str) -> list[float]:
        residual = tuple(Residual("structured" if joint == where else "noise", 1.0, 1.0, "") for joint in rig.joints)
        found = Searched(shelf(state), state, state, state, residual, (), np.ones(1))
        return asked(found, state, [3.0, 1.1])

    assert least("tilt") == [CONFIRMED, LENT]
    assert least("roll") == [CONFIRMED, CONFIRMED]


def test_what_the_rigid_model_shares_must_gain_much_beside_structure_at_another_joint() -> None:
    rig = Rig.load("thesis")
    gain, friction = TorqueBias("tilt"), Stribeck("tilt", 0.2, 2)
    state = fitted(rig, recorded(rig), gain, friction)

    def least(state_: str, limit: float) -> list[float]:
        residual = tuple(Residual(state_ if joint == "roll" else "noise", 1.0, 1.0, "") for joint in rig.joints)
        found = Searched(shelf(state), state, state, state, residual, (), np.full(1, limit))
        return asked(found, state, [1.3, 1.1])

    assert least("structured", 1.0) == [LENT, CONFIRMED]
    assert least("noise", 1.0) == [CONFIRMED, CONFIRMED]
    assert least("noise", 0.0) == [LENT, LENT], "what is no clearer than the error rate asks"


@pytest.mark.parametrize(("left", "none"), [(2 * NOISY, True), (0.5 * NOISY, False)])
def test_springs_at_several_joints_of_which_one_is_none_are_a_mounts(left: float, none: bool) -> None:
    """Where that one leaves more than noise: a mount that rings shows at every joint as one that gives."""
    rig = Rig.load("thesis")
    springs = [JointFlexibility(joint, 8.0, 0.1, 0.3) for joint in rig.joints[:2]]

    def state(causes: list[JointFlexibility]) -> State:
        problem = SimpleNamespace(evidence=SimpleNamespace(rig=rig))
        dispersion = np.array([1.0, left, 1.0])
        return cast(State, SimpleNamespace(problem=problem, causes=causes, fit=SimpleNamespace(dispersion=dispersion)))

    assert swings(state(springs), state(springs[:1])) == none
    assert not swings(state(springs), state(springs)) and not swings(state(springs[:1]), state([]))


def test_a_spring_accounts_for_what_it_asks_of_other_joints() -> None:
    """A structure at one of which something else is told may be that one's form, and at its own joint the spring's."""
    rig = Rig.load("thesis")
    spring, other = JointFlexibility("yaw", 8.0, 0.1, 0.3), Stribeck("tilt", 0.1)
    state = fitted(rig, recorded(rig), spring, other)
    assert shaken(state, {"roll"}) == [spring]
    assert shaken(state, {"yaw", "tilt"}) == shaken(state, set()) == []


@pytest.mark.parametrize("planted", [True, False])
def test_a_limit_leaves_nothing_where_it_bites(planted: bool) -> None:
    rig = Rig.load("thesis")
    log = recorded(rig)
    assert log.tau is not None
    peak, j = float(np.max(np.abs(log.tau[:, 0]))), 0
    limit, command = Saturation(rig.joints[j], 1.2 * peak, knee=3.0), np.linspace(-3 * peak, 3 * peak, 100001)
    asked_for = log.tau.copy()
    asked_for[:, j] = np.interp(log.tau[:, j], limit.passed(command), command)
    state = fitted(rig, replace(log, tau=asked_for) if planted else log, limit)
    assert misses(state, state.causes[0]) == (not planted)


@pytest.mark.parametrize(
    ("first", "last", "loud"), [(11.0, 12.0, True), (10.0, 11.0, True), (6.0, 12.0, True), (11.0, 12.0, False)]
)
def test_harmonics_that_run_on_into_the_last_that_is_tried_draw_what_is_none(
    first: float, last: float, loud: bool
) -> None:
    rig = Rig.load("thesis")
    cause = PositionDependentFriction("tilt", (first, last))
    state = fitted(rig, noisy(recorded(rig), 0.1, 6.0, 0) if loud else recorded(rig), cause)
    assert (state.fit.dispersion[rig.joint_index("tilt")] > MUCH) == loud
    assert goes_on(state, cause) == (loud and first == 11.0)


@pytest.mark.parametrize("swing", [0.0, 1.0])
def test_a_function_of_the_angle_leaves_nothing_but_noise(swing: float) -> None:
    """What another joint's motion swells is none, and three harmonics of the angle take their share of it."""
    rig = Rig.load("thesis")
    log, cause = recorded(rig), Cogging("tilt", (3.0,))
    assert log.tau is not None and log.v is not None
    tau, j = log.tau.copy(), rig.joint_index("tilt")
    pushed = 1.0 + swing * np.tanh(5 * log.v[:, 0])
    tau[:, j] += np.sqrt(np.mean(tau[:, j] ** 2)) * pushed * np.cos(3 * log.q[:, j])
    log = replace(log, tau=tau)
    first, state = fitted(rig, log), fitted(rig, log, cause)
    before, after = first.fit.dispersion[j], state.fit.dispersion[j]
    assert before > 100 * MUCH and after < 0.8 * before
    assert sketches(first, state, cause) == (swing > 0)
    assert not sketches(first, state, Stribeck("tilt", 0.1)), "which is none of the angle"
    assert outlines(first, state, state, {"tilt"}) == ([cause] if swing else [])
    assert outlines(first, state, state, {"yaw"}) == [], "noise may be as loud as it likes"


def test_a_ripple_of_fewer_periods_than_a_commutation_makes_leaves_noise() -> None:
    """Once or twice a turn a rotor, or an encoder, runs off its centre, and whatever has to do with the angle does."""
    rig = Rig.load("thesis")
    log, slow, fast = recorded(rig), TorqueRipple("tilt", (1.0, 5.0)), TorqueRipple("tilt", (1.0, 6.0))
    first = fitted(rig, log)
    for cause in (slow, fast):
        state = fitted(rig, log, cause)
        assert outlines(first, state, state, {"tilt"}) == ([cause] if cause is slow else [])
        assert outlines(first, state, state, set()) == []


@pytest.mark.parametrize("rotor", [0.0, 0.3])
@pytest.mark.parametrize("where", ["around 9 Hz", "over the motion", ""])
def test_a_spring_leaves_nothing_of_the_torque_through_a_resonator(where: str, rotor: float) -> None:
    """Of a torque that swells and fades by itself a spring takes its share, and leaves as much of another resonance."""
    rig = Rig.load("thesis")
    log, spring = recorded(rig), JointFlexibility("tilt", 8.0, 0.1, rotor_share=rotor)
    assert log.tau is not None
    hum = 1.0 + 0.4 * np.sin(2 * np.pi * 7.0 * log.t)[:, None]
    log = replace(log, tau=log.tau * np.where(np.arange(rig.n) == rig.joint_index("tilt"), hum, 1.0))
    state, left = fitted(rig, log, spring), Residual("structured" if where else "noise", 1.0, 1.0, where)
    assert left.rings == where.startswith("around")
    assert echoes(state, {"tilt"} if left.rings else set()) == ([spring] if left.rings else [])
    assert not echoes(state, {"yaw"}), "there nothing gives"
    assert not echoes(fitted(rig, recorded(rig), JointFlexibility("tilt", 60.0, 0.1, rotor_share=rotor)), {"tilt"}), (
        "little is left"
    )


@pytest.mark.parametrize(("harmonic", "bent"), [((1.0,), True), ((1.0, 2.0), True), ((1.0, 84.0), False)])
def test_less_than_one_turn_of_a_ripple_is_a_bend(harmonic: tuple[float, ...], bent: bool) -> None:
    """Of a joint that swings by a radian, as an encoder's error bends its weight; by two turns, a ripple."""
    seen = fitted(Rig.load("thesis"), recorded(Rig.load("thesis"))).problem.evidence.seen[0]
    alike = TorqueRipple("tilt", harmonic).blurred(seen._replace(travel=1.0))
    assert ("encoder-offset" in alike) == ("torque-gain" in alike) == bent
    assert TorqueRipple("tilt", harmonic).blurred(seen._replace(travel=4 * np.pi)) == ()


@pytest.mark.parametrize("cause", [Saturation("tilt", 0.1), Stribeck("tilt", 0.1)])
def test_a_drive_that_leaves_the_bodies_no_mass_is_none(cause: Cause) -> None:
    """Its rollout is none; and that friction beside masses that slow motion does not show has none denies none."""
    rig = Rig.load("thesis")
    held = cast(Evidence, SimpleNamespace(rig=rig))

    def figures(error: float, rolled: float) -> dict[str, dict[str, float]]:
        return {"torque_rmse": dict.fromkeys(rig.joints, error), "rollout_rmse": dict.fromkeys(rig.joints, rolled)}

    gained, nan = confirmation(figures(0.5, 1.0), figures(1.0, 1.0), held, cause), float("nan")
    assert gained == 2.0
    assert confirmation(figures(0.5, nan), figures(1.0, nan), held, cause) == gained
    lost = isinstance(cause, Saturation)
    assert confirmation(figures(0.5, nan), figures(1.0, 1.0), held, cause) == (0.0 if lost else gained)


def test_an_encoder_before_a_gap_reads_half_of_it_off() -> None:
    """As long as the link lies on one flank; and no gap is twice as wide as some offsets."""
    rig = Rig.load("thesis")
    cause = EncoderOffset("tilt", 0.1)
    state = fitted(rig, recorded(rig), cause)
    for least, like in ((0.1, True), (-0.5, False)):
        bears = [Borne(0.0, np.linspace(least, 1.0, 100)) for _ in state.problem.evidence.parts]
        state.__dict__["bearing"] = [bears] * rig.n
        assert leans(state, "tilt") == like
        assert ("backlash" in judged(state, cause, shelf(state), RNG(0)).alike) == like
    assert EncoderOffset("tilt", 0.6 * Backlash.shapes[0].upper).leant == ()


def test_a_cause_found_twice_is_told_once() -> None:
    """As itself, and as the look-alike that takes up what its form leaves over."""

    def one(cause: str, joint: str, share: float, *alike: str) -> Finding:
        row = inspect.signature(Finding).parameters
        known = {"cause": cause, "joint": joint, "explained_share": share, "alike": (cause, *alike)}
        return Finding(**{name: known.get(name) for name in row})

    spring, ripple = one("cable-spring", "pan", 0.9, "cogging"), one("torque-ripple", "pan", 0.2, "cable-spring")
    less, elsewhere = one("cogging", "pan", 0.1), one("cogging", "tilt", 0.1)
    assert once([less, ripple, elsewhere, spring]) == ([spring, ripple, elsewhere], [(less, spring)])
    teeth = one("cogging", "pan", 0.5, "torque-ripple")
    pull = one("cable-spring", "pan", 0.4, "cogging", "torque-ripple")
    both = one("cogging", "pan", 0.5, "torque-ripple", "cable-spring")
    assert once([pull, teeth]) == ([both], [(pull, teeth)])
    assert once([one("cogging", "pan", 0.5), pull])[1] == []


def test_a_held_out_part_without_a_difference_denies_it() -> None:
    rig = Rig.load("turret")
    moved = plant_with(nominal(rig), [parse_effect("payload-shift:x=0.0042,y=0.002,z=-0.001", rig)]).plant
    logs = [prescribed(one, 3, seconds=16.0, torque_noise=2e-3, dt=2e-3) for one in (moved, nominal(rig))]
    state, bodies = fitted(rig, logs[0]), Bodies(difference(rig, logs[0]))
    found, tried = chosen(bodies, BODIES)
    same, other = (gather(rig, [log], ALIGNED, {log.name: 0.0}) for log in logs)
    assert [confirmed(Case(state, bodies, found, tried, one), found.kinds[0]) for one in (same, other)] == [True, False]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_harmonic_is_a_line_and_what_no_harmonic_explains_is_none(seed: int) -> None:
    """A torque that jumps at times of its own has some of every harmonic; cogging beside it stands out."""
    rig, rng = Rig.load("thesis"), RNG(seed)
    for planted in ((), (f"cogging:{rig.joints[0]}:amplitude=0.03,harmonic=42",)):
        log = recorded(rig, *planted, seed=seed)
        jumps = np.cumsum(rng.exponential(0.4, 200))
        step = 0.03 * (-1.0) ** np.searchsorted(jumps, np.asarray(log.t))
        log = replace(log, tau=np.asarray(log.tau) + step[:, None] * (np.arange(rig.n) == 0))
        problem = Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce(rig))
        names = ("cogging", "torque-ripple", "position-dependent-friction")
        shelf = Library(problem, library(problem, {name: CAUSES[name] for name in names}))
        found = contenders(solved(problem, ()), shelf)
        high = [c for _, c in found if isinstance(c, Harmonic) and c.harmonic[0] > 15]
        assert any(c.name == "cogging" and abs(c.harmonic[0] - 42) < 3 for c in high) == bool(planted), high
        assert planted or not high


def test_beside_harmonics_that_gain_alike_none_is_a_line() -> None:
    rig = Rig.load("thesis")
    log = recorded(rig)
    state = solved(Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce(rig)), ())
    every = [state.columns(Cogging(rig.joints[0], (float(k),))) for k in range(1, 101)]
    alike = [(1.0 + 0.5 * np.cos(k), one) for k, one in enumerate(every)]
    assert not [one for _, one in lines(state, alike) if 20 < one.cause.harmonic[0] < 80]
    assert [one for _, one in lines(state, [*alike[:49], (10.0, every[49]), *alike[50:]])] == [every[49]]
    assert lines(state, alike[:3]) == alike[:3]


def test_what_others_gain_by_what_they_share_with_a_line_speaks_for_it() -> None:
    """Of a line's gain another harmonic takes up cos² of the angle; what all gain alike is no line's."""
    rig = Rig.load("thesis")
    log = recorded(rig)
    state = solved(Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce(rig)), ())
    every = [state.columns(Cogging(rig.joints[0], (float(k),))) for k in range(1, 101)]
    near = nearness(state.fit, span(state.fit, every[49]), every)
    for shared, line in ((0.0, True), (50.0, False)):
        rows = [(100.0 * x**2 + shared, one) for x, one in zip(near.tolist(), every)]
        rows = sorted(rows, key=lambda row: -row[0])
        assert rows[0][1] is every[49] and explains_others(state, rows[0], rows) == line


def test_a_size_that_the_log_hardly_tells_is_told_as_rough() -> None:
    """Half of itself or more; not what may have either sign, which may be near zero and known, nor what was set."""
    limit, phase = Parameter("limit", 1.0, "N m", 0.0, 10.0), Parameter("phase", 0.0, "rad", -3.0, 3.0)
    assert rough([replace(limit, std=0.1), replace(phase, std=0.1), limit]) == ""
    assert rough([replace(limit, std=0.5), replace(limit, name="knee", std=2.0)]) == " (limit, knee only roughly)"


def test_beside_an_unknown_residual_the_payload_is_told_as_rough() -> None:
    left = {"pan": Residual("noise", 0.1, 1.0, ""), "tilt": Residual("structured", 0.1, 9.0, "slow")}
    assert wrong.unsure(SimpleNamespace(residual=left)).endswith("unknown is left at tilt)")  # type: ignore[arg-type]
    assert wrong.unsure(SimpleNamespace(residual={"pan": left["pan"]})) == ""  # type: ignore[arg-type]


def test_noise_that_is_larger_than_what_would_be_found_is_said_to_average_out() -> None:
    """It is no contradiction, and where none is larger nothing is said."""

    def said(after: float, state: str) -> str:
        left = {"pan": Residual(state, 1e-3, 1.0, "")}
        shown = SimpleNamespace(residual=left, extended={"torque_rmse": {"pan": after}}, detection_limit={"pan": 0.01})
        shown.covering = Diagnosis.__dict__["covering"].fget(shown)
        hides = Diagnosis.left(cast(Diagnosis, shown), "pan").removeprefix(state)
        assert hides == (f", in which up to {after:g} N m may hide" if shown.covering else "")
        return cast(Callable[[object], str], Diagnosis.__dict__["drowned"].fget)(shown)

    assert said(0.02, "noise").startswith("pan: the noise that is left is larger") and "knocks" in said(0.02, "noise")
    assert said(0.002, "noise") == said(0.02, "structured") == ""


def test_nothing_says_what_the_held_out_part_did_not_confirm() -> None:
    """A cause that fits the training part alone is no finding, and no reason to call a model as good as the data."""
    why = "pan: backlash fits the part that was trained on and the held-out part does not confirm it"
    bare = SimpleNamespace(verdict="nothing", findings=(), lacking=(), beside="nothing", denied=())
    told = SimpleNamespace(**{**vars(bare), "denied": (why,)})
    for say in (wrong.doubted, page):
        assert why in say(cast(Diagnosis, told)) and "confirm" not in say(cast(Diagnosis, bare))


@pytest.mark.parametrize(("cause", "told"), [("payload-shift", True), ("cogging", False)])
def test_two_deviations_of_one_shift_are_said_to_be_two(cause: str, told: bool) -> None:
    """The payload's figures beside a finding about it are taken with its inertias open."""
    found = SimpleNamespace(findings=[SimpleNamespace(cause=cause)], residual={})
    assert ("inertias left open" in wrong.freely(cast(Diagnosis, found))) == told
