"""Compare the results of every verb with those that were frozen, to see that a rewriting changes none.

``scripts/frozen.json.gz`` holds the figures of calls of every verb on some 40 logs, made by ``--write`` at the commit
that the file came with: of their JSON, and of the models, controllers, motions and logs that they write. A figure may
differ by 1e-9 of itself; what differs by more is printed, with both values, and counted apart where it is more than a
tenth of the standard deviation that is stated beside it. Long lists are kept as their length, norm and a projection; of
sentences, paths and times only the keys are compared, and those that docs/pages/programs.md promises must be there.
Logs are simulated once into ``--folder`` and used again, so that a change of the simulation shows in its own results
alone; measured logs, of DATA, are left out, and said to be, where their folder is missing.
"""

from __future__ import annotations

import gzip
import json
import math
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
import yaml
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from real_data import cases

from gimbal_pin.cli import main as gimbal_pin

HERE = Path(__file__).resolve().parent
TABLE = HERE / "frozen.json.gz"
DATA = HERE.parents[1] / "shared" / "data"
PROMISES = HERE.parent / "docs" / "pages" / "programs.md"
TOLERANCE = 1e-9
SHARE_OF_DEVIATION = 0.1
UNCOMPARED = ("seconds_taken", "elapsed", "version", "command", "file", "path")
"""Keys of times, paths and the like."""
FEW = ("--plants", "3")
LIST_LENGTH = 24
"""Lists of more numbers are kept as three figures."""
WITHOUT_JSON = ("new-rig", "simulate", "animate")
RIGS = {
    "thesis": "zoom-lens",
    "handheld": "mirrorless",
    "turret": "infrared",
    "drone": "mirrorless",
    "ptu": "infrared",
}
PLANTED = {
    "cogging": ("turret", "cogging:pan:amplitude=0.05,harmonic=14"),
    "backlash": ("turret", "backlash:tilt:gap=0.004"),
    "spring": ("thesis", "cable-spring:yaw:stiffness=0.3"),
    "stribeck": ("ptu", "stribeck:pan:speed=0.1,extra=0.05"),
}
"""Name of a log → its rig and what is planted in it."""
DIAGNOSED = ("odrive_one_log_slower", "double_055640", "emps")
"""Names of measured logs (real_data.cases) that are diagnosed; all of them are inspected and identified."""


def makes() -> dict[str, tuple[str, ...]]:
    """Return the calls that write the logs, name → words; {F} is the folder."""
    calls: dict[str, tuple[str, ...]] = {}
    for rig, payload in RIGS.items():
        calls[f"motion-{rig}"] = (
            "excite",
            rig,
            "--payload",
            payload,
            "--starts",
            "1",
            "-o",
            f"{{F}}/motion-{rig}.csv",
        )
        motion = ("--reference", f"{{F}}/motion-{rig}.csv")
        calls[f"log-{rig}"] = (
            "simulate",
            rig,
            "--payload",
            payload,
            *motion,
            "-o",
            f"{{F}}/log-{rig}.csv",
        )
    for name, (rig, effect) in PLANTED.items():
        words = (
            "simulate",
            rig,
            "--payload",
            RIGS[rig],
            "--reference",
            f"{{F}}/motion-{rig}.csv",
            "--effect",
            effect,
        )
        calls[f"log-{name}"] = (*words, "-o", f"{{F}}/log-{name}.csv")
    for rig in ("thesis", "turret", "drone"):
        words = (
            "simulate",
            rig,
            "--reference",
            f"{{F}}/motion-{rig}.csv",
            "--platform",
            "S",
            "--imus",
        )
        calls[f"shaken-{rig}"] = (*words, "-o", f"{{F}}/shaken-{rig}.csv")
    return calls


def calls(made: Path) -> dict[str, tuple[str, ...]]:
    """Return the calls that are compared, name → words; {F} is the folder, {O} that of outputs."""
    chosen: dict[str, tuple[str, ...]] = {"rigs": ("rigs",)}
    for rig, payload in RIGS.items():
        of = (rig, "--payload", payload)
        chosen[f"check-{rig}"] = ("check", *of)
        chosen[f"base-{rig}"] = ("base", *of)
        chosen[f"identify-{rig}"] = (
            "identify",
            rig,
            f"{{F}}/log-{rig}.csv",
            "--payload",
            payload,
            "-o",
            "{O}/m.yaml",
        )
        chosen[f"tune-{rig}"] = (
            "tune",
            rig,
            f"{{F}}/log-{rig}.csv",
            "--payload",
            payload,
            "-o",
            "{O}/c.yaml",
            *FEW,
        )
        words = ("--payload", payload, "--seconds", "3", "--bandwidth-hz", "4", "-o", "{O}/l.csv")
        chosen[f"simulate-{rig}"] = (
            "simulate",
            rig,
            "--reference",
            f"{{F}}/motion-{rig}.csv",
            *words,
        )
    for estimator in ("ols", "robust", "instrumental", "output-error", "ridge", "physical"):
        words = ("identify", "turret", "{F}/log-turret.csv", "--estimator", estimator)
        chosen[f"identify-turret-{estimator}"] = words
    chosen["new-rig"] = ("new-rig", "turret", "-o", "{O}/rig.yaml")
    chosen["identify-model"] = ("identify", "turret", "{F}/log-turret.csv", "-o", "{F}/model.yaml")
    chosen["identify-refit"] = ("identify", "turret", "{F}/log-cogging.csv", "--refit", "--bias")
    chosen["identify-shaken"] = ("identify", "thesis", "{F}/shaken-thesis.csv")
    several = ("{F}/log-turret.csv", "{F}/log-cogging.csv", "{F}/log-backlash.csv")
    chosen["identify-several"] = ("identify", "turret", *several)
    cameras = (
        "{F}/log-thesis.csv@zoom-lens",
        "{F}/log-spring.csv@zoom-lens",
        "{F}/shaken-thesis.csv@cinema",
    )
    chosen["identify-cameras"] = ("identify", "thesis", *cameras)
    chosen["identify-follow"] = (
        "identify",
        "turret",
        "{F}/log-turret.csv",
        "--follow",
        "--idle",
        "0.1",
    )
    chosen["inspect"] = ("inspect", "{F}/shaken-turret.csv", "--rig", "turret")
    for name, (rig, _) in PLANTED.items():
        words = (rig, f"{{F}}/log-{name}.csv", "--payload", RIGS[rig], "-o", "{O}/findings")
        chosen[f"diagnose-{name}"] = ("diagnose", *words)
    chosen["diagnose-clean"] = (
        "diagnose",
        "turret",
        "{F}/log-turret.csv",
        "--payload",
        RIGS["turret"],
    )
    chosen["diagnose-shaken"] = ("diagnose", "drone", "{F}/shaken-drone.csv")
    chosen["auto"] = ("auto", "turret", "{F}/log-cogging.csv", "-o", "{O}/auto", *FEW)
    chosen["demo"] = ("demo", "--rig", "turret", "-o", "{O}/demo", *FEW)
    chosen["excite"] = ("excite", "turret", "--starts", "1", "--seconds", "5", "-o", "{O}/e.csv")
    chosen["animate"] = ("animate", "turret", "{F}/log-turret.csv", "-o", "{O}/a.html")
    chosen["tune-tracked"] = (
        "tune",
        "turret",
        "{F}/log-turret.csv",
        "-o",
        "{F}/controller.yaml",
        *FEW,
    )
    chosen["tune-margin"] = (
        "tune",
        "turret",
        "{F}/model.yaml",
        "--disk-margin",
        "1.0",
        "-o",
        "{O}/c.yaml",
        *FEW,
    )
    chosen["export"] = ("export", "{F}/controller.yaml", "--c", "{O}/c", "--simplefoc", "{O}/s")
    chosen["track-steps"] = ("track", "turret", "{F}/controller.yaml", *FEW)
    short = ("--seeds", "1", "--seconds", "2")
    chosen["track-platform"] = ("track", "turret", "--platform", "S", *short)
    chosen["track-learned"] = (
        "track",
        "thesis",
        "--platform",
        "S",
        *short,
        "--learn",
        "{F}/shaken-thesis.csv",
    )
    words = (
        "--count",
        "8",
        "--seconds",
        "1",
        "--workers",
        "1",
        "--spec",
        "overshoot_percent < 8",
        "-o",
        "{O}/fleet",
    )
    chosen["montecarlo"] = ("montecarlo", "turret", "{F}/model.yaml", *words)
    for case in [*cases.measured(DATA, made), *cases.benchmarks(DATA)]:
        maps = [word for one in case.maps for word in ("--map", one)]
        logs = [str(log) for log in case.logs]
        if not case.there:
            print(f"{case.name}: left out, {', '.join(logs)} missing")
            continue
        chosen[f"inspect-{case.name}"] = ("inspect", logs[0], "--rig", str(case.rig))
        for verb in ("identify", "diagnose") if case.name in DIAGNOSED else ("identify",):
            chosen[f"{verb}-{case.name}"] = (verb, str(case.rig), *logs, *maps)
    return chosen


def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of what is compared in a result."""
    if value in ({}, []):
        yield at, "none"
    elif isinstance(value, dict):
        for key, one in value.items():
            # A log's path is no figure.
            yield from leaves(
                "" if key in UNCOMPARED else one, f"{at}.{str(key).rsplit('/', 1)[-1]}"
            )
    elif isinstance(value, list):
        numbers = [
            one for one in np.ravel(np.array(value, dtype=object)) if isinstance(one, int | float)
        ]
        if len(numbers) > LIST_LENGTH and all(not isinstance(one, dict | str) for one in value):
            x = np.array(numbers, dtype=float)
            yield f"{at}.length", len(x)
            yield f"{at}.norm", float(np.linalg.norm(x))
            yield f"{at}.projection", float(np.cos(np.arange(len(x))) @ x)
        else:
            for k, one in enumerate(value):
                yield from leaves(one, f"{at}[{k}]")
    elif isinstance(value, str):
        yield (
            at,
            value if len(value) < LIST_LENGTH and " " not in value and "/" not in value else "…",
        )
    else:
        yield at, value


def written(folder: Path) -> Iterator[tuple[str, Any]]:
    """Yield what is compared of the files in a folder: figures of YAML, columns of CSV, of others their names."""
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        at = file.relative_to(folder).as_posix()
        if file.suffix == ".yaml":
            yield from leaves(yaml.safe_load(file.read_text(encoding="utf-8")), at)
        elif file.suffix == ".csv":
            names = file.read_text(encoding="utf-8").partition("\n")[0].split(",")
            columns = np.genfromtxt(file, delimiter=",", skip_header=1, ndmin=2).T
            yield from leaves({name: column.tolist() for name, column in zip(names, columns)}, at)
        else:
            yield at, "…"


def promised() -> dict[str, set[str]]:
    """Return verb → keys that docs/pages/programs.md promises; names of joints and the like are none."""
    rows = re.findall(
        r"^\| `([\w-]+)` \| (.*) \|$", PROMISES.read_text(encoding="utf-8"), re.MULTILINE
    )
    codes = {
        verb: re.sub(r"\{(joint|name): ", "", " ".join(re.findall(r"`([^`]*)`", text)))
        for verb, text in rows
    }
    return {verb: set(re.findall(r"[a-z_]\w*", text)) for verb, text in codes.items()}


def run(words: tuple[str, ...], folder: Path, out: Path) -> dict[str, Any]:
    """Return what a call writes, JSON and files, by path, with its exit code."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    filled = [word.format(F=folder, O=out) for word in words]
    target = folder / "result.json"
    target.unlink(missing_ok=True)
    as_json = [] if words[0] in WITHOUT_JSON else ["--json", str(target)]
    code = 0
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        try:
            gimbal_pin([*filled, *as_json])
        except SystemExit as end:
            code = int(end.code or 0)
    result = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    named = [
        Path(word) for word in filled if word.startswith(str(folder)) and word.endswith(".yaml")
    ]
    files = {key: one for file in named if file.exists() and file.parent == folder for key, one in
             leaves(yaml.safe_load(file.read_text(encoding="utf-8")), file.name)}  # fmt: skip
    return {"exit": code, **dict(leaves(result)), **files, **dict(written(out))}


def same(one: Any, other: Any) -> bool:
    """Whether two leaves are equal; numbers to the tolerance, relative."""
    if isinstance(one, float) or isinstance(other, float):
        if not isinstance(one, int | float) or not isinstance(other, int | float):
            return False
        return math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=1e-12) or (
            one != one and other != other
        )
    return bool(one == other)


def has_moved(key: str, kept: dict[str, Any], found: dict[str, Any]) -> bool | None:
    """Whether a value moved by more than a tenth of the deviation beside it; None where none is stated."""
    deviation = kept.get(f"{key.removesuffix('.value')}.std") if key.endswith(".value") else None
    if not isinstance(deviation, float) or not isinstance(found.get(key), int | float):
        return None
    return abs(found[key] - kept[key]) > SHARE_OF_DEVIATION * deviation


def main(
    folder: Path = HERE.parent / "freeze-logs",
    only: Annotated[
        str, tyro.conf.arg(help="names that contain one of these words, with commas")
    ] = "",
    write: Annotated[bool, tyro.conf.arg(help="make the table anew instead of comparing")] = False,
    show: Annotated[int, tyro.conf.arg(help="differences printed per result")] = 8,
) -> None:
    """Run the calls and print what differs from the table; exit 1 where something does."""
    folder.mkdir(parents=True, exist_ok=True)
    for words in tqdm(makes().values(), desc="logs", disable=None):
        if not Path(words[-1].format(F=folder)).exists():
            run_quietly(tuple(word.format(F=folder) for word in words))
    every = calls(folder)
    wanted = {
        name: words
        for name, words in every.items()
        if not only or any(w in name for w in only.split(","))
    }
    table: dict[str, dict[str, Any]] = (
        json.loads(gzip.decompress(TABLE.read_bytes())) if TABLE.exists() else {}
    )
    different = total = far = 0
    keys: dict[str, set[str]] = {}
    for name, words in tqdm(wanted.items(), desc="results", disable=None):
        begun = time.perf_counter()
        found = json.loads(json.dumps(run(words, folder, folder / "outputs")))
        took = time.perf_counter() - begun
        keys.setdefault(words[0], set()).update(
            part for key in found for part in re.split(r"[.\[\]]+", key)
        )
        if write:
            table[name] = found
            print(f"{name}: exit {found['exit']}, {len(found)} figures, {took:.1f} s", flush=True)
            continue
        kept = table[name]
        unequal = [
            key
            for key in kept.keys() | found.keys()
            if not same(kept.get(key, ""), found.get(key, ""))
        ]
        beyond = [key for key in unequal if has_moved(key, kept, found)]
        different = different + bool(unequal)
        total = total + len(unequal)
        far = far + len(beyond)
        print(f"{name}: {len(unequal)} of {len(kept)} figures moved, {len(beyond)} by over a tenth of their deviation, "
              f"{took:.1f} s", flush=True)  # fmt: skip
        for key in [*sorted(beyond), *sorted(set(unequal) - {*beyond})][:show]:
            print(f"    {key}: {kept.get(key, 'not there')} -> {found.get(key, 'not there')}")
    missing = {
        verb: sorted(names - keys[verb])
        for verb, names in promised().items()
        if verb in keys and not only
    }
    for verb, names in missing.items():
        if names:
            print(f"{verb}: no result has {', '.join(names)}, which {PROMISES.name} promises")
    if write:
        kept_names = {*table} if only else {*wanted}
        table = {name: one for name, one in table.items() if name in kept_names}
        TABLE.write_bytes(gzip.compress(json.dumps(table, sort_keys=True).encode(), mtime=0))
    print(
        f"{len(wanted)} results, {different} differ: {total} figures by over 1e-9, {far} by over a tenth of a deviation"
    )
    sys.exit(different > 0)


def run_quietly(words: tuple[str, ...]) -> None:
    """Make one log; what goes wrong is said on standard error."""
    with redirect_stdout(StringIO()):
        gimbal_pin(list(words))


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
