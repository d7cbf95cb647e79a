"""Laws of the executor: whatever computes the units, in whatever order and however often it is stopped, one table."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import map_units, open_executor
from tests.fleet import stub

ROOT = Path(__file__).parents[2]


class LastFirst(Executor):
    """Computes when results are asked for, what was submitted last first."""

    def submit(self, function: Any, /, *args: Any, **named: Any) -> Future:  # type: ignore[override]
        future: Future = Future()
        future.exception = lambda timeout=None: None  # type: ignore[method-assign]
        future.result = partial(function, *args, **named)  # type: ignore[method-assign]
        future.set_result(None)
        return future


def compute(
    folder: Path | None = None, count: int = 40, log: str = "", **options: Any
) -> pd.DataFrame:
    units = [(k, log) for k in range(count)]
    with ThreadPoolExecutor(2) as pool:
        return map_units(stub.square, units, **{"executor": pool, "folder": folder, **options})


def test_each_unit_is_a_row_in_the_units_order_and_a_failed_one_holds_its_error(
    tmp_path: Path,
) -> None:
    rows = compute(tmp_path)
    good = rows["error"].isna()
    assert rows["unit"].tolist() == list(range(40))
    assert rows["square"][good].tolist() == [k**2.0 for k in range(40) if k % 10 != 7]
    assert rows["error"][~good].tolist() == [
        f"ValueError: {k} ends with a seven" for k in (7, 17, 27, 37)
    ]
    pd.testing.assert_frame_equal(rows, pd.read_parquet(tmp_path / "results.parquet"))


def test_parallel_is_serial(processes: Executor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where several units share a task."""
    rows = compute()
    monkeypatch.setattr("gimbal_pin.fleet.executor.MOST_TASKS", 7)
    pd.testing.assert_frame_equal(rows, compute(executor=LastFirst()), check_exact=True)
    pd.testing.assert_frame_equal(rows, compute(executor=processes), check_exact=True)


def test_rows_that_are_there_are_not_computed_again(tmp_path: Path) -> None:
    """Half a line is what a killed process leaves."""
    log = str(tmp_path / "log")
    before = compute(tmp_path / "out", log=log)
    lines = (tmp_path / "out" / "rows.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "out" / "rows.jsonl").write_text("".join(lines[:30]) + lines[30][:9])
    pd.testing.assert_frame_equal(before, compute(tmp_path / "out", log=log), check_exact=True)
    assert np.bincount([int(word) for word in Path(log).read_text().split()]).sum() == 40 + 11


def test_a_folder_of_other_settings_or_files_is_refused(tmp_path: Path) -> None:
    compute(tmp_path / "out", settings={"seed": 1})
    for count, seed, words in (
        (40, 2, "other seed"),
        (41, 1, "other units"),
        (41, 2, "other seed, units"),
    ):
        with pytest.raises(UsageError, match=words):
            compute(tmp_path / "out", count, settings={"seed": seed})
    with pytest.raises(UsageError, match="holds out, which is of no run"):
        compute(tmp_path)


def test_a_killed_worker_ends_the_run_and_the_same_call_continues_it(tmp_path: Path) -> None:
    units = [(k, str(tmp_path / "log")) for k in range(8)]
    with pytest.raises(UsageError, match="the same call continues"), open_executor(2) as pool:
        map_units(stub.kill_once, units, pool, folder=tmp_path / "out")
    rows = map_units(stub.kill_once, units, LastFirst(), folder=tmp_path / "out")
    assert rows["square"][3] == 9.0 and rows["error"].notna().sum() == 1


COORDINATOR = """
import sys, time
from gimbal_pin.fleet import map_units
def wait(path):
    open(path, "w").close()
    time.sleep(0.05)
    return {}
if __name__ == "__main__":
    map_units(wait, [f"{sys.argv[1]}/{k}" for k in range(400)], folder=sys.argv[1] + "/out")
"""


def test_a_killed_coordinator_leaves_no_worker(tmp_path: Path) -> None:
    script = tmp_path / "coordinator.py"
    script.write_text(COORDINATOR)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    coordinator = subprocess.Popen([sys.executable, str(script), str(tmp_path)], env=environment)
    while not (tmp_path / "5").exists():
        time.sleep(0.02)
    coordinator.send_signal(signal.SIGKILL)
    coordinator.wait()
    count = -1
    while count != (count := len(list(tmp_path.iterdir()))):
        time.sleep(0.5)
    assert count < 400


def test_a_cluster_computes_the_same_table() -> None:
    from distributed import LocalCluster

    with (
        LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
        ) as cluster,
        open_executor(scheduler=cluster.scheduler_address) as pool,
    ):
        pd.testing.assert_frame_equal(compute(), compute(executor=pool), check_exact=True)
