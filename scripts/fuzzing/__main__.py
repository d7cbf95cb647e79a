"""Give every reader and every option hostile input, and see that only the package's own errors come out.

Each case is drawn from (seed, reader, number) alone: ``--only log:17 --seed 1`` runs that one and prints all that came
of it. Results and failures stand in the folder; with ``--resume`` a run that was stopped goes on. ``--kill 20`` kills
verbs while they write instead. The last line is ``N passed, N failed``; the exit code is 1 if any failed.
"""

from __future__ import annotations

import importlib
import itertools
import json as json_format
import pkgutil
import sys
import time
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro
from tqdm import tqdm

from fuzzing import seeds as valid
from fuzzing import table
from fuzzing.case import Place
from fuzzing.cases import APART, FEWER, READERS, Drawn
from fuzzing.kept import Kept, command
from fuzzing.laws import SECONDS, WAITING, failures
from fuzzing.running import bounded, ran, watched
from fuzzing.workers import Draw, Main, alone, results, shared

LATER = (
    "control",
    "matplotlib.figure",
    "pandas",
    "pyarrow.parquet",
    "scipy.optimize",
    "scipy.signal",
    "scipy.interpolate",
    "yourdfpy",
    "lxml.etree",
    "scipy.io",
    "lxml.html",
)
"""What the verbs import when they need it: here before the processes are forked, so that none of them waits for it."""


def main(
    readers: tuple[str, ...] = tuple(READERS),
    count: int = 1000,
    first: int = 0,
    seed: int = 1,
    workers: int = 2,
    minutes: float | None = None,
    folder: Path = Path("fuzz-results"),
    resume: bool = False,
    only: str | None = None,
    kill: int = 0,
    json: Path | None = None,
) -> None:
    """Run the cases that are missing and print the table.

    Args:
        readers: What is read: a reader's name, or options.
        count: Most cases of each; a twenty-fifth of those read in a process of their own.
        first: Number of the first.
        seed: Seed of all of them.
        workers: Processes.
        minutes: End after so long, shared evenly by the readers; that a reader had no case is a failure.
        folder: Where results and failures are kept.
        resume: Go on with what is in the folder; otherwise begin anew.
        only: READER:NUMBER of one case, of which everything is printed.
        kill: Kill identify, diagnose and auto so many times each, instead.
        json: Write the table and the failures as JSON.
    """
    gimbal_pin = loaded()
    folder.mkdir(parents=True, exist_ok=True)
    if kill:
        from fuzzing.killing import killed

        raise SystemExit(killed(gimbal_pin, kill, seed, folder.resolve()))
    with TemporaryDirectory() as place:
        corpus = Path(place) / "valid"
        corpus.mkdir()
        alone(lambda: valid.made(corpus))
        draw = Drawn(valid.read(corpus))
        if only is not None:
            reader, _, number = only.partition(":")
            raise SystemExit(shown(Place(seed, reader, int(number)), draw, gimbal_pin, folder.resolve() / "only"))
        kept = Kept(folder, seed, draw, resume)
        numbers = range(first, first + count)
        wanted = [Place(seed, r, k) for k in numbers for r in readers if r not in APART or k % FEWER == 0]
        run(kept, [one for one in wanted if one not in kept.done], draw, gimbal_pin, workers, minutes, Path(place))
    found = [kept.done[one] for one in wanted if one in kept.done]
    print(table.text(found))
    failed, missing = sum(bool(result.failures) for result in found), len(wanted) - len(found)
    unread = sorted({one.reader for one in wanted} - {result.place.reader for result in found})
    if json is not None:
        counts = {"cases": len(wanted), "failed": failed, "not_run": missing}
        content = {"schema": 1, "seed": seed, "readers": readers, **counts, "distinct": table.distinct(found)}
        json.write_text(json_format.dumps(content, indent=1) + "\n", encoding="utf-8")
    if missing:
        print(f"{missing} of {len(wanted)} cases were left out after {minutes:g} minutes")
    if unread:
        print(f"no case of: {', '.join(unread)}; give more minutes")
    print(f"{len(found) - failed} passed, {failed + len(unread)} failed")
    raise SystemExit(bool(failed or unread))


def run(
    kept: Kept, places: list[Place], draw: Draw, main: Main, workers: int, minutes: float | None, folder: Path
) -> None:
    """Run cases until all are done or the time is over."""
    end = time.monotonic() + (60 * minutes if minutes is not None else float("inf"))
    spent = defaultdict[str, float](float)
    timely = itertools.takewhile(lambda _: time.monotonic() < end, shared(places, spent))
    for result in tqdm(results(timely, draw, main, workers, folder), total=len(places), unit="case", disable=None):
        spent[result.place.reader] += result.seconds
        kept.add(result)


def shown(place: Place, draw: Draw, main: Main, folder: Path) -> int:
    """Run one case in this process, under the limits of a campaign, and print everything; its files stay."""
    bounded()
    case = draw(place)
    folder.parent.mkdir(parents=True, exist_ok=True)
    trace = folder.parent / ".trace"
    with watched(6 * SECONDS, 2 * WAITING, trace):
        plain = ran(main, case.plain, folder) if case.plain is not None else None
        run = ran(main, case, folder)
    trace.unlink()
    print(f"cd {folder}; {command(case)}\nexit code {run.code} after {run.seconds:.2f} s")
    for name, stream in (("standard output", run.out), ("standard error", run.err)):
        print(f"--- {name}\n{stream.decode(errors='replace')[:4000]!r}" if stream else f"--- {name}: nothing")
    if run.trace:
        print(run.trace)
    wrong = failures(run, case.code, plain)
    for failure in wrong:
        print(f"FAILED {failure.kind}: {failure.signature}")
    print(f"{int(not wrong)} passed, {int(bool(wrong))} failed")
    return int(bool(wrong))


def loaded() -> Main:
    """Return the command line, with all that it may import already imported."""
    import gimbal_pin
    from gimbal_pin.cli import main

    for module in pkgutil.walk_packages(gimbal_pin.__path__, "gimbal_pin."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in LATER:
        importlib.import_module(name)
    return main


if __name__ == "__main__":
    tqdm.monitor_interval = 0  # its thread would be there when processes are forked
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    tyro.cli(main, prog="scripts/fuzz", description=__doc__)
