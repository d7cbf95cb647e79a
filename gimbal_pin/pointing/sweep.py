"""Jitter against the model's error: how wrong a model may be before a PID, which needs none, is safer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import degrees, inf, isfinite
from typing import Any

from tqdm import tqdm

from gimbal_pin.control.controllers import BASELINE, OURS
from gimbal_pin.control.laws.carried import CarriedTorque
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.pointing.contest import Course
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.roster import Roster
from gimbal_pin.pointing.trust import changed, doubtful

SHARES = (-0.3, -0.15, 0.0, 0.15, 0.3)
"""Errors of every body's mass, moments and inertia."""
DEVIATIONS = (-3.0, 3.0)
"""Errors along what the log left most uncertain, in standard deviations."""
SECONDS = 3.0
"""Length of a run, s."""


@dataclass(frozen=True)
class Sweep:
    """Jitter of ours with models that are wrong on purpose, beside the world-frame PID's, all on one motion.

    Attributes:
        scaled: Error of all masses, moments and inertias, as a share → jitter, rad rms; inf where the loop diverged.
        uncertain: Error in standard deviations along the most uncertain way → the same; empty without a covariance.
        pid: The world-frame PID's jitter, rad rms.
        seconds: Length of a run, s.
    """

    scaled: Mapping[float, float]
    uncertain: Mapping[float, float]
    pid: float
    seconds: float

    @property
    def safer(self) -> tuple[float | None, float | None]:
        """Errors below and above which the PID holds the camera stiller, as shares; None: at none that was tried."""
        errors = sorted(self.scaled)
        low, high = ([error for error in errors if sign * error >= 0] for sign in (-1, 1))
        return self.crossing(low[::-1]), self.crossing(high)

    def crossing(self, errors: Sequence[float]) -> float | None:
        """Where jitter first rises above the PID's on the way through some errors, by the chord between two of them."""
        for before, after in pairwise(errors):
            a, b = self.scaled[before], self.scaled[after]
            if a > self.pid:
                return before
            if b > self.pid:
                return before + (after - before) * ((self.pid - a) / (b - a) if isfinite(b) else 1.0)
        return None

    @property
    def sentence(self) -> str:
        """What it says, in one sentence."""
        below, above = self.safer
        if self.scaled[0.0] > self.pid:
            return "here a PID is safer even with a model that is right"
        sides = [f"{100 * edge:+.0f} %" for edge in (below, above) if edge is not None]
        tried = 100 * max(abs(error) for error in self.scaled)
        if not sides:
            return f"with all masses and inertias up to {tried:.0f} % wrong, the model still does better than a PID"
        return f"a PID is safer with masses and inertias more than {' or '.join(sides)} wrong"

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds; null for the jitter of a loop that diverged."""
        sides = (self.scaled, self.uncertain)
        told = [[[error, degrees(size) if isfinite(size) else None] for error, size in one.items()] for one in sides]
        return {
            "scaled": told[0],
            "standard_deviations": told[1],
            "pid_deg": degrees(self.pid),
            "pid_safer": list(self.safer),
            "seconds": self.seconds,
        }


def sweep(course: Course, roster: Roster) -> Sweep:
    """Hold the camera with models that are wrong on purpose; runs are short, on the first seed's motion."""
    seconds = min(SECONDS, course.seconds)
    brief, ours = replace(course, seconds=seconds), roster.pointer(OURS)
    model, way = roster.model, doubtful(roster.model, roster.wanted, course.ground(0))
    models = {("scaled", share): model if share == 0 else heavier(model, share) for share in SHARES}
    if way is not None:
        models |= {("uncertain", size): changed(model, size * way) for size in DEVIATIONS}
    found: dict[str, dict[float, float]] = {"scaled": {}, "uncertain": {}}
    for (kind, error), wrong in tqdm(
        models.items(), "jitter against model error", unit="run", disable=None, leave=False
    ):
        found[kind][error] = jitter(brief, knowing(ours, wrong))
    return Sweep(**found, pid=jitter(brief, roster.pointer(BASELINE)), seconds=seconds)


def heavier(model: Model, share: float) -> Model:
    """Return the model with every mass, first moment and inertia more by a share; friction stays."""
    return replace(model, rig=model.rig.with_phi(model.rig.phi * (1 + share)))


def knowing(pointer: Pointer, model: Model) -> Pointer:
    """Return a controller with another model of the same rig: its gains and its navigation stay."""
    law = pointer.law
    return replace(pointer, law=replace(law, model=model)) if isinstance(law, CarriedTorque) else pointer


def jitter(course: Course, pointer: Pointer) -> float:
    """Jitter of one run, rad rms; inf for a loop that diverges."""
    try:
        run = course.held(pointer, 0)
    except UsageError:
        return inf
    return run.jitter[0]
