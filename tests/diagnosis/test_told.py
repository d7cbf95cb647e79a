"""Laws of what is told of findings: what else they may be, what is only roughly known, what the noise may hide."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from gimbal_pin.checks import CHECKS
from gimbal_pin.diagnosis import Diagnosis, Finding, Residual, Rival, is_size_known, measure_gain, overall, solved
from gimbal_pin.effects import CAUSES, Cause, Cogging, FrictionDrift, Term, TorqueRipple
from gimbal_pin.report import text
from gimbal_pin.rig import Rig
from tests.command_line import Run
from tests.diagnosis.test_forms import SEEN
from tests.refitted import RIG, first


def test_the_help_lists_every_cause(run: Run) -> None:
    said = run("diagnose", "--help")[1]
    assert {*CAUSES, *CHECKS, "platform-motion"} <= set(re.findall(r"[a-z]+(?:-[a-z]+)*", said))


def test_a_rival_that_is_worse_and_alike_has_its_reason() -> None:
    rivals = (Rival("actuator-lag", 40.0, 4.9), Rival("armature", 80.0, 9.0), Rival("cogging", 3.0, 1.0))
    gain = {"torque_rmse_before": 1.0, "torque_rmse_after": 0.5, "rollout_rmse_before": 1.0, "rollout_rmse_after": 0.5}
    alike = ("delay", "actuator-lag", "cogging")
    found = Finding("delay", "pan", "ambiguous", alike, (), gain, 0.001, 1.0, 0.5, 1.0, rivals, "pan: delay", "a chirp")
    one, other = found.open.split("; ")
    assert one == "this log cannot tell it from cogging" and "armature" not in other
    assert other.startswith("not ruled out, though less well") and other.endswith(
        ": actuator-lag (4.9 standard deviations)"
    )
    assert f"  {found.open}; try a chirp" in text.about_finding(found)
    assert replace(found, rivals=rivals[2:]).open == "this log cannot tell it from actuator-lag, cogging"
    assert not replace(found, alike=("delay",)).open


@pytest.mark.parametrize(("harmonic", "bent"), [((1.0,), True), ((1.0, 2.0), True), ((1.0, 84.0), False)])
def test_less_than_one_turn_of_a_ripple_is_a_bend(harmonic: tuple[float, ...], bent: bool) -> None:
    """Of a joint that swings by a radian, as an encoder's error bends its weight; by two turns, a ripple."""
    alike = TorqueRipple("tilt", harmonic).blurred(SEEN._replace(travel=1.0))
    assert ("encoder-offset" in alike) == ("torque-gain" in alike) == bent
    assert TorqueRipple("tilt", harmonic).blurred(SEEN._replace(travel=4 * np.pi)) == ()


def test_beside_an_unknown_residual_the_payload_is_told_as_rough() -> None:
    left = {"pan": Residual("noise", 0.1, 1.0), "tilt": Residual("structured", 0.1, 9.0, 1.0, "slow")}
    some, none = (SimpleNamespace(findings=[], residual=rest) for rest in (left, {"pan": left["pan"]}))
    assert text.caveats(cast(Diagnosis, some)).endswith("unknown is left at tilt)")
    assert text.caveats(cast(Diagnosis, none)) == ""


@pytest.mark.parametrize(
    ("fit", "state", "told"), [(80.0, "noise", True), (97.0, "noise", False), (80.0, "slow", False)]
)
def test_what_may_hide_in_the_noise_is_told_where_that_is_much_of_the_torque(
    fit: float, state: str, told: bool
) -> None:
    figures = {"torque_rmse": {"pan": 0.02}, "fit_percent": {"pan": fit}}
    shown = SimpleNamespace(residual={"pan": Residual(state, 1e-3, 1.0)}, extended=figures)
    shown.after = SimpleNamespace(model=SimpleNamespace(rig=Rig.load("turret")))
    shown.noisy = Diagnosis.__dict__["noisy"].fget(shown)
    said = Diagnosis.__dict__["hidden"].fget(shown)
    assert said.startswith("the noise may hide up to 0.02 N m at pan") if told else not said


@pytest.mark.parametrize(("cause", "told"), [("payload-shift", True), ("cogging", False)])
def test_two_deviations_of_one_shift_are_said_to_be_two(cause: str, told: bool) -> None:
    """The payload's figures beside a finding about it are taken with its inertias open."""
    found = SimpleNamespace(findings=[SimpleNamespace(cause=cause)], residual={})
    assert ("inertias left open" in text.caveats(cast(Diagnosis, found))) == told


def test_what_is_unconfirmed_names_nothing() -> None:
    noise = [Residual("noise", 1e-3, 1.0)]
    assert overall(["unconfirmed"], noise) == "unknown"
    assert overall(["unconfirmed", "ambiguous"], noise) == "ambiguous"
    assert overall(["unconfirmed", "named"], noise) == "named"
    assert overall([], noise) == "nothing"


def test_the_size_of_what_is_there_is_known_and_of_what_is_not_is_not() -> None:
    """Harmonics of a motor that has one of them, and friction that drifts where none does."""
    place = RIG.joints[1]
    state = first(Term(Cogging(place, (9.0,)), (0.03, 0.04)))

    def is_known(cause: Cause) -> bool:
        return is_size_known(solved(state.problem, (Cogging(place, (9.0,)), cause), state), cause)

    there = solved(state.problem, (Cogging(place, (9.0,)),), state)
    assert is_size_known(there, there.causes[0])
    assert sum(is_known(Cogging(place, (float(k),))) for k in range(20, 32)) <= 5
    assert not is_known(FrictionDrift(place, span=5.0))


def test_the_whole_rigs_gain_counts_joints_by_the_samples_that_tell() -> None:
    def figures(*rmse: float) -> dict[str, dict[str, float]]:
        return {"torque_rmse": dict(zip(("pan", "tilt"), rmse))}

    before, used = figures(1.0, 1.0), np.array([0.6, 0.3])
    assert measure_gain(before, figures(0.5, 2.0), used) == pytest.approx(0.3 * np.log(2))
    assert measure_gain(before, before, used) == 0.0
    assert measure_gain(before, figures(2.0, 0.5), used) < 0
    assert measure_gain(before, figures(0.5, 1e9), np.array([0.6, 0.0])) > 0, "a joint that stands says nothing"
