"""Many independent units of work on any executor: each result is a Parquet file as soon as it is there.

The units are known by their places in a sequence, and a task is a run of units. A worker computes a task, writes its
rows to ``parts/part-<task>.parquet`` whole or not at all, and returns nothing but their number: the coordinator holds
no result, and a run that was killed is resumed by the files that are there.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from itertools import islice
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from gimbal_pin.dynamics.threads import one_thread
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

Value = float | int | str | bool | None
Work = Callable[[Any], Mapping[str, Value]]
"""Computes one unit's record: name of a column → value. Workers import it by its name."""
ExecutorFactory = Callable[[], Executor]
"""Makes an executor: also a second one, where a killed worker has broken the first."""

PARTS, RUN, TABLE = "parts", "run.json", "results.parquet"
IN_FLIGHT_PER_WORKER = 4
"""Tasks handed to the executor per worker: no worker waits for the coordinator, and the queue stays short."""
CONNECTION_TIMEOUT = 10.0
"""How long a scheduler may take to answer, s."""
ATTEMPTS_ALONE = 3
"""How often a task may break its worker while no other task runs, before its units are rows with that error."""


@dataclass(frozen=True)
class Run:
    """Units of work and where their results go.

    Attributes:
        work: What computes a unit.
        units: The units' inputs, by place; may be computed on access.
        folder: Local path or any URL that fsspec knows; holds parts, `RUN` and `TABLE`.
        settings: What the results depend on, plain values: a folder of other settings is refused.
        units_per_task: Units that a worker computes and writes together; more where a unit takes milliseconds.
    """

    work: Work
    units: Sequence[Any]
    folder: str
    settings: Mapping[str, object] = field(default_factory=dict)
    units_per_task: int = 1

    @property
    def tasks(self) -> int:
        """Number of tasks."""
        return -(-len(self.units) // self.units_per_task)

    def task(self, number: int) -> Task:
        """The task of that number."""
        first = number * self.units_per_task
        inputs = tuple(self.units[k] for k in range(first, min(first + self.units_per_task, len(self.units))))
        return Task(self.work, first, inputs, part_path(self.folder, number))


@dataclass(frozen=True)
class Task:
    """A run of units for one worker: the place of the first, their inputs, and the file for their rows."""

    work: Work
    first: int
    inputs: tuple[Any, ...]
    path: str


@dataclass(frozen=True)
class Progress:
    """Units that were there before, were computed now, and of all the rows how many hold an error."""

    found: int
    computed: int
    failed: int


def run_units(run: Run, executor: ExecutorFactory | None = None, *, workers: int = 0, quiet: bool = False) -> Progress:
    """Compute the units whose rows are not there yet, and write `TABLE` with all rows in the units' order.

    A unit that raises is a row with its `error`. Killed workers cost what they were computing, which is computed again.

    Args:
        run: The units.
        executor: Makes the executor; None: `process_pool` with `workers` processes.
        workers: How many tasks run at once; 0: the processors of this machine.
        quiet: No progress bar.

    Raises:
        UsageError: The folder holds another run's results, or cannot be used; the executor cannot be reached.
    """
    from tqdm import tqdm

    workers = workers or os.cpu_count() or 1
    factory = executor or (lambda: process_pool(workers))
    claim_folder(run)
    missing, rows = find_missing(run)
    failed = 0
    with tqdm(total=len(run.units), initial=rows, desc="units", unit="unit", disable=quiet or None) as bar:
        for done, errors in compute(run, missing, factory, IN_FLIGHT_PER_WORKER * workers):
            failed += errors
            bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
            bar.update(done)
    write_table(run)
    return Progress(rows, len(run.units) - rows, failed)


def compute(run: Run, missing: Iterator[int], factory: ExecutorFactory, in_flight: int) -> Iterator[tuple[int, int]]:
    """Yield numbers of units computed and failed, task by task, in whatever order they end.

    A broken executor does not say which task broke it: all that were in flight are suspects, and run one at a time on
    the next one. What breaks `ATTEMPTS_ALONE` executors by itself is given up.
    """
    suspects: deque[tuple[int, int]] = deque()  # numbers of tasks, and how many executors each has broken alone
    while True:
        pending: dict[Future[tuple[int, int]], tuple[int, int]] = {}
        is_cautious = bool(suspects)
        with running(factory) as pool:
            try:
                while True:
                    while len(pending) < (1 if is_cautious else in_flight):
                        is_cautious = bool(suspects)
                        if not suspects:
                            suspects.extend((number, 0) for number in islice(missing, 1))
                        if not suspects:
                            break
                        future = pool.submit(compute_task, run.task(suspects[0][0]))
                        pending[future] = suspects.popleft()
                    if not pending:
                        return
                    for future in wait(pending, return_when=FIRST_COMPLETED).done:
                        counts = collect(run, future, pending[future][0])
                        del pending[future]
                        yield counts
            except BrokenExecutor as error:
                is_alone = len(pending) == 1
                for number, attempts in sorted(pending.values()):
                    if is_alone and attempts + 1 >= ATTEMPTS_ALONE:
                        yield write_failure(run.task(number), f"ended its process {attempts + 1} times ({error})")
                    else:
                        suspects.append((number, attempts + is_alone))


def collect(run: Run, future: Future[tuple[int, int]], number: int) -> tuple[int, int]:
    """What a task returned; what the executor gave up is written as rows with that error.

    Raises:
        BrokenExecutor: A process was killed, and took the executor with it.
        UsageError: The executor is gone.
    """
    try:
        error = future.exception()
    except CancelledError as dropped:
        mend = "start it again; the same call goes on with what is missing"
        raise UsageError("executor", "dropped its tasks", mend) from dropped
    if isinstance(error, BrokenExecutor):
        raise error
    # Each executor has errors of its own for a task that it gives up.
    return future.result() if error is None else write_failure(run.task(number), f"{type(error).__name__}: {error}")


@contextmanager
def running(factory: ExecutorFactory) -> Iterator[Executor]:
    """An executor that drops what has not begun when the block ends by an error."""
    pool = factory()
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def dask_executors(address: str) -> Iterator[tuple[ExecutorFactory, int]]:
    """Executors of the Dask cluster at an address such as ``tcp://host:8786``, and how many units it runs at once.

    Raises:
        UsageError: Dask is not installed, or nothing answers there.
    """
    try:
        from distributed import Client
    except ImportError as error:
        mend = "pip install gimbal-pin[cluster]"
        raise UsageError("--scheduler", "needs dask[distributed], which is not installed", mend) from error
    try:
        client = Client(address, timeout=CONNECTION_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"--scheduler {address}", f"does not answer ({error})", "start 'dask scheduler' there"
        ) from error
    with client:
        yield client.get_executor, sum(client.nthreads().values())


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Processes of this machine, each of which ends with the coordinator, however that ends."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=end_with_parent)


def end_with_parent() -> None:
    """Let this process end as soon as its parent has: a killed coordinator leaves no workers behind."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def compute_task(task: Task) -> tuple[int, int]:
    """Compute a task's units, write their rows, return how many there are and how many failed."""
    with one_thread():
        rows = [compute_unit(task.work, unit) for unit in task.inputs]
    return write_part(task, rows)


def compute_unit(work: Work, unit: Any) -> dict[str, Value]:
    """The unit's record, with its `error` or None, or `error` alone where it raises."""
    try:
        return {"error": None, **work(unit)}
    except Exception as error:  # noqa: BLE001 - whatever a unit raises is its result, and ends no other unit
        return {"error": f"{type(error).__name__}: {error}"}


def write_failure(task: Task, error: str) -> tuple[int, int]:
    """Write rows of units that could not be computed."""
    return write_part(task, [{"error": error}] * len(task.inputs))


def write_part(task: Task, rows: Sequence[Mapping[str, Value]]) -> tuple[int, int]:
    """Write a task's rows, each with its unit's place, and return how many there are and failed."""
    import pandas as pd

    table = pd.DataFrame.from_records([{"unit": task.first + k, **row} for k, row in enumerate(rows)])
    content = BytesIO()
    table.astype({"error": "string"}).to_parquet(content, index=False)
    write_whole(task.path, content.getvalue())
    return len(rows), sum(row["error"] is not None for row in rows)


def write_whole(path: str, content: bytes) -> None:
    """Put a file into its place in one step, on whatever system it lies."""
    files, place = file_system(path)
    staged = f"{place}.{uuid4().hex}"
    files.pipe_file(staged, content)
    files.mv(staged, place)


def file_system(path: str) -> tuple[AbstractFileSystem, str]:
    """The file system that holds a path or URL, and the path in it.

    Raises:
        UsageError: Its package is not installed.
    """
    from fsspec.core import url_to_fs

    try:
        files, place = url_to_fs(path)
    except (ImportError, ValueError) as error:
        raise UsageError(path, f"cannot be reached ({error})", "install fsspec's package for it") from error
    return files, str(place)


def part_path(folder: str, number: int) -> str:
    """Where a task's rows lie."""
    return f"{folder}/{PARTS}/part-{number:09d}.parquet"


def claim_folder(run: Run) -> None:
    """Make the folder, or raise `UsageError` where it holds the results of other settings."""
    if not run.folder:
        raise UsageError("folder", "has no name", "name one")
    files, place = file_system(run.folder)
    settings = json.loads(
        json.dumps({**run.settings, "units": len(run.units), "units_per_task": run.units_per_task}, sort_keys=True)
    )
    try:
        files.makedirs(f"{place}/{PARTS}", exist_ok=True)
        if not files.exists(f"{place}/{RUN}"):
            if others := {name.rsplit("/", 1)[-1] for name in files.ls(place, detail=False)} - {PARTS}:
                raise UsageError(run.folder, f"holds {min(others)}, which is of no run", "give an empty folder")
            write_whole(f"{run.folder}/{RUN}", json.dumps({"schema": 1, "settings": settings}, indent=1).encode())
        earlier = json.loads(files.cat_file(f"{place}/{RUN}")).get("settings")
    except (OSError, ValueError, AttributeError) as error:
        raise UsageError(run.folder, f"cannot be used ({error})", "give another folder") from error
    if earlier != settings:
        other = [key for key in {**settings, **(earlier or {})} if (earlier or {}).get(key) != settings.get(key)]
        what = f"holds another run's results: {', '.join(other)} differ{'s' * (len(other) == 1)}"
        raise UsageError(run.folder, what, "give another folder, or the same settings to go on")


def find_missing(run: Run) -> tuple[Iterator[int], int]:
    """The tasks whose rows are not there, and how many units' rows are."""
    files, place = file_system(f"{run.folder}/{PARTS}")
    there = bytearray(run.tasks)
    for path in files.ls(place, detail=False, refresh=True):
        name = path.rsplit("/", 1)[-1]
        if name.startswith("part-") and name.endswith(".parquet"):
            there[int(name[5:-8])] = 1
    tasks = sum(there)
    rows = min(tasks * run.units_per_task, len(run.units))
    if tasks and there[-1]:  # the last task may be a short one
        rows = (tasks - 1) * run.units_per_task + len(run.units) - (run.tasks - 1) * run.units_per_task
    return (number for number in range(run.tasks) if not there[number]), rows


def write_table(run: Run) -> None:
    """Write all parts as one table, row group by row group, in the units' order."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    files, place = file_system(run.folder)
    parts = [file_system(part_path(run.folder, number))[1] for number in range(run.tasks)]
    schema = pa.schema([])
    for part in parts:
        with files.open(part, "rb") as source:
            schema = pa.unify_schemas([schema, pq.read_schema(source)], promote_options="permissive")
    schema = schema.remove_metadata()
    staged = f"{place}/{TABLE}.{uuid4().hex}"
    with files.open(staged, "wb") as target, pq.ParquetWriter(target, schema) as writer:
        for part in parts:
            with files.open(part, "rb") as source:
                rows = pq.read_table(source)
            for column in set(schema.names) - set(rows.column_names):
                rows = rows.append_column(column, pa.nulls(len(rows), schema.field(column).type))
            writer.write_table(rows.select(schema.names).cast(schema))
    files.mv(staged, f"{place}/{TABLE}")
