"""A log counts once: given twice, or beside a model that was identified from it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control.experiment import bench_run
from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify, identify_new, read_known
from gimbal_pin.log import Log, read_log, write_log
from tests.command_line import Run, refused
from tests.rigs import bundled


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    """Two logs of one gimbal."""
    plant = nominal(bundled("turret", "cinema"))
    return [bench_run(plant, rng=seed, seconds=12) for seed in (0, 1)]


def test_a_log_that_is_given_twice_counts_once(logs: list[Log], tmp_path: Path, run: Run) -> None:
    """Its copy under another name, too, and the deviations are those of the log alone."""
    rig = bundled("turret", "cinema")
    once = identify(rig, logs[:1], holdout="none")
    twice = identify(rig, [logs[0], logs[0].part(slice(None))], holdout="none")
    assert np.array_equal(once.estimate.covariance, twice.estimate.covariance)
    assert len(identify(rig, logs, holdout="none").logs) == 2 and len(twice.logs) == 1
    write_log(logs[0], tmp_path / "a.csv")
    shutil.copy(tmp_path / "a.csv", tmp_path / "b.csv")
    call = ("identify", "turret", tmp_path / "a.csv", tmp_path / "b.csv", "--payload", "cinema")
    code, _, err = run(*call)
    assert code == 0 and "b.csv" in err and "once" in err


def test_a_known_model_of_the_same_log_is_refused(
    logs: list[Log], tmp_path: Path, run: Run
) -> None:
    """By its samples, whatever the file is called; another log of the gimbal is taken, and then counts, too."""
    rig = bundled("turret", "cinema")
    for name, log in zip(("a.csv", "copy.csv", "other.csv"), (logs[0], logs[0], logs[1])):
        write_log(log, tmp_path / name)
    call = ("identify", "turret", "--payload", "cinema")
    model = tmp_path / "model.yaml"
    next_model = tmp_path / "next.yaml"
    assert run(*call, tmp_path / "a.csv", "-o", model)[0] == 0
    refused(run(*call, tmp_path / "copy.csv", "--known", model), 2, "copy.csv", "--known")
    code, _, err = run(*call, tmp_path / "other.csv", "--known", model, "-o", next_model)
    assert code == 0, err
    known = read_known(next_model, rig)
    for name in ("copy.csv", "other.csv"):
        with pytest.raises(UsageError, match="twice"):
            identify_new(rig, [read_log(tmp_path / name, rig)], known)
