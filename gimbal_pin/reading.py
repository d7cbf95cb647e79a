"""Files as bytes and as plain YAML values, with errors that name the file and the line; where a mesh is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from gimbal_pin.errors import GimbalPinError, UsageError


@contextmanager
def readable(path: str | Path, kind: type[GimbalPinError]) -> Iterator[None]:
    """Turn the operating system's refusal to read `path` into an error of `kind`."""
    try:
        yield
    except FileNotFoundError as error:
        raise kind(str(path), "does not exist", "give the path of a file") from error
    except OSError as error:
        raise kind(str(path), f"cannot be read ({error.strerror})", "give a readable file") from error


def read_bytes(path: str | Path, kind: type[GimbalPinError] = UsageError) -> bytes:
    """Return a file's content; an error of `kind` says why it cannot be read."""
    with readable(path, kind):
        content = Path(path).read_bytes()
    return content


def mesh_file(name: str, folder: Path) -> Path | None:
    """Return the file that a URDF's mesh name means, seen from the URDF's folder; None if there is none.

    ``package://pkg/rest`` is sought as ``pkg/rest`` and ``rest`` in the folder and in those above it.
    """
    if not name.startswith("package://"):
        file = folder / name.removeprefix("file://")
        return file if file.is_file() else None
    inside = name.removeprefix("package://")
    candidates = (above / tail for above in (folder, *folder.parents) for tail in (inside, inside.partition("/")[2]))
    return next((file for file in candidates if file.is_file()), None)


def read_yaml(path: str | Path, kind: type[GimbalPinError] = UsageError) -> Any:
    """Return a YAML file's plain values; an error of `kind` names file and line where it is none."""
    try:
        loader = yaml.SafeLoader(read_bytes(path, kind).decode("utf-8-sig"))
        root = loader.get_single_node()
        check_keys(root)
        return None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise kind(f"{path}{line}", f"is not YAML ({error.problem})", "mend that line") from error
    except (UnicodeDecodeError, yaml.YAMLError, ValueError) as error:
        raise kind(str(path), f"is not YAML ({error})", "give a YAML file in UTF-8") from error


def check_keys(root: Any) -> None:
    """Raise `yaml.MarkedYAMLError` at a key that stands twice in one table: the first would be lost in silence."""
    for table in tables(root, set()):
        seen: set[tuple[str, str]] = set()
        for key, _ in table.value:
            name = (str(key.tag), str(key.value))
            if name in seen:
                raise yaml.MarkedYAMLError(problem=f"'{key.value}' stands twice", problem_mark=key.start_mark)
            seen.add(name)


def tables(node: Any, done: set[int]) -> Iterator[yaml.MappingNode]:
    """Yield every table in a YAML tree once; aliases may make it a graph, so `done` holds what was seen."""
    if id(node) in done or not isinstance(node, yaml.CollectionNode):
        return
    done.add(id(node))
    if isinstance(node, yaml.MappingNode):
        yield node
    for child in node.value:
        yield from tables(child[1] if isinstance(child, tuple) else child, done)
