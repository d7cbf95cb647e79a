"""Laws of the blind benchmark's scores, on the truths of a stored draw.

A perfect diagnosis reaches every aim, a silent one is never wrong and a lying one always; bounds
are Wilson's; honest probabilities are calibrated.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from tests.blind import answers
from tests.blind.judge import VISIBLE, judge
from tests.blind.reliability import claims, measure
from tests.blind.table import Figure, score, wilson

Json = dict[str, Any]
STORED = Path(__file__).parent / "blind" / "stored" / "development-923530b2.csv"
TRUTHS = [dict(case.truth) for case in answers.read(STORED).values()]


def find(cause: str, joint: str | None, status: str = "named", **sizes: float) -> Json:
    """Return a finding whose sizes have a deviation of 0.1."""
    parameters = {name: {"value": size, "std": 0.1} for name, size in sizes.items()}
    return {"cause": cause, "joint": joint, "status": status, "parameters": parameters}


def say(truth: Json, verdict: str, *findings: Json, left: float = 1.0) -> Json:
    """Return a diagnosis; `left` is what it leaves of the error above the noise, as a share."""
    floor = truth["noise_floor"]
    after = {joint: (1.0 + 99.0 * left) * noise for joint, noise in floor.items()}
    before = {joint: 100.0 * noise for joint, noise in floor.items()}
    errors = {"baseline": {"torque_rmse": before}, "extended": {"torque_rmse": after}}
    return {"verdict": verdict, "findings": list(findings), **errors}


def answer_perfectly(truth: Json) -> Json:
    """Return the diagnosis that says what is true."""
    if truth["stratum"] == "outside":
        return say(truth, "unknown")
    findings = [find(one["cause"], one["joint"]) for one in truth["causes"]]
    return say(truth, "named" if findings else "nothing", *findings, left=0.0)


def tabulate(*pairs: tuple[Json, Json]) -> list[Figure]:
    """Return the figures of some truths and the diagnoses of them."""
    return score([judge(*pair) for pair in pairs])


def get_value(rows: list[Figure], start: str) -> float | None:
    """Return the value of the figure whose name starts so."""
    return next(row.value for row in rows if row.name.startswith(start))


def test_a_perfect_diagnosis_reaches_every_aim() -> None:
    rows = tabulate(*((truth, answer_perfectly(truth)) for truth in TRUTHS))
    graded = [row for row in rows if row.must is not None and row.count]
    assert len(graded) == 11
    assert {row.grade for row in graded} == {"PASS, aim"}


def test_silence_is_never_wrong_and_never_right() -> None:
    rows = tabulate(*((truth, say(truth, "nothing")) for truth in TRUTHS))
    for name in ("false", "first name right", "named but wrong", "outside", "two effects"):
        assert get_value(rows, name) == 0.0


def test_a_liar_is_caught_everywhere() -> None:
    lie = find("a lie", None)
    rows = tabulate(*((truth, say(truth, "named", lie)) for truth in TRUTHS))
    for name in (
        "false",
        "named but wrong",
        "outside the library: something",
        "drive-like, clean: any",
    ):
        assert get_value(rows, name) == 1.0
    assert get_value(rows, "first name right") == 0.0


def make_truth(cause: str, fault: str = "", snr: float = 2 * VISIBLE, **more: Any) -> Json:
    """Return the truth about a log of two joints with a cause at "pan", or none."""
    told = {"cause": cause, "form": "plain", "joint": "pan", "foreign": False, "outside": False,
            "kin": [], "parameters": {"size": 2.0}, "comparable": True, "snr": {"pan": snr, "tilt": 0.0},
            "projected_rms": {"pan": 1.0, "tilt": 0.0}}  # fmt: skip
    return {"stratum": "single" if cause else "clean", "causes": [told | more] if cause else [],
            "faults": [fault], "data": None, "noise_floor": {"pan": 0.01, "tilt": 0.01}}  # fmt: skip


COGGING = make_truth("cogging")
RIGHT = find("cogging", "pan", size=2.19)
CLASS = find("delay", "pan", "ambiguous") | {"class": ["cogging"]}
CLOCK = find("clock", None, "data")


@pytest.mark.parametrize(
    ("truth", "verdict", "finding", "figure", "value"),
    [
        (make_truth(""), "data", CLOCK, "false findings", 1.0),
        (make_truth("", "clock"), "data", CLOCK, "false findings", 0.0),
        (COGGING, "named", find("cogging", "tilt"), "named but wrong", 1.0),
        (COGGING, "named", find("cogging", None), "named but wrong", 0.0),
        (COGGING, "ambiguous", CLASS, "first name right", 1.0),
        (COGGING, "ambiguous", CLASS, "truth in the class", 1.0),
        (COGGING, "named", RIGHT, "held-out gain", 0.5),
        (COGGING, "named", RIGHT, "interval coverage", 1.0),
        (COGGING, "named", find("cogging", "pan", size=1.75), "interval coverage", 0.0),
        (make_truth("cogging", snr=0.9 * VISIBLE), "named", RIGHT, "first name right", None),
        (make_truth("torque-bias", parameters={"bias": -2.0}), "named",
         find("torque-bias", "pan", bias=2.0), "interval coverage", 1.0),
    ],
)  # fmt: skip
def test_what_one_finding_scores(
    truth: Json, verdict: str, finding: Json, figure: str, value: float | None
) -> None:
    rows = tabulate((truth, say(truth, verdict, finding, left=0.5)))
    assert get_value(rows, figure) == pytest.approx(value)


@pytest.mark.parametrize(("hits", "count"), [(0, 20), (3, 7), (381, 381)])
def test_bounds_are_wilsons(hits: int, count: int) -> None:
    theirs = binomtest(hits, count).proportion_ci(method="wilson")
    assert wilson(hits, count) == pytest.approx((theirs.low, theirs.high), abs=1e-6)


def test_honest_probabilities_are_calibrated_and_overconfident_ones_are_not() -> None:
    rng = np.random.default_rng(0)
    honest = []
    sure = []
    for p in rng.uniform(0.01, 1.0, 1000):
        truth = make_truth("cogging" if rng.random() < p else "stribeck")
        for cases, stated in ((honest, p), (sure, p**0.5)):
            cause = {"cause": "cogging", "joint": "pan", "probability": stated}
            cases.append(judge(truth, say(truth, "named") | {"causes": [cause]}))
    assert measure(honest).error < 0.05 < 0.15 < measure(sure).error
    assert sum(one.bounds[0] <= one.mean <= one.bounds[1] for one in measure(honest).bins) >= 9


@pytest.mark.parametrize(
    ("truth", "stated", "rights"),
    [
        (COGGING, ["cogging", "stribeck"], [True, False]),
        (make_truth("cogging", snr=0.9 * VISIBLE), ["cogging", "stribeck"], [False]),
        (make_truth("delay"), ["delay", "actuator-lag"], [True]),
        (make_truth("wind", outside=True), ["unknown"], [True]),
        (make_truth("", "clock"), ["clock", "unknown"], [False]),
    ],
)
def test_a_stated_cause_is_right_wrong_or_left_out(
    truth: Json, stated: list[str], rights: list[bool]
) -> None:
    causes = [{"cause": name, "joint": "pan", "probability": 0.4} for name in stated]
    found = claims(judge(truth, say(truth, "named") | {"causes": causes}))
    assert [claim.right for claim in found] == rights
