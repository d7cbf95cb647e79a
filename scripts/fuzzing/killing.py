"""Kills verbs while they work and write over an older result: that stays whole, or the new one is.

What a file or folder holds afterwards is held against what two undisturbed runs leave. A folder is whole if its
``run.json`` lists what is there, with the right sums: it may be of the old run or of the new one, not of both. One
whose files were being replaced has no ``run.json``, and so says itself that it is not whole.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from fuzzing import seeds
from fuzzing.workers import FORK, Main, alone

VERBS: Mapping[str, tuple[str, ...]] = {
    "identify": ("identify", "turret", "log.csv", "-o", "out.yaml"),
    "diagnose": ("diagnose", "turret", "log.csv", "-o", "out"),
    "auto": ("auto", "turret", "log.csv", "-o", "out", "--plants", "2"),
}
"""Verb → a call that writes one file, or a folder."""
RUN = "run.json"
POLL = 1e-4
"""Time between two looks at the folder, s: a rename takes some ten microseconds."""
TIMES: Mapping[str, float] = {"anywhere": 0.4, "while it writes": 0.3, "while it replaces": 0.3}
"""How the moments are drawn, and their shares: over the whole run; from the first file that it touches to its end; just
after the old result is touched."""
JUST = 2e-3
"""That long after, s: some ten renames."""

CLEANED = 3
"""Kills after which the next run is looked at: it takes as long as any, and removes what the killed one left."""
CUT_OFF = f"no {RUN}: cut off while it replaced files"
WHOLE = ("the old result", "the new result", CUT_OFF)

Files = Mapping[str, str]
"""Name → SHA-256."""


@dataclass(frozen=True)
class Undisturbed:
    """A run that nobody kills.

    Attributes:
        result: What it leaves.
        seconds: How long it takes, s.
        writing: When it touches the first file, s.
    """

    result: Files
    seconds: float
    writing: float


def killed(main: Main, count: int, seed: int, folder: Path) -> int:
    """Kill every verb so many times; print a line each, and return the exit code."""
    place = folder / "killed"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    alone(lambda: logged(place))
    ends = run(main, VERBS, count, seed, place)
    for verb, left in ends.items():
        print(f"{verb:10}" + "; ".join(f"{end}: {times}" for end, times in sorted(Counter(left).items())))
    failed = sum(end not in WHOLE for left in ends.values() for end in left)
    print(f"{count * len(ends) - failed} passed, {failed} failed")
    return int(failed > 0)


def run(
    main: Main, verbs: Mapping[str, tuple[str, ...]], count: int, seed: int, place: Path
) -> Mapping[str, Sequence[str]]:
    """Return what each kill of each verb left; `place` holds the logs ``log.csv`` and ``older.csv``."""
    rng = np.random.default_rng(seed)
    with tqdm(total=count * len(verbs), unit="kill", disable=None) as bar:
        return {verb: list(outcomes(main, words, count, rng, place, bar)) for verb, words in verbs.items()}


def logged(place: Path) -> None:
    """Simulate the log, and one of another motion for the older result."""
    os.chdir(place)
    for name, number in (("log.csv", "1"), ("older.csv", "2")):
        seeds.called("simulate", "turret", "-o", "full.csv", "--seconds", "14", "--seed", number)
        seeds.thinned("full.csv", name, 4)
    Path("full.csv").unlink()


def outcomes(
    main: Main, words: Sequence[str], count: int, rng: np.random.Generator, place: Path, bar: Any
) -> Iterator[str]:
    """Yield what each of so many kills of a verb leaves; where that is not whole, its folder is kept."""
    work, target = place / words[0], words[-1]
    (work / "old").mkdir(parents=True)
    older = [str(place / "older.csv") if word == "log.csv" else word for word in words]
    newer = [str(place / "log.csv") if word == "log.csv" else word for word in words]
    old = undisturbed(main, older, work / "old", target)
    new = undisturbed(main, newer, fresh(work / "old", work / "new"), target)
    inputs, looked = sums(place), 0
    for number in range(count):
        folder = fresh(work / "old", work / "run")
        kind = str(rng.choice(list(TIMES), p=list(TIMES.values())))
        when = kill(main, newer, folder, target, kind, new, rng)
        end = found(folder, target, old.result, new.result) if sums(place) == inputs else "an input is changed"
        if end in WHOLE[:2] and looked < CLEANED and (hidden := left(folder)):
            looked += 1
            end = cleaned(main, newer, folder, target, hidden) or end
        if end not in WHOLE:
            kept = place / "failures" / f"{words[0]}-{number}"
            shutil.copytree(folder, kept)
            (kept / "failure.txt").write_text(f"{shlex.join(newer)}\n{kind}, {when:.4f} s\n{end}\n", encoding="utf-8")
        bar.update()
        yield end


def cleaned(main: Main, words: Sequence[str], folder: Path, target: str, hidden: Sequence[str]) -> str:
    """Return what the next run leaves of what a killed one left, or nothing."""
    undisturbed(main, words, folder, target)
    still = sorted(set(hidden) & set(left(folder)))
    return f"the next run leaves {still[0]}" if still else ""


def fresh(source: Path, target: Path) -> Path:
    """Return a copy of the folder with the old result, its times included."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target)
    return target


def undisturbed(main: Main, words: Sequence[str], folder: Path, target: str) -> Undisturbed:
    """Run a verb in a folder to its end, and look when it begins to write."""
    start, before, writing = time.monotonic(), state(folder, target), None
    process = started(main, words, folder)
    while process.is_alive():
        if writing is None and state(folder, target) != before:
            writing = time.monotonic() - start
        time.sleep(POLL)
    seconds = time.monotonic() - start
    if process.exitcode != 0:
        raise RuntimeError(f"gimbal-pin {shlex.join(words)} left with {process.exitcode}")
    return Undisturbed(sums(folder / target), seconds, seconds if writing is None else writing)


def kill(
    main: Main, words: Sequence[str], folder: Path, target: str, kind: str, usual: Undisturbed, rng: np.random.Generator
) -> float:
    """Start a verb, kill it at a moment of a kind, and return when that was."""
    start, before = time.monotonic(), state(folder, target)
    process = started(main, words, folder)
    if kind == "anywhere":
        wait_until(start + rng.uniform(0, usual.seconds), process)
    else:
        at = 0 if kind == "while it writes" else 1
        length = max(usual.seconds - usual.writing, JUST) if at == 0 else JUST
        while process.is_alive() and state(folder, target)[at] == before[at]:
            time.sleep(POLL if at == 0 else 0)
        wait_until(time.monotonic() + rng.uniform(0, length), process)
    when = time.monotonic() - start
    if process.is_alive():
        os.kill(process.pid, signal.SIGKILL)
    process.join()
    return when


def wait_until(moment: float, process: Any) -> None:
    """Wait for a moment, or for the process's end."""
    while process.is_alive() and time.monotonic() < moment:
        time.sleep(min(POLL, max(0.0, moment - time.monotonic())))


def started(main: Main, words: Sequence[str], folder: Path) -> Any:
    """Fork a verb, whose words nobody reads."""

    def work() -> None:
        os.chdir(folder)
        null = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(null, number)
        main(words)

    process = FORK.Process(target=work)
    process.start()
    return process


def state(folder: Path, target: str) -> tuple[Any, Any]:
    """Return what shows that something is written: names in the folder, and which files are the old result."""
    place = folder / target
    names = frozenset(os.listdir(folder)) | (frozenset(os.listdir(place)) if place.is_dir() else frozenset())
    if place.is_dir():
        with os.scandir(place) as entries:
            return names, frozenset((entry.name, entry.inode()) for entry in entries if visible(entry.name))
    try:
        found = place.stat()
    except FileNotFoundError:
        return names, None
    return names, (found.st_ino, found.st_mtime_ns)


def visible(name: str) -> bool:
    """Whether a file is a result."""
    return not name.startswith(".")


def sums(place: Path) -> Files:
    """Return the SHA-256 of a file, or of every visible file in a folder."""
    files = [place] if place.is_file() else [path for path in place.iterdir() if path.is_file() and visible(path.name)]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files} if place.exists() else {}


def left(folder: Path) -> list[str]:
    """Return the hidden files and folders of killed runs."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob(".*"))


def found(folder: Path, target: str, old: Files, new: Files) -> str:
    """Say which result is there, or what is wrong with it."""
    now = sums(folder / target)
    if not (folder / target).is_dir():
        return "the old result" if now == old else "the new result" if now == new else "a damaged file"
    if RUN not in now:
        return CUT_OFF
    listed = json.loads((folder / target / RUN).read_bytes())["files"]
    if listed != without(now):
        return f"{RUN} does not list what is there"
    # Its time of writing makes the new run.json another one each time; the other files' sums may hold such times, too.
    return "the old result" if now == old else "the new result" if now.keys() == new.keys() else "files of neither run"


def without(files: Files) -> Files:
    """Return the files but the list of them."""
    return {name: found for name, found in files.items() if name != RUN}
