"""Independent units of work on any `concurrent.futures.Executor`; a repeated call computes what is missing.

The calling process appends the row of every unit that returns to a file in the results' folder, and at the end writes
one Parquet table with all rows in the units' order.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.log.io.files import atomic_write, make_folder, open_replacement

if TYPE_CHECKING:
    from pandas import DataFrame

Value = float | int | str | bool | None
Row = Mapping[str, Value]
"""Column → value of one unit."""
ROWS = "rows.jsonl"
"""File of a run: a line of its settings, then a line per unit, in the order in which the units were computed."""
TABLE = "results.parquet"
"""File of all rows in the units' order."""
MOST_TASKS = 2000
"""Most tasks that a run is divided into. Double: an interrupted run of many units loses half as much work, and the
executor holds twice as many tasks. Of 10⁶ rigs a task is 500, six minutes of a core."""
CLUSTER_TIMEOUT = 30.0
"""Time in which a Dask scheduler has to answer, s: it may still be starting."""
RESUME = "free memory or disk space, or use fewer workers; the same call continues the run"
FAILURES = (
    *(GimbalPinError, ArithmeticError, AssertionError, AttributeError, LookupError),
    *(MemoryError, OSError, RuntimeError, TypeError, ValueError),
)
"""Exceptions of a unit's work that become the `error` of its row and do not end the run."""


@contextmanager
def open_executor(workers: int = 0, scheduler: str | None = None) -> Iterator[Executor]:
    """Open processes of this machine, or the executor of a Dask cluster.

    Args:
        workers: Number of processes; 0: one per processor; 1: a thread of this process.
        scheduler: Address of a Dask scheduler, such as ``tcp://host:8786``; `workers` is then without effect.

    Raises:
        UsageError: Dask is not installed, or the scheduler does not answer.
    """
    if scheduler is None:
        with (
            ThreadPoolExecutor(1)
            if workers == 1
            else open_processes(workers or os.cpu_count() or 1) as pool
        ):
            yield pool
        return
    try:
        from distributed import Client

        client = Client(scheduler, timeout=CLUSTER_TIMEOUT, set_as_default=False)
    except ImportError as error:
        mend = "pip install gimbal-pin[cluster]"
        raise UsageError(
            "--scheduler", "needs dask[distributed], which is not installed", mend
        ) from error
    except (OSError, ValueError) as error:
        what = f"does not answer ({error})"
        raise UsageError(
            f"--scheduler {scheduler}", what, "start 'dask scheduler' there"
        ) from error
    with client:
        yield client.get_executor(pure=False)


def open_processes(workers: int) -> ProcessPoolExecutor:
    """Return a pool of processes that end with this one, even if it is killed."""
    return ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=watch_parent
    )


def watch_parent() -> None:
    """Start a thread that ends this process as soon as its parent has ended."""
    threading.Thread(target=end_with_parent, daemon=True).start()


def end_with_parent() -> None:
    """Wait for the parent and end this process, which would wait for its next task for ever."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def map_units(
    work: Callable[[Any], Row],
    units: Sequence[Any],
    executor: Executor | None = None,
    *,
    folder: str | Path | None = None,
    settings: Mapping[str, object] | None = None,
    quiet: bool = True,
) -> DataFrame:
    """Return a row per unit, in the units' order, whatever order they are computed in.

    A unit whose work raises one of `FAILURES` is a row with its `error`.

    Args:
        work: Computes a unit's row; processes import it by its name.
        units: The units.
        executor: Runs the tasks; None: a process per processor of this machine.
        folder: Folder of the results; rows in it are not computed again. None: no folder.
        settings: Values that the rows depend on, as JSON holds them. A folder with other settings is refused.
        quiet: True shows no progress bar.

    Raises:
        UsageError: The folder holds another run's results or cannot be used, or the executor lost a task.
    """
    import pandas as pd
    from tqdm import tqdm

    if find_spec("pyarrow") is None:
        raise UsageError(
            "results", "need pyarrow, which is not installed", "pip install gimbal-pin[fleet]"
        )
    with ExitStack() as stack:
        place = make_folder(
            stack.enter_context(TemporaryDirectory()) if folder is None else folder
        ).resolve()
        rows = read_rows(place, {**(settings or {}), "units": len(units)})
        missing = sorted({*range(len(units))} - rows.keys())
        size = max(len(missing) // MOST_TASKS, 1)
        bar = tqdm(total=len(units), initial=len(rows), unit="unit", disable=quiet or None)
        pending = set()
        try:
            file = stack.enter_context(open(place / ROWS, "a"))
            pool = executor or stack.enter_context(open_executor())
            for k in range(0, len(missing), size):
                task = missing[k : k + size]
                pending.add(
                    pool.submit(compute_rows, work, task, [units[number] for number in task])
                )
            for future in as_completed(list(pending)):
                pending.discard(future)
                if error := future.exception():
                    raise BrokenExecutor(repr(error))
                rows |= future.result()
                file.writelines(
                    f"{json.dumps([number, row])}\n" for number, row in future.result().items()
                )
                file.flush()
                bar.update(len(future.result()))
        except (BrokenExecutor, OSError) as error:
            raise UsageError(
                str(place), f"is incomplete: the run stopped ({error})", RESUME
            ) from error
        finally:
            bar.close()
            for future in pending:
                future.cancel()
        table = pd.DataFrame([rows[number] for number in range(len(units))])
        table.insert(0, "unit", range(len(units)))
        with open_replacement(place / TABLE) as temporary:
            table.to_parquet(temporary)
        return table


def compute_rows(
    work: Callable[[Any], Row], numbers: Sequence[int], units: Sequence[Any]
) -> dict[int, Row]:
    """Return the rows of some units, by their numbers, each with an `error` or None."""
    rows = dict[int, Row]()
    with limit_to_one_thread():
        for number, unit in zip(numbers, units):
            try:
                rows[number] = {"error": None, **work(unit)}
            except FAILURES as error:
                rows[number] = {"error": f"{type(error).__name__}: {error}"}
    return rows


def read_rows(folder: Path, settings: Mapping[str, object]) -> dict[int, Row]:
    """Return the rows of earlier calls, by the units' numbers, and begin the file if there is none.

    Raises:
        UsageError: The folder holds files of no run, or the results of other settings.
    """
    path = folder / ROWS
    head = f"{json.dumps(settings)}\n"
    if not path.exists():
        if names := sorted(other.name for other in folder.iterdir()):
            raise UsageError(
                str(folder), f"holds {names[0]}, which is of no run", "give an empty folder"
            )
        atomic_write(path, head)
    first, *lines = path.read_text().splitlines(keepends=True)
    if first != head:
        earlier = read_settings(folder)
        stated = json.loads(head)
        other = ", ".join(
            name for name in {**stated, **earlier} if earlier.get(name) != stated.get(name)
        )
        what = f"holds another run's results: other {other}"
        raise UsageError(str(folder), what, "give another folder, or the same settings to continue")
    # A process that is killed may leave half of the last line.
    whole = [line for line in lines if line.endswith("\n")]
    if whole != lines:
        atomic_write(path, "".join([head, *whole]))
    return dict(map(json.loads, whole))


def read_settings(folder: str | Path) -> dict[str, Any]:
    """Return the settings of the run in a folder."""
    with open(Path(folder) / ROWS) as file:
        return dict(json.loads(file.readline()))
