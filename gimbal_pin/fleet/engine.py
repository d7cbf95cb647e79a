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
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent import futures
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from shutil import get_terminal_size
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.errors import GimbalPinError, UsageError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem
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
"""Broken executors after which a task runs alone, and after which its unit is a row with that error."""
RESUME = "the same call goes on with what is missing"
FAILURES = (
    GimbalPinError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
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


class UnitRange(NamedTuple):
    """Units `first` to ``stop - 1``, and in how many executors that broke they were in flight."""

    first: int
    stop: int
    breaks: int = 0

    def split(self, count: int) -> list[UnitRange]:
        """The first `count` units and the others, each if there are any."""
        middle = min(self.first + count, self.stop)
        return [UnitRange(a, b, self.breaks) for a, b in ((self.first, middle), (middle, self.stop)) if a < b]


class Progress(NamedTuple):
    """Units that were there before, were computed now, and of all the rows how many hold an error."""

    found: int
    computed: int
    failed: int


def compute_table(
    work: Work,
    units: Sequence[Any],
    settings: Mapping[str, object],
    folder: str | None = None,
    executor: ExecutorFactory | None = None,
    workers: int | Capacity = 0,
    quiet: bool = True,
) -> DataFrame:
    """Return all rows of a `Run` after `run_units`; its folder is None where nothing is kept."""
    with TemporaryDirectory(prefix="gimbal-pin-") if folder is None else nullcontext(folder) as place:
        run_units(Run(work, units, place, settings), executor, workers=workers, quiet=quiet)
        return read_table(place)


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
    found = total - sum(block.stop - block.first for block in missing)
    show = partial(tqdm, total=total, initial=found, desc="units", unit="unit", miniters=1, disable=quiet or None)
    columns, lines = get_terminal_size()  # tqdm shows nothing in a terminal that states a size of 0 by 0
    bar = show(ncols=columns, nrows=lines)
    is_written = bar.disable and not quiet and sys.stderr is not None
    try:
        with bar:
            if is_written and found:
                tqdm.write(f"units: {found} of {total} were there", sys.stderr)
            for done, errors in compute(run, missing, executor, capacity):
                failed += errors
                bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
                bar.update(done)
        progress = Progress(found, total - found, write_table(run))
        if is_written:
            tqdm.write(f"units: {progress.computed} computed, {progress.failed} of {total} failed", sys.stderr)
        return progress
    except OSError as error:
        raise UsageError(run.folder, f"cannot be written ({error})", RESUME) from error


def compute(run: Run, missing: list[UnitRange], factory: ExecutorFactory, capacity: Capacity) -> Iterator[Counts]:
    """Yield what tasks return, in whatever order they end.

    Tasks get smaller as less is left, so that all workers end together. A broken executor does not say which task broke
    it: all that were in flight go to the next one; units that were so `SHARED_BREAKS` times run one at a time.
    """
    queue, pending = deque(missing), dict[Future[Counts], UnitRange]()
    while queue:
        pool = factory()
        try:
            while queue or pending:
                is_alone = bool(queue) and queue[0].breaks >= SHARED_BREAKS  # such blocks are the first of the queue
                slots = 1 if is_alone else IN_FLIGHT_PER_WORKER * max(capacity(), 1)
                size = sum(block.stop - block.first for block in queue) // (2 * slots) + 1
                while queue and len(pending) < slots:
                    block, *rest = queue[0].split(1 if is_alone else min(size, TASK_UNITS))
                    inputs = [run.units[k] for k in range(block.first, block.stop)]
                    pending[pool.submit(compute_task, run.work, block.first, inputs, run.folder)] = block
                    queue.popleft()
                    queue.extendleft(rest)
                for future in futures.wait(pending, return_when=futures.FIRST_COMPLETED).done:
                    done, failed = read_counts(future)
                    queue.extendleft(pending.pop(future).split(done)[1:])
                    yield done, failed
        except BrokenExecutor:
            for block in sorted(pending.values(), key=lambda block: (block.breaks, -block.first)):
                queue.appendleft(block._replace(breaks=block.breaks + 1))
            if queue[0].breaks == BREAKS:
                yield write_part(run.folder, queue.popleft().first, [{"error": f"its process ended {BREAKS} times"}])
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
def dask_executors(address: str, timeout: float = 30.0) -> Iterator[tuple[ExecutorFactory, Capacity]]:
    """Executors of the Dask cluster at an address such as ``tcp://host:8786``, and how many tasks it runs at once.

    Raises:
        UsageError: Dask is not installed, or nothing answers there within `timeout`, s: it may still be starting.
    """
    try:
        from distributed import Client
    except ImportError as error:
        mend = "pip install gimbal-pin[cluster]"
        raise UsageError("--scheduler", "needs dask[distributed], which is not installed", mend) from error
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError) as error:
        what = f"does not answer ({error})"
        raise UsageError(f"--scheduler {address}", what, "start 'dask scheduler' there") from error
    with client:
        yield partial(client.get_executor, pure=False), lambda: sum(client.nthreads().values())


@contextmanager
def open_executors(scheduler: str | None, workers: int) -> Iterator[tuple[ExecutorFactory | None, int | Capacity]]:
    """Yield what runs units, see `dask_executors`, None for processes of this machine, and how many at once."""
    if scheduler is None:
        yield None, workers
        return
    with dask_executors(scheduler) as (factory, capacity):
        yield factory, workers or capacity


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
    """Compute units for `TASK_SECONDS`, and write their rows."""
    end, rows = monotonic() + TASK_SECONDS, []
    with limit_to_one_thread():
        for unit in units:
            rows.append(compute_unit(work, unit))
            if monotonic() > end:
                break
    return write_part(folder, first, rows)


def compute_unit(work: Work, unit: Any) -> Mapping[str, Value]:
    """The unit's record, with its `error` or None, or `error` alone where it raises."""
    try:
        return {"error": None, **work(unit)}
    except FAILURES as error:
        return {"error": f"{type(error).__name__}: {error}"}


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
    files, place = file_system(folder)
    staged = f"{place}/{PARTS}/{uuid4().hex}"
    files.pipe_file(staged, content)
    files.mv(staged, f"{place}/{name}")


def file_system(path: str) -> tuple[AbstractFileSystem, str]:
    """The file system that holds a path or URL, and the path in it; `UsageError`: its package is not installed."""
    from fsspec.core import url_to_fs

    try:
        files, place = url_to_fs(path)
    except (ImportError, ValueError) as error:
        raise UsageError(path, f"cannot be reached ({error})", "install fsspec's package for it") from error
    return files, str(place)


def list_folder(folder: str) -> list[str]:
    """Return the paths in a folder; an object store has no empty ones."""
    files, place = file_system(folder)
    try:
        return list(files.ls(place, detail=False, refresh=True))
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
    files, place = file_system(run.folder)
    settings = {**{name: shorten_setting(x) for name, x in run.settings.items()}, "units": len(run.units)}
    try:
        files.makedirs(f"{place}/{PARTS}", exist_ok=True)
        if not files.exists(f"{place}/{RUN}"):
            if others := {name.rsplit("/", 1)[-1] for name in list_folder(run.folder)} - {PARTS}:
                raise UsageError(run.folder, f"holds {min(others)}, which is of no run", "give an empty folder")
            write_whole(run.folder, RUN, json.dumps({"schema": 1, "settings": settings}, indent=1).encode())
        earlier = dict(json.loads(files.cat_file(f"{place}/{RUN}"))["settings"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UsageError(run.folder, f"cannot be used ({error})", "give another folder") from error
    if other := [key for key in {**settings, **earlier} if earlier.get(key) != settings.get(key)]:
        keys = " and ".join(f"`{key}`" for key in other)
        what = f"holds another run's results: {keys} differ{'s' * (len(other) == 1)}"
        raise UsageError(run.folder, what, "give another folder, or the same settings to go on")


def find_parts(run: Run) -> list[tuple[int, int, str]]:
    """First unit, last unit and path of every part, in the units' order."""
    names = ((PART.search(path), path) for path in list_folder(f"{run.folder}/{PARTS}"))
    return sorted((int(name[1]), int(name[2]), path) for name, path in names if name)


def find_missing(run: Run) -> list[UnitRange]:
    """The units whose rows are not there."""
    gaps, stop = [], 0
    for first, last, _ in [*find_parts(run), (len(run.units), 0, "")]:
        if first > stop:
            gaps.append(UnitRange(stop, first))
        stop = max(stop, last + 1)
    return gaps


def write_table(run: Run, at_once: int = 500) -> int:
    """Write all parts as one table in the units' order, and return how many rows hold an error.

    So many parts `at_once` become a row group in a file of this machine, since only after the last one all columns are
    known. A unit that two coordinators computed is one row.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if find_missing(run):
        raise UsageError(run.folder, "lacks rows that workers wrote elsewhere", "give a URL that all of them see")
    files, place = file_system(run.folder)
    schema = pa.schema([("unit", pa.int64()), ("error", pa.string())])
    parts, groups, stop, failed = find_parts(run), [], 0, 0
    with TemporaryDirectory(prefix="gimbal-pin-") as own:
        for k in range(0, len(parts), at_once):
            merged, tables = parts[k : k + at_once], []
            contents = files.cat([path for *_, path in merged])
            for first, last, path in merged:
                rows = pq.ParquetFile(BytesIO(contents[path])).read(use_threads=False)
                tables.append(rows.slice(max(stop - first, 0)))
                stop = max(stop, last + 1)
            rows = pa.concat_tables([schema.empty_table(), *tables], promote_options="permissive")
            schema, failed = rows.schema, failed + len(rows) - rows["error"].null_count
            groups.append(f"{own}/{k}")
            pq.write_table(rows, groups[-1])
        with pq.ParquetWriter(f"{own}/{TABLE}", schema) as writer:
            for group in groups:
                rows = [schema.empty_table(), pq.read_table(group)]
                writer.write_table(pa.concat_tables(rows, promote_options="permissive"))
        staged = f"{place}/{PARTS}/{uuid4().hex}"
        files.put_file(f"{own}/{TABLE}", staged)
    files.mv(staged, f"{place}/{TABLE}")
    if stale := [path for path in list_folder(f"{run.folder}/{PARTS}") if not PART.search(path)]:
        files.rm(stale)  # what killed processes were writing
    return failed


def read_table(folder: str) -> DataFrame:
    """Return all rows of a run."""
    import pandas as pd

    files, path = file_system(f"{folder}/{TABLE}")
    with files.open(path, "rb") as source:
        return pd.read_parquet(source)
