"""Logs of another engine with something hidden, or nothing: the seed chooses, the assertions do not look."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gimbal_pin.cli import main
from tests.blind import cases, draw, files
from tests.blind.judge import Judged, false_alarm, judge, named_wrong

SEED = 2026
SECONDS = 20.0
STRATA = {"clean": 2, "single": 2, "outside": 2}
PLANS = [
    pytest.param(replace(plan, seconds=SECONDS), id=f"{stratum}-{i}")
    for stratum, count in STRATA.items()
    for i, plan in enumerate(draw.sample(count, SEED, stratum))
]


def diagnosed(plan: draw.Plan, folder: Path) -> Judged:
    """Hide, write, diagnose the files, and judge what was said."""
    hidden = cases.hide(plan)
    written, told = files.write(hidden, folder), files.write_truth(hidden, folder)
    main(["diagnose", str(written.rig), str(written.log), "--json", str(folder / "said.json")])
    truth, said = (json.loads(path.read_text(encoding="utf-8")) for path in (told.truth, folder / "said.json"))
    return judge(truth, said)


@pytest.mark.parametrize("plan", PLANS)
def test_what_is_hidden_is_not_misnamed(plan: Any, tmp_path: Path) -> None:
    """Nothing is named with confidence that was not hidden, and nothing at all where nothing was."""
    case = diagnosed(plan, tmp_path)
    assert not named_wrong(case)
    if plan.stratum == "clean":
        assert false_alarm(case) < 1.0
