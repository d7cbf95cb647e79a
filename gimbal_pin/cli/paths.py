"""No verb writes over what it reads: which options name files, and one check before anything is read."""

from __future__ import annotations

import inspect
import os
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

from gimbal_pin.errors import UsageError


def list_inputs(value: str | Path | tuple[str, ...]) -> Iterator[Path]:
    """Yield the files that a value may name: a path, A.csv+B.csv, ``LOG@PAYLOAD``; ``-`` is standard input, a file too.

    What is no path at all, such as a number's unit or ``q_yaw=pos1``, is the name of a file that no verb writes.
    """
    from gimbal_pin.log.io import split_payload
    from gimbal_pin.log.io.readers import files_of

    for text in value if isinstance(value, tuple) else (str(value),):
        file, payload = (Path("/dev/stdin"), None) if text == "-" else split_payload(text)
        yield from files_of(file)
        yield from () if payload is None else list_payload_files(payload)


@dataclass(frozen=True)
class Reads:
    """Marks an option whose value means other files that the verb reads than those that it names.

    Attributes:
        files: Value → which.
        unless: Flag that allows to write over them.
    """

    files: Callable[[Any], Iterable[Path]] = list_inputs
    unless: str = ""


@dataclass(frozen=True)
class Writes:
    """Marks an option whose value means a file that the verb writes, or a folder for the files of one run.

    Attributes:
        suffixes: Those that the file's name may have, or what returns them: then a device or pipe, which has none, is
            refused.
        files: Which files are written, where it is not the value itself.
        run: All that the verb was given → the names of the files of a run that may come to stand in the folder.
    """

    suffixes: tuple[str, ...] | Callable[[], tuple[str, ...]] = ()
    files: Callable[[Path, Mapping[str, Any]], list[Path]] = lambda value, given: [value]
    run: Callable[[Mapping[str, Any]], Iterable[str]] | None = None

    def list_files(self, value: Path, given: Mapping[str, Any]) -> list[Path]:
        """Return the files that a value means, with those of an earlier run, which the next one removes."""
        from gimbal_pin.log.io.files import RUN_FILE, read_run

        if self.run is None:
            return self.files(value, given)
        return [value / name for name in (*self.run(given), *read_run(value), RUN_FILE)]

    def list_suffixes(self) -> tuple[str, ...]:
        """Return the suffixes."""
        return self.suffixes() if callable(self.suffixes) else self.suffixes


def list_plot_suffixes() -> tuple[str, ...]:
    """Return the suffixes of plots."""
    return (".png", ".svg", ".pdf")


def list_log_suffixes() -> tuple[str, ...]:
    """Return the suffixes of logs and trajectories that are written."""
    from gimbal_pin.log.io.readers import FORMATS

    return tuple(suffix for suffix, form in FORMATS.items() if form.write is not None)


def list_payload_files(value: str) -> list[Path]:
    """Return the URDF of a payload, and the meshes that it names."""
    from gimbal_pin.rig.files import find_payload
    from gimbal_pin.rig.meshes import list_sources

    return list_sources(find_payload(value), {})


def list_rig_files(value: str) -> Iterator[Path]:
    """Yield the YAML files that a rig's name leads through, its URDF and its YAML, its payload, their meshes."""
    from gimbal_pin.rig.files import find_rig, list_configs
    from gimbal_pin.rig.meshes import list_sources

    urdf, config = find_rig(value)
    yield from (*list_configs(value), urdf.with_suffix(".yaml"), *list_sources(urdf, config.xacro))
    yield from () if config.payload is None else list_payload_files(config.payload)


def list_auto_files(given: Mapping[str, Any]) -> list[str]:
    """Return the names of the files that `auto` may put into a folder."""
    from gimbal_pin.report.pipeline import FILES
    from gimbal_pin.rig.files import find_rig

    return [*FILES.values(), f"{find_rig(given['rig'])[0].stem}.urdf"]


def check_outputs(verb: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Raise what there is against the places that a verb would write to, before it begins.

    Raises:
        UsageError: It would write over a file that it reads, or two outputs into one; a name tells no format of its
            kind; a place cannot be written to; or a folder holds a file of that name that is of no run, or has been
            edited since.
    """
    from gimbal_pin.log.io.files import check_run

    every = [(label, value, find_mark(marks)) for label, value, marks in list_options(verb, given)]
    written = [
        (label, Path(value), mark)
        for label, value, mark in every
        if isinstance(mark, Writes) and value != Path("-")
    ]
    taken: dict[str | None, tuple[str, str]] = {}
    for label, value, mark in every if written else ():
        if (
            isinstance(mark, Reads)
            and isinstance(value, (str, Path, tuple))
            and not given.get(mark.unless)
        ):
            mend = f", or add --{mark.unless}" if mark.unless else ""
            taken |= {
                identify_file(file): (f"which {label} reads", mend) for file in mark.files(value)
            }
    for label, value, mark in written:
        own = {identify_file(file): file for file in mark.list_files(value, given)}
        for file in (own.keys() & taken.keys()) - {None}:
            what, mend = taken[file]
            raise UsageError(
                label, f"would write over {own[file]}, {what}", f"name another place{mend}"
            )
        taken |= dict.fromkeys(own, (f"which {label} writes", ""))
    for label, value, mark in written:
        if mark.run is not None:
            check_run(value, mark.list_files(value, given), label)
        else:
            check_file(value, mark, label)


def check_file(path: Path, mark: Writes, label: str) -> None:
    """Raise `UsageError` unless a file can be put there, under that name."""
    from gimbal_pin.log.io.files import check_target

    check_target(path, label)
    special = path.exists() and not path.is_file()
    known = mark.list_suffixes()
    if path.suffix.lower() not in known and (callable(mark.suffixes) or not special):
        raise UsageError(label, f"names {path}", f"give it a name that ends in {', '.join(known)}")


def identify_file(path: str | Path) -> str | None:
    """Return a file's path without links, or None for a device, pipe or folder."""
    return os.path.realpath(path) if os.path.isfile(path) or not os.path.exists(path) else None


def list_options(
    of: Callable[..., Any], given: Mapping[str, Any]
) -> Iterator[tuple[str, Any, tuple[Any, ...]]]:
    """Yield name on the command line, value and annotations of every option that has a value, nested ones too."""
    for name, hint in inspect.get_annotations(of, eval_str=True).items():
        value = given.get(name)
        marks = getattr(hint, "__metadata__", ())
        if is_dataclass(value):
            yield from list_options(type(value), vars(value))
        elif value is not None:
            yield label(name, marks), value, marks


def list_read_files(verb: Callable[..., None], given: Mapping[str, Any]) -> list[Path]:
    """Return the files that a verb reads with these arguments, each once."""
    marks = ((value, find_mark(several)) for _, value, several in list_options(verb, given))
    read = (
        (value, mark)
        for value, mark in marks
        if isinstance(mark, Reads) and isinstance(value, (str, Path, tuple))
    )
    files = (os.path.realpath(file) for value, mark in read for file in mark.files(value))
    return [Path(file) for file in dict.fromkeys(files) if os.path.isfile(file)]


def spell_call(verb: Callable[..., None], given: Mapping[str, Any]) -> str:
    """Return a command line that gives a verb these arguments; of absolute paths it has the last parts alone."""
    from tyro.conf import UseAppendAction

    parameters = inspect.signature(verb).parameters
    usual = {
        name: value
        for name, value, _ in list_options(verb, {x.name: x.default for x in parameters.values()})
    }
    words = ["gimbal-pin", verb.__name__.replace("_", "-")]
    for name, value, marks in list_options(verb, given):
        if name in usual and value == usual[name]:
            continue
        if isinstance(value, bool):
            words.append(name if value else f"--no-{name[2:]}")
            continue
        values = [str(item) for item in (value if isinstance(value, tuple) else (value,))]
        if not name.startswith("-"):
            words += values
        elif UseAppendAction in marks:
            words += [word for item in values for word in (name, item)]
        else:
            words += [name, *values]
    return shlex.join(re.sub(r"(^|[=+@,])/(?:[^/]+/)*", r"\1", word) for word in words)


def find_mark(marks: tuple[Any, ...]) -> Reads | Writes:
    """Return what an option's value means: files that are read, unless it is marked."""
    return next((mark for mark in marks if isinstance(mark, (Reads, Writes))), Reads())


def label(name: str, marks: tuple[Any, ...]) -> str:
    """Return how an option is called: its short name, a positional's word in the usage, or ``--its-name``."""
    from tyro.conf import Positional

    described = [mark for mark in marks if hasattr(mark, "metavar") and hasattr(mark, "aliases")]
    if any(mark is Positional for mark in marks):
        return next(str(mark.metavar).split()[0] for mark in described if mark.metavar)
    return next(
        (str(mark.aliases[0]) for mark in described if mark.aliases), f"--{name.replace('_', '-')}"
    )
