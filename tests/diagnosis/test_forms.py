"""Laws of forms beyond a cause's first: gains of one direction, ripple of many poles, large turns, slack cables."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.diagnosis import (
    DIAGNOSIS_BAND,
    Evidence,
    Problem,
    State,
    gather,
    refit_without,
    solve_causes,
    torque_rmse,
)
from gimbal_pin.diagnosis.extended import settle_causes
from gimbal_pin.diagnosis.library import ColumnLibrary, list_candidates
from gimbal_pin.diagnosis.shapes import free, move_shape, shape_names
from gimbal_pin.diagnosis.state import resize, solve_consistently
from gimbal_pin.dynamics import Model, nominal, reduce_parameters
from gimbal_pin.effects import (
    CAUSES,
    AsymmetricFriction,
    BaseTilt,
    CableSpring,
    Cause,
    Cogging,
    DeadZone,
    EncoderOffset,
    OperatingRange,
    Presliding,
    RigEffect,
    Sample,
    Saturation,
    Stribeck,
    Term,
    TorqueBias,
    TorqueGain,
    TorqueRipple,
    parse_effect,
)
from gimbal_pin.log import Array
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.candidates import measure, refined, worth

ALIGNED = replace(DIAGNOSIS_BAND, alignment=0.0)
SEEN = OperatingRange(60.0, 0.002, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)
RIG = Rig.load("thesis")


def evidence(model: Model) -> Evidence:
    """What a log of the model's prescribed motion shows of the bundled rig."""
    log = prescribed(model, seconds=14.0, torque_noise=1e-3, dt=2e-3)
    return gather(RIG, [log], ALIGNED)


def fitted(model: Model, *causes: Cause) -> State:
    """Causes as the library starts them, fitted to a log of the model, before what they are built from is settled."""
    problem = Problem.of(evidence(model), reduce_parameters(RIG))
    return solve_causes(problem, causes, solve_causes(problem, ()))


def inverse(zone: DeadZone, torque: Array) -> Array:
    """Commands that give these torques, (N,)."""
    commands = np.linspace(-2.0, 2.0, 400_001) * np.abs(torque).max()
    return np.interp(torque, zone.passed(commands), commands)


def test_a_bias_is_coulomb_friction_that_differs_by_direction() -> None:
    """While it slides, and at rest both leave it anything between ``b - c`` and ``b + c``: they are one class."""
    ways = np.array([-1.0, 1.0])
    at = Sample(0.0, 0.0, ways, 0.0, slide=ways, tau=0.0)
    bias = TorqueBias("tilt")
    uneven = AsymmetricFriction("tilt")
    np.testing.assert_array_equal(
        Term(bias, (0.3,)).torque(at) * np.ones(2), Term(uneven, (0.3, 0.0)).torque(at)
    )
    assert uneven.name in bias.blurred(SEEN)


def test_stribecks_speeds_that_are_passed_within_a_bristles_stroke_are_bristles() -> None:
    """Of one joint that swings by an angle A at Ω: it is at ``v = A Ω² t`` after ``A Ω² t²/2`` of way."""
    assert Presliding.shapes[0].lower == 0.0001
    slow = Stribeck("tilt", 0.02)
    quick = Stribeck("tilt", 0.01)
    assert "presliding" in quick.blurred(SEEN) and "presliding" not in slow.blurred(SEEN)
    assert "presliding" in slow.blurred(SEEN._replace(rate=4.0, travel=2.0))
    assert "presliding" not in quick.blurred(SEEN._replace(rate=0.5))


def test_the_gains_of_both_directions_are_that_of_the_whole() -> None:
    tau = np.linspace(-2.0, 3.0, 101)
    both, up, down = (
        TorqueGain("tilt", side).basis(Sample(*([0.0] * 5), tau=tau))[0] for side in (0, 1, -1)
    )
    np.testing.assert_array_equal(up + down, both)
    assert np.min(up) == 0.0 == np.max(down)
    assert TorqueGain("tilt").coupled and not TorqueGain("tilt", 1).coupled
    assert {one.side for one in TorqueGain.tried("tilt", SEEN) if isinstance(one, TorqueGain)} == {
        0,
        1,
        -1,
    }


@pytest.mark.parametrize("side", [1, -1])
def test_a_gain_of_one_direction_is_found_with_its_size(side: int) -> None:
    effect = TorqueGain(RIG.joints[-1], side)
    state = solve_consistently(fitted(Model(RIG, (Term(effect, (0.1,)),)), effect))
    assert state.coefficients(state.causes[0])[0] == pytest.approx(0.1, abs=0.005)


def test_ripple_of_many_poles_is_sought_six_times_per_electrical_turn() -> None:
    tried = [
        one.harmonic[0] for one in TorqueRipple.tried("pan", SEEN) if isinstance(one, TorqueRipple)
    ]
    assert {1.0, 99.0, 126.0, 252.0} <= set(tried)
    assert all(k <= 100 or k % 6 == 0 for k in tried)


def test_what_repeats_with_a_tooth_is_sought_at_its_overtones_whatever_the_grid_holds() -> None:
    """A steep tooth's second harmonic, which the coarse grid leaves out, enters as a part of the first one's cause."""
    tooth = Cogging("tilt", (90.0,))
    second = Cogging("tilt", (180.0,))
    model = replace(
        nominal(RIG),
        terms=(*nominal(RIG).terms, Term(tooth, (0.1, 0.0)), Term(second, (0.03, 0.03))),
    )
    found = fitted(model, tooth)
    kinds: dict[str, type[Cause]] = {"cogging": Cogging, "torque-ripple": TorqueRipple}
    grid = [
        cause
        for cause in list_candidates(found.problem.evidence, kinds)
        if cause not in tooth.above()
    ]
    library = ColumnLibrary(found.problem.evidence.rig, grid)
    shown = [one.cause for one in library.columns(found)]
    assert second in shown and max(shown, key=partial(worth, found)) == second
    assert not [one for one in library.columns(refit_without(found, tooth)) if one.cause == second]
    assert {one.harmonic for one in Cogging("tilt", (400.0,)).above()} == {(800.0,)}


def size(least: float, most: float) -> st.SearchStrategy[float]:
    """Numbers of every order of magnitude between two, and none at all."""
    return st.just(0.0) | st.floats(np.log10(least), np.log10(most)).map(lambda x: float(10**x))


ANY_LOG = st.builds(
    OperatingRange,
    seconds=st.floats(0.05, 1e6),
    dt=st.floats(1e-5, 1.0),
    band=st.floats(0.1, 2e3),
    travel=size(1e-9, 1e7),
    rate=size(1e-9, 1e5),
    rate_std=size(1e-9, 1e5),
    torque=size(1e-9, 1e7),
    peak=size(1e-9, 1e7),
    warm=st.booleans(),
    upright=st.booleans(),
    middle=st.floats(-1e7, 1e7),
    rms=size(1e-9, 1e7),
)
"""A second or a week, one angle or a million turns, a motor of a watch or of a press."""


@pytest.mark.parametrize(
    "name", sorted(name for name, kind in CAUSES.items() if not kind.of_given_model)
)
@given(seen=ANY_LOG, factor=st.floats(1e-9, 1e9))
def test_whatever_a_log_shows_no_cause_is_tried_beyond_its_bounds(
    name: str, seen: OperatingRange, factor: float
) -> None:
    """Nor moved there: a cause outside its bounds is refused with figures that nobody gave."""
    tried = CAUSES[name].tried("pan", seen)
    for cause in (*tried[:: max(1, len(tried) // 8)], *tried[-1:]):
        moves = [cause.moved(shape, factor * getattr(cause, shape)) for shape in shape_names(cause)]
        assert all(one.name == name for one in moves)


@pytest.mark.parametrize("peak", [1.2, 4.0, 40.0])
def test_clips_are_tried_a_step_apart_however_rare_the_peaks(peak: float) -> None:
    clips = [
        one
        for one in Saturation.tried("tilt", SEEN._replace(peak=peak))
        if isinstance(one, Saturation)
    ]
    limits = np.array([one.limit for one in clips if one.side == 0 and not one.knee])
    assert limits[0] == pytest.approx(0.2 * SEEN.torque) and limits[-1] == pytest.approx(
        (1 - 0.05) * peak
    )
    assert np.max(limits[1:] / limits[:-1]) <= 1.25 * (1 + 1e-9)
    off = peak - limits[limits >= (1 - 0.25) * peak * (1 - 1e-9)]
    assert np.max(off[:-1] / off[1:]) <= 1.8 * (1 + 1e-9)


def test_once_per_turn_about_a_vertical_axis_may_be_a_base_that_leans() -> None:
    upright = SEEN._replace(upright=True, travel=7.0)
    assert "base-tilt" in Cogging("yaw", (1.0,)).blurred(upright)
    assert "base-tilt" not in Cogging("yaw", (1.0,)).blurred(upright._replace(upright=False))
    assert "base-tilt" not in Cogging("yaw", (1.0, 42.0)).blurred(upright)
    assert [one.upright for one in evidence(nominal(RIG)).seen].index(True) == 0


@pytest.mark.parametrize(
    ("turn", "trials"),
    [
        (EncoderOffset(RIG.joints[1], 0.5), (EncoderOffset(RIG.joints[1], 1e-3),)),
        (BaseTilt(0.2, -0.3), (BaseTilt(roll=1e-3), BaseTilt(pitch=1e-3))),
    ],
    ids=["encoder-offset", "base-tilt"],
)
def test_a_large_turn_is_built_at_its_own_angle(turn: RigEffect, trials: tuple[Cause, ...]) -> None:
    """In proportion to a small turn its torque would be off by a tenth; and it is no candidate a second time."""
    linear = fitted(nominal(turn.apply(RIG)), *trials)
    state = solve_consistently(linear)
    (found,) = settle_causes(state)
    for shape in turn.shapes:
        assert getattr(found, shape.name) == pytest.approx(getattr(turn, shape.name), abs=1e-3)
    assert np.all(state.fit.dispersion < 1.2) and np.all(linear.fit.dispersion > 100)
    assert not ColumnLibrary(state.problem.evidence.rig, trials).columns(state)


@pytest.mark.parametrize("turn", [BaseTilt(pitch=0.7), EncoderOffset(RIG.joints[1], 0.5)])
def test_a_large_turn_explains_as_much_as_is_missed_without_it(turn: RigEffect) -> None:
    """The inertias that are fitted without it take it up, and are no rig's that is turned."""
    state = solve_consistently(fitted(nominal(turn.apply(RIG)), resize(turn, 1e-3)))
    (cause,) = state.causes
    base = refit_without(state, cause)
    found = measure(base, cause)
    assert found.gain == pytest.approx(base.fit.cost - state.fit.cost, rel=1e-3)
    np.testing.assert_allclose(found.beta, state.coefficients(cause), rtol=1e-3)


def test_a_base_that_sinks_is_found_with_its_rate() -> None:
    sinking = BaseTilt(pitch_rate=-0.02)
    model = replace(nominal(RIG), changes=(sinking,))
    log = prescribed(nominal(RIG), seconds=14.0, torque_noise=1e-3, dt=2e-3)
    more = [m.inverse(log.q, log.v, 0.0 * log.q, t=log.t) for m in (model, nominal(RIG))]
    log = replace(log, tau=log.tau + more[0] - more[1])
    problem = Problem.of(gather(RIG, [log], ALIGNED), reduce_parameters(RIG))
    linear = solve_causes(problem, (BaseTilt(pitch_rate=1e-3),), solve_causes(problem, ()))
    state = solve_consistently(linear)
    (found,) = settle_causes(state)
    assert found.to_dict()["pitch_rate"] == pytest.approx(-0.02, abs=1e-4)
    assert np.all(state.fit.dispersion < 1.2) and np.any(linear.fit.dispersion > 3)
    errors = [np.max(torque_rmse(problem.evidence, one)) for one in (model, nominal(RIG))]
    assert errors[0] < 0.2 * errors[1]


def test_a_switch_is_found_from_a_gap_that_is_none() -> None:
    """The command that gives half of itself is told whatever the sharpness: both are found, polished as often."""
    start = DeadZone("tilt", 1.1, 4.0)
    truth = DeadZone("tilt", 0.02, 150.0)
    found = evidence(nominal(RIG))
    j = RIG.joint_index("tilt")
    low = 0.5 * float(np.quantile(np.abs(found.torque[0][:, j]), 0.5))
    truth = replace(truth, width=low)
    (part,) = found.parts
    tau = part.channels.tau.copy()
    tau[:, j] = inverse(truth, tau[:, j])
    problem = Problem.of(
        replace(found, parts=(part._replace(channels=part.channels._replace(tau=tau)),)),
        reduce_parameters(RIG),
    )
    base = solve_causes(problem, (), solve_causes(problem, ()))
    best = replace(start, width=start.width * low)
    for _ in range(4):
        best = refined(base, best)
    assert isinstance(best, DeadZone) and best.sharpness > 60.0
    assert best.width == pytest.approx(low, rel=0.01)


@pytest.mark.parametrize(
    "cause", [EncoderOffset(RIG.joints[1], 1e-3), BaseTilt(1e-3, 0.0), BaseTilt(0.0, 1e-3)]
)
def test_a_rig_is_changed_within_its_bounds(cause: EncoderOffset | BaseTilt) -> None:
    columns = fitted(nominal(RIG)).columns(cause)
    shape = cause.shapes[0]
    assert columns.lower.tolist() == [shape.lower] and columns.upper.tolist() == [shape.upper]


@pytest.mark.parametrize(
    ("given", "side"), [("", 0), (",side=1", 1), (",side=-1", -1), (",side=0", 0)]
)
def test_the_side_of_a_limit_can_be_planted(given: str, side: int) -> None:
    planted = parse_effect(f"saturation:tilt:limit=0.5{given}", RIG)
    assert planted == Saturation("tilt", 0.5, side)


@pytest.mark.parametrize(("knee", "side"), [(1.5, 0), (2.0, 0), (2.0, 1), (4.0, -1)])
def test_a_soft_limit_is_a_clip_that_begins_early(knee: float, side: int) -> None:
    """Next to nothing is lost of small torques, never more than the limit passes, and the inverse gives it back."""
    soft = Saturation("tilt", 0.5, side, knee)
    clip = Saturation("tilt", 0.5, side)
    x = np.linspace(-5.0, 5.0, 401)
    y = np.asarray(soft.passed(x))
    assert np.all(np.abs(y) <= np.abs(clip.passed(x)) + 1e-15)
    assert np.all(np.diff(y) > 0)
    small = np.abs(x) < 0.02
    np.testing.assert_allclose(y[small], x[small], rtol=0.01)
    if side:
        np.testing.assert_array_equal(y[side * x < 0], x[side * x < 0])
    within = np.abs(y) < 0.49
    np.testing.assert_allclose(
        [soft.command(one) for one in y[within].tolist()], x[within], rtol=1e-9, atol=1e-12
    )
    assert Saturation("tilt", 0.5, side, 20.0).passed(0.2) == pytest.approx(
        clip.passed(0.2), rel=1e-6
    )


def growing(joint: str, stiffness: float, rest: float, growth: float) -> Term:
    """``stiffness growth sinh((q - rest)/growth)``, end by end."""
    ends = stiffness * growth / 2 * np.exp(np.array([-rest, rest]) / growth)
    return Term(CableSpring(joint, growth=growth), tuple(ends.tolist()))


@pytest.mark.parametrize(
    ("stiffness", "rest", "growth"), [(0.3, 0.2, 0.15), (0.05, -0.4, 0.4), (0.8, 0.0, 5.0)]
)
def test_a_pull_that_grows_is_the_hyperbolic_sine_about_its_rest(
    stiffness: float, rest: float, growth: float
) -> None:
    term = growing("tilt", stiffness, rest, growth)
    q = np.linspace(-1.0, 1.0, 41)
    pull = np.asarray(term.torque(Sample(0.0 * q, q, *([0.0 * q] * 4))))
    np.testing.assert_allclose(
        pull, stiffness * growth * np.sinh((q - rest) / growth), rtol=1e-9, atol=1e-12
    )
    assert {p.name: p.value for p in term.effect.shown(term.values)} == pytest.approx(
        {"stiffness": stiffness, "rest": rest, "growth": growth}, abs=1e-9
    )
    assert float(term.torque(Sample(0.0, 0.7, 0.0, 0.0, 0.0, 0.0))) == pytest.approx(
        np.interp(0.7, q, pull), abs=1e-3
    )


def test_a_pull_that_grows_is_found_where_powers_of_the_angle_are_hidden_by_the_weight() -> None:
    joint = RIG.joints[-1]
    state = fitted(Model(RIG, (growing(joint, 0.02, 0.1, 0.12),)))
    seen = state.problem.evidence.seen[RIG.joint_index(joint)]
    found = [
        (worth(state, at := refined(state, one)), at) for one in CableSpring.tried(joint, seen)
    ]
    best = max(found, key=lambda row: row[0])[1]
    assert isinstance(best, CableSpring) and best.growth == pytest.approx(0.12, rel=0.05)


def net(state: State, cause: Cause) -> float:
    """What a cause gains, in units of the noise, less what its parameters gain by luck."""
    return worth(state, cause) - free(cause) * float(np.log(state.problem.evidence.rows))


def slack(joint: str, above: float, below: float, upper: float, lower: float) -> Term:
    """A cable that is taut above one angle and below another; one of no stiffness is not there."""
    taut = 2 if above and below else 1 if above else -1
    values = tuple(x for x in (above, below) if x)
    return Term(
        CableSpring(joint, taut=taut, upper=upper if above else 0.0, lower=lower if below else 0.0),
        values,
    )


@pytest.mark.parametrize(("above", "below"), [(0.3, 0.3), (0.1, 0.4), (0.2, 0.0), (0.0, 0.5)])
def test_a_slack_cable_pulls_in_proportion_once_it_is_taut(above: float, below: float) -> None:
    term = slack("tilt", above, below, 0.4, -0.1)
    q = np.linspace(-1.0, 1.0, 41)
    pull = np.asarray(term.torque(Sample(0.0 * q, q, *([0.0 * q] * 4))))
    np.testing.assert_allclose(
        pull, np.where(q > 0.4, above * (q - 0.4), np.where(q < -0.1, below * (q + 0.1), 0.0))
    )
    for at in (-0.7, 0.1, 0.9):
        alone = float(term.torque(Sample(0.0, at, 0.0, 0.0, 0.0, 0.0)))
        assert alone == pytest.approx(np.interp(at, q, pull), abs=1e-12)
    assert isinstance(term.effect, CableSpring)
    assert term.effect.spring(term.values)[0] == pytest.approx(np.mean(term.values))
    assert {p.name for p in term.effect.shown(term.values)} <= {"stiffness", "upper", "lower"}
    assert ("above" in term.sentence(), "below" in term.sentence()) == (above > 0, below > 0)


@pytest.mark.parametrize(
    ("joint", "above", "below", "upper", "lower"),
    [(-1, 0.05, 0.15, 0.0, -0.3), (1, 0.2, 0.0, 0.1, 0.0)],
)
def test_where_a_cable_comes_taut_is_found(
    joint: int, above: float, below: float, upper: float, lower: float
) -> None:
    term = slack(RIG.joints[joint], above, below, upper, lower)
    state = fitted(Model(RIG, (term,)))
    seen = state.problem.evidence.seen[joint]
    tried = [refined(state, one) for one in CableSpring.tried(term.effect.joint, seen)]
    best = max(tried, key=partial(net, state))
    assert (
        isinstance(best, CableSpring)
        and isinstance(term.effect, CableSpring)
        and best.taut == term.effect.taut
    )
    assert (best.upper, best.lower) == pytest.approx(
        (term.effect.upper, term.effect.lower), abs=0.02
    )
    assert measure(state, best).beta == pytest.approx(term.values, rel=0.1)


@pytest.mark.parametrize("given", ["stiffness=0.02,cubic=0.3", "growth"])
def test_a_spring_that_is_never_slack_is_not_told_as_one_that_is(given: str) -> None:
    joint = RIG.joints[0]
    term = (
        growing(joint, 0.05, 0.1, 0.2)
        if given == "growth"
        else parse_effect(f"cable-spring:{joint}:{given}", RIG)
    )
    assert isinstance(term, Term)
    state = fitted(Model(RIG, (term,)))
    tried = [
        refined(state, one) for one in CableSpring.tried(joint, state.problem.evidence.seen[0])
    ]
    best = max(tried, key=partial(net, state))
    assert isinstance(best, CableSpring) and not best.taut


def test_an_angle_of_either_sign_is_moved_by_radians_and_no_end_of_the_slack_passes_the_other() -> (
    None
):
    cable = CableSpring("tilt", taut=2, upper=0.1, lower=-0.3)
    assert (up := move_shape(cable, "upper", 2.0)) and (down := move_shape(cable, "upper", 0.5))
    assert (
        up.to_dict()["upper"] == pytest.approx(0.1 + np.log(2.0))
        and down.to_dict()["upper"] == -0.3
    )
    assert shape_names(cable) == ["upper", "lower"] and shape_names(CableSpring("tilt")) == []
    assert shape_names(CableSpring("tilt", taut=-1, lower=0.2)) == ["lower"]
