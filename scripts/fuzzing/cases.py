"""What every reader is given: a valid input that is damaged, and a verb that reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from fuzzing import (
    bombs,
    damaged_bytes,
    damaged_csv,
    damaged_parquet,
    damaged_xml,
    damaged_yaml,
    options,
    restarts,
    scripted,
)
from fuzzing.case import PORT, Case, Place
from fuzzing.junk import one
from fuzzing.seeds import WRITERS, Seeds

RNG = np.random.Generator
BYTES = 0.4
"""Share of the cases that are damaged below their format; the others are well formed and wrong."""
ODD_NAMES = 0.03
NAMES = ("a b", "a\x1b[31m", "a\nb", "ä", "a@cinema", "a'b\"", "n" * 200, "-a", "a\udcff", "a=b", "\u202ea")
"""File names that are odd, without their suffix."""
RIG = ("pan.urdf", "pan.yaml", "part.stl")
LATE = 0.01
"""Share of a verb that takes seconds."""


@dataclass(frozen=True)
class Drawn:
    """How the cases of a run are drawn.

    Attributes:
        seeds: The valid inputs.
    """

    seeds: Seeds

    def __call__(self, place: Place) -> Case:
        """Return the case of a place: always the same."""
        return READERS[place.reader](place.rng(), self.seeds)


def changed(rng: RNG, data: bytes, structured: Callable[[RNG, bytes], bytes]) -> bytes:
    """Damage bytes, or what they mean."""
    return damaged_bytes.damaged(rng, data) if rng.random() < BYTES else structured(rng, data)


def call(rng: RNG, seeds: Seeds, line: str, damaged: Mapping[str, bytes], piped: bytes | None = None) -> Case:
    """Return a call on the seeds that its line names, of which some are damaged, in an odd place now and then."""
    words = line.split()
    files = {name: damaged.get(name, content) for name, content in seeds.items() if name in words or name in damaged}
    if any(name in ("pan.yaml", "pan.urdf") for name in words):
        files |= {name: damaged.get(name, seeds[name]) for name in RIG}
    able = [name for name in damaged if name in words]
    if able and rng.random() < ODD_NAMES:
        name = one(rng, able)
        odd = one(rng, NAMES) + PurePath(name).suffix
        words, files[odd] = [odd if word == name else word for word in words], files.pop(name)
    old, target = {}, words[words.index("-o") + 1] if "-o" in words else ""
    if PurePath(target).suffix and rng.random() < 0.3:
        old = {target: OLD[PurePath(target).suffix]}
    return Case(tuple(words), files, old, piped)


OLD = {
    ".yaml": b"old: 1\n",
    ".csv": b"old\n1\n",
    ".html": b"<!DOCTYPE html><html></html>",
    ".json": b"{}\n",
    ".parquet": b"PAR1PAR1",
}
"""Results that stand there already."""


def line(rng: RNG, *choices: tuple[float, str]) -> str:
    """Return one of the lines, by their weights."""
    weights = np.array([weight for weight, _ in choices])
    return choices[int(rng.choice(len(choices), p=weights / weights.sum()))][1]


def log(rng: RNG, seeds: Seeds) -> Case:
    """A CSV log."""
    chosen = line(
        rng,
        (70, "identify pan.yaml log.csv -o out.yaml"),
        (10, "identify turret log2.csv -o out.yaml"),
        (5, "identify pan.yaml log.csv log.csv -o out.yaml --json out.json"),
        (4, "identify pan.yaml log.csv --estimator robust"),
        (2, "identify pan.yaml log.csv --estimator physical --bias --refit --urdf out.urdf"),
        (6, "tune pan.yaml log.csv -o out.yaml"),
        (4, "animate pan.yaml log.csv -o out.html"),
        (2, "excite pan.yaml -o out.csv --seconds 2 --starts 1 --harmonics 2 --rate 100 --after log.csv"),
        (LATE * 100, "diagnose pan.yaml log.csv"),
    )
    name = "log2.csv" if "log2.csv" in chosen else "log.csv"
    return call(rng, seeds, chosen, {name: changed(rng, seeds[name], damaged_csv.damaged)})


def follow(rng: RNG, seeds: Seeds) -> Case:
    """A growing log: a file that does not grow, and standard input."""
    content = changed(rng, seeds["log.csv"], damaged_csv.damaged)
    extra = line(rng, (8, ""), (1, " --json -"), (1, " --known model.yaml"), (1, " --forget 2 -o out.yaml"))
    if rng.random() < 0.5:
        return call(rng, seeds, f"identify pan.yaml - --follow{extra}", {}, content)
    return call(rng, seeds, f"identify pan.yaml log.csv --follow --idle 0{extra}", {"log.csv": content})


def trajectory(rng: RNG, seeds: Seeds) -> Case:
    """A reference."""
    content = changed(rng, seeds["reference.csv"], damaged_csv.damaged)
    chosen = line(
        rng,
        (4, "simulate pan.yaml -o out.csv --reference reference.csv"),
        (1, "animate pan.yaml reference.csv -o out.html"),
    )
    return call(rng, seeds, chosen, {"reference.csv": content})


def parquet(rng: RNG, seeds: Seeds) -> Case:
    """Parquet, of a log or of a platform."""
    stem = "platform" if rng.random() < 0.2 else "log"
    table = seeds[f"{stem}.csv"]
    content = damaged_parquet.damaged(rng, damaged_csv.shown(table), table, seeds[f"{stem}.parquet"])
    chosen = line(
        rng,
        (4, "identify pan.yaml log.parquet -o out.yaml"),
        (1, "simulate pan.yaml -o out.parquet --reference log.parquet"),
    )
    platform = "simulate pan.yaml -o out.csv --platform-log platform.parquet --seconds 0.3"
    return call(rng, seeds, platform if stem == "platform" else chosen, {f"{stem}.parquet": content})


def binary(*names: str) -> Callable[[RNG, Seeds], Case]:
    """Logs of formats that are damaged below their format only; ``plain`` and ``hdf5`` have other names in them."""

    def drawn(rng: RNG, seeds: Seeds) -> Case:
        name = one(rng, names)
        chosen = line(rng, (2, f"identify pan.yaml {name} -o out.yaml"), (1, f"inspect {name} --rig pan.yaml"))
        return call(rng, seeds, chosen, {name: damaged_bytes.damaged(rng, seeds[name])})

    return drawn


def urdf(rng: RNG, seeds: Seeds) -> Case:
    """The rig's URDF, or the payload's."""
    name = "block.urdf" if rng.random() < 0.25 else "pan.urdf"
    content = changed(rng, seeds[name], damaged_xml.damaged)
    rig = "pan.yaml --payload block.urdf" if name == "block.urdf" else one(rng, ("pan.yaml", "pan.urdf"))
    chosen = line(
        rng,
        (10, f"check {rig}"),
        (6, f"base {rig}"),
        (2, f"check {rig} --json out.json"),
        (2, f"animate {rig} log.csv -o out.html"),
        (1, f"identify {rig} log.csv -o out.yaml --urdf out.urdf"),
        (1, f"simulate {rig} -o out.csv --seconds 0.2"),
    )
    return call(rng, seeds, chosen, {name: content})


def mesh(rng: RNG, seeds: Seeds) -> Case:
    """A mesh that the URDF draws, in every format that one may name."""
    suffix = one(rng, ("stl", "stl", "obj", "dae", "3mf", "glb", "gltf", "ply", "zip", "STL"))
    contents = (
        seeds["part.stl"],
        b"solid x\nfacet normal 0 0 1\nouter loop\n" + b"vertex 0 1 0\n" * 3 + b"endloop\nendfacet\nendsolid x\n",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        b"f 1 2 99999999999\nv nan 0 0\nmtllib ../../etc/hostname\n",
        b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 50,
        b"ply\nformat ascii 1.0\nelement vertex 4294967295\nproperty float x\nend_header\n",
        b"PK\x03\x04" + b"\0" * 100,
        b"glTF\x02\0\0\0\xff\xff\xff\xffJSON",
        damaged_xml.DTD.replace("robot", "COLLADA").encode() + b"<COLLADA>&bomb;</COLLADA>",
    )
    content = one(rng, contents)
    content = damaged_bytes.damaged(rng, content) if rng.random() < 0.7 else content
    name = f"part.{suffix}"
    rig = seeds["pan.urdf"].replace(b"part.stl", name.encode())
    chosen = line(
        rng,
        (3, "animate pan.yaml log.csv -o out.html"),
        (1, "check pan.yaml"),
        (1, "animate pan.urdf log.csv -o out.html"),
    )
    case = call(rng, seeds, chosen, {"pan.urdf": rig, name: content})
    return replace(case, inputs={key: value for key, value in case.inputs.items() if key in (*RIG, name, "log.csv")})


def rig(rng: RNG, seeds: Seeds) -> Case:
    """A rig's YAML."""
    content = changed(rng, seeds["pan.yaml"], damaged_yaml.damaged)
    chosen = line(
        rng,
        (10, "check pan.yaml"),
        (3, "base pan.yaml"),
        (2, "identify pan.yaml log.csv -o out.yaml"),
        (2, "tune pan.yaml model.yaml -o out.yaml"),
        (1, "animate pan.yaml log.csv -o out.html"),
        (2, "simulate pan.yaml -o out.csv --seconds 0.2"),
        (1, "simulate pan.yaml -o out.csv --seconds 0.2 --platform S --imus"),
        (1, "excite pan.yaml -o out.csv --seconds 2 --starts 1 --harmonics 2 --rate 100"),
    )
    return call(rng, seeds, chosen, {"pan.yaml": content})


def mapping(rng: RNG, seeds: Seeds) -> Case:
    """A mapping's YAML, and what stands on the command line."""
    verb = line(rng, (3, "identify pan.yaml mapped.csv -o out.yaml"), (1, "animate pan.yaml mapped.csv -o out.html"))
    if rng.random() < 0.5:
        content = changed(rng, seeds["map.yaml"], damaged_yaml.damaged)
        return call(rng, seeds, f"{verb} --map map.yaml", {"map.yaml": content})
    case = call(rng, seeds, verb, {"mapped.csv": seeds["mapped.csv"]})
    entries = [": ".join(entry.split(": ")).replace(": ", "=") for entry in seeds["map.yaml"].decode().splitlines()]
    at = int(rng.integers(len(entries)))
    entries[at] = options.mangled(rng, entries[at])
    return replace(case, words=(*case.words, *(word for entry in entries for word in ("--map", entry))))


def model(rng: RNG, seeds: Seeds) -> Case:
    """An identified model's YAML."""
    return modelled(rng, seeds, "model.yaml")


def extended(rng: RNG, seeds: Seeds) -> Case:
    """An extended model's YAML: with causes of every kind."""
    return modelled(rng, seeds, "extended.yaml")


def modelled(rng: RNG, seeds: Seeds, name: str) -> Case:
    """A call on a model."""
    chosen = line(
        rng,
        (10, f"tune pan.yaml {name} -o out.yaml"),
        (3, f"tune pan.yaml {name} --robust --json out.json"),
        (4, f"simulate pan.yaml -o out.csv --seconds 0.2 --model {name}"),
        (1, f"identify pan.yaml log.csv --known {name} -o out.yaml"),
        (1, f"identify pan.yaml log.csv --follow --idle 0 --known {name}"),
        (1, f"track pan.yaml controller.yaml --model {name}"),
        (1, f"excite pan.yaml -o out.csv --seconds 2 --starts 1 --harmonics 2 --rate 100 --model {name}"),
    )
    return call(rng, seeds, chosen, {name: changed(rng, seeds[name], damaged_yaml.damaged)})


def controller(rng: RNG, seeds: Seeds) -> Case:
    """A controller's YAML."""
    name = one(rng, ("controller.yaml", "controller.yaml", "pid.yaml", "controller2.yaml"))
    if name == "controller2.yaml":
        chosen = f"simulate turret -o out.csv --seconds 0.1 --controller {name}"
    else:
        chosen = line(
            rng,
            (3, f"simulate pan.yaml -o out.csv --seconds 0.2 --controller {name}"),
            (1, f"track pan.yaml {name} --json out.json"),
        )
    return call(rng, seeds, chosen, {name: changed(rng, seeds[name], damaged_yaml.damaged)})


def platform(rng: RNG, seeds: Seeds) -> Case:
    """A log of what carries the rig."""
    content = changed(rng, seeds["platform.csv"], damaged_csv.damaged)
    chosen = line(
        rng,
        (20, "simulate pan.yaml -o out.csv --platform-log platform.csv --seconds 0.3"),
        (1, "identify pan.yaml platform.csv -o out.yaml"),
    )
    return call(rng, seeds, chosen, {"platform.csv": content})


READ: Mapping[str, str] = {
    **dict.fromkeys(("log.csv", "log.parquet", *WRITERS), "identify pan.yaml {} -o out.yaml"),
    "log.tlog": "inspect {}",
    "pan.urdf": "check pan.yaml",
    "pan.yaml": "check {}",
    "part.stl": "animate pan.yaml log.csv -o out.html",
    "block.urdf": "check pan.yaml --payload {}",
    "map.yaml": "identify pan.yaml mapped.csv --map {} -o out.yaml",
    "model.yaml": "tune pan.yaml {} -o out.yaml",
    "extended.yaml": "simulate pan.yaml -o out.csv --seconds 0.2 --model {}",
    "controller.yaml": "simulate pan.yaml -o out.csv --seconds 0.2 --controller {}",
    "platform.csv": "simulate pan.yaml -o out.csv --seconds 0.2 --platform-log {}",
    "reference.csv": "simulate pan.yaml -o out.csv --reference {}",
}
"""A file of every kind → what reads it."""
DEVICES = ("/dev/zero", "/dev/urandom", "/dev/null", "/dev/full", "/dev/tty", ".", "itself", "/proc/self/mem")


def pipes(rng: RNG, seeds: Seeds) -> Case:
    """A pipe that nobody writes into, or somebody slowly, or a device, in place of every kind of file."""
    name = one(rng, list(READ))
    chosen = READ[name].format(name) + " --follow --idle 0" * (name == "log.csv" and rng.random() < 0.5)
    case = call(rng, seeds, chosen.replace("-o out.yaml --follow", "--follow"), {})
    inputs = {key: content for key, content in case.inputs.items() if key != name}
    if rng.random() < 0.5:
        device = one(rng, DEVICES)
        return replace(case, inputs=inputs, links={name: name if device == "itself" else device})
    return replace(case, inputs=inputs, pipes={name: one(rng, (None, b"", seeds[name]))})


def bomb(rng: RNG, seeds: Seeds) -> Case:
    """A small file that unfolds to more than memory."""
    name = one(rng, list(bombs.WRITERS))
    chosen = line(
        rng,
        (4, f"identify pan.yaml {name} -o out.yaml"),
        (1, f"inspect {name} --rig pan.yaml"),
        (1, f"animate pan.yaml {name} -o out.html"),
        (1, f"simulate pan.yaml -o out.csv --seconds 0.2 --platform-log {name}"),
    )
    return replace(call(rng, seeds, chosen, {}), code=2)


def names(rng: RNG, seeds: Seeds) -> Case:
    """Names that are code to a page: of rig, joint, links, payload, files and columns."""
    chosen = line(
        rng,
        (90, "animate pan.yaml log.csv -o out.html"),
        (10, "animate pan.yaml log.csv -o out.html --payload block.urdf"),
        (LATE * 100, "auto pan.yaml log.csv -o out"),
    )
    return scripted.scripted(rng, seeds, chosen)


def restart(rng: RNG, seeds: Seeds) -> Case:
    """A gimbal on the other end of UDP that begins anew."""
    datagrams, harmless = restarts.drawn(rng, seeds["log.csv"])
    case = call(rng, seeds, f"identify pan.yaml {PORT} --follow --idle 0.5 -o out.yaml", {})
    return replace(case, datagrams=datagrams, code=0 if harmless else None)


def option(rng: RNG, seeds: Seeds) -> Case:
    """Odd values of any option of any verb."""
    verb = line(rng, *((weight, name) for name, (weight, _) in options.LINES.items()))
    case = call(rng, seeds, f"{verb} {options.LINES[verb][1]}", {})
    more = options.drawn(rng, verb)
    there = {name: seeds[name] for name in options.THERE if name not in case.inputs}
    read = {name for name in there if any(name in word for word in options.read(more))}
    inputs = {**case.inputs, **{name: there[name] for name in read}}
    old = {name: content for name, content in there.items() if name not in read}  # may be written over
    return replace(case, words=(*case.words, *more), inputs=inputs, old=old)


READERS: Mapping[str, Callable[[RNG, Seeds], Case]] = {
    "log": log,
    "follow": follow,
    "trajectory": trajectory,
    "parquet": parquet,
    "csv.gz": binary("log.csv.gz"),
    "npy": binary("log.npy", "plain.npy"),
    "npz": binary("log.npz"),
    "candump": binary("log.candump"),
    "mat": binary("log.mat", "hdf5.mat"),
    "bag": binary("log.bag"),
    "db3": binary("log.db3"),
    "mcap": binary("log.mcap"),
    "ulg": binary("log.ulg"),
    "tlog": binary("log.tlog"),
    "urdf": urdf,
    "mesh": mesh,
    "rig": rig,
    "mapping": mapping,
    "model": model,
    "extended": extended,
    "controller": controller,
    "platform": platform,
    "pipes": pipes,
    "bombs": bomb,
    "names": names,
    "restarts": restart,
    "options": option,
}
"""What is read → how its cases are drawn."""
APART = ("mat", "bag", "db3", "mcap", "ulg", "tlog", "bombs")
"""Readers that start a process of their own for each case: half a second, seven times what the others take."""
FEWER = 25
"""Of those one case in so many is run: a thousand of each would take 23 minutes of two cores."""
