"""Files written whole or not at all, and YAML and JSON of plain values."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gimbal_pin import __version__
from gimbal_pin.errors import UNSAFE, UsageError
from gimbal_pin.rig.reading import LARGEST_TEXT, read_bytes, wrap_read_errors

STAGING_PREFIX = ".gimbal-pin-unfinished-"
"""How the names of the folders begin in which files are written before they take their places."""
_HOST = platform.node()
RUN_FILE = "run.json"
"""File that says which run a folder's files are of."""


@contextmanager
def open_replacement(path: str | Path) -> Iterator[Path]:
    """Yield a new file's path, of the same name; it takes the place of `path` when the block ends without an error.

    A device or pipe cannot be replaced: it is written to after the block, from a file that is whole.

    Raises:
        UsageError: The folder is missing, `path` is a folder, or writing is not allowed.
    """
    with wrap_os_errors(path):
        special = Path(path).exists() and not Path(path).is_file()
        target = Path(path) if special else Path(os.path.realpath(path))
        check_target(target, str(path))
    with _staging(Path(tempfile.gettempdir()) if special else target.parent, path) as staged:
        with wrap_os_errors(path):
            (staged / target.name).touch()
        yield staged / target.name
        with wrap_os_errors(path):
            move_into_place(staged / target.name, target, special)


@contextmanager
def _staging(folder: Path, path: str | Path) -> Iterator[Path]:
    """Yield a new hidden folder in `folder` to write files into, gone after the block.

    Its name holds the host and the process: those of this host's killed processes are removed first.

    `path`: what an error names.
    """
    with wrap_os_errors(path):
        for left in folder.glob(f"{STAGING_PREFIX}{_HOST}-*"):
            if not left.is_symlink() and not _is_alive(left.name.split("-")[-2]):
                shutil.rmtree(left, ignore_errors=True)
        made = tempfile.mkdtemp(prefix=f"{STAGING_PREFIX}{_HOST}-{os.getpid()}-", dir=folder)
    try:
        yield Path(made)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _is_alive(process: str) -> bool:
    """Whether a process of this number runs; so it does for a name that holds none."""
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except (ValueError, OverflowError, PermissionError):
        return True
    return True


def write_run(
    path: str | Path, writers: Mapping[str, Callable[[Path], object]], run: Mapping[str, object]
) -> tuple[str, ...]:
    """Write the files of one run into a folder, and beside them `RUN_FILE`, which lists them.

    Each is written whole before the first takes its place. `RUN_FILE` is removed first and written last: a folder where
    it agrees with the files holds one run's, whenever a run is killed. Files that an earlier one lists and this run
    does not write are removed, unless they have changed since.

    Args:
        path: The folder; made if it is not there.
        writers: Name → what writes that file to a path.
        run: What it says beside schema, version, time (UTC) and each file's SHA-256: the verb and its arguments.

    Returns:
        A sentence for each file of an earlier run that stays because it was changed.

    Raises:
        UsageError: The folder or one of the files in it cannot be written.
    """
    folder = make_folder(path).resolve()
    for name in (*writers, RUN_FILE):
        with wrap_os_errors(folder / name):
            check_target(folder / name, str(folder / name))
    with _staging(folder, path) as staged:
        for name, write in writers.items():
            write(staged / name)
        files = {name: hash_file(staged / name) for name in writers}
        about = {
            "schema": 1,
            **run,
            "version": __version__,
            "time": datetime.now(timezone.utc).isoformat(),
        }
        write_json({**about, "files": files}, staged / RUN_FILE)
        with wrap_os_errors(path):
            older = {name: found for name, found in read_run(folder).items() if name not in writers}
            changed = [
                name for name, found in older.items() if hash_file(folder / name) not in (found, "")
            ]
            for name in (RUN_FILE, *(older.keys() - set(changed))):
                (folder / name).unlink(missing_ok=True)
            for name in (*writers, RUN_FILE):
                move_into_place(staged / name, folder / name)
    return tuple(
        f"{folder / name} is of an earlier run, but was changed since: it stays" for name in changed
    )


def read_run(folder: Path) -> Mapping[str, str]:
    """Return name → SHA-256 of the files that a folder's `RUN_FILE` lists; none where there is no such file of ours."""
    try:
        found = json.loads(read_bytes(folder / RUN_FILE, most=LARGEST_TEXT))["files"]
        return {
            name: str(of)
            for name, of in found.items()
            if Path(name).name == name and name != RUN_FILE
        }
    except (UsageError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}


def hash_file(path: Path) -> str:
    """Return a regular file's SHA-256 in hexadecimal, "" where there is none; `UsageError` if it cannot be read."""
    if path.is_symlink() or not os.path.isfile(path):
        return ""
    with wrap_read_errors(path, UsageError), path.open("rb") as file:
        found = hashlib.sha256()
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()


def check_target(target: Path, place: str) -> None:
    """Raise `UsageError` unless a file can be put at `target`."""
    if target.is_dir():
        raise UsageError(place, "is a folder", "name a file in it")
    if not target.parent.is_dir():
        raise UsageError(
            place,
            f"lies in a folder that does not exist ({target.parent})",
            "create the folder first",
        )
    if target.exists() and not os.access(target, os.W_OK):
        raise UsageError(place, "is write-protected", "name another file")


def check_folder(folder: Path, place: str) -> None:
    """Raise `UsageError` unless `folder` is one that can be written to, or can be made."""
    there = next(one for one in (folder, *folder.absolute().parents) if os.path.lexists(one))
    if not there.is_dir():
        raise UsageError(
            place, f"would be a folder where {there.name} is a file", "name another place"
        )
    if not os.access(there, os.W_OK | os.X_OK):
        raise UsageError(place, "is write-protected", "name another folder")


def check_run(folder: Path, files: Iterable[Path], place: str) -> None:
    """Raise `UsageError` if a run cannot be put into a folder, or would replace one of `files` that is no run's."""
    check_folder(folder, place)
    ours = read_run(folder)
    mend = "name another folder, or move it"
    for file in files:
        if file.name == RUN_FILE or not os.path.lexists(file):
            continue
        if file.name not in ours:
            raise UsageError(place, f"holds {file.name}, which is of no earlier run", mend)
        if hash_file(file) != ours[file.name]:
            raise UsageError(
                place, f"holds {file.name}, which was changed after the run that wrote it", mend
            )


def move_into_place(temporary: Path, target: Path, special: bool = False) -> None:
    """Move `temporary` to `target`, which keeps its access rights; a special file is written through."""
    if special:
        with temporary.open("rb") as source, target.open("wb") as sink:
            shutil.copyfileobj(source, sink)
        return
    if target.exists():
        shutil.copymode(target, temporary)
    os.replace(temporary, target)


@contextmanager
def wrap_os_errors(path: str | Path) -> Iterator[None]:
    """Turn the operating system's refusal to write `path` into a `UsageError`."""
    try:
        yield
    except OSError as error:
        raise UsageError(
            str(path), f"cannot be written ({error.strerror})", "choose a place that can"
        ) from error


def atomic_write(path: str | Path, content: str | bytes) -> None:
    """Write a whole file or nothing; text as UTF-8 with line feeds. Raises `UsageError` like `open_replacement`.

    What UTF-8 has no bytes for (a file's name may hold it) is written out as its code.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    with open_replacement(path) as temporary, wrap_os_errors(path):
        temporary.write_bytes(data)


def make_folder(path: str | Path) -> Path:
    """Create the folder that a verb's ``-o DIR`` names, parents included, and return it; `UsageError` if that fails."""
    folder = Path(path)
    with wrap_os_errors(path):
        check_folder(folder, str(path))
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_yaml(value: object, path: str | Path) -> None:
    """Write `to_plain(value)` as YAML, keys in the order given, numbers exact: `read_yaml` returns what was written."""
    text = yaml.safe_dump(
        to_plain(value), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120
    )
    atomic_write(path, text)


def to_json(value: object, indent: int | None = 2) -> str:
    """Return `to_plain(value)` as JSON text, keys in the order given; NaN and infinities, which JSON lacks, are null.

    Without an indent it is one line. What a terminal would obey is escaped as JSON does it.
    """
    text = (
        json.dumps(to_plain(value, finite=True), indent=indent, ensure_ascii=False, allow_nan=False)
        + "\n"
    )
    return UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def write_json(value: object, path: str | Path) -> None:
    """Write `to_json(value)` to a file."""
    atomic_write(path, to_json(value))


def to_plain(value: object, *, finite: bool = False) -> Any:
    """Return `value` in Python's own scalars, lists and dictionaries; NumPy's scalars and arrays become these.

    `finite`: whether NaN and infinities become None.

    Raises:
        TypeError: Something else is inside.
    """
    if isinstance(value, (np.generic, np.ndarray)):
        return to_plain(value.tolist(), finite=finite)
    if isinstance(value, Mapping):
        if keys := [key for key in value if not isinstance(key, str)]:
            raise TypeError(f"key {keys[0]!r} is no text")
        return {str(key): to_plain(entry, finite=finite) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(entry, finite=finite) for entry in value]
    if isinstance(value, (str, Path)):
        return (
            str(value).encode("utf-8", "backslashreplace").decode()
        )  # a file's name may hold what is no character
    if isinstance(value, float) and finite and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float)):
        return value
    raise TypeError(f"{type(value).__name__} has no plain form")
