"""Compare the results of every verb with those that were frozen before the rewriting of the rooms began.

``scripts/frozen.json.gz`` holds the figures of 40 calls of the command line, made by ``--write`` at the starting
commit. A figure may differ by 1e-9 of itself; what differs by more is printed, with both values. Long lists are kept as
their length, norm and a projection; sentences, paths and times are not compared. Logs are simulated once into
``--folder`` and used again, so that a change of the simulation shows in its own results alone; measured logs, of
DATA, are left out where that folder is missing.
"""

from __future__ import annotations

import gzip
import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from real_data import cases

from gimbal_pin.cli import main as gimbal_pin

HERE = Path(__file__).resolve().parent
TABLE = HERE / "frozen.json.gz"
DATA = HERE.parents[1] / "shared" / "data"
TOLERANCE = 1e-9
UNCOMPARED = ("seconds_taken", "elapsed", "version", "command", "file", "path")
"""Keys of times, paths and the like."""
LIST_LENGTH = 24
"""Lists of more numbers are kept as three figures."""
RIGS = {"thesis": "zoom-lens", "handheld": "mirrorless", "turret": "infrared", "drone": "mirrorless", "ptu": "infrared"}
PLANTED = {
    "cogging": ("turret", "cogging:pan:amplitude=0.05,harmonic=14"),
    "backlash": ("turret", "backlash:tilt:gap=0.004"),
    "spring": ("thesis", "cable-spring:yaw:stiffness=0.3"),
    "stribeck": ("ptu", "stribeck:pan:speed=0.1,extra=0.05"),
}
"""Name of a log → its rig and what is planted in it."""
MEASURED = {
    "odrive_one_log_slower": ("identify",),
    "simple_system_identification": ("identify",),
    "double_055640": ("identify", "diagnose"),
}
"""Name of a measured log (real_data.cases) → the verbs that are run on it."""


def makes() -> dict[str, tuple[str, ...]]:
    """Return the calls that write the logs, name → words; {F} is the folder."""
    calls: dict[str, tuple[str, ...]] = {}
    for rig, payload in RIGS.items():
        calls[f"motion-{rig}"] = ("excite", rig, "--payload", payload, "--starts", "1", "-o", f"{{F}}/motion-{rig}.csv")
        motion = ("--reference", f"{{F}}/motion-{rig}.csv")
        calls[f"log-{rig}"] = ("simulate", rig, "--payload", payload, *motion, "-o", f"{{F}}/log-{rig}.csv")
    for name, (rig, effect) in PLANTED.items():
        words = ("simulate", rig, "--payload", RIGS[rig], "--reference", f"{{F}}/motion-{rig}.csv", "--effect", effect)
        calls[f"log-{name}"] = (*words, "-o", f"{{F}}/log-{name}.csv")
    for rig in ("thesis", "turret"):
        words = ("simulate", rig, "--reference", f"{{F}}/motion-{rig}.csv", "--platform", "S", "--imus")
        calls[f"shaken-{rig}"] = (*words, "-o", f"{{F}}/shaken-{rig}.csv")
    return calls


def calls() -> dict[str, tuple[str, ...]]:
    """Return the calls that are compared, name → words; {F} is the folder, {O} that of outputs."""
    chosen: dict[str, tuple[str, ...]] = {"rigs": ("rigs",)}
    for rig, payload in RIGS.items():
        of = (rig, "--payload", payload)
        chosen[f"check-{rig}"] = ("check", *of)
        chosen[f"base-{rig}"] = ("base", *of)
        chosen[f"identify-{rig}"] = ("identify", rig, f"{{F}}/log-{rig}.csv", "--payload", payload, "-o", "{O}/m.yaml")
        chosen[f"tune-{rig}"] = ("tune", rig, f"{{F}}/log-{rig}.csv", "--payload", payload, "-o", "{O}/c.yaml")
    for estimator in ("ols", "robust", "instrumental", "output-error", "ridge", "physical"):
        words = ("identify", "turret", "{F}/log-turret.csv", "--estimator", estimator)
        chosen[f"identify-turret-{estimator}"] = words
    chosen["identify-refit"] = ("identify", "turret", "{F}/log-cogging.csv", "--refit", "--bias", "--bootstrap", "20")
    chosen["identify-shaken"] = ("identify", "thesis", "{F}/shaken-thesis.csv")
    chosen["identify-follow"] = ("identify", "turret", "{F}/log-turret.csv", "--follow", "--idle", "0.1")
    chosen["inspect"] = ("inspect", "{F}/shaken-turret.csv", "--rig", "turret")
    for name, (rig, _) in PLANTED.items():
        chosen[f"diagnose-{name}"] = ("diagnose", rig, f"{{F}}/log-{name}.csv", "--payload", RIGS[rig])
    chosen["diagnose-clean"] = ("diagnose", "turret", "{F}/log-turret.csv", "--payload", RIGS["turret"])
    chosen["excite"] = ("excite", "turret", "--starts", "1", "--seconds", "5", "-o", "{O}/e.csv")
    chosen["tune-tracked"] = ("tune", "turret", "{F}/log-turret.csv", "-o", "{F}/controller.yaml")
    chosen["track-steps"] = ("track", "turret", "{F}/controller.yaml")
    short = ("--seeds", "1", "--seconds", "2")
    chosen["track-platform"] = ("track", "turret", "--platform", "S", *short)
    chosen["track-learned"] = ("track", "thesis", "--platform", "S", *short, "--learn", "{F}/shaken-thesis.csv",
                               "--controllers", "pid-world,switch,oracle")  # fmt: skip
    for case in [*cases.motors(DATA), *cases.pendulums(DATA)]:
        if case.name in MEASURED:
            maps = [word for one in case.maps for word in ("--map", one)]
            chosen[f"inspect-{case.name}"] = ("inspect", str(case.logs[0]), "--rig", str(case.rig))
            for verb in MEASURED[case.name]:
                chosen[f"{verb}-{case.name}"] = (verb, str(case.rig), str(case.logs[0]), *maps)
    return chosen


def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of what is compared in a result."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key not in UNCOMPARED:
                yield from leaves(one, f"{at}.{key.rsplit('/', 1)[-1]}")  # a log's path is no figure
    elif isinstance(value, list):
        numbers = [one for one in np.ravel(np.array(value, dtype=object)) if isinstance(one, int | float)]
        if len(numbers) > LIST_LENGTH and all(not isinstance(one, dict | str) for one in value):
            x = np.array(numbers, dtype=float)
            yield f"{at}.length", len(x)
            yield f"{at}.norm", float(np.linalg.norm(x))
            yield f"{at}.projection", float(np.cos(np.arange(len(x))) @ x)
        else:
            for k, one in enumerate(value):
                yield from leaves(one, f"{at}[{k}]")
    elif not isinstance(value, str) or (len(value) < LIST_LENGTH and " " not in value and "/" not in value):
        yield at, value


def run(words: tuple[str, ...], folder: Path, out: Path) -> dict[str, Any]:
    """Return what a call writes as JSON, by path, with its exit code."""
    filled = [word.format(F=folder, O=out) for word in words]
    target = out / "result.json"
    target.unlink(missing_ok=True)
    code = 0
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        try:
            gimbal_pin([*filled, "--json", str(target)])
        except SystemExit as end:
            code = int(end.code or 0)
    result = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    return {"exit": code, **dict(leaves(result))}


def same(one: Any, other: Any) -> bool:
    """Whether two leaves are equal; numbers to the tolerance, relative."""
    if isinstance(one, float) or isinstance(other, float):
        if not isinstance(one, int | float) or not isinstance(other, int | float):
            return False
        return math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=1e-12) or (one != one and other != other)
    return bool(one == other)


def main(
    folder: Path = HERE.parent / "freeze-logs",
    only: Annotated[str, tyro.conf.arg(help="names that contain one of these words, with commas")] = "",
    write: Annotated[bool, tyro.conf.arg(help="make the table anew instead of comparing")] = False,
    show: Annotated[int, tyro.conf.arg(help="differences printed per result")] = 8,
) -> None:
    """Run the calls and print what differs from the table; exit 1 where something does."""
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / "outputs"
    out.mkdir(exist_ok=True)
    for words in tqdm(makes().values(), desc="logs", disable=None):
        if not Path(words[-1].format(F=folder)).exists():
            run_quietly(tuple(word.format(F=folder) for word in words))
    wanted = {name: words for name, words in calls().items() if not only or any(w in name for w in only.split(","))}
    if not DATA.exists():
        wanted = {name: words for name, words in wanted.items() if str(DATA) not in " ".join(words)}
    table: dict[str, dict[str, Any]] = json.loads(gzip.decompress(TABLE.read_bytes())) if TABLE.exists() else {}
    different = 0
    for name, words in tqdm(wanted.items(), desc="results", disable=None):
        begun = time.perf_counter()
        found = json.loads(json.dumps(run(words, folder, out)))
        took = time.perf_counter() - begun
        if write:
            table[name] = found
            print(f"{name}: exit {found['exit']}, {len(found)} figures, {took:.1f} s")
            continue
        kept = table[name]
        unequal = [key for key in kept.keys() | found.keys() if not same(kept.get(key), found.get(key))]
        different += bool(unequal)
        print(f"{name}: {len(unequal)} of {len(kept)} figures differ, {took:.1f} s")
        for key in sorted(unequal)[:show]:
            print(f"    {key}: {kept.get(key)} -> {found.get(key)}")
    if write:
        TABLE.write_bytes(gzip.compress(json.dumps(table, sort_keys=True).encode(), mtime=0))
    print(f"{len(wanted)} results, {different} differ")
    sys.exit(different > 0)


def run_quietly(words: tuple[str, ...]) -> None:
    """Make one log; what goes wrong is said on standard error."""
    with redirect_stdout(StringIO()):
        gimbal_pin(list(words))


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
