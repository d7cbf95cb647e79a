"""Laws of the blind benchmark's scores, on the truths of a stored draw.

A perfect diagnosis passes everywhere, a silent one is never wrong and a lying one always; bounds
are Wilson's; honest probabilities are calibrated.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blind_comparison import compare
from scipy.stats import binomtest

from tests.blind import answers
from tests.blind.judge import VISIBLE, get_errors, judge
from tests.blind.reliability import claims, measure
from tests.blind.table import score, wilson

Json = dict[str, Any]
STORED = Path(__file__).parent / "blind" / "stored" / "development-923530b2.csv"
TRUTHS = [case.truth for case in answers.read(STORED).values()]


def find(cause: str, joint: str | None, size: float = 0.0, **more: Any) -> Json:
    """Return a finding whose size has a deviation of 0.1."""
    told = {"cause": cause, "joint": joint, "status": "named"}
    return told | {"parameters": {"length": {"value": size, "std": 0.1}}} | more


def say(truth: Any, verdict: str, *findings: Json, left: float = 1.0) -> Json:
    """Return a diagnosis; `left` is what it leaves of the error above the noise, as a share."""
    errors = {"refitted": 1.0, "extended": left}
    floor = truth["noise_floor"]
    rmse = {
        stage: {"torque_rmse": {joint: (1.0 + 99.0 * share) * x for joint, x in floor.items()}}
        for stage, share in errors.items()
    }
    return {"verdict": verdict, "findings": findings, "held_out": rmse}


def answer_perfectly(truth: Any) -> Json:
    """Return the diagnosis that says what is true."""
    if truth["stratum"] == "outside":
        return say(truth, "unknown")
    findings = [find(one["cause"], one["joint"]) for one in truth["causes"]]
    return say(truth, "named" if findings else "nothing", *findings, left=0.0)


def test_a_perfect_diagnosis_passes() -> None:
    rows = score([judge(truth, answer_perfectly(truth)) for truth in TRUTHS])
    grades = [row.grade for row in rows if row.must is not None and row.count]
    assert grades == 11 * ["PASS"]


def test_a_perfect_engine_loses_no_log_to_a_silent_one() -> None:
    named = {str(number): truth for number, truth in enumerate(TRUTHS)}
    silent = {name: judge(truth, say(truth, "nothing")) for name, truth in named.items()}
    perfect = {name: judge(truth, answer_perfectly(truth)) for name, truth in named.items()}
    for forth, back in zip(compare(silent, perfect), compare(perfect, silent)):
        assert not forth.lost
        assert (back.lost, back.won) == (forth.won, forth.lost)
        assert back.p_value == forth.p_value
    assert sum(len(pair.won) for pair in compare(silent, perfect)) > 0


def test_errors_of_either_schema_are_stored_and_read() -> None:
    cases = [case for case in answers.read(STORED).values() if case.findings]
    assert cases
    for case in cases:
        errors = get_errors(case.diagnosis)
        assert errors and errors.keys() <= {*case.truth["joints"]}
        stored = json.loads(answers.encode_answer(case.diagnosis))
        assert get_errors(stored) == errors


RIGHT = ["first name right", "two effects"]
WRONG = [
    "false findings",
    "named but wrong",
    "outside the library: something",
    "drive-like, clean: any",
]


@pytest.mark.parametrize(
    ("findings", "wrong"), [([], 0.0), ([find("a lie", None)], 1.0)], ids=["silence", "a lie"]
)
def test_silence_is_never_wrong_and_a_lie_always_and_neither_is_right(
    findings: list[Json], wrong: float
) -> None:
    rows = score([judge(truth, say(truth, "nothing", *findings)) for truth in TRUTHS])
    assert {row.value for row in rows if row.name.startswith(tuple(RIGHT))} == {0.0}
    assert {row.value for row in rows if row.name.startswith(tuple(WRONG))} == {wrong}


def make_truth(cause: str, fault: str = "", snr: float = 2 * VISIBLE, **more: Any) -> Json:
    """Return the truth about a log of two joints with a cause at "pan", or none."""
    told = {"cause": cause, "form": "plain", "joint": "pan", "foreign": False, "outside": False,
            "kin": [], "parameters": {"length": 2.0}, "comparable": True, "snr": {"pan": snr, "tilt": 0.0},
            "projected_rms": {"pan": 1.0, "tilt": 0.0}}  # fmt: skip
    return {"stratum": "single" if cause else "clean", "causes": [told | more] if cause else [],
            "faults": [fault], "data": None, "noise_floor": {"pan": 0.01, "tilt": 0.01}}  # fmt: skip


COGGING = make_truth("cogging")
RIGHT_SIZE = find("cogging", "pan", 2.19)
CLASS = find("delay", "pan", status="ambiguous") | {"class": ["cogging"]}
UNCONFIRMED = find("cogging", "pan", status="unconfirmed")
CLOCK = find("clock", None, status="data")
FAINT = make_truth("cogging", snr=0.9 * VISIBLE)
BIAS = make_truth("torque-bias", parameters={"bias": -2.0})
OPPOSITE = find("torque-bias", "pan", parameters={"bias": {"value": 2.0, "std": 0.1}})


@pytest.mark.parametrize(
    ("truth", "finding", "figure", "value"),
    [
        (make_truth(""), CLOCK, "false findings", 1.0),
        (make_truth("", "clock"), CLOCK, "false findings", 0.0),
        (make_truth(""), UNCONFIRMED, "false findings", 0.0),
        (COGGING, UNCONFIRMED, "first name right", 0.0),
        (COGGING, find("cogging", "tilt"), "named but wrong", 1.0),
        (COGGING, find("cogging", None), "named but wrong", 0.0),
        (COGGING, CLASS, "first name right", 1.0),
        (COGGING, CLASS, "truth in the class", 1.0),
        (COGGING, RIGHT_SIZE, "held-out gain", 0.5),
        (COGGING, RIGHT_SIZE, "interval coverage", 1.0),
        (COGGING, find("cogging", "pan", 1.75), "interval coverage", 0.0),
        (FAINT, RIGHT_SIZE, "first name right", None),
        (BIAS, OPPOSITE, "interval coverage", 1.0),
    ],
)
def test_what_one_finding_scores(
    truth: Json, finding: Json, figure: str, value: float | None
) -> None:
    rows = score([judge(truth, say(truth, finding["status"], finding, left=0.5))])
    found = next(row.value for row in rows if row.name.startswith(figure))
    assert found == pytest.approx(value)


@pytest.mark.parametrize(("hits", "count"), [(0, 20), (3, 7), (381, 381)])
def test_bounds_are_wilsons(hits: int, count: int) -> None:
    theirs = binomtest(hits, count).proportion_ci(method="wilson")
    assert wilson(hits, count) == pytest.approx((theirs.low, theirs.high), abs=1e-6)


def state(truth: Json, causes: list[str], probability: float) -> Any:
    """Return a judged case that states a probability of some causes at "pan": of a finding and its rivals."""
    first, *others = causes
    rivals = [{"cause": name, "probability": probability} for name in others]
    return judge(
        truth, say(truth, "named", find(first, "pan", probability=probability, rivals=rivals))
    )


def test_honest_probabilities_are_calibrated_and_overconfident_ones_are_not() -> None:
    rng = np.random.default_rng(0)
    drawn = rng.uniform(0.01, 1.0, 1000)
    truths = [make_truth("cogging" if there else "stribeck") for there in rng.random(1000) < drawn]
    honest, sure = (
        measure([state(*pair) for pair in zip(truths, 1000 * [["cogging"]], drawn**power)])
        for power in (1.0, 0.5)
    )
    assert honest.error < 0.05 < 0.15 < sure.error
    assert sum(one.bounds[0] <= one.mean <= one.bounds[1] for one in honest.bins) >= 9


@pytest.mark.parametrize(
    ("truth", "causes", "rights"),
    [
        (COGGING, ["cogging", "stribeck"], [True, False]),
        (FAINT, ["cogging", "stribeck"], [False]),
        (make_truth("delay"), ["delay", "actuator-lag"], [True]),
        (make_truth("wind", outside=True), ["unknown"], [True]),
        (make_truth("", "clock"), ["clock", "unknown"], [False]),
    ],
)
def test_a_stated_cause_is_right_wrong_or_left_out(
    truth: Json, causes: list[str], rights: list[bool]
) -> None:
    assert [claim.right for claim in claims(state(truth, causes, 0.4))] == rights
