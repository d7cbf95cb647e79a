"""Laws of what is told: one state of a joint everywhere, and probabilities of one cause that sum to what is listed."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis import (
    LISTED,
    Finding,
    Rival,
    describe_friction,
    diagnose,
    find_credible,
)
from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import Opinion, judge_joint
from gimbal_pin.report import show_diagnosis, tables
from gimbal_pin.report.summary import missed
from tests.bench_logs import prescribed
from tests.diagnosis.cases import detent, found
from tests.refitted import RIG

SIZE = re.compile(r"([\d.e-]+) ±")


def find(*rivals: Rival, blurred: tuple[str, ...] = ()) -> Finding:
    """Return a delay with rivals, and with causes that no log of its range tells from it."""
    return Finding("delay", "pan", (), {}, 0.0, "pan: delay", "a chirp", rivals, blurred)


def test_probabilities_are_of_one_cause_and_sure_only_where_many_blocks_tell() -> None:
    """Odds e^-δ where the log likelihood is exact; even, however large δ, where a block or two make all of it."""
    rivals = (Rival("actuator-lag", 2.0, 1e6), Rival("cogging", 5.0, 1e6, "tilt"))
    told = [chance for *_, chance in find(*rivals).probabilities]
    assert sum(told) == pytest.approx(LISTED)
    np.testing.assert_allclose(np.log(told[0] / np.array(told)), [0.0, 2.0, 5.0], atol=1e-3)
    few, many = (find(Rival("cogging", 40.0, z)) for z in (0.5, 50.0))
    assert (few.status, many.status) == ("ambiguous", "named")
    assert few.probability < 0.8 * LISTED < many.probability
    shared = find(Rival("cogging", np.log(3.0), 1e6), blurred=("armature",))
    told = [chance / LISTED for *_, chance in shared.probabilities]
    np.testing.assert_allclose(told, [0.375, 0.375, 0.25], rtol=1e-3)


def test_the_class_is_the_smallest_that_holds_the_probability() -> None:
    rivals = [Rival(name, delta, 1e6) for name, delta in (("a", 4.0), ("b", 1.0), ("c", 9.0))]
    assert find_credible("delay", rivals) == ["delay", "b"]
    assert find_credible("delay", [Rival("b", 3.0, 1e6)]) == ["delay"]


def test_friction_that_is_told_is_the_refitted_models_where_it_is_positive_and_known() -> None:
    """Of rigs without stated friction."""
    bare = replace(RIG, friction=np.zeros_like(RIG.friction))
    log = prescribed(nominal(RIG), seconds=12.0, torque_noise=0.01, dt=4e-3)
    said = diagnose(bare, log, {})
    known = said.before.estimated
    assert known is not None
    (note,) = describe_friction(said.before, ())
    assert note in said.notes
    np.testing.assert_allclose([float(x) for x in SIZE.findall(note)], known.theta[-4:], rtol=0.01)
    last = np.arange(len(known.theta)) == len(known.theta) - 4
    unsure = replace(known, covariance=known.covariance + np.diag(1.0 * last))
    pushing = replace(known, theta=known.theta - 1.0 * last)
    for one, count in ((unsure, 3), (pushing, 2)):
        (note,) = describe_friction(replace(said.before, estimated=one), ())
        assert len(SIZE.findall(note)) == count
    assert "tilt" not in " ".join(describe_friction(said.before, ("tilt",)))


# one state


def test_no_poor_or_degraded_fit_is_explained() -> None:
    for fit, structured, lacks, worse in product(np.linspace(-50, 100, 61), *[(False, True)] * 3):
        state = judge_joint(float(fit), 0.9, structured, lacks, worse)
        if state in (Opinion.EXPLAINED, Opinion.NOISE_LEFT):
            assert fit > 50 and not structured and not worse
        assert state is not Opinion.EXPLAINED or fit > 90
        assert state.is_open == (state in (Opinion.STRUCTURE_LEFT, Opinion.NOT_EXPLAINED))
    for lost in ((np.nan, 0.9), (99.0, 0.0)):
        assert judge_joint(*lost, True, True, True) is Opinion.NOT_JUDGED


@pytest.mark.parametrize(
    ("urdf", "refitted", "extended", "verdict"),
    [
        (75.0, 60.0, 60.0, "unknown"),
        (75.0, 60.0, 95.0, "nothing"),
        (30.0, 40.0, 45.0, "unknown"),
        (75.0, 74.0, 74.0, "nothing"),
    ],
)
def test_a_refit_that_fails_keeps_a_diagnosis_from_nothing(
    urdf: float, refitted: float, extended: float, verdict: str
) -> None:
    """A joint that refitting made worse is open, until findings undo it."""
    clean = found("nothing")
    stated, rubbing, baseline, after = (
        {**clean.baseline, "fit_percent": {"pan": fit, "tilt": 75.0}}
        for fit in (urdf, urdf, refitted, extended)
    )
    said = replace(clean, stated=stated, rubbing=rubbing, baseline=baseline, extended=after)
    assert said.verdict == verdict
    assert bool(said.deteriorations) == (max(urdf, refitted) > extended + 10)


def test_all_that_speaks_of_a_joint_agrees() -> None:
    """Table, page, headline and JSON read one state, and name what was found."""
    said = detent()
    stated = {joint: state.value for joint, state in said.opinions.items()}
    assert {joint: row["opinion"] for joint, row in said.to_dict()["residual"].items()} == stated
    for row, state in zip(tables.residual(said).rows, stated.values()):
        assert any(state in str(cell) for cell in row)
    assert said.unexplained == ["pan"]
    near = said.candidate
    assert near is not None and near.after < near.before
    assert f"{near.cause} at {near.joint}" in show_diagnosis(said).to_text().lower()
    assert "pan" in missed(said)
    named = found("teeth and breakaway")
    for one in named.findings:
        for text in (missed(named), show_diagnosis(named).to_text(), show_diagnosis(named).html):
            assert one.cause in text and str(one.joint) in text
    assert missed(None) == missed(found("nothing")) == ""


def test_a_fault_of_the_data_comes_before_all_findings() -> None:
    said = found("cable")
    fault = Fault("acceleration-noise", "tilt", "tilt: noise", (), 2.0, True, "record again")
    spoilt = replace(said, faults=(fault,))
    assert spoilt.verdict == "data" and spoilt.to_dict()["findings"][0]["cause"] == fault.cause
