"""Laws of a rehearsal: logs show what it says they show, from the size that it says on, and nothing much smaller."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin.diagnosis import Diagnosis, Rehearsal, Rehearsed, diagnose, rehearse
from gimbal_pin.effects import CAUSES, Term, parse_effect
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.diagnosis.cases import DT, few
from tests.refitted import ALIGNED, RIG, plant, record

KINDS = few(
    "torque-bias",
    "asymmetric-friction",
    "cable-spring",
    "quadratic-drag",
    "friction-drift",
    "encoder-offset",
)
MOTION = fourier(RIG, 3, 16.0, DT)


@cache
def rehearsed(noise: float = 0.01) -> Rehearsal:
    return rehearse(RIG, MOTION, KINDS, torque_noise=noise, rng=0)


def row(found: Rehearsal, cause: str) -> Rehearsed:
    (one,) = (one for one in found.causes if (one.cause, one.joint) == (cause, "pan"))
    return one


def said(effect: str, factor: float) -> Diagnosis:
    """What a log of the motion says of a rig with a cause of so many times the size, of the same noise."""
    term = parse_effect(effect, RIG)
    assert isinstance(term, Term)
    larger = replace(term, values=tuple(factor * x for x in term.values))
    log = record(plant(larger), 3, 16.0, 0.0, DT)
    tau = np.asarray(log.tau)
    rng = np.random.default_rng(1)
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    v = np.asarray(log.v) + 1e-4 * rng.standard_normal(tau.shape)
    return diagnose(RIG, replace(log, v=v, tau=tau), KINDS, filtering=ALIGNED)


@pytest.mark.parametrize("cause", ["friction-drift", "quadratic-drag", "cable-spring"])
def test_a_log_shows_twice_what_is_told_and_not_a_third_of_it(cause: str) -> None:
    told = row(rehearsed(), cause).seen_from
    assert told is not None
    assert [cause in one.alike for one in said(told.effect, 2.0).findings] == [True]
    assert [one.cause for one in said(told.effect, 1 / 3).findings] == []


def test_a_cause_alone_is_named_from_the_size_that_is_told() -> None:
    told = row(rehearsed(), "quadratic-drag").named_from
    assert told is not None
    assert [one.alike for one in said(told.effect, 1.5).findings] == [("quadratic-drag",)]


def test_what_a_log_cannot_tell_apart_or_show_is_said_beforehand() -> None:
    """A constant torque is friction that differs by direction; an upright axis hides where its encoder has its zero."""
    told = row(rehearsed(), "asymmetric-friction")
    assert told.seen_from is not None and told.named_from is None
    assert "torque-bias" in [one.cause for one in told.confused_with]
    hidden = row(rehearsed(), "encoder-offset")
    assert (hidden.seen_from, hidden.shown) == (None, 0)
    assert hidden.why == CAUSES["encoder-offset"].hidden


def test_noise_hides_in_proportion() -> None:
    """Where noise and not an error of form is what hides a cause, twice the noise hides one twice as large."""
    less, more = (row(rehearsed(noise), "torque-bias").seen_from for noise in (0.05, 0.1))
    assert less is not None and more is not None
    assert 1.6 < more.share_of_torque / less.share_of_torque < 2.5


def test_every_size_is_an_effect_that_simulate_plants() -> None:
    rig = Rig.load("thesis")
    found = rehearse(rig, fourier(rig, 1, 10.0, DT), rng=0)
    shown = [one for one in found.causes if one.seen_from is not None]
    assert len({one.cause for one in shown}) > 12
    for one in shown:
        for size in (one.seen_from, one.named_from):
            if size is not None:
                parse_effect(size.effect, rig)
                assert 0 < size.share_of_torque <= 1
        assert one.forms >= one.shown > 0 and one.why is None
