"""Files as bytes and as plain YAML values, with errors that name the file and the line."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from gimbal_pin.errors import GimbalPinError, UsageError

_MOST_VALUES = 400_000
"""Most values in a YAML file, aliases counted by what they stand for: twelve payloads' models of a rig of 20 joints,
each with the covariance of 176 parameters. They are read in 5 s."""
LARGEST_LOG = 2**30
"""Most bytes of a log, unpacked: 0.7 GB are an hour of three joints at 1 kHz as text of 17 digits."""
LARGEST_TEXT = 16 * 2**20
"""Largest YAML or URDF, bytes: twice what so many numbers of 20 digits take."""
_DEEPEST = 32
"""Deepest nesting of a YAML file; what the package writes has 6."""
LONGEST_NUMBER = 64
"""Most characters of a number, boolean or null; 17 digits distinguish all doubles."""
_DECIMAL = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?0*\d{1,2})?", re.ASCII)
"""A decimal number that every reader takes for the same double; with a third digit in the exponent some overflow."""
_WORD_PATTERN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\d_]+")
_PREFIX = "tag:yaml.org,2002:"
_TEXT_TAG = f"{_PREFIX}str"
_COLLECTION_TAGS = (None, "!", f"{_PREFIX}seq", f"{_PREFIX}map")
_CONSTRUCTOR = yaml.constructor.SafeConstructor()
_RESOLVER = yaml.resolver.Resolver()
_SCALARS = {
    f"{_PREFIX}{kind}": getattr(yaml.constructor.SafeConstructor, f"construct_yaml_{kind}")
    for kind in ("null", "bool", "int", "float", "str")
}
"""Tags that a value may have, and what makes it."""


@contextmanager
def wrap_read_errors(path: str | Path, kind: type[GimbalPinError]) -> Iterator[None]:
    """Turn the operating system's refusal to read `path` into an error of `kind`."""
    try:
        yield
    except FileNotFoundError as error:
        raise kind(str(path), "does not exist", "give the path of a file") from error
    except OSError as error:
        raise kind(
            str(path), f"cannot be read ({error.strerror})", "give a readable file"
        ) from error


def read_bytes(
    path: str | Path, kind: type[GimbalPinError] = UsageError, most: int = LARGEST_LOG
) -> bytes:
    """Return what a regular file or a pipe holds, up to `most` bytes; an error of `kind` says why it cannot be read."""
    with wrap_read_errors(path, kind), open(path, "rb", opener=open_without_waiting) as file:
        state = os.fstat(file.fileno())
        if not (stat.S_ISREG(state.st_mode) or stat.S_ISFIFO(state.st_mode)):
            raise kind(str(path), "is neither a file nor a pipe", "give the path of a file")
        whole = stat.S_ISFIFO(state.st_mode) or state.st_size <= most
        content = file.read(-1 if stat.S_ISREG(state.st_mode) else most + 1) if whole else b""
    check_size(path, len(content) if whole else state.st_size, kind, most)
    return content


def check_size(
    path: str | Path, size: int, kind: type[GimbalPinError], most: int = LARGEST_LOG
) -> None:
    """Raise an error of `kind` for more bytes, of a file or of what it unfolds to, than are read."""
    if size > most:
        raise kind(
            str(path),
            f"holds more than {most / 1e6:.0f} MB, unpacked",
            "give a smaller file, or a part of it",
        )


def read_beginning(path: str | Path, size: int) -> bytes:
    """Return the first bytes of a regular file; none of anything else: from a pipe they would be gone."""
    with suppress(OSError):
        if os.path.isfile(path):
            with open(path, "rb") as file:
                return file.read(size)
    return b""


def open_without_waiting(path: str, flags: int) -> int:
    """Return a file's descriptor; a pipe that nobody writes to is empty and is not waited for."""
    descriptor = os.open(path, flags | os.O_NONBLOCK)
    os.set_blocking(descriptor, True)
    return descriptor


def read_yaml(path: str | Path, kind: type[GimbalPinError] = UsageError) -> Any:
    """Return a YAML file's plain values: texts, numbers, booleans, null, lists, and tables whose keys are texts.

    An error of `kind` names file and line of anything else, and of what is nested or repeated without measure.
    """
    content = read_bytes(path, kind, LARGEST_TEXT)
    try:
        # libyaml's parser takes an eighth of the time. One event at a time: nothing is built before it is checked.
        return _build_value(
            yaml.parse(content.decode("utf-8-sig"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        )
    except yaml.MarkedYAMLError as error:
        last = content.count(b"\n")  # libyaml takes the end of the text for a line of its own
        line = f":{min(error.problem_mark.line, last) + 1}" if error.problem_mark else ""
        raise kind(f"{path}{line}", f"is not YAML ({error.problem})", "mend that line") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise kind(str(path), f"is not YAML ({error})", "give a YAML file in UTF-8") from error


def _build_value(events: Iterable[yaml.Event]) -> Any:
    """Return what a stream of YAML events spells; `yaml.MarkedYAMLError` where that is no plain value, or too much."""
    ahead = iter(events)
    anchors = dict[str, tuple[Any, int]]()
    count = 0

    def built(event: Any, depth: int) -> Any:
        nonlocal count
        before = count
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in anchors:
                raise _refuse(f"*{event.anchor} stands for nothing", event.start_mark)
            value, size = anchors[event.anchor]
            count += size
        else:
            count += 1
            value = (
                _build_scalar(event)
                if isinstance(event, yaml.ScalarEvent)
                else collection(event, depth)
            )
        if count > _MOST_VALUES:
            raise _refuse(f"more than {_MOST_VALUES} values", event.start_mark)
        if event.anchor is not None and not isinstance(event, yaml.AliasEvent):
            anchors[event.anchor] = value, count - before
        return value

    def collection(event: Any, depth: int) -> Any:
        if event.tag not in _COLLECTION_TAGS:
            raise _refuse(f"no plain value: {event.tag}", event.start_mark)
        if depth >= _DEEPEST:
            raise _refuse(f"nested over {_DEEPEST} deep", event.start_mark)
        values: list[Any] = []
        table: dict[str, Any] = {}
        while not isinstance(inner := next(ahead), yaml.CollectionEndEvent):
            value = built(inner, depth + 1)
            if isinstance(event, yaml.SequenceStartEvent):
                values.append(value)
            elif not isinstance(value, str):
                raise _refuse("a key is no text: quote it", inner.start_mark)
            elif value in table:  # the first would be lost in silence
                raise _refuse(f"'{value}' stands twice", inner.start_mark)
            else:
                table[value] = built(next(ahead), depth + 1)
        return values if isinstance(event, yaml.SequenceStartEvent) else table

    root, documents = None, 0
    for event in ahead:
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise _refuse("a second document", event.start_mark)
        elif isinstance(event, yaml.NodeEvent):
            root = built(event, 0)
    return root


def _build_scalar(event: yaml.ScalarEvent) -> Any:
    """Return a text, number, boolean or null; what YAML 1.1 takes for a date or a merge is a text."""
    if "\0" in event.value:  # no path, name or unit has one, and the system refuses it
        raise _refuse("a NUL character", event.start_mark)
    tag = event.tag
    short = len(event.value) <= LONGEST_NUMBER
    if tag in (None, "!"):
        tag = (
            _RESOLVER.resolve(yaml.ScalarNode, event.value, event.implicit) if short else _TEXT_TAG
        )
        tag = tag if tag in _SCALARS else _TEXT_TAG
    try:
        if not short and tag != _TEXT_TAG:
            raise ValueError(f"it has over {LONGEST_NUMBER} characters")
        return _SCALARS[tag](_CONSTRUCTOR, yaml.ScalarNode(tag, event.value))
    except (LookupError, ValueError) as error:
        raise _refuse(f"no plain value: {tag}", event.start_mark) from error


def _refuse(what: str, mark: Any) -> yaml.MarkedYAMLError:
    """Return the error of what is no plain value, at the mark of an event of either parser."""
    return yaml.MarkedYAMLError(problem=what, problem_mark=mark)


def parse_decimal(text: str) -> float | None:
    """Return the number that a text spells, or None."""
    return float(text) if len(text) <= LONGEST_NUMBER and _DECIMAL.fullmatch(text) else None


def split_words(name: str) -> tuple[str, ...]:
    """Return the words and numbers of a name in lower case: ``posMeas_1`` and ``pos meas 1`` are pos, meas, 1."""
    return tuple(word.lower() for word in _WORD_PATTERN.findall(name[:400]))
