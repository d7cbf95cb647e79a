"""Laws of the executor: one table, whatever runs the units, in any order and with any number of interruptions."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import map_units, open_executor


def square(unit: tuple[int, str]) -> dict[str, float]:
    """Return the square of a number, of the first one last; no square of 7, 17 and so on.

    A folder gets a file per unit; one named `kill` kills the worker of unit 3 once.
    """
    number, folder = unit
    time.sleep(0.1 if number == 0 else 0.0)
    if folder:
        Path(folder, f"computed {number}").touch()
        if number == 3 and (kill := Path(folder, "kill")).exists():
            kill.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
    if number % 10 == 7:
        raise ValueError(f"{number} ends with a seven")
    return {"square": number**2.0}


def compute(
    executor: Executor | None = None, count: int = 40, log: str = "", **options: Any
) -> pd.DataFrame:
    units = [(k, log) for k in range(count)]
    with ThreadPoolExecutor(2) as pool:
        return map_units(square, units, executor or pool, **options)


def test_each_unit_is_a_row_in_the_units_order_and_a_failed_one_holds_its_error(
    tmp_path: Path,
) -> None:
    """Of so many that two share a task."""
    rows = compute(count=4001, folder=tmp_path)
    assert rows["unit"].tolist() == list(range(4001))
    assert rows["square"].dropna().tolist() == [k**2.0 for k in range(4001) if k % 10 != 7]
    errors = rows["error"].dropna()
    assert errors.index.tolist() == [*range(7, 4001, 10)]
    assert set(errors) == {f"ValueError: {k} ends with a seven" for k in errors.index}
    pd.testing.assert_frame_equal(rows, pd.read_parquet(tmp_path / "results.parquet"))


def test_processes_and_a_cluster_compute_the_same_table() -> None:
    distributed = pytest.importorskip("distributed")
    expected = compute()
    with open_executor(2) as pool:
        pd.testing.assert_frame_equal(compute(pool), expected, check_exact=True)
    with (
        distributed.LocalCluster(1, processes=False, dashboard_address=None) as cluster,
        open_executor(scheduler=cluster.scheduler_address) as pool,
    ):
        pd.testing.assert_frame_equal(compute(pool), expected, check_exact=True)


def test_rows_that_are_there_are_not_computed_again(tmp_path: Path) -> None:
    """Half a line is what a killed process leaves."""
    out = tmp_path / "out"
    before = compute(folder=out)
    lines = (out / "rows.jsonl").read_text().splitlines(keepends=True)
    (out / "rows.jsonl").write_text("".join(lines[:30]) + lines[30][:9])
    again = compute(folder=out, log=str(tmp_path))
    pd.testing.assert_frame_equal(before, again, check_exact=True)
    assert len([*tmp_path.glob("computed *")]) == 11
    pd.testing.assert_frame_equal(before, compute(folder=out), check_exact=True)


def test_a_folder_of_other_settings_or_files_is_refused(tmp_path: Path) -> None:
    compute(folder=tmp_path / "out", settings={"seed": 1})
    with pytest.raises(UsageError, match="another run's results: other seed, units;"):
        compute(count=41, folder=tmp_path / "out", settings={"seed": 2})
    with pytest.raises(UsageError, match="holds out, which is of no run"):
        compute(folder=tmp_path)


def test_a_killed_worker_ends_the_run_and_the_same_call_continues_it(tmp_path: Path) -> None:
    (tmp_path / "kill").touch()
    out = tmp_path / "out"
    with pytest.raises(UsageError, match="the same call continues"), open_executor(2) as pool:
        compute(pool, 8, str(tmp_path), folder=out)
    rows = compute(count=8, folder=out)
    pd.testing.assert_frame_equal(rows, compute(count=8), check_exact=True)


COORDINATOR = """
import sys, time
from gimbal_pin.fleet import map_units
def wait(path):
    open(path, "w").close()
    time.sleep(0.05)
    return {}
if __name__ == "__main__":
    map_units(wait, [f"{sys.argv[1]}/{k}" for k in range(400)])
"""


def test_a_killed_coordinator_leaves_no_worker(tmp_path: Path) -> None:
    script = tmp_path / "coordinator.py"
    script.write_text(COORDINATOR)
    coordinator = subprocess.Popen([sys.executable, script, tmp_path])
    while not (tmp_path / "5").exists():
        time.sleep(0.02)
    coordinator.kill()
    coordinator.wait()
    count = -1
    while count != (count := len([*tmp_path.iterdir()])):
        time.sleep(0.5)
    assert count < 400
