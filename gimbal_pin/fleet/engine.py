"""Many independent units of work on any executor: each result is in a Parquet file as soon as it is there.

The units are known by their places in a sequence, and a task is a block of them. A worker computes units for
`TASK_SECONDS`, writes their rows to ``parts/part-<first>-<last>.parquet`` whole or not at all, and returns nothing but
their number: the coordinator holds no result, and a run that was killed is resumed by the files that are there.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import re
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent import futures
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from shutil import get_terminal_size
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.errors import GimbalPinError, UsageError

if TYPE_CHECKING:
    from fsspec.implementations.dirfs import DirFileSystem
    from pandas import DataFrame

Value = float | int | str | bool | None
Work = Callable[[Any], Mapping[str, Value]]
"""Computes one unit's record: name of a column → value. Workers import it by its name."""
ExecutorFactory = Callable[[], Executor]
"""Makes an executor: also a second one, where a killed worker has broken the first."""
Capacity = Callable[[], int]
"""How many tasks run at once now: a cluster grows and shrinks."""
Counts = tuple[int, int]
"""How many units were computed, and how many of them failed."""

PARTS, RUN, TABLE = "parts", "run.json", "results.parquet"
PART = re.compile(r"part-(\d+)-(\d+)\.parquet$")
IN_FLIGHT_PER_WORKER = 2
"""Tasks handed to the executor per worker: no worker waits for the coordinator, and the queue stays short."""
TASK_SECONDS = 10.0
"""How long a worker computes before it writes, s: what a killed one costs; a thousand times what a task's way takes."""
TASK_UNITS = 100
"""Most units of a task: where they take a millisecond, a task takes ten times what its way does."""
SHARED_BREAKS, BREAKS = 2, 5
"""Broken executors after which a unit runs alone, and after which it is a row with that error."""
RESUME = "the same call goes on with what is missing"
FAILURES = (
    *(GimbalPinError, ArithmeticError, AssertionError, AttributeError, LookupError),
    *(MemoryError, OSError, RuntimeError, TypeError, ValueError),
)
"""What a unit can make its work raise, be it a fault of the program: its result, which ends no other unit."""


@dataclass(frozen=True)
class Run:
    """Units of work and where their results go.

    Attributes:
        work: What computes a unit.
        units: The units' inputs, by place; may be computed on access.
        folder: Local path or any URL that fsspec knows; holds parts, `RUN` and `TABLE`.
        settings: What the results depend on, as JSON holds it: a folder of other settings is refused.
    """

    work: Work
    units: Sequence[Any]
    folder: str
    settings: Mapping[str, object] = field(default_factory=dict)


class Progress(NamedTuple):
    """Units that were there before, were computed now, and of all the rows how many hold an error."""

    found: int
    computed: int
    failed: int


def compute_table(
    work: Work,
    units: Sequence[Any],
    settings: Mapping[str, object],
    folder: str | Path | None,
    executor: ExecutorFactory | None,
    workers: int | Capacity,
    quiet: bool,
) -> DataFrame:
    """Return all rows of a `Run` after `run_units`; its folder is None where nothing is kept."""
    with TemporaryDirectory(prefix="gimbal-pin-") as temporary:
        run = Run(work, units, temporary if folder is None else str(folder), settings)
        run_units(run, executor, workers=workers, quiet=quiet)
        return read_table(run.folder)


def run_units(
    run: Run, executor: ExecutorFactory | None = None, *, workers: int | Capacity = 0, quiet: bool = False
) -> Progress:
    """Compute the units whose rows are not there yet, and write `TABLE` with all rows in the units' order.

    A unit that raises is a row with its `error`. Killed workers cost what they were computing, which is computed again.

    Args:
        run: The units.
        executor: Makes the executor; None: as many processes as `workers`, or this process for one.
        workers: How many tasks run at once, or what tells; 0: the processors of this machine.
        quiet: No progress bar, nor lines on standard error where that is no terminal.

    Raises:
        UsageError: The folder holds another run's results, or cannot be used; the executor cannot be reached.
    """
    from tqdm import tqdm

    capacity = workers if callable(workers) else partial(int, workers or os.cpu_count() or 1)
    executor = executor or (partial(ThreadPoolExecutor, 1) if workers == 1 else partial(process_pool, capacity()))
    if not run.folder:
        raise UsageError("folder", "has no name", "name one")
    if "://" not in run.folder:  # workers may run elsewhere
        run = replace(run, folder=os.path.abspath(run.folder))
    claim_folder(run)
    failed, missing, total = 0, find_missing(run), len(run.units)
    found = total - sum(map(len, missing))
    columns, lines = get_terminal_size()  # tqdm shows nothing in a terminal that states a size of 0 by 0
    show = partial(tqdm, total=total, initial=found, desc="units", unit="unit", miniters=1, disable=quiet or None)
    bar = show(ncols=columns, nrows=lines)
    is_written = bar.disable and not quiet and sys.stderr is not None
    try:
        with bar:
            if is_written and found:
                tqdm.write(f"units: {found} of {total} were there", sys.stderr)
            for done, errors in compute_missing(run, missing, executor, capacity):
                failed += errors
                bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
                bar.update(done)
        progress = Progress(found, total - found, write_table(run))
        if is_written:
            tqdm.write(f"units: {progress.computed} computed, {progress.failed} of {total} failed", sys.stderr)
        return progress
    except OSError as error:
        raise UsageError(run.folder, f"cannot be written ({error})", RESUME) from error


def compute_missing(run: Run, missing: list[range], factory: ExecutorFactory, capacity: Capacity) -> Iterator[Counts]:
    """Yield what tasks return, in whatever order they end.

    Tasks get smaller as less is left, so that all workers end together. A broken executor does not say which task broke
    it: all that were in flight go to the next one; units that were so `SHARED_BREAKS` times run one at a time.
    """
    queue, pending, breaks = deque(missing), dict[Future[Counts], range](), Counter[int]()
    while queue:
        pool = factory()
        try:
            while queue or pending:
                is_alone = bool(queue) and breaks[queue[0].start] >= SHARED_BREAKS  # such are the first of the queue
                slots = 1 if is_alone else IN_FLIGHT_PER_WORKER * max(capacity(), 1)
                size = 1 if is_alone else min(sum(map(len, queue)) // (2 * slots) + 1, TASK_UNITS)
                while queue and len(pending) < slots:
                    block = queue.popleft()
                    task, rest = block[:size], block[size:]
                    inputs = [run.units[k] for k in task]
                    pending[pool.submit(compute_task, run.work, task.start, inputs, run.folder)] = task
                    queue.extendleft([rest] if rest else [])
                for future in futures.wait(pending, return_when=futures.FIRST_COMPLETED).done:
                    done, failed = read_counts(future)
                    rest = pending.pop(future)[done:]
                    queue.extendleft([rest] if rest else [])
                    yield done, failed
        except BrokenExecutor:
            breaks.update(k for block in pending.values() for k in block)
            queue.extendleft(sorted(pending.values(), key=lambda block: (breaks[block.start], -block.start)))
            if breaks[queue[0].start] == BREAKS:
                yield write_part(run.folder, queue.popleft().start, [{"error": f"its process ended {BREAKS} times"}])
        finally:
            for future in pending:
                future.cancel()
            pool.shutdown(wait=not pending)
            pending.clear()


def read_counts(future: Future[Counts]) -> Counts:
    """Return what a task returned.

    Raises:
        BrokenExecutor: A process was killed, and took the executor or at least this task with it.
        UsageError: The executor is gone, or a worker cannot read the task or write its rows.
    """
    error = futures.CancelledError() if future.cancelled() else future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker":  # Dask's
        raise BrokenExecutor(str(error)) from error
    raise UsageError("executor", f"gave a task up ({error!r})", f"mend that; {RESUME}") from error


@contextmanager
def open_executors(
    scheduler: str | None, workers: int, timeout: float = 30.0
) -> Iterator[tuple[ExecutorFactory | None, int | Capacity]]:
    """Yield what makes executors and how many tasks they run at once: None, for processes of this machine, or Dask's.

    Args:
        scheduler: Address of a Dask cluster, such as ``tcp://host:8786``; None: this machine.
        workers: How many tasks at once; 0: as many as there are processors.
        timeout: How long the cluster may take to answer, s: it may still be starting.

    Raises:
        UsageError: Dask is not installed, or does not answer.
    """
    if scheduler is None:
        yield None, workers
        return
    try:
        from distributed import Client

        client = Client(scheduler, timeout=timeout, set_as_default=False)
    except ImportError as error:
        mend = "pip install gimbal-pin[cluster]"
        raise UsageError("--scheduler", "needs dask[distributed], which is not installed", mend) from error
    except (OSError, ValueError) as error:
        what = f"does not answer ({error})"
        raise UsageError(f"--scheduler {scheduler}", what, "start 'dask scheduler' there") from error
    with client:
        yield partial(client.get_executor, pure=False), workers or (lambda: sum(client.nthreads().values()))


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Processes of this machine, which end with the coordinator, however that ends; `UsageError`: none starts."""
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=end_with_parent)
    try:
        pool.submit(os.getpid).result()
    except BrokenExecutor as error:
        mend = "call this under if __name__ == '__main__', or with one worker"
        raise UsageError("process pool", f"cannot start ({error})", mend) from error
    return pool


def end_with_parent() -> None:
    """Let this process end as soon as its parent has: a killed coordinator leaves no workers behind."""

    def watch() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def compute_task(work: Work, first: int, units: Sequence[Any], folder: str) -> Counts:
    """Compute units for `TASK_SECONDS`, and write their rows: a record without error, or the error that was raised."""
    end, rows = monotonic() + TASK_SECONDS, list[Mapping[str, Value]]()
    with limit_to_one_thread():
        for unit in units:
            try:
                rows.append({"error": None, **work(unit)})
            except FAILURES as error:
                rows.append({"error": f"{type(error).__name__}: {error}"})
            if monotonic() > end:
                break
    return write_part(folder, first, rows)


def write_part(folder: str, first: int, rows: Sequence[Mapping[str, Value]]) -> Counts:
    """Write the rows of units from `first` on, each with its unit's place."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {"unit": range(first, first + len(rows)), **{name: [row.get(name) for row in rows] for name in names}}
    pq.write_table(pa.table(columns), content := BytesIO(), store_schema=False, write_statistics=False)
    write_whole(folder, f"{PARTS}/part-{first:09d}-{first + len(rows) - 1:09d}.parquet", content.getvalue())
    return len(rows), sum(row["error"] is not None for row in rows)


def write_whole(folder: str, name: str, content: bytes) -> None:
    """Put a file into a folder in one step, on whatever system that lies."""
    files, staged = open_folder(folder), f"{PARTS}/{uuid4().hex}"
    files.pipe_file(staged, content)
    files.mv(staged, name)


def open_folder(folder: str) -> DirFileSystem:
    """Return a folder of any file system by its path or URL; `UsageError`: its package is not installed."""
    from fsspec.core import url_to_fs
    from fsspec.implementations.dirfs import DirFileSystem

    try:
        files, place = url_to_fs(folder)
    except (ImportError, ValueError) as error:
        raise UsageError(folder, f"cannot be reached ({error})", "install fsspec's package for it") from error
    return DirFileSystem(place, files)


def list_folder(folder: str) -> list[str]:
    """Return the names in a folder; an object store has no empty ones."""
    try:
        return [path.rpartition("/")[2] for path in open_folder(folder).ls("", detail=False, refresh=True)]
    except FileNotFoundError:
        return []


def check_installed(place: str, *packages: str) -> None:
    """Raise `UsageError` for a package of the extra [fleet] that is missing."""
    for package in packages:
        if find_spec(package) is None:
            raise UsageError(place, f"needs {package}, which is not installed", "pip install gimbal-pin[fleet]")


def shorten_setting(value: object) -> object:
    """Return a number or a text as it is, and the digest of a list or a table."""
    if not isinstance(value, (list, tuple, dict)):
        return value
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def claim_folder(run: Run) -> None:
    """Make the folder, or raise `UsageError` where it holds the results of other settings."""
    files = open_folder(run.folder)
    settings = {**{name: shorten_setting(x) for name, x in run.settings.items()}, "units": len(run.units)}
    try:
        files.makedirs(PARTS, exist_ok=True)
        if not files.exists(RUN):
            if others := {*list_folder(run.folder)} - {PARTS}:
                raise UsageError(run.folder, f"holds {min(others)}, which is of no run", "give an empty folder")
            write_whole(run.folder, RUN, json.dumps({"schema": 1, "settings": settings}, indent=1).encode())
        earlier = dict(json.loads(files.cat_file(RUN))["settings"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UsageError(run.folder, f"cannot be used ({error})", "give another folder") from error
    if other := [key for key in {**settings, **earlier} if earlier.get(key) != settings.get(key)]:
        keys = " and ".join(f"`{key}`" for key in other)
        what = f"holds another run's results: {keys} differ{'s' * (len(other) == 1)}"
        raise UsageError(run.folder, what, "give another folder, or the same settings to go on")


def find_parts(run: Run) -> list[tuple[int, int, str]]:
    """First unit, last unit and name of every part, in the units' order."""
    found = filter(None, map(PART.match, list_folder(f"{run.folder}/{PARTS}")))
    return sorted((int(one[1]), int(one[2]), one[0]) for one in found)


def find_missing(run: Run) -> list[range]:
    """The units whose rows are not there."""
    gaps, stop = list[range](), 0
    for first, last, _ in [*find_parts(run), (len(run.units), 0, "")]:
        gaps.append(range(stop, first))
        stop = max(stop, last + 1)
    return [gap for gap in gaps if gap]


def write_table(run: Run, at_once: int = 500) -> int:
    """Write all parts as one table in the units' order, and return how many rows hold an error.

    So many parts are fetched and joined `at_once`. A unit that two coordinators computed is one row.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if find_missing(run):
        raise UsageError(run.folder, "lacks rows that workers wrote elsewhere", "give a URL that all of them see")
    files, parts, stop = open_folder(f"{run.folder}/{PARTS}"), find_parts(run), 0
    groups = [pa.table({"unit": pa.array([], pa.int64()), "error": pa.array([], pa.string())})]
    for k in range(0, len(parts), at_once):
        contents, tables = files.cat([name for *_, name in parts[k : k + at_once]]), []
        for first, last, name in parts[k : k + at_once]:
            tables.append(pq.ParquetFile(BytesIO(contents[name])).read(use_threads=False).slice(max(stop - first, 0)))
            stop = max(stop, last + 1)
        groups.append(pa.concat_tables(tables, promote_options="permissive").combine_chunks())
    table = pa.concat_tables(groups, promote_options="permissive")
    pq.write_table(table, content := BytesIO())
    write_whole(run.folder, TABLE, content.getvalue())
    if stale := [name for name in list_folder(f"{run.folder}/{PARTS}") if not PART.match(name)]:
        files.rm(stale)  # what killed processes were writing
    return int(len(table) - table["error"].null_count)


def read_table(folder: str) -> DataFrame:
    """Return all rows of a run."""
    import pandas as pd

    return pd.read_parquet(BytesIO(open_folder(folder).cat_file(TABLE)))
