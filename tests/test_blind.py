"""Logs of another engine with something hidden, or nothing: the seed chooses, the assertions do not look.

A few short ones, from the files to the verdict; `scripts/blind` counts over a thousand.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gimbal_pin.cli import main
from tests.blind import cases, draw, files
from tests.blind.effects import CATALOGUE
from tests.blind.judge import Judged, confident, false_alarm, judge, near

SEED = 2026
SECONDS = 15.0
STRATA = {"clean": 1, "single": 1}


def small(plan: draw.Plan) -> draw.Plan:
    """The plan on as few axes and as short a log as its effects allow."""
    needed = max([CATALOGUE[item.cause].needs_axes for item in plan.hidden], default=1)
    return replace(plan, seconds=SECONDS, axes=needed)


PLANS = [
    pytest.param(small(plan), id=f"{stratum}-{i}")
    for stratum, count in STRATA.items()
    for i, plan in enumerate(draw.sample(count, SEED, stratum))
]


def diagnosed(plan: draw.Plan, folder: Path) -> Judged:
    """Hide, write, diagnose the files, and judge what was said."""
    hidden = cases.hide(plan)
    written = files.write(hidden, folder)
    told = files.write_truth(hidden, folder)
    main(["diagnose", str(written.rig), str(written.log), "--json", str(folder / "said.json")])
    truth, said = (
        json.loads(path.read_text(encoding="utf-8")) for path in (told.truth, folder / "said.json")
    )
    return judge(truth, said)


@pytest.mark.parametrize("plan", PLANS)
def test_what_is_hidden_is_not_misnamed(plan: Any, tmp_path: Path) -> None:
    """Nothing is named with confidence but what was hidden, or what comes near it; nothing where nothing was."""
    case = diagnosed(plan, tmp_path)
    named = filter(confident, case.findings)
    assert all(any(near(found, cause) for cause in case.causes) for found in named)
    if plan.stratum == "clean":
        assert false_alarm(case) < 1.0
