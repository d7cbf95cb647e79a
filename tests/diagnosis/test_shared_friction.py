"""Laws of friction that varies over part of a turn: how its formula shares it with Coulomb friction is no matter."""

from __future__ import annotations

import numpy as np
import pytest

from gimbal_pin.diagnosis import Fit, fit, gained
from gimbal_pin.effects import Cogging, Coulomb, PositionDependentFriction, Term
from gimbal_pin.log import Array
from tests.candidates import measure
from tests.diagnosis.test_score import column
from tests.refitted import RIG, first

AT = RIG.joints[1]


def straight(columns: Array, target: Array) -> Fit:
    """A fit of some columns, (rows, c), to a target, (rows,), in forty blocks."""
    rows = len(target)
    return fit(
        columns[:, None], target[:, None], np.ones(1), np.floor(np.arange(rows) * 40.0 / rows)
    )


def small_turn() -> tuple[Array, Array, Array]:
    """Angle, rate and direction of a joint that turns by less than a radian to either side."""
    t = np.linspace(0.0, 60.0, 4000)
    return 0.8 * np.sin(t), 0.8 * np.cos(t), np.sign(np.cos(t))


@pytest.mark.parametrize("held", [10.0, -15.0])
def test_friction_over_the_angle_gains_the_same_however_much_coulomb_friction_it_holds(
    held: float,
) -> None:
    q, v, slide = small_turn()
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(q))
    now = straight(np.stack([slide, v], axis=1), slide * (0.3 + 0.1 * np.cos(6 * q)) + noise)

    def gain(more: float, shared: Array | None) -> float:
        own = (slide * (np.cos(6 * q) + more))[:, None]
        return gained(now, column(own, shared=shared), False).gain

    assert gain(held, slide) == pytest.approx(gain(0.0, slide)) == pytest.approx(gain(0.0, None))
    assert gain(held, None) == 0.0, "a torque of its own of that size works but against the model"


def test_only_friction_shares_with_friction() -> None:
    state = first()
    friction, teeth = (
        state.columns(kind(AT, (3.0,))) for kind in (PositionDependentFriction, Cogging)
    )
    assert teeth.shared is None and friction.shared is not None
    np.testing.assert_allclose(friction.shared, state.columns(Coulomb(AT)).own[:, 0], atol=1e-12)


def test_a_wave_of_friction_may_be_larger_than_the_torque() -> None:
    """A cosine of seven times the largest torque, about its top, beside Coulomb friction as large against it."""
    wave = PositionDependentFriction(AT, (1.0,))
    large = 40.0
    q = np.concatenate([part.channels.q[:, 1] for part in first().problem.evidence.parts])
    top = (np.max(q) + np.min(q)) / 2
    values = (-large * float(np.cos(top)), -large * float(np.sin(top)))
    state = first(Term(wave, values), Term(Coulomb(AT), (large + 0.1,)))
    found = measure(state, wave)
    assert large > 6 * state.problem.evidence.seen[1].peak
    assert found.gain > 0 and found.beta == pytest.approx(values, rel=0.02)
