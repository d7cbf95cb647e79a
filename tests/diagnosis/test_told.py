"""Laws of what is told of findings: what else they may be, what is only roughly known, what the noise may hide."""

from __future__ import annotations

import re

import numpy as np
import pytest

from gimbal_pin.checks import CHECKS
from gimbal_pin.diagnosis import (
    LISTED,
    Finding,
    Rival,
    find_credible,
)
from gimbal_pin.effects import CAUSES, TorqueRipple
from gimbal_pin.report.sections import diagnosis as sections
from tests.command_line import Run
from tests.diagnosis.test_forms import SEEN


def test_the_help_lists_every_cause(run: Run) -> None:
    said = run("diagnose", "--help")[1]
    assert {*CAUSES, *CHECKS, "platform-motion"} <= set(re.findall(r"[a-z]+(?:-[a-z]+)*", said))


def find(*rivals: Rival, untried: tuple[str, ...] = ()) -> Finding:
    """A delay with rivals, and with causes that no log of its range tells from it."""
    gain = {
        "torque_rmse_before": 1.0,
        "torque_rmse_after": 0.5,
        "rollout_rmse_before": 1.0,
        "rollout_rmse_after": 0.5,
    }
    return Finding("delay", "pan", (), gain, 0.0, "pan: delay", "a chirp", rivals, untried)


def test_what_else_it_may_be_is_told_with_its_probability() -> None:
    found = find(
        Rival("actuator-lag", np.log(4.0), 1e6, "pan"), Rival("armature", 80.0, 9.0, "pan")
    )
    assert found.open == f"this log cannot tell it from actuator-lag ({20 * LISTED:.0f} %)"
    said = "\n".join(map(str, sections.show_finding(found)))
    assert (
        f"  T{found.open[1:]}. Try a chirp." in said
        and f"  Probability {80 * LISTED:.0f} % (" in said
    )
    named = find(Rival("armature", 80.0, 9.0, "pan"))
    text = "\n".join(map(str, sections.show_finding(named)))
    assert (
        not named.open and text.count(f"{100 * LISTED:.0f} %") == 2
    )  # the probability, and the limit beside it


def test_probabilities_are_of_one_cause_and_sure_only_where_many_blocks_tell() -> None:
    """Odds e^-δ where the log likelihood is exact; even, however large δ, where a block or two make all of it."""
    rivals = Rival("actuator-lag", 2.0, 1e6), Rival("cogging", 5.0, 1e6, "tilt")
    chances = {name: chance for name, _, chance in find(*rivals).probabilities}
    assert sum(chances.values()) == pytest.approx(LISTED)
    assert chances["actuator-lag"] / chances["delay"] == pytest.approx(np.exp(-2.0), rel=1e-3)
    assert chances["cogging"] / chances["delay"] == pytest.approx(np.exp(-5.0), rel=1e-3)
    few, many = (find(Rival("cogging", 40.0, z)) for z in (0.5, 50.0))
    assert few.status == "ambiguous" and few.probability < 0.8 * LISTED
    assert many.status == "named" and many.probability == pytest.approx(LISTED)
    equal = find(Rival("cogging", 0.0, 0.0))
    assert equal.probability == pytest.approx(LISTED / 2)


def test_the_class_is_the_smallest_that_holds_the_probability() -> None:
    rivals = [Rival(name, delta, 1e6) for name, delta in (("a", 4.0), ("b", 1.0), ("c", 9.0))]
    assert find_credible("delay", rivals) == ["delay", "b"]
    assert find_credible("delay", [Rival("b", 3.0, 1e6)]) == ["delay"]


def test_what_no_log_tells_apart_shares_a_probability() -> None:
    shared = find(Rival("cogging", np.log(3.0), 1e6), untried=("armature",))
    assert [round(chance / LISTED, 3) for _, _, chance in shared.probabilities] == [
        0.375,
        0.375,
        0.25,
    ]


@pytest.mark.parametrize(
    ("harmonic", "bent"), [((1.0,), True), ((1.0, 2.0), True), ((1.0, 84.0), False)]
)
def test_less_than_one_turn_of_a_ripple_is_a_bend(harmonic: tuple[float, ...], bent: bool) -> None:
    """Of a joint that swings by a radian, as an encoder's error bends its weight; by two turns, a ripple."""
    alike = TorqueRipple("tilt", harmonic).blurred(SEEN._replace(travel=1.0))
    assert ("encoder-offset" in alike) == ("torque-gain" in alike) == bent
    assert TorqueRipple("tilt", harmonic).blurred(SEEN._replace(travel=4 * np.pi)) == ()
