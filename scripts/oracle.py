"""Is the log or the method the limit? Each hidden cause, told where it sits, fitted by a search far wider than any.

From every form of the library's grid and from forms thrown at random about the best of them the shapes are refined,
the rigid model refitted with each. A cause that so gains next to nothing on held-out data is not in the log as the
library knows it; one that gains and that ``diagnose`` does not name is lost by a gate, and which is printed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from tqdm import tqdm

from gimbal_pin.audit import audit
from gimbal_pin.calibration import rectified
from gimbal_pin.diagnosis import BAND, verdict
from gimbal_pin.diagnosis.confirmed import STRAYED
from gimbal_pin.diagnosis.contenders import ENTER, hushes, possible
from gimbal_pin.diagnosis.evidence import Evidence, gather, judged
from gimbal_pin.diagnosis.extended import extended
from gimbal_pin.diagnosis.heldout import CONFIRMED, Figures, measured
from gimbal_pin.diagnosis.leftover import judge
from gimbal_pin.diagnosis.score import HIDDEN
from gimbal_pin.diagnosis.search import holds, polished, surest, with_cause
from gimbal_pin.diagnosis.searched import comparable
from gimbal_pin.diagnosis.shapes import form, measure, moved, refined, shape_names, worth
from gimbal_pin.diagnosis.state import Problem, State, consistent, solved, without
from gimbal_pin.effects import CAUSES, Cause, RigEffect
from gimbal_pin.effects.harmonic import Harmonic
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import moved as shaken
from gimbal_pin.identification import split
from gimbal_pin.io import read_log
from gimbal_pin.reduction import reduce
from gimbal_pin.rig import Rig

STARTS = 4
"""Forms of each kind from which shapes are refined."""
THROWN = 24
"""Forms thrown about the best."""
WIDE = 1.0
"""Spread of the throws, of the logarithm of each shape."""
HARMONICS = 8


class Told(NamedTuple):
    """What the oracle made of a folder."""

    before: Figures
    after: Figures
    first: State
    state: State
    lost: tuple[str, ...]
    known: bool


def prepared(folder: Path) -> tuple[Problem, Evidence]:
    """Return a folder's training part and its held-out part, as ``diagnose`` sees them."""
    rig = Rig.load(str(folder / "rig.yaml"))
    log = audit(rig, rectified(rig, read_log(folder / "log.csv", rig)).log).log
    train, test, _ = split([log], None, BAND)
    origins = {log.name: float(log.t[0])}
    evidence = gather(rig, train, BAND, origins)
    held = judged(rig, test, BAND, origins, {log.name: log}) if test else evidence
    return Problem.of(evidence, reduce(rig, base=shaken(rig, train))), held


def grid(problem: Problem, name: str, joint: str | None) -> list[Cause]:
    """The library's forms of a cause at a joint; of the whole rig, or of every joint where that is not told."""
    rows = zip(problem.evidence.rig.joints, problem.evidence.seen)
    return [c for place, seen in rows if joint in (None, place) for c in CAUSES[name].tried(place, seen)]


def thrown(cause: Cause, rng: np.random.Generator) -> Iterator[Cause]:
    """Yield forms of a cause with all shapes moved at random."""
    for _ in range(THROWN):
        other: Cause | None = cause
        for name in shape_names(cause):
            other = moved(other, name, float(np.exp(rng.normal(0.0, WIDE)))) if other is not None else None
        if other is not None:
            yield other


def best(state: State, forms: Sequence[Cause], rng: np.random.Generator) -> Cause | None:
    """Return the form that gains most beside a state, however it is reached; None where none gains."""
    kinds: dict[tuple[object, ...], list[Cause]] = {}
    for gain, one in sorted(((worth(state, one), one) for one in forms), key=lambda row: -row[0]):
        if gain > 0:
            kinds.setdefault(form(one), []).append(one)
    starts = [one for alike in kinds.values() for one in alike[:STARTS]]
    found = max((refined(state, one) for one in starts), key=lambda one: worth(state, one), default=None)
    if found is None:
        return None
    if shape_names(found):
        throws = sorted(thrown(found, rng), key=lambda one: -worth(state, one))[:STARTS]
        found = max([found, *(refined(state, one) for one in throws)], key=lambda one: worth(state, one))
    return found


def parts(cause: Cause) -> int:
    """How many of a cause's forms make it up: harmonics, or a lean about each of two axes."""
    return HARMONICS if isinstance(cause, Harmonic) else 2 if isinstance(cause, RigEffect) else 1


def fitted(first: State, truth: Sequence[dict[str, Any]], rng: np.random.Generator) -> State:
    """Return the state with every true cause in, harmonics one after the other."""
    state = first
    for cause in truth:
        forms = grid(first.problem, cause["cause"], cause["joint"])
        for _ in range(parts(forms[0])):
            new = best(state, forms, rng)
            if new is None or (isinstance(new, Harmonic | RigEffect) and measure(state, new).p > ENTER):
                break
            state = consistent(solved(state.problem, with_cause(state.causes, new), state))
            forms = [one for one in forms if one != new]
    return polished(state)


def gates(first: State, state: State, cause: Cause, held: Evidence) -> Iterator[str]:
    """Yield the names of the tests that a true cause does not pass."""
    base = without(state, cause)
    found = measure(base, cause)
    lacking, full = (measured(held, extended(one)) for one in (base, state))
    joints = [cause.place] if cause.of_joint else list(held.rig.joints)
    ratio = max(lacking["torque_rmse"][j] / full["torque_rmse"][j] for j in joints)
    strayed = np.divide(*(np.linalg.norm([one["rollout_rmse"][j] for j in joints]) for one in (full, lacking)))
    failed = {
        f"hidden by the rigid model ({found.visible:.2g})": found.visible < HIDDEN,
        "no gain, or bounds": found.gain <= 0,
        f"p {surest(base, cause, found):.2g}": surest(base, cause, found) > ENTER,
        "hushes": hushes(base, found, cause),
        "no such cause would": not possible(base, found, cause),
        f"immaterial ({verdict.share(base, found):.2g})": not verdict.material(base, found),
        "folds of the fit": not holds(base, cause),
        "doubtful": verdict.doubtful(first, state, cause),
        "at a bound": verdict.at_bound(base, cause),
        "minor": verdict.minor(state, cause),
        f"held-out torque ({ratio:.3f})": ratio <= CONFIRMED,
        f"held-out rollout ({strayed:.3g})": strayed > STRAYED,
    }
    return (name for name, lost in failed.items() if lost)


def told(folder: Path, rng: np.random.Generator) -> Told:
    """Fit the hidden causes of a folder."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    known = [one for one in truth["causes"] if one["cause"] in comparable(CAUSES)]
    problem, held = prepared(folder)
    first = solved(problem, (), solved(problem, ()))
    state = fitted(first, known, rng)
    lost = tuple(f"{c.name}: {name}" for c in state.causes for name in gates(first, state, c, held))
    return Told(measured(held, extended(first)), measured(held, extended(state)), first, state, lost, bool(known))


def rows(folder: Path, seed: int) -> Iterator[str]:
    """Yield what is printed of a folder."""
    rng = np.random.default_rng(seed)
    found = told(folder, rng)
    yield folder.name
    dispersions = zip(found.first.fit.dispersion, found.state.fit.dispersion, judge(found.state, rng))
    for joint, (before, after, left) in zip(found.before["torque_rmse"], dispersions):
        errors = [one["torque_rmse"][joint] for one in (found.before, found.after)]
        where = f" {left.state} {left.where}".rstrip()
        yield (
            f"  {joint}: held-out torque {errors[0]:.3g} -> {errors[1]:.3g} N m (noise {left.noise_floor:.2g}),"
            f" dispersion {before:.3g} -> {after:.3g},{where}"
        )
    yield from (f"  {cause}" for cause in found.state.causes)
    yield from (f"  lost: {name}" for name in found.lost)
    gain = max(a / b for a, b in zip(*(one["torque_rmse"].values() for one in (found.before, found.after))))
    yield f"  limit: {limit(found, gain, rng)} (held-out error without over with {gain:.3f})"


def limit(found: Told, gain: float, rng: np.random.Generator) -> str:
    """What a miss of the hidden causes would be due to."""
    if not found.known:
        return "not told: only the given model shows it, or the library does not have it"
    if gain > CONFIRMED and found.state.causes:
        return "the method, by the gates above" if found.lost else "none, it can be found; where missed, the search"
    unlike = any(left.state == "structured" for left in judge(found.first, rng))
    return "the library's formula: something is left, and it does not explain it" if unlike else "the log"


def main(folders: tyro.conf.Positional[tuple[Path, ...]], seed: int = 0) -> None:
    """Fit the true causes of some folders and print what they gain and which gates they do not pass.

    Args:
        folders: Each with rig.yaml, log.csv and truth.json, as ``scripts/blind --keep`` leaves them.
        seed: Of the forms thrown at random.
    """
    for folder in tqdm(folders, desc="folders", disable=None, file=sys.stderr):
        try:
            print("\n".join(rows(folder, seed)), flush=True)
        except GimbalPinError as error:
            print(f"{folder.name}\n  {error}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
