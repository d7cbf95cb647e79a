"""What `track` judges beside the camera on profile S: the thesis's steps, and what a motion asks of the motors."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, nan

import numpy as np
import pytest

from gimbal_pin.control import Experiment, StepMetrics, Tracking, bench_run
from gimbal_pin.dynamics import Model, name_columns, nominal, reduce_parameters
from gimbal_pin.identification import compare_payload, identify
from gimbal_pin.log import Log, Platform, profile_s
from gimbal_pin.pointing import (
    WANTED,
    Contest,
    Demand,
    Followed,
    Pointing,
    Row,
    Sight,
    Sweep,
    jitter,
    shaken_log,
    unbalanced,
)
from gimbal_pin.pointing.demand import least
from gimbal_pin.pointing.sweep import doubtful, heavier
from gimbal_pin.pointing.targets import step_targets
from gimbal_pin.report import text
from gimbal_pin.rig import Rig

JUDGED = "with-friction"

DT = 1e-3


# --- Steps -------------------------------------------------------------------------------------------------------


def metrics(rms: float, overshoot: float, peak: float) -> StepMetrics:
    return StepMetrics(0.3, overshoot, 0.5, 0.0, rms, peak, 0.0)


def test_steps_are_judged_by_their_worst_joint() -> None:
    log = Log("steps", ("a", "b"), np.arange(2.0), np.zeros((2, 2)), tau=np.zeros((2, 2)))

    def ran(name: str, controller: str, a: StepMetrics, b: StepMetrics, cross: float) -> Experiment:
        return Experiment(name, controller, {"a": a, "b": b}, cross, np.zeros((2, 2)), log)

    both = ran("all-axes", JUDGED, metrics(1e-4, 0.01, 1e-3), metrics(2e-4, 0.04, 2e-3), nan)
    one = ran("a", JUDGED, metrics(1e-4, 0.3, 1e-3), metrics(1e-5, nan, 3e-5), 3e-5)
    other = ran("b", "pid-joint", metrics(9e-4, 9.0, 1e-3), metrics(1e-5, nan, 3e-3), 3e-3)
    found = Tracking("rig", None, {"a": 0.5, "b": 0.3}, (both, one, other))
    assert Followed.of(found) == {JUDGED: Followed(2e-4, 0.3, 3e-5), "pid-joint": Followed(9e-4, 9.0, 3e-3)}
    tracking, overshoot, cross = step_targets(found)
    assert (tracking.value, cross.value) == (pytest.approx(degrees(2e-4)), pytest.approx(degrees(3e-5)))
    assert [target.verdict for target in (tracking, overshoot, cross)] == ["must", "missed", "aim"]


# --- What a shaken log teaches -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shaken() -> tuple[Rig, Model, Log]:
    """A rig, its plant, and 12 s of it on a base that is shaken by hand."""
    rig = Rig.load("thesis")
    plant = nominal(unbalanced(rig))
    return rig, plant, shaken_log(plant, seconds=12.0)


def test_a_shaken_log_is_used_as_far_as_it_tells(shaken: tuple[Rig, Model, Log]) -> None:
    """Every deviation is within 1.5 times the bound, by the filter that such a log gets; and none is surely under it.

    Deviations scatter as those of a joint's noise, which its share of the rows' degrees of freedom tells: 1/√(2 ν).
    """
    rig, _, log = shaken
    found = identify(rig, [log], holdout="none", examined="noisy")
    assert found.filtering.cutoff == 12.0 and found.bound is not None
    assert (found.estimate.std < 1.5 * found.bound).all()
    freedom = (found.estimate.rows - len(found.names)) / rig.n
    assert (found.estimate.std > (1 - 3 / np.sqrt(2 * freedom)) * found.bound).all()
    told = text.identified(found, compare_payload(found))
    assert "± at best" in told and "for they are small: " in told
    assert found.to_dict()["least_std"][found.names[0]] == found.bound[0]


def test_a_shaken_log_shows_what_a_base_at_rest_hides(shaken: tuple[Rig, Model, Log]) -> None:
    """The six parameters that only a moving base shows, from 12 s of profile S at half size.

    As a group they are within 10 % of their norm. One by one, 10 % is asked of those alone that such a log shows to a
    twentieth: half of them are near zero on a rig drawn symmetric; all are told to within their own deviations.
    """
    rig, plant, log = shaken
    model = identify(rig, [log], holdout="none").model
    shows, fixed, (_, places) = (
        reduce_parameters(rig, base="rotating"),
        reduce_parameters(rig, base="fixed").mixing,
        name_columns(rig),
    )
    true, found = shows.mixing @ plant.rig.phi[places], shows.mixing @ model.rig.phi[places]
    seen = np.linalg.pinv(fixed) @ fixed
    new = [k for k, row in enumerate(shows.mixing) if np.linalg.norm(row - row @ seen) > 1e-6]
    assert len(new) == 6
    std = model.estimated.std[: len(true)]
    assert np.abs((found - true)[new] / std[new]).max() < 4
    clear = [k for k in new if std[k] < 0.05 * abs(true[k])]
    assert clear and np.abs(found[clear] / true[clear] - 1).max() < 0.1
    change = np.linalg.pinv(shows.mixing) @ (found - true)
    whole = np.linalg.pinv(shows.mixing) @ true
    hidden = np.eye(len(seen)) - seen
    assert np.linalg.norm(hidden @ change) < 0.1 * np.linalg.norm(hidden @ whole)


# --- What a motion asks of the motors ----------------------------------------------------------------------------


def test_holding_the_camera_takes_what_inverse_dynamics_says() -> None:
    """On a platform that leans and falls: gravity on the payload's 5 mm, half of it where half the weight is felt."""
    rig = Rig.load("thesis")
    plant, t = nominal(unbalanced(rig)), 0.01 * np.arange(5)
    leaning = Platform.still(t, pitch=0.2)
    demand = Demand.of(plant, WANTED, leaning)
    q = Sight(rig).reached(
        np.array([[np.cos(0.2), 0, np.sin(0.2)], [0, 1, 0], [-np.sin(0.2), 0, np.cos(0.2)]]), WANTED, np.zeros(3)
    )
    zero = np.zeros((1, 3))
    alone = plant.inverse(q[None], zero, zero, platform=leaning.part(slice(1)))
    np.testing.assert_allclose(demand.tau, np.broadcast_to(alone, (5, 3)), atol=1e-8)
    light = Demand.of(plant, WANTED, replace(leaning, f=leaning.f / 2))
    np.testing.assert_allclose(light.tau, demand.tau / 2, atol=1e-8)
    assert demand.weak == () == demand.moments and demand.within(t).all()
    short = replace(demand, tau_max=np.array([9.0, 9.0, 0.9 * demand.peak["tilt"]]))
    assert short.weak == ("tilt",) and short.moments == ((0.0, pytest.approx(0.04)),) and not short.within(t).any()


def test_jitter_apart_from_the_moments_at_which_a_motor_is_too_weak() -> None:
    """A run that shakes four times as much around two such moments has, apart from them, the jitter of its rest."""
    t, times = DT * np.arange(20000), 0.01 * np.arange(2000)
    beyond = (np.abs(times - 8.0) < 0.055) | (np.abs(times - 8.4) < 0.025) | (np.abs(times - 14.0) < 0.005)
    demand = Demand(("yaw",), times, np.where(beyond, -2.0, 0.5)[:, None], np.ones(1), np.ones((2000, 1)))
    assert np.allclose(demand.moments, [(7.95, 8.42), (14.0, 14.0)])
    fine = demand.within(t)
    assert (~fine).sum() == pytest.approx((2 * (0.1 + 0.6) + 0.47) / DT, abs=4)
    shake = np.where(fine, 1e-5, 4e-5) * np.sin(2 * np.pi * 10 * t)
    error, none = np.stack([0 * t, shake, 0 * t], axis=1), np.zeros((len(t), 1))
    run = Pointing("switch", "log", 0, ("yaw",), t, error, none, none, np.tile([1.0, 0, 0, 0], (len(t), 1)), np.ones(1))
    assert demand.jitter(run) == pytest.approx(1e-5 / np.sqrt(2), rel=0.02)
    assert jitter(run.sight, DT)[0] > 1.5 * demand.jitter(run)
    contest = Contest("rig", None, (Row("switch", (run, run)),))
    assert demand.apart(contest) == {"switch": pytest.approx(demand.jitter(run))}
    told = demand.to_dict(contest)
    assert told["peak"] == {"yaw": 2.0} and told["jitter_rms_deg_within"]["switch"] == pytest.approx(4.05e-4, rel=0.03)
    never = replace(demand, tau=np.full((2000, 1), 2.0))
    assert np.isnan(never.jitter(run)) and never.to_dict(contest)["jitter_rms_deg_within"] == {"switch": None}


def test_no_controller_gets_below_the_least_error_of_a_weak_motor() -> None:
    """Unforeseen, the motor can but push: e = ½ b d t². Foreseen, it is less; twice the torque, twice the error."""
    dt, limit, excess, answer = 0.004, 3.0, 1.5, 2.0
    t = dt * np.arange(150)
    asked = np.where((t >= 0.2) & (t < 0.26), limit + excess, 0.5)
    blind, seeing = (least(dt, asked, limit, np.full(150, answer), first) for first in (50, 0))
    assert np.all(blind[:50] == 0.0)
    pushed = (t >= 0.2) & (t < 0.26)
    np.testing.assert_allclose(blind[pushed], -answer * excess * (t[pushed] - 0.2 + dt) ** 2 / 2, rtol=1e-4)
    # By then it is e = -5.4 mrad and ė = -0.18 rad/s; a push of 2.5 · 2 rad/s² needs ė²/2a = 3.24 mrad more to stop it.
    assert np.abs(blind).max() == pytest.approx(5.4e-3 + 0.18**2 / 2 / (answer * 2.5), rel=0.02)
    assert 0 < np.sum(seeing**2) < 0.2 * np.sum(blind**2)
    twice = least(dt, 2 * asked, 2 * limit, np.full(150, answer), 50)
    np.testing.assert_allclose(twice, 2 * blind, atol=1e-3 * np.abs(blind).max())
    demand = Demand(("yaw",), t, asked[:, None], np.array([limit]), np.full((150, 1), answer))
    counted = replace(demand, t=t + 10.0)
    longer = Demand(
        ("yaw",),
        dt * np.arange(1150),
        np.append(np.full(1000, 0.5), asked)[:, None],
        np.array([limit]),
        np.full((1150, 1), 2.0),
    )
    assert demand.least == counted.least == {"unforeseen": 0.0, "foreseen": 0.0}
    assert longer.least["unforeseen"] == pytest.approx(np.sqrt(np.sum(blind**2) / 650), rel=0.02)
    assert longer.least["foreseen"] < 0.5 * longer.least["unforeseen"]


def test_where_a_pid_becomes_safer() -> None:
    """Between two errors by the chord; at a loop that diverges; nowhere if never worse."""
    sizes = {-0.2: 3e-4, -0.1: 1e-4, 0.0: 1e-4, 0.1: 1.5e-4, 0.2: np.inf}
    found = Sweep(sizes, {}, 2e-4, 3.0)
    assert found.safer == (pytest.approx(-0.15), pytest.approx(0.2))
    assert "-15 % or +20 %" in found.sentence and found.to_dict()["scaled"][-1] == [0.2, None]
    hopeless = replace(found, pid=1e-5)
    assert hopeless.safer == (0.0, 0.0) and hopeless.sentence == "here a PID is safer even with a model that is right"
    calm = replace(found, scaled={-0.2: 1e-4, 0.0: 1e-4, 0.2: 1e-4})
    assert calm.safer == (None, None) and "up to 20 % wrong" in calm.sentence


def test_models_that_are_wrong_on_purpose() -> None:
    """Heavier: as much more torque. The least certain change is of one standard deviation."""
    rig, rng = Rig.load("turret"), np.random.default_rng(0)
    model, t = nominal(rig), 0.01 * np.arange(300)
    zero = np.zeros((4, rig.n))
    bare = replace(model, terms=())
    np.testing.assert_allclose(
        heavier(bare, 0.2).inverse(zero, zero, zero + 1.0), 1.2 * bare.inverse(zero, zero, zero + 1.0), rtol=1e-12
    )
    assert doubtful(model, WANTED, Platform.still(t)) is None and heavier(model, 0.2).terms == model.terms
    log = bench_run(model, rng=rng, seconds=6.0)
    known, moves = identify(rig, [log], holdout="none").model, profile_s(t, rng)
    way, deviation = doubtful(known, WANTED, moves), known.estimated.covariance
    assert way @ np.linalg.solve(deviation, way) == pytest.approx(1.0, rel=1e-6)
