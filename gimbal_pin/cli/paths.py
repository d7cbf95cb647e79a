"""No verb writes over what it reads: which options name files, and one check before anything is read."""

from __future__ import annotations

import inspect
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

from gimbal_pin.errors import UsageError

Files = Callable[[Any, Mapping[str, Any]], Iterable["str | Path"]]
"""Value of an option and all that the verb was given → the files that the value means."""


def itself(value: str | Path, given: Mapping[str, Any]) -> list[str | Path]:
    """Return the path that an option's value is; ``-`` is standard input or output."""
    return [value] if str(value) != "-" else []


@dataclass(frozen=True)
class Reads:
    """Marks an option whose value means files that the verb reads.

    Attributes:
        files: Which.
        unless: Flag that allows to write over them.
    """

    files: Files = itself
    unless: str = ""


@dataclass(frozen=True)
class Writes:
    """Marks an option whose value means files that the verb writes.

    Attributes:
        files: Which.
        suffixes: Those that a file's name may have.
        chosen: What returns them where they choose the format, so that a device or pipe, which has none, is refused.
        run: Whether the value is a folder, for the files of one run.
    """

    files: Files = itself
    suffixes: tuple[str, ...] = ()
    chosen: Callable[[], tuple[str, ...]] = tuple
    run: bool = False


def log_suffixes() -> tuple[str, ...]:
    """Suffixes of logs and trajectories that are written."""
    from gimbal_pin.log.io.readers import FORMATS

    return tuple(suffix for suffix, form in FORMATS.items() if form.write is not None)


def plot_suffixes() -> tuple[str, ...]:
    """Suffixes of plots."""
    return (".png", ".svg", ".pdf")


def logs(value: str | Path | tuple[str, ...], given: Mapping[str, Any]) -> Iterator[str | Path]:
    """Files of logs, ``LOG@PAYLOAD`` too; ``-`` is standard input, which may be a file."""
    from gimbal_pin.log.io import split_payload
    from gimbal_pin.log.io.readers import files_of

    for log in value if isinstance(value, tuple) else (str(value),):
        file, payload = (Path("/dev/stdin"), None) if log == "-" else split_payload(log)
        yield from files_of(file)
        yield from () if payload is None else payloads(payload, given)


def maps(value: tuple[str, ...], given: Mapping[str, Any]) -> list[str]:
    """YAML files among the entries of a mapping."""
    from gimbal_pin.log.mapping import is_mapping_file

    return [entry for entry in value if is_mapping_file(entry)]


def payloads(value: str, given: Mapping[str, Any]) -> list[Path]:
    """URDF of a payload, and the meshes that it names."""
    from gimbal_pin.rig.files import find_payload

    return with_meshes(find_payload(value), {})


def rigs(value: str, given: Mapping[str, Any]) -> Iterator[Path]:
    """YAML files that a rig's name leads through, its URDF, the YAML beside that, its payload and their meshes."""
    from gimbal_pin.rig.config import load_config
    from gimbal_pin.rig.files import YAML_SUFFIXES, bundled, bundled_rigs, find_rig, find_target

    urdf, config = find_rig(value)
    path = bundled() / f"{value}.urdf" if value in bundled_rigs() else Path(value)
    while path.suffix in YAML_SUFFIXES:
        yield path
        path = find_target(path, load_config(path))
    yield from (urdf.with_suffix(".yaml"), *with_meshes(urdf, config.xacro))
    if config.payload is not None and given.get("payload") is None:
        yield from payloads(config.payload, given)


def with_meshes(rig: Path, arguments: Mapping[str, str]) -> list[Path]:
    """Return the file of a rig or payload, what it includes, and the meshes that it names; `arguments`: xacro's."""
    from gimbal_pin.rig.formats import convert_to_urdf
    from gimbal_pin.rig.meshes import find_mesh_file
    from gimbal_pin.rig.urdf import parse

    text, _, included = convert_to_urdf(rig, arguments)
    named = [mesh.get("filename", "") for mesh in parse(text, str(rig)).iter("mesh")]
    meshes = (find_mesh_file(name, rig.parent) for name in named)
    return [rig, *map(Path, included), *(file for file in meshes if file is not None)]


def diagnosed(value: Path, given: Mapping[str, Any]) -> list[Path]:
    """Files that `diagnose` may put into a folder."""
    from gimbal_pin.diagnosis.file import FILES

    return in_folder(value, FILES.values())


def walked(value: Path, given: Mapping[str, Any]) -> list[Path]:
    """Files that `auto` may put into a folder."""
    from gimbal_pin.report.pipeline import FILES
    from gimbal_pin.rig.files import find_rig

    return in_folder(value, (*FILES.values(), f"{find_rig(given['rig'])[0].stem}.urdf"))


def in_folder(folder: Path, names: Iterable[str]) -> list[Path]:
    """Return files that a run writes into a folder, and those of an earlier run, which it removes."""
    from gimbal_pin.log.io.files import RUN_FILE, read_run

    return [folder / name for name in (*names, *read_run(folder), RUN_FILE)]


def check(verb: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Raise what there is against the places that a verb would write to, before it begins.

    Raises:
        UsageError: It would write over a file that it reads, or two outputs into one; a name tells no format of its
            kind; a place cannot be written to; or a folder holds a file of that name that is of no run, or has been
            edited since.
    """
    marked = [(label, value, mark) for label, value, marks in options(verb, given) for mark in marks]
    written = [(label, value, mark) for label, value, mark in marked if isinstance(mark, Writes)]
    if not written:
        return
    taken: dict[object, tuple[str, str]] = {}
    for label, value, mark in marked:
        if isinstance(mark, Reads) and not given.get(mark.unless):
            mend = f", or add --{mark.unless}" if mark.unless else ""
            taken |= {identity(file): (f"which {label} reads", mend) for file in mark.files(value, given)}
    for label, value, mark in written:
        own = {identity(file): file for file in mark.files(value, given)}
        for file in (own.keys() & taken.keys()) - {None}:
            what, mend = taken[file]
            raise UsageError(label, f"would write over {own[file]}, {what}", f"name another place{mend}")
        taken |= dict.fromkeys(own, (f"which {label} writes", ""))
    for label, value, mark in written:
        files = list(mark.files(value, given))
        if mark.run:
            check_run(value, files, label)
        elif files:
            check_file(Path(value), mark, label)


def check_file(path: Path, mark: Writes, label: str) -> None:
    """Raise `UsageError` unless a file can be put there, under that name."""
    from gimbal_pin.log.io.files import check_target

    check_target(path, label)
    special = path.exists() and not path.is_file()
    known = mark.chosen() or mark.suffixes
    if path.suffix.lower() not in known and not (special and mark.suffixes):
        raise UsageError(label, f"names {path}", f"give it a name that ends in {', '.join(known)}")


def check_run(folder: Path, files: Iterable[str | Path], label: str) -> None:
    """Raise `UsageError` if a run cannot be put into a folder, or would replace what is not an earlier run's."""
    from gimbal_pin.log.io.files import RUN_FILE, check_folder, hash_file, read_run

    check_folder(folder, label)
    ours = read_run(folder)
    for file in (Path(file) for file in files):
        if file.name == RUN_FILE or not os.path.lexists(file):
            continue
        if file.name not in ours:
            raise UsageError(label, f"holds {file.name}, which is of no earlier run", "name another folder, or move it")
        if hash_file(file) != ours[file.name]:
            what = f"holds {file.name}, which was changed after the run that wrote it"
            raise UsageError(label, what, "name another folder, or move it")


def identity(path: str | Path) -> object:
    """Return what two names of one file share: its inode, or where it will be; None for a device, pipe or folder."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return os.path.realpath(path)
    return (found.st_dev, found.st_ino) if stat.S_ISREG(found.st_mode) else None


def options(of: Callable[..., Any], given: Mapping[str, Any]) -> Iterator[tuple[str, Any, tuple[Any, ...]]]:
    """Yield name on the command line, value and annotations of every option that has a value, nested ones too."""
    for name, hint in inspect.get_annotations(of, eval_str=True).items():
        value, marks = given.get(name), getattr(hint, "__metadata__", ())
        if is_dataclass(value):
            yield from options(type(value), vars(value))
        elif value is not None:
            yield label(name, marks), value, marks


def label(name: str, marks: tuple[Any, ...]) -> str:
    """Return how an option is called: its short name, a positional's word in the usage, or ``--its-name``."""
    from tyro.conf import Positional

    described = next((mark for mark in marks if hasattr(mark, "metavar") and hasattr(mark, "aliases")), None)
    if described is not None and described.aliases:
        return str(described.aliases[0])
    if described is not None and any(mark is Positional for mark in marks):
        return str(described.metavar).split()[0]
    return f"--{name.replace('_', '-')}"
