"""Laws of names that stand for a relative outside the library: bristles beside other friction, sags, stops that rub."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from gimbal_pin.diagnosis.relatives import related, rubs, sags, stands_aside
from gimbal_pin.diagnosis.state import Problem, State, solved
from gimbal_pin.effects.base import Sample, Term
from gimbal_pin.effects.cable_spring import CableSpring
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.coulomb import Coulomb
from gimbal_pin.effects.delay import Delay
from gimbal_pin.effects.position_dependent_friction import PositionDependentFriction
from gimbal_pin.effects.presliding import Presliding
from gimbal_pin.effects.saturation import Saturation
from gimbal_pin.model import Model, nominal
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with
from tests.test_forms import ALIGNED, gather, prescribed

RIG = Rig.load("turret")
JOINT = RIG.joints[0]


def state(model: Model, *causes: Cause) -> State:
    """Causes fitted to a log of a model."""
    log = prescribed(model, 3, seconds=14.0, torque_noise=1e-4, dt=2e-3)
    problem = Problem.of(gather(RIG, [log], ALIGNED, {log.name: 0.0}), reduce(RIG))
    return solved(problem, causes, solved(problem, ()))


@dataclass(frozen=True)
class Rubbing(CableSpring):
    """A stop's friction: in proportion to what it pushes back with."""

    dry: ClassVar[bool] = True

    def basis(self, at: Sample) -> tuple[float | np.ndarray, ...]:
        return tuple(np.abs(push) * at.slide for push in super().basis(at))


def test_planted_bristles_are_the_joints_dry_friction() -> None:
    plant = plant_with(nominal(RIG), [Term(Presliding(JOINT, 0.02), (0.1,))]).plant
    coulomb = {t.effect.joint: t.values[0] for t in plant.terms if isinstance(t.effect, Coulomb)}
    before = {t.effect.joint: t.values[0] for t in nominal(RIG).terms if isinstance(t.effect, Coulomb)}
    assert coulomb == {**before, JOINT: 0.0} and before[JOINT] > 0
    assert (
        plant_with(nominal(RIG), [Term(Presliding(JOINT, 0.02), (0.0,))]).plant.terms[: 2 * RIG.n] == nominal(RIG).terms
    )


@pytest.mark.parametrize(("coulomb", "aside"), [(0.0, False), (0.1, True)])
def test_bristles_beside_friction_that_does_not_bend_are_none(coulomb: float, aside: bool) -> None:
    """A cable with hysteresis bends beside the bearing's dry friction; bristles are that friction."""
    bristles = Presliding(JOINT, 0.05)
    plant = plant_with(nominal(RIG), [Term(bristles, (0.15,)), Term(Coulomb(JOINT), (coulomb,))]).plant
    found = state(plant, bristles)
    assert found.coefficients(found.causes[0])[0] == pytest.approx(0.15, rel=0.02)
    assert related(found, found.causes[0]) == stands_aside(found, found.causes[0]) == aside


def test_bristles_that_slide_all_the_time_may_stand_beside_others_that_are_shorter() -> None:
    bristles = Presliding(JOINT, 1e-3)
    plant = plant_with(nominal(RIG), [Term(bristles, (0.15,)), Term(Coulomb(JOINT), (0.1,))]).plant
    found = state(plant, bristles)
    assert not related(found, found.causes[0])


def test_a_limit_that_falls_with_the_rate_is_a_supply_that_gives_out() -> None:
    """``±limit (1 ∓ v/v₀)`` beside ``±limit``: the slope by ``-limit/v₀`` is the rate where the limit bites."""
    command, rate, least = np.linspace(-3.0, 3.0, 61), np.linspace(0.5, -0.4, 61), 1e-3
    for side in (0, 1, -1):
        limit = Saturation(JOINT, 1.05, side)
        reach = [limit.limit + least * rate, -limit.limit + least * rate]
        slower = np.clip(command, -np.inf if side > 0 else reach[1], np.inf if side < 0 else reach[0])
        np.testing.assert_allclose((slower - limit.passed(command)) / least, limit.sagging(command, rate), atol=1e-9)
    assert not np.any(Delay(JOINT, 0.01).sagging(command, rate))


@pytest.mark.parametrize("slope", [0.0, 3.0])
def test_what_a_sagging_limit_leaves_gives_it_away(slope: float) -> None:
    model = nominal(RIG)
    peak = state(model, Delay(JOINT, 1e-4)).problem.evidence.seen[0].peak
    found = state(model, Saturation(JOINT, 0.8 * peak))
    evidence, now = found.problem.evidence, found.fit
    channels = [part.channels for part in evidence.parts]
    beside = np.zeros((evidence.rows, RIG.n, 1))
    beside[:, 0, 0] = evidence.whiten([found.causes[0].sagging(c.tau[:, 0], c.v[:, 0]) for c in channels], 0)
    more = now.stacked(beside)[:, 0]
    more -= now.basis @ (now.basis.T @ more)
    more /= np.linalg.norm(more)
    more *= slope * np.linalg.norm(now.residual) - more @ now.residual
    there = replace(found, fit=replace(now, target=now.target + more, residual=now.residual + more))
    assert now.dispersion[0] > 4.0
    assert sags(there, there.causes[0]) == related(there, there.causes[0]) == (slope > 0)


CABLE = CableSpring(JOINT, taut=1, upper=0.1)
UNEVEN = PositionDependentFriction(JOINT, (1.0, 3.0))


@pytest.mark.parametrize("mu", [0.1, 0.6])
def test_friction_that_begins_where_a_cable_comes_taut_is_a_stops(mu: float) -> None:
    """Neither of the two names is then true, and one of them alone says nothing of the other."""
    plant = replace(
        nominal(RIG),
        terms=(*nominal(RIG).terms, Term(CABLE, (2.0,)), Term(Rubbing(JOINT, taut=1, upper=0.1), (2.0 * mu,))),
    )
    found = state(plant, CABLE, UNEVEN)
    assert found.coefficients(found.causes[0])[0] == pytest.approx(2.0, rel=0.2)
    assert all(related(found, cause) for cause in found.causes)
    assert rubs(state(plant, CABLE), CABLE)


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize(
    "form", [{"taut": 2, "upper": 0.2, "lower": -0.1}, {"taut": -1, "lower": -0.1}, {"growth": 0.2}]
)
def test_a_cables_pull_without_friction_in_proportion_to_it_is_a_cables(form: dict[str, float], mu: float) -> None:
    """Whatever its form, and whether or not any other friction was found beside it."""
    cable, stop = CableSpring(JOINT, **form), Rubbing(JOINT, **form)  # type: ignore[arg-type]
    values = (1.0, 0.8)[: len(cable.coefficients)]
    terms = (*nominal(RIG).terms, Term(cable, values), Term(stop, tuple(mu * x for x in values)))
    assert rubs(state(replace(nominal(RIG), terms=terms), cable), cable) == (mu > 0)


@pytest.mark.parametrize("harmonic", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_cable_beside_a_bearing_that_is_tight_somewhere_is_one(harmonic: float, sign: float) -> None:
    tight = PositionDependentFriction(JOINT, (harmonic,))
    values: Sequence[float] = (0.03 * sign, 0.03)
    plant = replace(nominal(RIG), terms=(*nominal(RIG).terms, Term(CABLE, (2.0,)), Term(tight, tuple(values))))
    found = state(plant, CABLE, tight)
    assert not any(related(found, cause) for cause in found.causes)
