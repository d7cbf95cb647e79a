"""Laws of the engine: whatever computes the units, in whatever order and however often it is killed, one table."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fsspec
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from gimbal_pin.errors import UsageError
from gimbal_pin.fleet import Progress, Run, process_pool, run_units
from tests.fleet import stub

ROOT = Path(__file__).parents[2]


def run_of(folder: Path, count: int = 40, log: str = "", work=stub.square, **settings: object) -> Run:  # type: ignore[no-untyped-def]
    return Run(work, [(k, log) for k in range(count)], str(folder), settings)


def table(folder: Path) -> pd.DataFrame:
    return pd.read_parquet(folder / "results.parquet")


def test_each_unit_is_a_row_in_the_units_order_and_a_failed_one_holds_its_error(tmp_path: Path) -> None:
    progress = run_units(run_of(tmp_path), lambda: ThreadPoolExecutor(2), quiet=True)
    rows = table(tmp_path)
    assert rows.unit.tolist() == list(range(40)) and (progress.computed, progress.failed) == (40, 4)
    good = rows.error.isna()
    assert rows.square[good].tolist() == [k**2.0 for k in range(40) if k % 10 != 7]
    assert rows.error[~good].tolist() == [f"ValueError: {k} ends with a seven" for k in (7, 17, 27, 37)]


def test_the_table_is_the_same_whatever_computes_it_in_whatever_order_and_tasks(tmp_path: Path) -> None:
    makers = {"one": lambda: ThreadPoolExecutor(1), "last first": stub.LastFirst, "processes": lambda: process_pool(2)}
    for workers, (name, factory) in zip((50, 1, 2), makers.items()):
        run_units(run_of(tmp_path / name, work=stub.sometimes), factory, workers=workers, quiet=True)
    parts = [len(list((tmp_path / name / "parts").iterdir())) for name in makers]
    assert parts[0] == 40 > parts[2] > parts[1]
    for name in ("last first", "processes"):
        pd.testing.assert_frame_equal(table(tmp_path / "one"), table(tmp_path / name), check_exact=True)
        assert pq.read_schema(tmp_path / name / "results.parquet") == pq.read_schema(tmp_path / "one/results.parquet")


def test_a_resumed_run_says_what_was_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_units(run_of(tmp_path, 12), lambda: ThreadPoolExecutor(1), workers=1, quiet=True)
    assert capsys.readouterr().err == ""
    min((tmp_path / "parts").iterdir()).unlink()
    found = run_units(run_of(tmp_path, 12), lambda: ThreadPoolExecutor(1), workers=1).found
    said = [f"units: {found} of 12 were there", f"units: {12 - found} computed, 1 of 12 failed"]
    assert 0 < found < 12 and capsys.readouterr().err.splitlines() == said


def test_what_is_there_is_not_computed_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    run = run_of(tmp_path / "out", log=str(log))
    run_units(run, lambda: ThreadPoolExecutor(2), quiet=True)
    before = table(tmp_path / "out")
    parts = tmp_path / "out" / "parts"
    for part in (min(parts.iterdir()), max(parts.iterdir())):
        part.unlink()
    (parts / "stale").touch()
    progress = run_units(run, lambda: ThreadPoolExecutor(2), quiet=True)
    again = sorted(map(int, log.read_text().split()[40:]))
    assert (progress.found, progress.computed, progress.failed) == (40 - len(again), len(again), 4)
    assert {0, 39} < set(again) < set(range(40)) and len(set(again)) == len(again)
    assert all(part.suffix == ".parquet" for part in parts.iterdir())
    pd.testing.assert_frame_equal(before, table(tmp_path / "out"), check_exact=True)


class Store(MemoryFileSystem):
    """As object stores: a folder is there when something is in it."""

    protocol = "store"

    def makedirs(self, path, exist_ok=False):  # type: ignore[no-untyped-def]
        pass


def test_results_may_go_to_an_object_store(tmp_path: Path) -> None:
    fsspec.register_implementation("store", Store, clobber=True)
    run = Run(stub.square, [(k, "") for k in range(40)], "store://bucket/rigs")
    for computed in (40, 0):
        assert run_units(run, lambda: ThreadPoolExecutor(2), quiet=True) == Progress(40 - computed, computed, 4)
    run_units(run_of(tmp_path), lambda: ThreadPoolExecutor(2), quiet=True)
    with fsspec.open("store://bucket/rigs/results.parquet") as source:
        pd.testing.assert_frame_equal(pd.read_parquet(source), table(tmp_path), check_exact=True)


def test_a_disk_that_is_full_ends_the_run_and_the_same_call_goes_on(tmp_path: Path) -> None:
    run = run_of(tmp_path)
    parts = tmp_path / "parts"

    def fill(*args: object) -> ThreadPoolExecutor:
        parts.rename(tmp_path / "full")
        parts.touch()
        return ThreadPoolExecutor(2)

    with pytest.raises(UsageError, match="goes on with what is missing"):
        run_units(run, fill, quiet=True)
    parts.unlink()
    (tmp_path / "full").rename(parts)
    done = run_units(run, lambda: ThreadPoolExecutor(2), quiet=True)
    # A task that was on when the disk was full may still end, and its rows are found.
    assert done.found + done.computed == 40 and done.failed == 4


def test_a_folder_of_other_settings_is_refused(tmp_path: Path) -> None:
    run_units(run_of(tmp_path, seed=1), lambda: ThreadPoolExecutor(1), quiet=True)
    for other, keys in (
        (run_of(tmp_path, seed=2), "`seed` differs"),
        (run_of(tmp_path, 41, seed=1), "`units` differs"),
        (run_of(tmp_path, 41, seed=2), "`seed` and `units` differ;"),
    ):
        with pytest.raises(UsageError, match=f"another run's results: {keys}"):
            run_units(other, quiet=True)


def test_a_unit_that_kills_its_worker_is_a_row_and_one_killed_by_chance_is_computed_again(tmp_path: Path) -> None:
    run_units(run_of(tmp_path / "out", 12, str(tmp_path / "log"), stub.fatal), workers=2, quiet=True)
    rows = table(tmp_path / "out")
    assert rows.index[rows.error.notna()].tolist() == [5, 7] and "its process ended 5 times" in rows.error[5]
    assert rows.square[3] == 9.0


COORDINATOR = """
import sys
from gimbal_pin.fleet import Run, run_units
from tests.fleet import stub
if __name__ == "__main__":
    folder, log = sys.argv[1:]
    run_units(Run(stub.slow_square, [(k, log) for k in range(40)], folder), workers=2, quiet=True)
"""


def test_a_killed_coordinator_costs_what_was_in_flight_and_leaves_no_worker(tmp_path: Path) -> None:
    script, log, out = tmp_path / "coordinator.py", tmp_path / "log", tmp_path / "out"
    script.write_text(COORDINATOR)
    command = [sys.executable, str(script), str(out), str(log)]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    killed = subprocess.Popen(command, env=environment)
    while not log.exists() or len(log.read_text().split()) < 8:
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    count = -1
    while count != (count := len(log.read_text().split())):  # workers end; nothing more is computed
        time.sleep(0.5)
    assert count < 40
    subprocess.run(command, env=environment, check=True)
    computed = np.bincount([int(word) for word in log.read_text().split()], minlength=40)
    assert computed.min() == 1 and (computed - 1).sum() <= 2 * 5  # two workers' tasks
    run_units(run_of(tmp_path / "other"), lambda: ThreadPoolExecutor(2), quiet=True)
    pd.testing.assert_frame_equal(table(out), table(tmp_path / "other"), check_exact=True)
