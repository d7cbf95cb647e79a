"""The blind set's scoring: a perfect, a silent and a lying diagnoser, and what sits between them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tests.blind import answers
from tests.blind.judge import judge, named_wrong, near
from tests.blind.table import Figure, text, wilson
from tests.blind.table import score as score_of

Json = dict[str, Any]
JOINTS = ("yaw", "tilt")


def cause(name: str, joint: str | None = "yaw", snr: float = 10.0, **more: Any) -> Json:
    strong = {joint_: snr if joint_ == (joint or "tilt") else 0.1 for joint_ in JOINTS}
    plain: Json = {
        "cause": name, "form": "plain", "joint": joint, "foreign": False, "outside": False, "kin": [],
        "parameters": {"size": 2.0}, "comparable": True, "share": 0.01 * snr, "snr": strong,
        "projected_rms": {joint_: 0.01 * value for joint_, value in strong.items()},
    }  # fmt: skip
    return plain | more


def truth(
    stratum: str, *causes: Json, faults: tuple[str, ...] = (), data: str | None = None
) -> Json:
    return {
        "stratum": stratum, "causes": list(causes), "faults": [*faults, *([data] if data else [])],
        "data": {"cause": data} if data else None, "noise_floor": dict.fromkeys(JOINTS, 0.01),
    }  # fmt: skip


def finding(
    name: str, joint: str | None = "yaw", status: str = "named", size: float = 2.0, **more: Any
) -> Json:
    parameters = {"size": {"value": size, "std": 0.1, "unit": ""}}
    told: Json = {
        "cause": name,
        "joint": joint,
        "status": status,
        "class": [name],
        "parameters": parameters,
    }
    return told | more


def diagnosis(verdict: str, *findings: Json, after: float = 0.01, structured: bool = False) -> Json:
    state = {"state": "structured" if structured else "noise"}
    return {
        "verdict": verdict, "findings": list(findings), "residual": dict.fromkeys(JOINTS, state),
        "baseline": {"torque_rmse": dict.fromkeys(JOINTS, 0.1)},
        "extended": {"torque_rmse": dict.fromkeys(JOINTS, after)},
    }  # fmt: skip


TRUTHS = [
    *[truth("clean") for _ in range(20)],
    *[truth("single", cause("cogging")) for _ in range(10)],
    *[truth("single", cause("delay", foreign=True, comparable=False)) for _ in range(10)],
    *[truth("pair", cause("cogging"), cause("stribeck", "tilt")) for _ in range(10)],
    *[truth("outside", cause("wind", outside=True, comparable=False)) for _ in range(10)],
    *[truth("data", data="clock") for _ in range(10)],
    *[truth("mismatched", data="late-torque") for _ in range(10)],
]


def perfect(case: Json) -> Json:
    if case["data"]:
        return diagnosis("data", finding(case["data"]["cause"], None, "data"))
    if not case["causes"]:
        return diagnosis("nothing")
    if case["stratum"] == "outside":
        return diagnosis("unknown", structured=True, after=0.1)
    return diagnosis("named", *(finding(item["cause"], item["joint"]) for item in case["causes"]))


def score(pairs: Iterable[tuple[Json, Json]]) -> list[Figure]:
    return score_of([judge(*pair) for pair in pairs])


def row(rows: list[Figure], start: str) -> Figure:
    return next(figure for figure in rows if figure.name.startswith(start))


def test_a_perfect_diagnosis_reaches_every_aim_but_too_sure_intervals() -> None:
    rows = score((case, perfect(case)) for case in TRUTHS)
    graded = [figure for figure in rows if figure.must is not None and figure.count]
    assert {figure.name: figure.grade for figure in graded if figure.grade != "PASS, aim"} == {
        "interval coverage at 95 %": "FAIL"
    }
    assert row(rows, "held-out gain").value == pytest.approx(1.0)
    assert row(rows, "data faults told").value == 1.0


def test_stored_answers_are_judged_as_the_folder_they_came_from(tmp_path: Path) -> None:
    for number, case in enumerate(TRUTHS):
        place = tmp_path / "draw" / f"log-{number:03d}"
        place.mkdir(parents=True)
        (place / "truth.json").write_text(json.dumps(case))
        (place / "diagnosis.json").write_text(json.dumps(perfect(case)))
    assert answers.write(tmp_path / "stored.csv", tmp_path / "draw") == len(TRUTHS)
    stored = answers.read(tmp_path / "stored.csv")
    assert score_of(list(stored.values())) == score((case, perfect(case)) for case in TRUTHS)


def test_silence_is_never_wrong_and_never_right() -> None:
    rows = score((case, diagnosis("nothing", after=0.1)) for case in TRUTHS)
    for name, value in {
        "false": 0.0,
        "first name right, known": 0.0,
        "named but wrong": 0.0,
        "outside": 0.0,
        "torque late": 0.0,
        "two": 0.0,
    }.items():
        assert row(rows, name).value == value
    assert row(rows, "truth in the class").value is None
    assert row(rows, "truth in the class").grade == "-"


def test_a_liar_is_caught_everywhere() -> None:
    rows = score((case, diagnosis("named", finding("backlash", "tilt"))) for case in TRUTHS)
    for name in (
        "false findings",
        "named but wrong",
        "outside the library: something",
        "data faults: physics",
    ):
        assert row(rows, name).value == 1.0
    assert row(rows, "first name right, known").value == 0.0


def test_unknown_on_a_clean_log_is_half_a_false_finding() -> None:
    rows = score([(truth("clean"), diagnosis("unknown")), (truth("clean"), diagnosis("nothing"))])
    assert row(rows, "false findings").value == 0.25


def test_a_true_fault_of_the_sensors_is_no_false_finding() -> None:
    dirty = truth("clean", faults=("clock",))
    told = diagnosis("data", finding("clock", None, "data"))
    assert row(score([(dirty, told)]), "false findings").value == 0.0
    assert row(score([(truth("clean"), told)]), "false findings").value == 1.0


def test_faults_do_not_hide_the_first_name() -> None:
    dirty = truth("single", cause("cogging"), faults=("clock",))
    told = diagnosis("data", finding("clock", None, "data"), finding("cogging"))
    assert row(score([(dirty, told)]), "first name right, known").value == 1.0


def test_the_right_name_on_the_wrong_joint_is_wrong() -> None:
    case = judge(
        truth("single", cause("cogging", "yaw")), diagnosis("named", finding("cogging", "tilt"))
    )
    assert named_wrong(case)
    assert not named_wrong(
        judge(
            truth("single", cause("base-tilt", None)),
            diagnosis("named", finding("base-tilt", "tilt")),
        )
    )


def test_a_class_that_holds_the_truth_is_right() -> None:
    told = finding("torque-bias", status="ambiguous") | {
        "class": ["torque-bias", "asymmetric-friction"]
    }
    rows = score([(truth("single", cause("asymmetric-friction")), diagnosis("ambiguous", told))])
    assert row(rows, "first name right, known").value == 1.0
    assert row(rows, "truth in the class").value == 1.0
    assert row(rows, "named but wrong").value == 0.0


def test_effects_below_the_noise_are_not_asked_for() -> None:
    rows = score([(truth("single", cause("cogging", snr=1.0)), diagnosis("nothing"))])
    assert row(rows, "first name right, known").count == 0
    assert row(rows, "named but wrong").count == 1


def test_a_torque_by_formula_may_be_told_by_either_name() -> None:
    formula = truth("data", data="commanded-torque")
    told = finding("controller-formula", None, "data")
    rows = score([(formula, diagnosis("data", told))])
    assert row(rows, "data faults told").value == 1.0
    assert row(rows, "data faults: physics").value == 0.0


def test_drives_logs_have_rows_of_their_own() -> None:
    clean = truth("drive-clean")
    single = truth("drive-single", cause("cogging"))
    class_of_two = finding("torque-ripple", status="ambiguous") | {
        "class": ["torque-ripple", "cogging"]
    }
    said = diagnosis("unknown", structured=True)
    said["residual"] = {
        joint: state | {"dispersion": 1.4, "discrepancy": 0.2}
        for joint, state in said["residual"].items()
    }
    rows = score([
        (clean, said), (clean, diagnosis("nothing")), (clean, diagnosis("refused")),
        (clean, diagnosis("named", finding("delay"))),
        (single, diagnosis("ambiguous", class_of_two)), (single, diagnosis("nothing")),
        (truth("drive-single", cause("cogging", snr=2.0)), diagnosis("nothing")),
    ])  # fmt: skip
    assert row(rows, "drive-like, clean: unknown").value == pytest.approx(1.0 / 3.0)
    assert row(rows, "drive-like, clean: any name").value == pytest.approx(1.0 / 3.0)
    assert row(rows, "refused").value == pytest.approx(1.0 / 7.0)
    one = row(rows, "drive-like, one cause: right")
    assert (one.value, one.count, one.grade) == (0.5, 2, "FAIL")
    assert row(rows, "false findings").count == row(rows, "first name right, known").count == 0


def test_near_causes_are_near_only_from_outside() -> None:
    wind = cause("wind", outside=True, kin=["friction-drift"])
    assert near(finding("friction-drift"), wind) and not near(
        finding("friction-drift", "tilt"), wind
    )
    assert not near(finding("cogging"), wind)


def test_half_of_the_gain_is_half_of_the_gain() -> None:
    case = truth("single", cause("cogging"))
    told = diagnosis("named", finding("cogging"), after=0.055)
    assert row(score([(case, told)]), "held-out gain").value == pytest.approx(0.5)


def test_coverage_counts_what_lies_within_and_reads_other_words() -> None:
    case = truth("single", cause("cogging"))
    told = [
        (case, diagnosis("named", finding("cogging", size=2.0 + 0.1 * z)))
        for z in (0.0, 1.9, -1.9, 2.5)
    ]
    assert row(score(told), "interval coverage").value == 0.75
    bias = truth("single", cause("torque-bias", parameters={"bias": 2.0}))
    for bias_told, value in ((-2.0, 1.0), (2.0, 0.0)):
        parameters = {"bias": {"value": bias_told, "std": 0.1, "unit": "N m"}}
        said = diagnosis("named", finding("torque-bias", parameters=parameters))
        assert row(score([(bias, said)]), "interval coverage").value == value


@given(st.integers(1, 400), st.floats(0.0, 1.0))
def test_bounds_are_wilsons(count: int, share: float) -> None:
    hits = round(share * count)
    theirs = binomtest(hits, count).proportion_ci(method="wilson")
    assert wilson(hits, count) == pytest.approx((theirs.low, theirs.high), abs=1e-6)


def test_three_hundred_clean_logs_bound_one_per_cent() -> None:
    assert wilson(0, 20)[1] > 0.1
    assert wilson(0, 381)[1] < 0.01


def test_the_table_is_one_line_a_figure() -> None:
    rows = score((case, perfect(case)) for case in TRUTHS)
    assert len(text(rows).splitlines()) == len(rows) + 2
    assert "≥ 95 %" in text(rows) and "85–99 %" in text(rows)
