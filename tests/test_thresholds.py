"""Laws of drives that pass nothing up to a threshold and all beyond it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from gimbal_pin.control import ComputedTorque, Pid
from gimbal_pin.diagnosis.contenders import signs_only, untaken
from gimbal_pin.diagnosis.edges import away, decided
from gimbal_pin.diagnosis.evidence import gather
from gimbal_pin.diagnosis.library import Library
from gimbal_pin.diagnosis.restart import edged
from gimbal_pin.diagnosis.score import NOTHING
from gimbal_pin.diagnosis.search import needed, polished, variants
from gimbal_pin.diagnosis.shapes import otherwise, refined, worth
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.effects.actuator_lag import ActuatorLag
from gimbal_pin.effects.cogging import Cogging
from gimbal_pin.effects.dead_zone import APART, DeadZone
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.saturation import Saturation
from gimbal_pin.effects.signal import Static
from gimbal_pin.model import nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import Sensors, simulate
from tests.bench_logs import fourier
from tests.test_forms import BAND, SEEN

RIG = Rig.load("turret")
DT = 2e-3


@cache
def looped(*drive: Static, seed: int = 2) -> State:
    """The refitted model without any cause, on a log of a closed loop whose drive that is."""
    model = nominal(RIG)
    law = ComputedTorque(model, (Pid.placed(6.0, 1.0, 0.2),) * RIG.n, DT, lead=1.5 * DT)
    sense = Sensors(np.full(RIG.n, 2 * np.pi / 2**18), np.full(RIG.n, 2e-3), np.zeros(RIG.n))
    log = simulate(
        model, law, fourier(RIG, seed, 14.0, DT), rng=np.random.default_rng(seed), sensors=sense, drive=drive
    )
    problem = Problem.of(gather(RIG, [log], BAND, {log.name: 0.0}), reduce(RIG))
    return solved(problem, (), solved(problem, ()))


def test_what_comes_to_the_samples_as_the_torque_did_is_the_torque() -> None:
    for part in looped().problem.evidence.parts:
        assert part.logged is not None
        for j, tau in enumerate(part.channels.tau.T):
            np.testing.assert_allclose(part.logged.smoothed(part.logged.tau[:, j]), tau, atol=1e-12)
            np.testing.assert_allclose(part.acted(DeadZone(RIG.joints[j], 1e-12, whole=True), tau, j, None), tau)


@pytest.mark.parametrize(("joint", "width", "seed"), [(0, 0.12, 2), (0, 0.2, 5), (1, 0.12, 4), (1, 0.06, 8)])
def test_a_threshold_is_found_where_it_is_though_the_command_crosses_it_all_the_time(
    joint: int, width: float, seed: int
) -> None:
    """No edge of a smoothed torque, however sharp, explains as much; from such an edge the search goes on to it."""
    place = RIG.joints[joint]
    state = looped(DeadZone(place, width, whole=True), seed=seed)
    edge = max((refined(state, DeadZone(place, x * width, 12.0)) for x in (0.83, 1.07)), key=lambda c: worth(state, c))
    best = max(variants(state, edge, Library(state.problem, ())), key=lambda row: row[0].gain)[1]
    assert isinstance(best, DeadZone) and best.whole and best.width == pytest.approx(width, rel=0.02)
    assert worth(state, best) > worth(state, edge)
    after, mended = (solved(state.problem, (cause,), state).fit.dispersion[joint] for cause in (best, edge))
    assert after < mended / 2


@pytest.mark.parametrize("off", [0.85, 1.1])
def test_a_threshold_is_found_from_an_edge_that_is_far_from_it(off: float) -> None:
    """It need not lie where the edge loses half, only somewhere in it."""
    state, edge = looped(DeadZone(RIG.joints[0], 0.12, whole=True)), DeadZone(RIG.joints[0], off * 0.12, 5.0)
    (found,) = otherwise(state, edge)
    assert isinstance(found, DeadZone) and found.whole and found.width == pytest.approx(0.12, rel=0.02)


def test_thresholds_are_tried_all_through_an_edge() -> None:
    zone, edge = DeadZone("pan", 0.1, whole=True), DeadZone("pan", 0.1, 6.0)
    widths = np.array([one.width for one in edge.akin(SEEN) if isinstance(one, DeadZone) and one.whole])
    np.testing.assert_allclose(edge.passed(widths[[0, -1]]) / widths[[0, -1]], [0.2, 0.8])
    assert np.max(widths[1:] / widths[:-1]) <= APART * (1 + 1e-9)
    assert not any(one.akin(SEEN) for one in (zone, DeadZone("pan", 0.1), Cogging("pan", (3.0,))))


def test_a_threshold_passes_nothing_or_all() -> None:
    zone = DeadZone("pan", 0.1, whole=True)
    x = np.linspace(-1.0, 1.0, 401)
    np.testing.assert_array_equal(zone.passed(x), np.where(np.abs(x) > 0.1, x, 0.0))
    assert [zone.passed(float(one)) for one in x] == zone.passed(x).tolist()
    assert zone.passed(zone.command(0.5)) == pytest.approx(0.5) and zone.command(0.0) == 0.0


def test_a_threshold_is_judged_where_its_edge_is_far() -> None:
    """The gate is shut where commands linger within the sensor's noise of the edge, and nowhere else."""
    before = looped(DeadZone(RIG.joints[0], 0.12, whole=True))
    none, zone = DeadZone(RIG.joints[0], 1e3, whole=True), DeadZone(RIG.joints[0], 0.12, whole=True)
    whole, now = decided(before, before, none), before.fit.dispersion[0]
    assert whole is not None and whole == pytest.approx((now, now), rel=0.05)
    assert decided(before, before, DeadZone(RIG.joints[0], 0.12)) is None
    part, band = before.problem.evidence.parts[0], before.problem.evidence.band
    assert part.logged is not None
    noisy = np.random.default_rng(0).normal(0.0, 0.03, part.logged.tau.shape)
    shut = away(part._replace(logged=part.logged._replace(tau=part.logged.tau + noisy)), zone, 0, band)
    near = np.abs(np.abs(part.channels.tau[:, 0]) - 0.12)
    closed = (shut.gate[:, 0] < 0.5) & (part.gate[:, 0] > 0.5)
    assert np.median(near[closed]) < np.median(near[~closed])
    np.testing.assert_array_equal(shut.gate[:, 1:], part.gate[:, 1:])
    assert np.all(shut.gate <= part.gate)


def test_a_threshold_stands_in_for_what_took_of_its_edge() -> None:
    """Judged where its edge is clear it explains nearly all; what a search had in its place is no more a start."""
    place, width = RIG.joints[0], 0.12
    first = looped(DeadZone(place, width, whole=True))
    shelf = Library(first.problem, [DeadZone(place, width, 12.0), Cogging(place, (3.0,))])
    others = solved(first.problem, (Cogging(place, (3.0,)), ActuatorLag(place, 0.01)), first)
    found = edged(first, others, 0, shelf)
    assert found is not None and len(found.causes) == 1
    (zone,) = found.causes
    assert isinstance(zone, DeadZone) and zone.whole and zone.width == pytest.approx(width, rel=0.02)
    assert edged(first, found, 0, shelf) is None, "it is there already"
    assert edged(looped(), looped(), 0, Library(looped().problem, shelf.causes)) is None, "a drive without one has none"


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_a_limit_that_bites_most_of_the_time_is_one_where_the_motion_follows_it(share: float) -> None:
    """Commands far beyond it move the rig's own masses by it; by another, bodies would have to be lighter."""
    place, torque = RIG.joints[0], np.concatenate(looped().problem.evidence.torque)[:, 0]
    limit = Saturation(place, share * float(np.sqrt(np.mean(torque**2))))
    state = looped(limit)
    assert np.mean(limit.biting(np.concatenate(state.acting)[:, 0])) > 0.9
    assert not signs_only(state, NOTHING, limit)
    assert signs_only(state, NOTHING, Saturation(place, 0.3 * limit.limit))


def test_only_what_can_enter_is_asked_for() -> None:
    place = RIG.joints[0]
    zone, other, tooth = DeadZone(place, 0.1), DeadZone(place, 0.2, 4.0), Cogging(place, (7.0,))
    state = solved(looped().problem, (zone, Cogging(place, (3.0,))), looped())
    columns = [state.columns(one) for one in (other, tooth, DeadZone(RIG.joints[1], 0.2))]
    assert untaken(state, columns) == columns[1:]


def test_a_lag_that_mends_what_a_delay_is_off_is_left_out_and_what_is_there_is_not() -> None:
    place, late = RIG.joints[0], 0.012
    torque = np.concatenate(looped().problem.evidence.torque)[:, 0]
    limit = Saturation(place, 0.8 * float(np.max(np.abs(torque))))
    before = looped(limit, Delay(place, late))
    mended = (limit, Delay(place, late - 6e-4), ActuatorLag(place, 6e-4))
    found = needed(solved(before.problem, mended, before))
    assert {cause.name for cause in found.causes} == {"saturation", "delay"}
    delay = next(cause for cause in found.causes if isinstance(cause, Delay))
    assert delay.late(DT) == pytest.approx(late, rel=0.03)


@pytest.mark.parametrize("way", [1, -1])
def test_a_limit_behind_a_gap_is_another_than_before_it(way: int) -> None:
    """Begun the wrong way round, refined to what they are in the order in which they are."""
    place = RIG.joints[0]
    peak = float(np.max(np.abs(np.concatenate(looped().problem.evidence.torque)[:, 0])))
    drive = (DeadZone(place, 0.06 * peak), Saturation(place, 0.8 * peak))[::way]
    before = looped(*drive)
    state = polished(solved(before.problem, drive[::-1], before))
    assert [cause.name for cause in state.causes] == [cause.name for cause in drive]
    limit = next(cause for cause in state.causes if isinstance(cause, Saturation))
    zone = next(cause for cause in state.causes if isinstance(cause, DeadZone))
    assert limit.limit == pytest.approx(0.8 * peak, rel=0.01) and zone.width == pytest.approx(0.06 * peak, rel=0.03)
