"""Stated probabilities against the truth: honest ones are calibrated, and what cannot be judged is left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.blind.judge import Judged, judge
from tests.blind.reliability import as_figures, chart, claims, measure, text
from tests.test_blind_table import cause, diagnosis, truth

Json = dict[str, Any]


def said(name: str, probability: float, joint: str | None = "yaw") -> Json:
    return {"cause": name, "joint": joint, "probability": probability}


def case_of(hidden: Json, *stated: Json) -> Judged:
    return judge(hidden, diagnosis("named") | {"causes": list(stated)})


def rights(case: Judged) -> list[bool]:
    return [claim.right for claim in claims(case)]


def test_honest_probabilities_are_calibrated_and_overconfident_ones_are_not() -> None:
    rng = np.random.default_rng(0)
    honest = []
    sure = []
    for p in rng.uniform(0.01, 1.0, 4000):
        hidden = truth("single", cause("cogging" if rng.random() < p else "stribeck"))
        honest.append(case_of(hidden, said("cogging", p)))
        sure.append(case_of(hidden, said("cogging", p**0.5)))
    assert measure(honest).error < 0.03 < 0.15 < measure(sure).error
    assert sum(each.bounds[0] <= each.mean <= each.bounds[1] for each in measure(honest).bins) >= 9


def test_the_error_is_what_the_hand_computes() -> None:
    hidden = truth("single", cause("cogging"))
    found = measure(
        [
            case_of(hidden, said("cogging", 0.8), said("stribeck", 0.3)),
            case_of(hidden, said("cogging", 1)),
        ]
    )
    by_hand = (1 * abs(0.0 - 0.3) + 1 * abs(1.0 - 0.8) + 1 * abs(1.0 - 1.0)) / 3
    assert found.error == pytest.approx(by_hand)
    assert [(each.low, each.count, each.right) for each in found.bins] == [
        (pytest.approx(0.3), 1, 0), (pytest.approx(0.8), 1, 1), (pytest.approx(0.9), 1, 1),
    ]  # fmt: skip


def test_a_planted_cause_that_is_not_visible_is_neither_right_nor_wrong() -> None:
    hidden = truth("single", cause("cogging", snr=1.0))
    assert rights(case_of(hidden, said("cogging", 0.6), said("stribeck", 0.2))) == [False]
    whole = truth("single", cause("base-tilt", None))
    assert rights(case_of(whole, said("base-tilt", 0.9, "tilt"), said("base-tilt", 0.9, None))) == [
        True,
        True,
    ]
    assert rights(case_of(whole, said("base-tilt", 0.9, "yaw"))) == []


def test_look_alikes_are_one_claim_and_places_are_not() -> None:
    (claim,) = claims(
        case_of(truth("single", cause("delay")), said("delay", 0.4), said("actuator-lag", 0.55))
    )
    assert claim.right and claim.probability == pytest.approx(0.95)
    hidden = truth("single", cause("cogging", "yaw"))
    assert rights(case_of(hidden, said("cogging", 0.5), said("cogging", 0.5, "tilt"))) == [
        True,
        False,
    ]


def test_unknown_is_right_where_something_from_outside_is_visible() -> None:
    outside = truth("outside", cause("wind", outside=True, foreign=False))
    assert rights(case_of(outside, said("unknown", 0.9), said("unknown", 0.1, "tilt"))) == [
        True,
        False,
    ]
    assert (
        rights(
            case_of(truth("outside", cause("wind", outside=True, snr=1.0)), said("unknown", 0.3))
        )
        == []
    )
    assert (
        rights(case_of(truth("single", cause("cogging", foreign=True)), said("unknown", 0.3))) == []
    )
    assert rights(case_of(truth("clean"), said("unknown", 0.3))) == [False]


def test_the_logs_own_faults_are_left_out() -> None:
    noisy = truth("clean", faults=("acceleration-noise",))
    assert rights(case_of(noisy, said("acceleration-noise", 0.9, None))) == []
    with pytest.raises(ValueError, match="diagnose the logs again"):
        measure(
            [
                case_of(truth("data", data="clock"), said("cogging", 0.3)),
                judge(truth("clean"), diagnosis("nothing")),
            ]
        )


def test_a_visible_cause_that_is_not_listed_is_counted() -> None:
    pair = truth("pair", cause("cogging"), cause("stribeck", "tilt"))
    found = measure([case_of(pair, said("cogging", 1.0))])
    assert (found.planted, found.unlisted) == (2, 1)
    assert [figure.value for figure in as_figures(found)] == [0.0, 1.0, 0.5]


def test_the_diagram_shows_every_bin() -> None:
    hidden = truth("single", cause("cogging"))
    found = measure(
        [case_of(hidden, said("cogging", p), said("stribeck", 1.0 - p)) for p in (0.65, 0.75, 0.95)]
    )
    assert len(text(found.bins).splitlines()) == len(found.bins) + 2
    above, below = chart(found).axes
    assert len(above.lines[1].get_xdata()) == len(below.patches) == len(found.bins)  # type: ignore[arg-type]
