"""Diagnoses of logs of another simulator: nothing is named with confidence but what was hidden.

A few short logs, from files to verdict. `scripts/blind` counts over a thousand.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gimbal_pin.cli import main
from tests.blind import cases, draw, files
from tests.blind.judge import confident, false_alarm, judge, near


@pytest.mark.parametrize("stratum", ["clean", "single"])
def test_what_is_hidden_is_not_misnamed(stratum: str, tmp_path: Path) -> None:
    (plan,) = draw.sample(1, 2026, stratum)
    hidden = cases.hide(replace(plan, seconds=15.0, axes=1))
    files.write(hidden, tmp_path)
    told = tmp_path / "said.json"
    words = [str(tmp_path / name) for name in ("rig.yaml", "log.csv")]
    main(["diagnose", *words, "--json", str(told)])
    case = judge(hidden.truth, json.loads(told.read_text(encoding="utf-8")))
    named = filter(confident, case.findings)
    assert all(any(near(found, cause) for cause in case.causes) for found in named)
    if stratum == "clean":
        assert false_alarm(case) < 1.0
