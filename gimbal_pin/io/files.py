"""Files written whole or not at all, and YAML and JSON of plain values."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import yaml

from gimbal_pin.errors import UsageError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a new file's path in the folder of `path`; it takes that name when the block ends without an error.

    The yielded path keeps the suffix, for writers that choose a format by it. A device or pipe cannot be replaced: it
    is written to after the block, from a file that is whole.

    Raises:
        UsageError: The folder is missing, `path` is a folder, or writing is not allowed.
    """
    special = Path(path).exists() and not Path(path).is_file()
    target = Path(path) if special else Path(os.path.realpath(path))
    check_target(target, str(path))
    folder = Path(tempfile.gettempdir()) if special else target.parent
    temporary = folder / f".{uuid4().hex[:12]}{target.suffix}"
    try:
        with told(path):
            temporary.open("xb").close()
        yield temporary
        with told(path):
            put(temporary, target, special)
    finally:
        temporary.unlink(missing_ok=True)


def check_target(target: Path, place: str) -> None:
    """Raise `UsageError` unless a file can be put at `target`."""
    if target.is_dir():
        raise UsageError(place, "is a folder", "name a file in it")
    if not target.parent.is_dir():
        raise UsageError(place, f"lies in a folder that does not exist ({target.parent})", "create the folder first")
    if target.exists() and not os.access(target, os.W_OK):
        raise UsageError(place, "is write-protected", "name another file")


def put(temporary: Path, target: Path, special: bool) -> None:
    """Move `temporary` to `target`, which keeps its access rights; a special file is written through."""
    if special:
        with temporary.open("rb") as source, target.open("wb") as sink:
            shutil.copyfileobj(source, sink)
        return
    if target.exists():
        shutil.copymode(target, temporary)
    os.replace(temporary, target)


@contextmanager
def told(path: str | Path) -> Iterator[None]:
    """Turn the operating system's refusal to write `path` into a `UsageError`."""
    try:
        yield
    except OSError as error:
        raise UsageError(str(path), f"cannot be written ({error.strerror})", "choose a place that can") from error


def atomic_write(path: str | Path, content: str | bytes) -> None:
    """Write a whole file or nothing; text as UTF-8 with line feeds. Raises `UsageError` like `replacing`."""
    with replacing(path) as temporary, told(path):
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


def output_folder(path: str | Path) -> Path:
    """Create the folder that a verb's ``-o DIR`` names, parents included, and return it; `UsageError` if that fails."""
    folder = Path(path)
    if folder.exists() and not folder.is_dir():
        raise UsageError(str(path), "is a file, not a folder", "name a folder")
    with told(path):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_yaml(value: object, path: str | Path) -> None:
    """Write `plain(value)` as YAML, keys in the order given, numbers exact (`read_yaml` returns what was written)."""
    text = yaml.safe_dump(plain(value), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120)
    atomic_write(path, text)


def to_json(value: object, indent: int | None = 2) -> str:
    """Return `plain(value)` as JSON text, keys in the order given; NaN and infinities, which JSON lacks, are null.

    Without an indent it is one line.
    """
    return json.dumps(finite(plain(value)), indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def write_json(value: object, path: str | Path) -> None:
    """Write `to_json(value)` to a file."""
    atomic_write(path, to_json(value))


def plain(value: object) -> Any:
    """Return `value` in Python's own scalars, lists and dictionaries; NumPy's scalars and arrays become these.

    Raises:
        TypeError: Something else is inside.
    """
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {plain_key(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (str, Path)):
        return str(value)
    if value is None or isinstance(value, (bool, int, float)):
        return value
    raise TypeError(f"{type(value).__name__} has no plain form")


def plain_key(key: object) -> str:
    """Return a mapping's key, which must be a text."""
    if not isinstance(key, str):
        raise TypeError(f"key {key!r} is no text")
    return str(key)


def finite(value: Any) -> Any:
    """Return plain values with every NaN or infinity replaced by None."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
