"""Laws of what is told: one state of a joint everywhere, sizes as far as they are known, probabilities of one."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from markupsafe import Markup

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
from gimbal_pin.effects import Parameter
from gimbal_pin.identification import Opinion, judge_joint
from gimbal_pin.report import show_diagnosis, tables
from gimbal_pin.report.summary import missed
from tests.bench_logs import prescribed
from tests.diagnosis.cases import detent, found
from tests.refitted import RIG

INTERVAL = re.compile(r"([-−]?[\d.]+(?:e[-+]\d+)?) ± ([\d.]+(?:e[-+]\d+)?)")


def find(*rivals: Rival, blurred: tuple[str, ...] = ()) -> Finding:
    """A delay with rivals, and with causes that no log of its range tells from it."""
    keys = [f"{x}_rmse_{y}" for x in ("torque", "rollout") for y in ("before", "after")]
    gain = dict(zip(keys, (1.0, 0.5, 1.0, 0.5)))
    return Finding("delay", "pan", (), gain, 0.0, "pan: delay", "a chirp", rivals, blurred)


def test_probabilities_are_of_one_cause_and_sure_only_where_many_blocks_tell() -> None:
    """Odds e^-δ where the log likelihood is exact; even, however large δ, where a block or two make all of it."""
    rivals = Rival("actuator-lag", 2.0, 1e6), Rival("cogging", 5.0, 1e6, "tilt")
    chances = {name: chance for name, _, chance in find(*rivals).probabilities}
    assert sum(chances.values()) == pytest.approx(LISTED)
    assert chances["actuator-lag"] / chances["delay"] == pytest.approx(np.exp(-2.0), rel=1e-3)
    assert chances["cogging"] / chances["delay"] == pytest.approx(np.exp(-5.0), rel=1e-3)
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


# sizes


@pytest.mark.parametrize("lower", [-np.inf, 0.0])
@pytest.mark.parametrize("ratio", [0.1, 0.4, 0.6, 70.0])
def test_a_size_has_an_interval_or_a_bound(lower: float, ratio: float) -> None:
    """The bound holds the whole interval; an interval never holds zero."""
    size = Parameter("level", 0.24, "N m", lower, std=ratio * 0.24)
    assert size.is_known == (2 * ratio < 1)
    for text in (size.describe(), tables.state_size(size)):
        assert (INTERVAL.search(text) is not None) == size.is_known and "N m" in text
    if not size.is_known:
        bound = float(re.findall(r"[\d.]+(?:e[-+]\d+)?", size.describe())[-1])
        assert bound == pytest.approx(0.24 * (1 + 1.96 * ratio), rel=0.06)


@pytest.mark.parametrize(
    ("coulomb", "stated"), [((0.02, 0.002), True), ((-4.8, 0.1), False), ((0.02, 0.02), False)]
)
def test_friction_that_is_told_is_positive_and_known(
    coulomb: tuple[float, float], stated: bool
) -> None:
    """Of rigs without stated friction."""
    model = found("nothing").before
    known = model.estimated
    assert known is not None
    k = known.names.index("tilt.coulomb.Fs")
    theta = known.theta.copy()
    covariance = known.covariance.copy()
    theta[k] = coulomb[0]
    covariance[k, k] = coulomb[1] ** 2
    bare = replace(
        model,
        rig=replace(model.rig, friction=np.zeros_like(model.rig.friction)),
        estimated=replace(known, theta=theta, covariance=covariance),
    )
    said = " ".join(describe_friction(bare, ()))
    assert ("tilt" in said) == (coulomb[0] > 0) and ("0.02" in said) == stated
    assert all(float(value) > float(half) for value, half in INTERVAL.findall(said))
    assert "tilt" not in " ".join(describe_friction(bare, ("tilt",)))


def test_friction_that_is_told_is_the_refitted_models() -> None:
    bare = replace(RIG, friction=np.zeros_like(RIG.friction))
    log = prescribed(nominal(RIG), seconds=12.0, torque_noise=0.01, dt=4e-3)
    said = diagnose(bare, log, {})
    (note,) = describe_friction(said.before, ())
    assert note in said.notes and said.before.estimated is not None
    told = [float(value) for value, _ in INTERVAL.findall(note)]
    np.testing.assert_allclose(told, said.before.estimated.theta[-4:], rtol=0.01)


# one state


def test_no_poor_or_degraded_fit_is_explained() -> None:
    for fit, structured, lacks, worse in product(np.linspace(-50, 100, 61), *[(False, True)] * 3):
        state = judge_joint(float(fit), 0.9, structured, lacks, worse)
        if state in (Opinion.EXPLAINED, Opinion.NOISE_LEFT):
            assert fit > 50 and not structured and not worse
        assert state is not Opinion.EXPLAINED or fit > 90
        assert state.is_open == (state in (Opinion.STRUCTURE_LEFT, Opinion.NOT_EXPLAINED))
    lost, still = (judge_joint(*x, True, True, True) for x in ((np.nan, 0.9), (99.0, 0.0)))
    assert lost is still


@pytest.mark.parametrize(
    ("urdf", "refitted", "extended", "verdict"),
    [
        (75.0, 75.0, 75.0, "nothing"),
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
    names = ("stated", "rubbing", "baseline", "extended")
    errors = {
        name: {**getattr(clean, name), "fit_percent": {"pan": fit, "tilt": 75.0}}
        for name, fit in zip(names, (urdf, urdf, refitted, extended))
    }
    said = replace(clean, **errors)  # type: ignore[arg-type]
    assert said.verdict == verdict
    assert bool(said.deteriorations) == (max(urdf, refitted) > extended + 10)


def states_of(table: tables.Table) -> dict[str, str]:
    """Return joint → what its row says of what is left."""
    column = table.head.index("What is left")
    return {Markup(row[0]).striptags(): Markup(row[column]).striptags() for row in table.rows}


def test_all_that_speaks_of_a_joint_agrees() -> None:
    """Table, page, terminal, headline and JSON read one state."""
    said = detent()
    stated = {joint: state.value for joint, state in said.opinions.items()}
    assert {joint: row["opinion"] for joint, row in said.to_dict()["residual"].items()} == stated
    table = states_of(tables.residual(said))
    assert all(table[joint].startswith(state) for joint, state in stated.items())
    assert said.unexplained == ["pan"]
    near = said.candidate
    assert near is not None and near.after < near.before
    assert f"{near.cause} at {near.joint}" in show_diagnosis(said).to_text().lower()
    for text in (show_diagnosis(said).to_text(), missed(said)):
        assert "pan" in text


def test_headline_and_page_name_what_was_found() -> None:
    """Beside each probability stands the most that any can be, beside errors their band."""
    said = found("teeth and breakaway")
    page = show_diagnosis(said).to_text()
    assert len(re.findall(rf"%[^%]*\b{100 * LISTED:.0f} %", page)) >= len(said.findings)
    assert said.held is not None and page.count(f"{said.held.band:g} Hz") >= 2
    for one in said.findings:
        for text in (missed(said), show_diagnosis(said).to_text(), show_diagnosis(said).html):
            assert one.cause in text and str(one.joint) in text
    assert missed(None) == missed(found("nothing")) == ""


def test_a_fault_of_the_data_comes_before_all_findings() -> None:
    said = found("cable")
    fault = Fault("acceleration-noise", "tilt", "tilt: noise", (), 2.0, True, "record again")
    spoilt = replace(said, faults=(fault,))
    assert spoilt.verdict == "data" and spoilt.to_dict()["findings"][0]["cause"] == fault.cause
