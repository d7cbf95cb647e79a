"""Laws of a rehearsal: logs show what it says they show, from the size that it says on, and nothing much smaller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Diagnosis, Rehearsal, Rehearsed, diagnose, rehearse
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, Cause, Term, parse_effect
from gimbal_pin.log import Log, Motion, write_motion
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.command_line import Run, refused, result

DT, SECONDS, NOISE = 0.005, 20.0, 0.01
NAMES = "torque-bias asymmetric-friction cable-spring quadratic-drag stribeck friction-drift encoder-offset dead-zone"
KINDS: Mapping[str, type[Cause]] = {name: CAUSES[name] for name in NAMES.split()}


@cache
def rig() -> Rig:
    return Rig.load("turret")


@cache
def motion() -> Motion:
    return fourier(rig(), 3, SECONDS, DT)


@cache
def rehearsed(noise: float = NOISE) -> Rehearsal:
    return rehearse(rig(), motion(), KINDS, torque_noise=noise, rng=0)


def row(found: Rehearsal, cause: str, joint: str | None = "pan") -> Rehearsed:
    return next(one for one in found.causes if (one.cause, one.joint) == (cause, joint))


def said(effect: str, factor: float, seed: int) -> Diagnosis:
    """What a log says of a rig with a cause of so many times the size."""
    term = parse_effect(effect, rig())
    m = motion()
    rng = np.random.default_rng(seed)
    assert isinstance(term, Term)
    larger = replace(term, values=tuple(factor * x for x in term.values))
    tau = plant_with(nominal(rig()), [larger]).plant.inverse(m.q, m.v, m.a, t=m.t)
    tau = tau + NOISE * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    log = Log("log", rig().joints, m.t, m.q, m.v + 1e-4 * rng.standard_normal(m.q.shape), tau)
    return diagnose(rig(), [log], KINDS, rng=1, filtering=replace(DIAGNOSIS_BAND, alignment=0.0))


@pytest.mark.parametrize("cause", ["friction-drift", "quadratic-drag", "cable-spring", "stribeck"])
def test_a_log_shows_twice_what_is_told_and_not_a_third_of_it(cause: str) -> None:
    told = row(rehearsed(), cause)
    assert told.seen_from is not None
    assert [cause in found.alike for found in said(told.seen_from.effect, 2.0, 1).findings] == [
        True
    ]
    assert [found.cause for found in said(told.seen_from.effect, 1 / 3, 2).findings] == []


def test_a_cause_alone_is_named_from_the_size_that_is_told() -> None:
    told = row(rehearsed(), "quadratic-drag").named_from
    assert told is not None
    assert [found.alike for found in said(told.effect, 1.5, 4).findings] == [("quadratic-drag",)]


def test_what_a_log_cannot_tell_apart_is_said_beforehand() -> None:
    """A constant torque and friction that differs by direction: found, and never told apart, as is promised."""
    told = row(rehearsed(), "asymmetric-friction")
    assert told.seen_from is not None and told.named_from is None
    assert "torque-bias" in [one.cause for one in told.confused_with]
    (found,) = said(told.seen_from.effect, 2.0, 3).findings
    assert found.status == "ambiguous" and {"asymmetric-friction", "torque-bias"} <= set(
        found.alike
    )


def test_an_upright_axis_hides_where_its_encoder_has_its_zero() -> None:
    told = row(rehearsed(), "encoder-offset")
    assert (told.seen_from, told.shown, told.why) == (None, 0, CAUSES["encoder-offset"].hidden)


def test_a_slow_motion_hides_what_grows_with_the_rate() -> None:
    """At 1/200 of the rate drag is 1/2800 or less: to show, it would have to stop the motor below its limit of rate."""
    m = motion()
    slow = Motion(10 * m.t, m.q / 20, m.v / 200, m.a / 2000)
    kinds = {"quadratic-drag": CAUSES["quadratic-drag"], "torque-bias": CAUSES["torque-bias"]}
    found = rehearse(rig(), slow, kinds, rng=0)
    assert row(found, "torque-bias").seen_from is not None
    told = row(found, "quadratic-drag")
    assert told.seen_from is None and told.why is not None and "limits" in told.why


def test_noise_hides_in_proportion() -> None:
    """Where noise and not an error of form is what hides a cause, twice the noise hides one twice as large."""
    for cause in ("stribeck", "torque-bias"):
        less, more = (row(rehearsed(noise), cause).seen_from for noise in (0.05, 0.1))
        assert less is not None and more is not None
        assert 1.6 < more.share_of_torque / less.share_of_torque < 2.5


@pytest.mark.parametrize("name", ["turret", "thesis"])
def test_every_size_is_an_effect_that_simulate_plants(name: str) -> None:
    planted_on = Rig.load(name)
    found = rehearse(planted_on, fourier(planted_on, 1, 15.0, DT), rng=0)
    sizes = [
        (one, size)
        for one in found.causes
        for size in (one.seen_from, one.named_from)
        if size is not None
    ]
    assert len({one.cause for one, _ in sizes}) > 12
    for one, size in sizes:
        parse_effect(size.effect, planted_on)
        assert 0 < size.share_of_torque <= 1 and one.forms >= one.shown > 0 and one.why is None


def test_the_command_line_tells_what_simulated_logs_show(run: Run, tmp_path: Path) -> None:
    """A joint that the motion holds shows nothing; what is planted at twice the size told is found in a log of it."""
    path = tmp_path / "motion.csv"
    log = tmp_path / "log.csv"
    still = fourier(rig(), 3, 16.0)
    only = np.array([1.0, 0.0])
    write_motion(
        replace(still, q=still.q * only, v=still.v * only, a=still.a * only), rig().joints, path
    )
    found = result(run, "rehearse", "turret", path)
    held = {one["why"] for one in found["causes"] if one["joint"] == "tilt"}
    assert held == {"the motion holds the joint still"}
    (bias,) = (
        one["seen_from"]
        for one in found["causes"]
        if (one["cause"], one["joint"]) == ("torque-bias", "pan")
    )
    assert bias["effect"].startswith("torque-bias:pan:bias=") and (
        bias["parameter"],
        bias["unit"],
    ) == ("bias", "N m")
    effect = f"torque-bias:pan:bias={2 * bias['value']}"
    assert run("simulate", "turret", "--reference", path, "--effect", effect, "-o", log)[0] == 0
    (seen,) = result(run, "diagnose", "turret", log)["findings"]
    assert "torque-bias" in seen["class"] and seen["joint"] == "pan"
    refused(run("rehearse", "turret", tmp_path / "none.csv"), 2, "none.csv")
