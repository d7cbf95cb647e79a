"""Files as bytes and as plain YAML values, with errors that name the file and the line."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from gimbal_pin.errors import GimbalPinError, UsageError

NODES = 400_000
"""Most values in a YAML file, aliases counted by what they stand for: twelve payloads' models of a rig of 20 joints,
each with the covariance of 176 parameters. They are read in 5 s."""
TEXT = 16 * 2**20
"""Largest YAML or URDF, bytes: twice what so many numbers of 20 digits take."""
DEPTH = 32
"""Deepest nesting of a YAML file; what the package writes has 6."""
LONGEST = 64
"""Most characters of what is no text; 17 digits tell every double."""
DECIMAL = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?0*\d{1,2})?", re.ASCII)
"""A decimal number that every reader takes for the same double; with a third digit in the exponent some overflow."""
PREFIX = "tag:yaml.org,2002:"
TEXTUAL = f"{PREFIX}str"
COLLECTIONS = (None, "!", f"{PREFIX}seq", f"{PREFIX}map")
CONSTRUCTOR, RESOLVER = yaml.constructor.SafeConstructor(), yaml.resolver.Resolver()
SCALARS = {
    f"{PREFIX}{kind}": getattr(yaml.constructor.SafeConstructor, f"construct_yaml_{kind}")
    for kind in ("null", "bool", "int", "float", "str")
}
"""Tags that a value may have, and what makes it."""


@contextmanager
def readable(path: str | Path, kind: type[GimbalPinError]) -> Iterator[None]:
    """Turn the operating system's refusal to read `path` into an error of `kind`."""
    try:
        yield
    except FileNotFoundError as error:
        raise kind(str(path), "does not exist", "give the path of a file") from error
    except OSError as error:
        raise kind(str(path), f"cannot be read ({error.strerror})", "give a readable file") from error


def read_bytes(path: str | Path, kind: type[GimbalPinError] = UsageError, most: int | None = None) -> bytes:
    """Return a file's content; an error of `kind` says why it cannot be read.

    `most`: bytes; None: `largest`, as a log's text, its lines and its numbers are held at once.
    """
    most = largest() if most is None else most
    with readable(path, kind), open(path, "rb", opener=opened) as file:
        state = os.fstat(file.fileno())
        regular = stat.S_ISREG(state.st_mode)
        whole = not regular or state.st_size <= most
        content = file.read(-1 if regular else most + 1) if whole else b""
    if not whole or len(content) > most:
        raise kind(str(path), f"is larger than {most / 1e6:.0f} MB", "give a smaller file")
    return content


def largest() -> int:
    """Return the most bytes that a file may have, packed or not: a quarter of the machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 4


def opened(path: str, flags: int) -> int:
    """Return a file's descriptor; a pipe that nobody writes to is empty and is not waited for."""
    descriptor = os.open(path, flags | os.O_NONBLOCK)
    os.set_blocking(descriptor, True)
    return descriptor


def read_yaml(path: str | Path, kind: type[GimbalPinError] = UsageError) -> Any:
    """Return a YAML file's plain values: texts, numbers, booleans, null, lists, and tables whose keys are texts.

    An error of `kind` names file and line of anything else, and of what is nested or repeated without measure.
    """
    content = read_bytes(path, kind, TEXT)
    try:
        # With libyaml's parser it takes an eighth of the time. One event at a time, so that nothing is built in vain.
        return plain_value(yaml.parse(content.decode("utf-8-sig"), getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except yaml.MarkedYAMLError as error:
        last = content.count(b"\n")  # libyaml takes the end of the text for a line of its own
        line = f":{min(error.problem_mark.line, last) + 1}" if error.problem_mark else ""
        raise kind(f"{path}{line}", f"is not YAML ({error.problem})", "mend that line") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise kind(str(path), f"is not YAML ({error})", "give a YAML file in UTF-8") from error


@dataclass
class Open:
    """A list or table of a YAML file whose end has not been read.

    Attributes:
        anchor: Its name for aliases, or None.
        before: How many values were read before it.
        is_table: Whether keys and values alternate in it.
        values: What is in it so far.
        keys: Keys so far.
    """

    anchor: str | None
    before: int
    is_table: bool
    values: list[Any] = field(default_factory=list)
    keys: set[str] = field(default_factory=set)

    def add(self, value: Any, mark: Any) -> None:
        """Take a value or a key; raise `yaml.MarkedYAMLError` unless a key is a text that stands once."""
        if self.is_table and len(self.values) % 2 == 0:
            if not isinstance(value, str):
                raise unfit("a key is no text: quote it", mark)
            if value in self.keys:  # the first would be lost in silence
                raise unfit(f"'{value}' stands twice", mark)
            self.keys.add(value)
        self.values.append(value)

    @property
    def value(self) -> Any:
        """The list or table, once it has ended."""
        return dict(zip(self.values[::2], self.values[1::2])) if self.is_table else self.values


def plain_value(events: Iterable[yaml.Event]) -> Any:
    """Return what a stream of YAML events spells; `yaml.MarkedYAMLError` where that is no plain value, or too much."""
    root = Open(None, 0, False)
    inside, known, count = [root], dict[str, tuple[Any, int]](), 0
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            if event.tag not in COLLECTIONS:
                raise unfit(f"no plain value: {event.tag}", event.start_mark)
            if len(inside) > DEPTH:
                raise unfit(f"nested over {DEPTH} deep", event.start_mark)
            inside.append(Open(event.anchor, count, isinstance(event, yaml.MappingStartEvent)))
            count += 1
            continue
        if isinstance(event, yaml.ScalarEvent):
            value, anchor, size = scalar(event), event.anchor, 1
            count += 1
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in known:
                raise unfit(f"*{event.anchor} stands for nothing", event.start_mark)
            (value, size), anchor = known[event.anchor], None
            count += size
        elif isinstance(event, yaml.CollectionEndEvent):
            done = inside.pop()
            value, anchor, size = done.value, done.anchor, count - done.before
        elif isinstance(event, yaml.DocumentStartEvent) and root.values:
            raise unfit("a second document", event.start_mark)
        else:
            continue
        if count > NODES:
            raise unfit(f"more than {NODES} values", event.start_mark)
        if anchor is not None:
            known[anchor] = value, size
        inside[-1].add(value, event.start_mark)
    return root.values[0] if root.values else None


def scalar(event: yaml.ScalarEvent) -> Any:
    """Return a text, number, boolean or null; what YAML 1.1 takes for a date or a merge is a text."""
    if "\0" in event.value:  # no path, name or unit has one, and the system takes none
        raise unfit("a NUL character", event.start_mark)
    tag, short = event.tag, len(event.value) <= LONGEST
    if tag in (None, "!"):
        tag = RESOLVER.resolve(yaml.ScalarNode, event.value, event.implicit) if short else TEXTUAL
        tag = tag if tag in SCALARS else TEXTUAL
    try:
        if not short and tag != TEXTUAL:
            raise ValueError(f"it has over {LONGEST} characters")
        return SCALARS[tag](CONSTRUCTOR, yaml.ScalarNode(tag, event.value))
    except (LookupError, ValueError) as error:
        raise unfit(f"no plain value: {tag}", event.start_mark) from error


def unfit(what: str, mark: Any) -> yaml.MarkedYAMLError:
    """Return the error of something that the package's YAML has not, at the mark of an event of either parser."""
    return yaml.MarkedYAMLError(problem=what, problem_mark=mark)


def decimal(text: str) -> float | None:
    """Return the number that a text spells, or None."""
    return float(text) if len(text) <= LONGEST and DECIMAL.fullmatch(text) else None
