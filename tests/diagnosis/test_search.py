"""Laws of candidates: within bounds on any log, alike on a short range, and refined to the shapes that were planted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.diagnosis import State, refit_without, solve_causes
from gimbal_pin.diagnosis.extended import settle_causes
from gimbal_pin.diagnosis.library import ColumnLibrary
from gimbal_pin.diagnosis.shapes import form, free, shape_names
from gimbal_pin.diagnosis.state import resize, solve_consistently
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import (
    CAUSES,
    AsymmetricFriction,
    BaseTilt,
    CableSpring,
    Cause,
    Cogging,
    Delay,
    Effect,
    EncoderOffset,
    FrictionDrift,
    JointFlexibility,
    Losses,
    OperatingRange,
    Presliding,
    RigEffect,
    Saturation,
    Stribeck,
    Term,
    TorqueBias,
    TorqueGain,
    TorqueRipple,
)
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.candidates import measure, refined, worth
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
    ("tried", "shape", "first", "last", "step"),
    [
        (Presliding.tried("tilt", SEEN), "stroke", 4e-4, 0.5, 4.2),
        (Delay.tried("tilt", SEEN), "time", 5e-4, 0.02, 2.2),
        (Saturation.tried("tilt", SEEN._replace(peak=40.0)), "limit", 0.2, 38.0, 1.8),
        (Stribeck.tried("tilt", SEEN), "speed", 0.01, 0.5, 2.2),
    ],
)
def test_what_is_tried_spans_what_a_log_shows_without_a_wide_step(
    tried: tuple[Cause, ...], shape: str, first: float, last: float, step: float
) -> None:
    grid = np.unique([getattr(one, shape) for one in tried])
    assert grid[0] == pytest.approx(first) and grid[-1] >= last * (1 - 1e-9)
    assert np.max(grid[1:] / grid[:-1]) < step


@pytest.mark.parametrize(
    ("cause", "seen", "rival", "alike"),
    [
        (Stribeck("tilt", 0.01), SEEN, "presliding", True),
        (Stribeck("tilt", 0.02), SEEN, "presliding", False),
        (Stribeck("tilt", 0.01), SEEN._replace(rate=0.5), "presliding", False),
        (Cogging("yaw", (1.0,)), TURN._replace(upright=True), "base-tilt", True),
        (Cogging("yaw", (1.0,)), TURN, "base-tilt", False),
        (Cogging("yaw", (1.0, 42.0)), TURN._replace(upright=True), "base-tilt", False),
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


# shapes


def net(state: State, cause: Cause) -> float:
    """By how much a cause is likelier than noise, less what its parameters gain by luck."""
    left = state.fit.residual[state.fit.rows(RIG.joint_index(cause.place))]
    rows = state.problem.evidence.rows
    share = max(1.0 - worth(state, cause) / float(left @ left), 1e-12)
    return -rows * float(np.log(share)) - free(cause) * float(np.log(rows))


def find_best(state: State, kind: type[Cause], joint: str) -> Cause:
    """Of each form the best that is tried, refined; of these the best."""
    seen = state.problem.evidence.seen[RIG.joint_index(joint)]
    tried = kind.tried(joint, seen)
    forms: dict[object, list[Cause]] = {}
    for one in (*tried, *tried[0].akin(seen)):
        forms.setdefault(form(one), []).append(one)
    best = [max(alike, key=partial(worth, state)) for alike in forms.values()]
    return max((refined(state, one) for one in best), key=partial(net, state))


@pytest.mark.parametrize(
    "term",
    [
        Term(TorqueGain("tilt", 1), (0.1,)),
        Term(TorqueGain("tilt", -1), (0.1,)),
        Term(Stribeck("pan", 0.1, 1), (0.1,)),
        Term(Stribeck("pan", 0.1), (0.1,)),
        Term(Presliding("pan", 6e-3), (0.5,)),
        Term(Presliding("pan", 0.03, damped=True), (0.1, 0.2)),
        Term(AsymmetricFriction("pan", 0.4), (0.05,)),
        Term(AsymmetricFriction("pan", 0.3, thin=True), (0.05, 0.03)),
        Term(CableSpring("tilt", growth=0.12), (0.002, 0.003)),
        Term(CableSpring("pan", taut=2, upper=0.2, lower=-0.3), (0.1, 0.15)),
        Term(CableSpring("pan", taut=1, upper=0.1), (0.2,)),
        Term(CableSpring("pan", stiffening=True), (0.0, 0.02, 0.0, 0.3)),
    ],
    ids=str,
)
def test_a_form_is_told_from_others_with_its_shape_and_size(term: Term) -> None:
    state = refit(record(plant(term)))
    best = find_best(state, type(term.effect), term.effect.joint)
    assert form(best) == form(term.effect)
    for name in shape_names(best):
        assert getattr(best, name) == pytest.approx(getattr(term.effect, name), rel=0.1, abs=0.02)
    assert measure(state, best).beta == pytest.approx(term.values, rel=0.1, abs=0.01)
    assert isinstance(best, Effect)
    after = solve_causes(state.problem, (best,), state)
    assert np.all(after.fit.dispersion < 1.5)


@pytest.mark.parametrize(
    "turn",
    [EncoderOffset("roll", 0.5), BaseTilt(0.2, -0.3), BaseTilt(pitch_rate=-0.02)],
    ids=["encoder-offset", "base-tilt", "base-sinking"],
)
def test_a_large_turn_is_built_at_its_own_angle(turn: RigEffect) -> None:
    """It explains what is missed without it, and is no candidate a second time; in proportion it would be off."""
    rig = Rig.load("thesis")
    changed = replace(nominal(turn.apply(rig)), changes=(turn,))
    trials = [
        resize(replace(turn, **{x.name: 0.0 for x in turn.shapes if x is not shape}), 1e-3)
        for shape in turn.shapes
        if getattr(turn, shape.name)
    ]
    plain = refit(record(changed, dt=4e-3), rig)
    linear = solve_causes(plain.problem, trials, plain)
    state = solve_consistently(linear)
    (found,) = settle_causes(state)
    for shape in turn.shapes:
        assert getattr(found, shape.name) == pytest.approx(getattr(turn, shape.name), abs=1e-3)
    assert np.all(state.fit.dispersion < 1.2) and np.any(linear.fit.dispersion > 2)
    assert not ColumnLibrary(rig, trials).columns(state)
    if len(trials) == 1:
        (cause,) = state.causes
        base = refit_without(state, cause)
        gain = measure(base, cause).gain
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


@pytest.mark.parametrize("span", [2.0, 15.0, 1e4])
def test_a_torque_that_is_held_warms_to_its_square(span: float) -> None:
    t = np.arange(0.0, 30.0, 7e-3)
    losses = Losses.along(t, np.full(len(t), 3.0), t)
    warm = 9.0 * -np.expm1(-t / span)
    np.testing.assert_allclose(losses.warmth(span), warm, atol=9.0 * 0.02 / span)


def test_what_a_motor_did_before_a_part_of_its_log_warmed_it() -> None:
    """Of a pause the mean of what it did else; a log of a year keeps its losses in a few megabytes."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(1e-3, 9e-3, 4000))
    tau = rng.standard_normal(4000)
    whole, part = (Losses.along(t, tau, at).warmth(5.0) for at in (t, t[2500:]))
    np.testing.assert_array_equal(whole[2500:], part)
    t = np.array([0.0, 0.01, 3e7, 3e7 + 0.01])
    year = Losses.along(t, np.array([3.0, 9.0, 3.0, 3.0]), t)
    assert year.power.nbytes < 10e6
    np.testing.assert_allclose(year.warmth(1e4)[-2:], 33.0, rtol=1e-6)


def test_friction_that_a_motor_warms_by_its_own_torque_is_found() -> None:
    """By its losses it is told to the noise, with span and size, not by time: the motion swells and ebbs."""
    term = Term(FrictionDrift("tilt", 4.0, held=0.5), (-0.03, 0.0))
    plain = record(nominal(RIG), seconds=16.0)
    swell = 1.0 - 0.6 * np.cos(2 * np.pi * plain.t / 16.0)
    q = plain.q * swell[:, None]
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
    size = measure(state, best).beta[0] / best.held**2
    assert size == pytest.approx(-0.03 / 0.25, rel=0.1)
