"""Laws of sizes: what is not known to two deviations is bounded, and friction is physical."""

from __future__ import annotations

import re
from dataclasses import replace
from math import pi

import numpy as np
import pytest

from gimbal_pin.diagnosis import Diagnosis, describe_friction, diagnose
from gimbal_pin.dynamics import Model, nominal
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.report import show_diagnosis, tables
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.control.test_compensation import with_causes

INTERVAL = re.compile(r"([-−]?[\d.]+(?:e[-+]\d+)?) ± ([\d.]+(?:e[-+]\d+)?)")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def found(rig: Rig) -> Diagnosis:
    model = with_causes(rig, "cogging:tilt:amplitude=0.05,harmonic=11")
    few = {name: CAUSES[name] for name in ("cogging", "stribeck")}
    return diagnose(rig, [prescribed(model, seconds=12.0, torque_noise=0.01, dt=4e-3)], few)


@pytest.mark.parametrize(
    ("value", "lower"), [(-1.0, -np.inf), (0.24, 0.0), (1e-3, 0.0), (-30.0, -np.inf)]
)
@pytest.mark.parametrize("ratio", [0.1, 0.4, 0.6, 70.0])
def test_a_size_has_an_interval_or_a_bound(value: float, lower: float, ratio: float) -> None:
    """The bound holds the whole interval; an interval never holds zero."""
    size = Parameter("level", value, "N m", lower, std=ratio * abs(value))
    assert size.is_known == (2 * ratio < 1)
    for text in (size.describe(), tables.state_size(size)):
        assert (INTERVAL.search(text) is not None) == size.is_known and "N m" in text
    if not size.is_known:
        bound = float(re.findall(r"[\d.]+(?:e[-+]\d+)?", size.describe())[-1])
        assert bound == pytest.approx(abs(value) * (1 + 1.96 * ratio), rel=0.06)


def test_a_phase_near_zero_is_known_and_one_of_the_whole_circle_is_not() -> None:
    near, far = (Parameter("phase", 0.01, "rad", -pi, pi, std=std) for std in (0.05, 2.0))
    assert near.is_known and not far.is_known and "±" not in far.describe()


@pytest.mark.parametrize("joint", ["pan", "tilt"])
def test_no_page_states_an_interval_that_holds_zero(found: Diagnosis, joint: str) -> None:
    """Whatever the deviations of a finding's sizes are, only bounds are stated of those that are not known."""
    (finding,) = found.findings
    sizes = [
        Parameter("coulomb", -1.0, "N m", std=70.0),
        Parameter("span", 1194.0, "s", 0.0, std=9e4),
    ]
    vague = replace(
        finding,
        joint=joint,
        cause="friction-drift",
        parameters=tuple(sizes),
        sentence=f"{joint}: it",
    )
    told = replace(found, findings=(vague,))
    text = show_diagnosis(told).to_text()
    assert "coulomb" in text and "span" in text
    assert not any(
        float(half) > abs(float(value.replace("−", "-")))
        for value, half in INTERVAL.findall(heads(text))
    )
    assert not any(one["is_known"] for one in told.to_dict()["findings"][0]["parameters"].values())


def heads(text: str) -> str:
    """Return what is said of findings, without the table of notes."""
    return text.split("What is left")[0]


@pytest.mark.parametrize(
    ("coulomb", "viscous", "stated"),
    [
        ((0.02, 1e-3), (0.01, 1e-3), "0.02"),
        ((-4.8, 0.1), (128.0, 1.0), ""),
        ((0.02, 1e-3), (-1e-4, 1e-3), "0.02"),
    ],
)
def test_friction_that_is_told_is_positive_and_known(
    rig: Rig,
    found: Diagnosis,
    coulomb: tuple[float, float],
    viscous: tuple[float, float],
    stated: str,
) -> None:
    """Of rigs without stated friction: a negative coefficient leaves its joint out, an unknown one itself."""
    bare = replace(rig, friction=np.zeros_like(rig.friction))
    known = found.before.estimated
    assert known is not None
    theta = known.theta.copy()
    std = known.std
    rows = {name: k for k, name in enumerate(known.names)}
    covariance = np.diag(std**2)
    places = [rows[name] for name in rows if name.startswith("tilt.")]
    for place, (value, deviation) in zip(places, (coulomb, viscous), strict=True):
        theta[place], covariance[place, place] = value, deviation**2
    model = Model(bare, found.before.terms, replace(known, theta=theta, covariance=covariance))
    said = " ".join(describe_friction(model, ()))
    assert ("tilt" in said) == bool(stated) and stated in said
    assert all(float(value) > float(half) for value, half in INTERVAL.findall(said))
    assert "tilt" not in " ".join(describe_friction(model, ("tilt",)))


def test_the_refitted_friction_is_told_with_intervals(rig: Rig) -> None:
    bare = replace(rig, friction=np.zeros_like(rig.friction))
    found = diagnose(bare, [prescribed(nominal(rig), seconds=12.0, torque_noise=0.01, dt=4e-3)], {})
    (said,) = (note for note in found.notes if "no friction" in note)
    values = [float(value) for value, _ in INTERVAL.findall(said)]
    known = found.before.estimated
    assert known is not None and values
    for value in values:
        assert np.any(np.isclose(known.theta, value, rtol=0.01)) and value > 0
