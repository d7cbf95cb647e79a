"""Values that no option should trip over; which options there are is asked of the verbs themselves."""

from __future__ import annotations

import dataclasses
import inspect
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from tyro.conf import Positional

from fuzzing.junk import ABSURD, NO_NUMBERS, number, one, text

LINES: Mapping[str, tuple[float, str]] = {
    "inspect": (10, "log.csv --rig pan.yaml"),
    "rigs": (2, ""),
    "new-rig": (6, "pan.urdf -o out.yaml"),
    "check": (6, "pan.yaml"),
    "base": (6, "pan.yaml"),
    "excite": (10, "pan.yaml -o out.csv --seconds 2 --starts 1 --harmonics 2 --rate 100"),
    "simulate": (20, "pan.yaml -o out.csv --seconds 0.2"),
    "rehearse": (0.5, "pan.yaml reference.csv"),
    "identify": (25, "pan.yaml log.csv -o out.yaml"),
    "diagnose": (1, "pan.yaml log.csv"),
    "tune": (12, "pan.yaml model.yaml -o out.yaml --plants 1"),
    "track": (8, "pan.yaml controller.yaml --plants 1"),
    "export": (3, "controller.yaml --c out --rig pan.yaml"),
    "animate": (10, "pan.yaml log.csv -o out.html"),
    "auto": (0.3, "pan.yaml log.csv -o out --plants 1"),
    "studio": (0.5, "pan.yaml -o out --check"),
    "montecarlo": (0.5, "pan.yaml -o out --count 1 --seconds 0.6 --workers 1"),
    "fleet": (0.5, ". --rig pan.yaml -o out --quick --workers 1"),
    "demo": (0.3, "-o out --seconds 2 --plants 1"),
}
"""Verb → its weight, dearer ones less, and a call that is quick."""
THERE = ("log.csv", "map.yaml", "model.yaml", "controller.yaml", "platform.csv", "block.urdf", "reference.csv")
"""Files that options may name."""
LEFT_OUT = {"live", "browser", "check", "yes", "force", "jobs", "workers", "scheduler"}
"""Options that open a port, or keep from it, allow what would be refused, or start or look for processes."""
OUTPUTS = (
    "--output", "--c", "--ros2", "--simplefoc", "--odrive", "--json", "--urdf", "--mend", "--plot", "--report",
    "--animation", "--yaml",
)  # fmt: skip
"""Options that are written to."""

PATHS = (
    "", ".", "..", "no/such/file.csv", "/dev/null", "/dev/full", "/dev/zero", "/dev/stdin", "pan.yaml", "log.csv",
    "./log.csv", "model.yaml",
    "out", "out.xyz", "out.csv", "out.json", "out.yaml", "out.html", "out.parquet", "out.png.", "x" * 300 + ".csv",
    "d/" * 2500 + "x.csv", "\x1b[31m.csv",
    "a\nb.json", "-", "--", "~", "out.csv/", "/proc/self/mem", "/proc/1/x.csv", "ä.csv", "*.csv", "block.urdf",
    "map.yaml", "log.csv@", "log.csv@cinema",
    "log.csv@no", "@", "platform.csv", "reference.csv", "controller.yaml", "\udcff.csv",
)  # fmt: skip
"""Paths that are odd; none lies outside the case's folder but devices that lose nothing."""

SOUND: Mapping[str, tuple[str, ...]] = {
    "effect": ("cogging:pan:amplitude=0.1,harmonic=12", "delay:pan:time=0.002", "base-tilt:roll=0.02",
    "backlash:pan:gap=0.001", "help"),
    "files": ("log.csv", "log.csv+platform.csv"),
    "map": ("q_pan=q_pan*1", "t=t", "tau_pan=tau_pan/2", "map.yaml", "gyro_base_x=gyro_base_x*pi/180"),
    "holdout": ("last-third", "none", "log:1", "log:2"),
    "payload": ("block.urdf", "cinema", "none"),
    "controller": ("computed-torque", "pid", "controller.yaml"),
    "learn": ("log.csv", "platform.csv"),
    "after": ("log.csv",),
    "logs": ("log.csv",),
    "source": ("model.yaml", "log.csv"),
    "known": ("model.yaml",),
    "rig": ("pan.yaml", "turret"),
}  # fmt: skip
"""Option → texts that its grammar allows."""
MARKS = (":", "=", ",", "*", "/", "@", "-", "::", "e", "nan", "inf", "\x1b[31m", " ", '"', "(", "9" * 400, "pi", "\n")


@dataclass(frozen=True)
class Option:
    """One option of a verb.

    Attributes:
        name: As in the signature.
        kinds: Types that it takes; literals as their values.
        positional: Whether it has no name on the command line.
    """

    name: str
    kinds: tuple[Any, ...]
    positional: bool

    def typed(self, value: str) -> list[str]:
        """Return the words that give it a value."""
        if self.positional:
            return [value]
        flag = f"--{self.name.replace('_', '-')}"
        return [f"{flag}={value}"] if value.startswith("-") and value not in ("-", "--") else [flag, value]


@cache
def options(verb: str) -> tuple[Option, ...]:
    """Return every option of a verb, those of its dataclasses included."""
    from gimbal_pin.cli import VERBS

    return tuple(option for option in listed(VERBS[verb]) if option.name not in LEFT_OUT)


def listed(signed: Callable[..., Any]) -> Iterator[Option]:
    """Yield the options that a signature names."""
    hints = get_type_hints(signed, include_extras=True)
    for name in inspect.signature(signed).parameters:
        kinds, marks = opened(hints[name])
        nested: Any = next((kind for kind in kinds if dataclasses.is_dataclass(kind)), None)
        if nested is not None:
            yield from listed(nested)
        else:
            yield Option(name, tuple(kinds), any(mark is POSITIONAL for mark in marks))


POSITIONAL = get_args(Positional[int])[1]
"""What marks a positional argument."""


def opened(hint: Any) -> tuple[list[Any], list[Any]]:
    """Return the plain types, or a literal's values, and the marks inside a hint."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        kinds, marks = opened(inner[0])
        return kinds, [*marks, *inner[1:]]
    if origin is Literal:
        return [Literal, *inner], []
    if origin in (Union, types.UnionType, tuple):
        parts = [opened(part) for part in inner if part not in (type(None), Ellipsis)]
        return [kind for part in parts for kind in part[0]], [mark for part in parts for mark in part[1]]
    return [hint], []


def drawn(rng: np.random.Generator, verb: str) -> list[str]:
    """Return one to three options with odd values, seldom none that there is."""
    words: list[str] = []
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        option = one(rng, options(verb))
        words += flagged(rng, option) if option.kinds == (bool,) else option.typed(value(rng, option))
    if "--follow" in words and not any(word.startswith("--idle") for word in words):
        words += ["--idle", "0"]  # it would wait for more, as it should
    if rng.random() < 0.03:
        words.insert(int(rng.integers(len(words) + 1)), text(rng))
    return [word.replace("\0", "") for word in words]


def read(words: list[str]) -> list[str]:
    """Return the words but the values of what is written to."""
    return [word for before, word in zip(["", *words], words) if before not in OUTPUTS and not word.startswith(OUTPUTS)]


def flagged(rng: np.random.Generator, option: Option) -> list[str]:
    """Return a switch, on, off, or with what it does not take."""
    name = option.name.replace("_", "-")
    return one(rng, ([f"--{name}"], [f"--no-{name}"], [f"--{name}", "True"], [f"--{name}=x"]))


def value(rng: np.random.Generator, option: Option) -> str:
    """Return a value, odd or sound, for an option; none that merely asks for much, in good order, as 1 000 s would."""
    if option.name in SOUND and rng.random() < 0.7:
        sound = one(rng, SOUND[option.name])
        return mangled(rng, sound) if rng.random() < 0.8 else sound
    if Literal in option.kinds:
        return one(rng, (*map(str, option.kinds[1:]), *map(str, option.kinds[1:]), text(rng)))
    if float in option.kinds or int in option.kinds:
        return one(rng, (*ABSURD, *NO_NUMBERS, *("0.001", "0.01", "0.1", "0.5", "1", "2", "3") * 2))
    if Path in option.kinds or rng.random() < 0.4:
        return one(rng, PATHS)
    return text(rng)


def mangled(rng: np.random.Generator, grammatical: str) -> str:
    """Return a text with some of its parts exchanged for others."""
    for _ in range(int(rng.integers(1, 3))):
        at, kind = int(rng.integers(len(grammatical) + 1)), rng.random()
        if kind < 0.35:
            grammatical = grammatical[:at] + one(rng, MARKS) + grammatical[at:]
        elif kind < 0.6:
            grammatical = grammatical[:at] + grammatical[at + int(rng.integers(1, 6)) :]
        elif kind < 0.8:
            head, sign, _ = grammatical.rpartition(one(rng, ("=", ":", "*", ",")))
            grammatical = head + sign + number(rng)
        else:
            grammatical = grammatical[:at] + text(rng)[:600] + grammatical[at:]
    return grammatical
