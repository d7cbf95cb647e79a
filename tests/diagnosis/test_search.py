"""Laws of candidates: within bounds, scored by what they explain, refined to the shapes that were planted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.control import tune
from gimbal_pin.diagnosis import (
    DIAGNOSIS_BAND,
    Columns,
    State,
    fit,
    gained,
    refit_without,
    solve_causes,
)
from gimbal_pin.diagnosis.extended import settle_causes
from gimbal_pin.diagnosis.library import ColumnLibrary
from gimbal_pin.diagnosis.shapes import form, free, shape_names
from gimbal_pin.diagnosis.state import resize, solve_consistently
from gimbal_pin.diagnosis.uncertainty import estimate_figures
from gimbal_pin.dynamics import nominal, simulate
from gimbal_pin.effects import (
    CAUSES,
    AsymmetricFriction,
    Backlash,
    BaseTilt,
    CableSpring,
    Cause,
    Cogging,
    Coulomb,
    DeadZone,
    EncoderOffset,
    FrictionDrift,
    JointFlexibility,
    JointLoad,
    Losses,
    OperatingRange,
    Presliding,
    RigEffect,
    Saturation,
    Signal,
    Stribeck,
    Term,
    TorqueBias,
    TorqueGain,
    TorqueRipple,
)
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.candidates import measure, refined, worth
from tests.diagnosis.cases import log_of
from tests.refitted import RIG, plant, record, refit

SEEN = OperatingRange(60.0, 0.005, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)
TURN = SEEN._replace(travel=7.0)
SIZES = st.just(0.0) | st.floats(-9.0, 7.0).map(lambda x: float(10**x))
"""Of a watch or of a press, and none at all."""
ANY_LOG = st.builds(
    OperatingRange,
    st.floats(0.05, 1e6),
    st.floats(1e-5, 1.0),
    st.floats(0.1, 2e3),
    *[SIZES] * 5,
    st.booleans(),
    st.booleans(),
    st.floats(-1e7, 1e7),
    SIZES,
)
ROWS = 1200
SEEDS = st.integers(0, 2**32 - 1)
BLOCK = np.arange(ROWS) * 40 // ROWS


@pytest.mark.parametrize(
    "name", sorted(name for name, kind in CAUSES.items() if not kind.of_given_model)
)
@given(seen=ANY_LOG, factor=st.floats(1e-9, 1e9))
def test_no_cause_is_tried_or_moved_beyond_its_bounds(
    name: str, seen: OperatingRange, factor: float
) -> None:
    """A cause outside its bounds is refused."""
    tried = CAUSES[name].tried("pan", seen)
    for cause in (*tried[:: max(1, len(tried) // 8)], *tried[-1:]):
        for shape in shape_names(cause):
            assert cause.moved(shape, factor * getattr(cause, shape)).name == name


@pytest.mark.parametrize(
    ("cause", "seen", "rival", "alike"),
    [
        (Stribeck("tilt", 0.01), SEEN, "presliding", True),
        (Stribeck("tilt", 0.02), SEEN, "presliding", False),
        (Cogging("yaw", (1.0,)), TURN._replace(upright=True), "base-tilt", True),
        (Cogging("yaw", (1.0,)), TURN, "base-tilt", False),
        (Cogging("yaw", (1.0,)), SEEN, "cable-spring", True),
        (Cogging("yaw", (4.0,)), SEEN, "cable-spring", False),
        (TorqueRipple("tilt", (1.0, 2.0)), SEEN, "encoder-offset", True),
        (TorqueRipple("tilt", (1.0, 84.0)), SEEN, "encoder-offset", False),
        (JointFlexibility("tilt", 25.0), SEEN, "delay", True),
        (JointFlexibility("tilt", 23.0), SEEN, "delay", False),
        (TorqueBias("tilt"), SEEN, "asymmetric-friction", True),
    ],
)
def test_a_short_range_makes_causes_alike(
    cause: Cause, seen: OperatingRange, rival: str, alike: bool
) -> None:
    assert (rival in cause.blurred(seen)) == alike


# scores


def column(values: Array, joint: int | None = 0, shared: Array | None = None) -> Columns:
    """Return columns without bounds, (rows, c) at a joint, or (rows, n, c) at all, of some cause."""
    wide = np.full(values.shape[-1], np.inf)
    count = 1 if joint is not None else values.shape[1]
    return Columns(Coulomb("any"), count, joint, values, -wide, wide, shared=shared)


@given(SEEDS, st.integers(1, 4), st.integers(0, 1), st.floats(-320.0, 5.0))
def test_gain_is_that_of_least_squares_whatever_the_size_and_place_of_columns(
    seed: int, width: int, joint: int, power: float
) -> None:
    """A column at one joint is one of zeros at the others; one that dies away gains nothing, without a warning."""
    rng = np.random.default_rng(seed)
    now = fit(
        rng.normal(size=(ROWS, 2, 3)), rng.normal(size=(ROWS, 2)) * [1.0, 3.0], np.ones(2), BLOCK
    )
    own = rng.normal(size=(ROWS, width))
    everywhere = np.zeros((ROWS, 2, width))
    everywhere[:, joint] = own
    whole = gained(now, column(everywhere, None), False)
    both = np.concatenate([now.stack, now.stacked(everywhere)], axis=1)
    theta, left, *_ = np.linalg.lstsq(both, now.target)
    assert whole.gain == pytest.approx(now.cost - left[0])
    np.testing.assert_allclose(whole.beta, theta[3:], rtol=1e-6)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        scaled = gained(now, column(10.0**power * own, joint), False)
    if power > -10.0:
        assert scaled.gain == pytest.approx(whole.gain, rel=1e-6)
        assert scaled.visible == pytest.approx(whole.visible)
    elif power < -15.0:
        assert scaled.gain == scaled.visible == 0.0


@pytest.mark.parametrize("held", [10.0, -15.0])
def test_friction_over_the_angle_gains_the_same_however_much_coulomb_friction_it_holds(
    held: float,
) -> None:
    t = np.linspace(0.0, 60.0, ROWS)
    wave = np.cos(4.8 * np.sin(t))
    slide = np.sign(np.cos(t))
    noise = 0.01 * np.random.default_rng(0).standard_normal(ROWS)
    base = np.stack([slide, 0.8 * np.cos(t)], axis=1)
    torque = slide * (0.3 + 0.1 * wave) + noise
    now = fit(base[:, None], torque[:, None], np.ones(1), BLOCK)
    alone, more, pushing = (
        gained(now, column((slide * (wave + extra))[:, None], shared=shared), False).gain
        for extra, shared in ((0.0, None), (held, slide), (held, None))
    )
    assert more == pytest.approx(alone)
    assert pushing == 0.0, "a torque of its own of that size works but against the model"


def test_of_two_shapes_of_which_only_the_product_matters_neither_has_a_deviation() -> None:
    state = refit(log_of("nothing"))
    loose = solve_causes(state.problem, (Backlash("pan", 0.01, 1e-3, 0.2),), state)
    sizes = {p.name: p.std for p in estimate_figures(loose, loose.causes[0])}
    assert np.isnan(sizes["gap"]) and np.isnan(sizes["inertia"]) and sizes["rotor_share"] > 0


# shapes


def net(state: State, cause: Cause) -> float:
    """Return by how much a cause is likelier than noise, less what its parameters gain by luck."""
    left = state.fit.residual[state.fit.rows(RIG.joint_index(cause.place))]
    rows = state.problem.evidence.rows
    share = max(1.0 - worth(state, cause) / float(left @ left), 1e-12)
    return -rows * float(np.log(share)) - free(cause) * float(np.log(rows))


def find_best(state: State, kind: type[Cause], joint: str) -> Cause:
    """Return of each form the best that is tried, refined; of these the best."""
    seen = state.problem.evidence.seen[RIG.joint_index(joint)]
    tried = kind.tried(joint, seen)
    forms: dict[object, list[Cause]] = {}
    for one in (*tried, *tried[0].akin(seen)):
        forms.setdefault(form(one), []).append(one)
    best = [max(alike, key=partial(worth, state)) for alike in forms.values()]
    return max((refined(state, one) for one in best), key=partial(net, state))


def assert_alike(found: Cause, planted: Cause) -> None:
    """Assert the form of a cause, and its shapes to a tenth."""
    assert form(found) == form(planted)
    for name in shape_names(found):
        slack = 0.2 if name == "sharpness" else 0.1
        assert getattr(found, name) == pytest.approx(getattr(planted, name), rel=slack, abs=0.02)


@pytest.mark.parametrize(
    "term",
    [
        Term(TorqueGain("tilt", -1), (0.1,)),
        Term(Stribeck("pan", 0.1, 1), (0.1,)),
        Term(Stribeck("pan", 0.1), (0.1,)),
        Term(Presliding("pan", 6e-3), (0.5,)),
        Term(Presliding("pan", 0.03, damped=True), (0.1, 0.2)),
        Term(AsymmetricFriction("pan", 0.3, thin=True), (0.05, 0.03)),
        Term(CableSpring("tilt", growth=0.12), (0.002, 0.003)),
        Term(CableSpring("pan", taut=2, upper=0.2, lower=-0.3), (0.1, 0.15)),
        Term(CableSpring("pan", stiffening=True), (0.0, 0.02, 0.0, 0.3)),
    ],
    ids=str,
)
def test_a_form_is_told_from_others_with_its_shape_and_size(term: Term) -> None:
    state = refit(record(plant(term)))
    best = find_best(state, type(term.effect), term.effect.joint)
    assert_alike(best, term.effect)
    assert measure(state, best).beta == pytest.approx(term.values, rel=0.1, abs=0.01)
    assert np.all(solve_causes(state.problem, (best,), state).fit.dispersion < 1.5)


@pytest.mark.parametrize(
    "turn", [EncoderOffset("roll", 0.5), BaseTilt(0.2, -0.3), BaseTilt(pitch_rate=-0.02)], ids=str
)
def test_a_large_turn_is_built_at_its_own_angle(turn: RigEffect) -> None:
    """It explains what is missed without it, and is no candidate a second time; in proportion it would be off."""
    rig = Rig.load("thesis")
    changed = replace(nominal(turn.apply(rig)), changes=(turn,))
    shapes = [shape.name for shape in turn.shapes if getattr(turn, shape.name)]
    trials = [
        resize(replace(turn, **{name: 0.0 for name in shapes if name != own}), 1e-3)
        for own in shapes
    ]
    plain = refit(record(changed, dt=4e-3), rig)
    linear = solve_causes(plain.problem, trials, plain)
    state = solve_consistently(linear)
    (found,) = settle_causes(state)
    for name in shapes:
        assert getattr(found, name) == pytest.approx(getattr(turn, name), abs=1e-3)
    assert np.all(state.fit.dispersion < 1.2) and np.any(linear.fit.dispersion > 2)
    assert not ColumnLibrary(rig, trials).columns(state)
    if len(trials) == 1:
        base = refit_without(state, state.causes[0])
        gain = measure(base, state.causes[0]).gain
        assert gain == pytest.approx(base.fit.cost - state.fit.cost, rel=1e-3)


def test_overtones_of_what_repeats_with_a_tooth_are_sought_whatever_the_grid_holds() -> None:
    tooth = Cogging("tilt", (90.0,))
    second = Cogging("tilt", (180.0,))
    state = refit(record(plant(Term(tooth, (0.1, 0.0)), Term(second, (0.03, 0.03)))))
    state = solve_causes(state.problem, (tooth,), state)
    library = ColumnLibrary(RIG, [Cogging("tilt", (float(k),)) for k in (12, 90, 91)])
    shown = [one.cause for one in library.columns(state)]
    assert max(shown, key=partial(worth, state)) == second
    shown = [one.cause for one in library.columns(refit_without(state, tooth))]
    assert second not in shown


# friction that a motor warms by its own losses


def test_a_torque_that_is_held_warms_to_its_square() -> None:
    """A part of a log is as warm as in the whole, and a year's losses take a few megabytes."""
    t = np.arange(0.0, 30.0, 7e-3)
    losses = Losses.along(t, np.full(len(t), 3.0), t)
    np.testing.assert_allclose(losses.warmth(15.0), -9.0 * np.expm1(-t / 15.0), atol=0.012)
    rough = np.random.default_rng(0).standard_normal(len(t))
    whole, part = (Losses.along(t, rough, at).warmth(5.0) for at in (t, t[2500:]))
    np.testing.assert_array_equal(whole[2500:], part)
    t = np.array([0.0, 0.01, 3e7, 3e7 + 0.01])
    year = Losses.along(t, np.array([3.0, 9.0, 3.0, 3.0]), t)
    assert year.power.nbytes < 10e6
    np.testing.assert_allclose(year.warmth(1e4)[-2:], 33.0, rtol=1e-6)


def test_friction_that_a_motor_warms_by_its_own_torque_is_found() -> None:
    """By its losses it is told to the noise, with span and size, not by time: the motion swells and ebbs."""
    term = Term(FrictionDrift("tilt", 4.0, held=0.5), (-0.03, 0.0))
    plain = record(nominal(RIG), seconds=16.0)
    q = plain.q * (1.0 - 0.6 * np.cos(2 * np.pi * plain.t / 16.0))[:, None]
    v = np.gradient(q, plain.dt, axis=0)
    a = np.gradient(v, plain.dt, axis=0)
    losses = None
    for _ in range(8):
        tau = plant(term).inverse(q, v, a, t=plain.t, losses=losses)
        losses = [Losses.along(plain.t, x, plain.t) for x in tau.T]
    tau += 1e-3 * np.random.default_rng(4).standard_normal(tau.shape)
    state = refit(Log("warming", RIG.joints, plain.t, q, v, tau))
    best = find_best(state, FrictionDrift, "tilt")
    assert isinstance(best, FrictionDrift) and best.held > 0
    assert best.span == pytest.approx(4.0, rel=0.1)
    assert measure(state, best).beta[0] / best.held**2 == pytest.approx(-0.03 / 0.25, rel=0.1)


# drives, gaps and springs between motor and link


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_gap_feels_the_command_less_friction_and_what_its_link_bears(share: float) -> None:
    """``x/J`` is the rotor's acceleration less the link's, which the load brakes; with the encoder there it is x."""
    command = 0.3 + 0.5 * np.sin(0.018 * np.arange(800))
    gap = Backlash("tilt", 0.01, 0.004, share)
    beside = share / (1 - share) * 0.2 - 0.1 if share else 0.0
    acting = gap.acting(command + beside, 1e-3) - beside
    borne = JointLoad(np.full(800, 0.1), np.full(800, 0.2))
    np.testing.assert_allclose(gap.along(command, 1e-3, borne), acting)
    np.testing.assert_array_equal(gap.along(command, 1e-3, None), gap.acting(command, 1e-3))


def test_a_gap_at_rest_does_not_knock_at_the_noise_of_a_rate() -> None:
    command = np.full(400, 0.1)
    brake = 0.5 * np.sign(np.random.default_rng(0).standard_normal(400))
    load = np.full(400, 0.05)
    gap = Backlash("tilt", 2e-3, 0.01, 0.3)
    held, moving = (JointLoad.along(brake, load, command, np.full(400, x)) for x in (True, False))
    np.testing.assert_allclose(gap.along(command, 2e-3, held), command)
    assert np.abs(gap.along(command, 2e-3, moving) - command).max() > 0.5


def test_a_spring_passes_on_what_the_link_asks_for_while_the_rotor_sticks_too() -> None:
    """``y = (I + J) a + friction + load``, whatever friction is taken to hold the rotor where it stands."""
    dt = 1e-4
    rotor = 0.003
    link = 0.007
    rng = np.random.default_rng(3)
    t = dt * np.arange(15000)
    load = 0.1 + 0.05 * np.sin(4.4 * t)
    push = load + 0.25 * np.sin(12.0 * t) + 0.05 * np.sin(31.4 * t)
    w = 2 * np.pi * 15.0
    k = w * w * rotor * link / 0.01
    bend = 0.3 / k
    bending = 0.0
    rate = 0.0
    rows = []
    for u, asked in zip(push.tolist(), load.tolist()):
        spring = k * (bend + 2 * 0.1 / w * bending)
        free = u - spring + rate * rotor / dt
        brake = max(-0.1, min(0.1, free))
        a = (u - spring - brake) / rotor
        rate += a * dt
        rows.append((brake, a, abs(rate) < 1e-12))
        bending += (a - (spring - asked) / link) * dt
        bend += bending * dt
    friction, acceleration, still = np.array(rows).T
    moves = still == 0
    told = np.where(moves, friction, rng.normal(size=len(t)))
    borne = JointLoad(told, load, 0.01 * acceleration, ~moves)
    passed = JointFlexibility("tilt", 15.0, 0.1, 0.3).along(push, dt, borne)
    wrong = passed - (0.01 * acceleration + friction + load)
    assert np.sqrt(np.mean(wrong[moves] ** 2)) < 0.02 * np.sqrt(np.mean(push**2))


def test_a_resonance_is_moved_along_its_zero() -> None:
    other = JointFlexibility("tilt", 20.0, 0.05, 0.2).moved("frequency", 26.0)
    assert isinstance(other, JointFlexibility)
    assert sqrt(other.rotor_share) * other.frequency == pytest.approx(sqrt(0.2) * 20.0)
    assert other.damping / other.frequency == pytest.approx(0.05 / 20.0)


def looped(drive: Signal, reference: Motion, bandwidth: float = 6.0) -> State:
    """Return the refitted model without any cause, on a log of a closed loop with this drive."""
    dt = float(reference.t[1] - reference.t[0])
    law = tune(nominal(RIG), bandwidth_hz=bandwidth, dt=dt).controller
    log = simulate(nominal(RIG), law, reference, rng=np.random.default_rng(2), drive=(drive,))
    noise = 2e-3 * np.random.default_rng(4).normal(size=log.q.shape)
    return refit(replace(log, tau=np.asarray(log.tau) + noise), filtering=DIAGNOSIS_BAND)


@pytest.mark.parametrize(
    "drive",
    [DeadZone("pan", 0.12, 4.0), Saturation("tilt", 0.8, 0, 2.0), Saturation("pan", 0.3, -1)],
    ids=str,
)
def test_a_drive_without_memory_is_told_with_its_shape(drive: Signal) -> None:
    state = looped(drive, fourier(RIG, 2, 8.0, 2e-3))
    assert_alike(find_best(state, type(drive), drive.joint), drive)


def test_a_threshold_explains_more_than_an_edge_though_the_command_crosses_it_all_the_time() -> (
    None
):
    """No edge of a smoothed torque, however sharp, explains as much."""
    drive = DeadZone("pan", 0.12, whole=True)
    state = looped(drive, fourier(RIG, 2, 8.0, 2e-3))
    edge = max(worth(state, refined(state, DeadZone("pan", x, 12.0))) for x in (0.1, 0.13))
    left = float(np.sum(state.fit.residual[state.fit.rows(0)] ** 2))
    assert left - worth(state, drive) < (left - edge) / 2


def test_a_gap_in_which_the_loop_chatters_is_told_by_every_sample() -> None:
    """What the rotor crosses under a torque goes by the product of gap and inertia alone."""
    state = looped(Backlash("pan", 0.012, 0.01), fourier(RIG, 3, 6.0, 1e-3), 8.0)
    near = find_best(state, Backlash, "pan").akin(state.problem.evidence.seen[0])
    found = refined(state, max(near, key=partial(worth, state)))
    assert isinstance(found, Backlash) and not found.rotor_share
    assert found.gap * found.inertia == pytest.approx(1.2e-4, rel=0.02)


def test_a_spring_is_found_by_its_zero() -> None:
    """With dry friction on the rotor, which turns round and sticks."""
    slow = fourier(RIG, 0, 6.0, 2e-3)
    w = 2 * np.pi * np.linspace(1.0, 11.0, 21)
    phase = np.outer(slow.t, w) + np.random.default_rng(5).uniform(0, 2 * np.pi, 21)
    q, v, a = (
        x + np.outer(wave @ (0.3 / w**power), [0.0, 1.0])
        for x, wave, power in (
            (slow.q, np.sin(phase), 1.5),
            (slow.v, np.cos(phase), 0.5),
            (slow.a, -np.sin(phase), -0.5),
        )
    )
    state = looped(JointFlexibility("tilt", 13.0, 0.08, 0.2), Motion(slow.t, q, v, a), 2.0)
    tried = JointFlexibility.tried("tilt", state.problem.evidence.seen[1])
    found = refined(state, max(tried, key=partial(worth, state)))
    assert isinstance(found, JointFlexibility)
    assert found.frequency / sqrt(1 / found.rotor_share - 1) == pytest.approx(6.5, rel=0.1)
