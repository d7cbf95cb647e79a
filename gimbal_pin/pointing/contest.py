"""Controllers side by side on the same plant, the same platform's motion and the same sensors' noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import degrees, sqrt
from typing import Any

import numpy as np

from gimbal_pin.control.controllers import BASELINE, ORACLE, OURS
from gimbal_pin.dynamics.model import Model, friction_effects
from gimbal_pin.effects import Signal
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.budget import Budget
from gimbal_pin.pointing.events import summed
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.roster import Roster
from gimbal_pin.pointing.run import point
from gimbal_pin.pointing.seen import Station
from gimbal_pin.pointing.swinging import Swing, swinging


@dataclass(frozen=True, eq=False)
class Row:
    """One controller's runs.

    Attributes:
        controller: Its name.
        runs: One per seed.
    """

    controller: str
    runs: tuple[Pointing, ...]

    @property
    def jitter_rms(self) -> float:
        """Over all runs, rad."""
        return sqrt(float(np.mean([run.jitter[0] ** 2 for run in self.runs])))

    @property
    def jitter_max(self) -> float:
        """The largest of all runs, rad."""
        return max(run.jitter[1] for run in self.runs)

    @property
    def drift(self) -> float:
        """Mean of the runs', rad."""
        return float(np.mean([run.jitter[2] for run in self.runs]))

    @property
    def torque_rms(self) -> Mapping[str, float]:
        """Joint → torque over all runs, N m rms."""
        every = [run.torque_rms for run in self.runs]
        return {joint: sqrt(float(np.mean([one[joint] ** 2 for one in every]))) for joint in self.runs[0].joints}

    @property
    def at_limit(self) -> Mapping[str, float]:
        """Joint → share of the time at the motor's limit, mean of the runs."""
        every = [run.at_limit for run in self.runs]
        return {joint: float(np.mean([one[joint] for one in every])) for joint in self.runs[0].joints}

    @property
    def events(self) -> tuple[str, ...]:
        """What happened in any of the runs, each once."""
        return tuple(dict.fromkeys(event for run in self.runs for event in run.events))

    @property
    def happened(self) -> tuple[str, ...]:
        """The events of all runs, each kind once, with its count."""
        return summed(event for run in self.runs for event in run.events)

    @property
    def swings(self) -> tuple[Swing, ...]:
        """Per joint whose loop swings by itself in any of the runs, the largest."""
        every = sorted((swing for run in self.runs for swing in run.swings), key=lambda swing: swing.share)
        return tuple(sorted({swing.joint: swing for swing in every}.values(), key=lambda swing: -swing.share))

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `track`)."""
        return {
            "controller": self.controller,
            "platform": self.runs[0].platform,
            "seeds": len(self.runs),
            "jitter_rms_deg": degrees(self.jitter_rms),
            "jitter_max_deg": degrees(self.jitter_max),
            "drift_deg": degrees(self.drift),
            "torque_rms": dict(self.torque_rms),
            "at_limit": dict(self.at_limit),
            "events": list(self.events),
            "unstable": [swing.to_dict() for swing in self.swings],
        }


@dataclass(frozen=True, eq=False)
class Contest:
    """The result of `compete`.

    Attributes:
        rig: Name of the rig.
        payload: Its payload, or None.
        rows: One per controller.
        beside: Causes that the controllers compensate beside friction, which add torque.
    """

    rig: str
    payload: str | None
    rows: tuple[Row, ...]
    beside: tuple[str, ...] = ()

    @cached_property
    def jitter(self) -> Mapping[str, float]:
        """Controller → jitter, rad rms."""
        return {row.controller: row.jitter_rms for row in self.rows}

    @cached_property
    def stable(self) -> Mapping[str, float]:
        """The same of controllers whose loops do not swing by themselves."""
        return {row.controller: row.jitter_rms for row in self.rows if not row.swings}

    @property
    def gain(self) -> float | None:
        """Jitter of the world-frame PID over ours; None where one did not run, or is unstable."""
        return self.ratio(BASELINE, OURS)

    @property
    def distance(self) -> float | None:
        """Ours over the oracle's."""
        return self.ratio(OURS, ORACLE)

    def ratio(self, above: str, below: str) -> float | None:
        """One controller's jitter over another's, None where one did not run, or is unstable."""
        have = self.stable
        return have[above] / have[below] if above in have and below in have else None

    @property
    def budget(self) -> Budget | None:
        """Where the baseline's error goes, as far as controllers are stable."""
        return Budget.of(self.stable, self.beside)

    def to_dict(self) -> dict[str, Any]:
        """Return the rows and the budget, JSON's `pointing` and `pointing_budget`."""
        budget = self.budget
        shown = None
        if budget is not None:
            shown = {what: {"share": share, "deg": degrees(budget.size(what))} for what, share in budget.parts.items()}
        return {"pointing": [row.to_dict() for row in self.rows], "pointing_budget": shown}


Ground = Callable[[int], Platform]
"""The platform's motion of a seed, sampled at half the control interval."""


@dataclass(frozen=True, eq=False)
class Course:
    """What all controllers of a contest meet.

    Attributes:
        plant: The plant.
        ground: The platform's motion of a seed.
        motion: What it is called: "S" or "log".
        seconds: Length of a run, s.
        station: The sensors.
        drive: What stands between command and torque, after the plant's own.
        delay: Samples from measurement to torque.
    """

    plant: Model
    ground: Ground
    motion: str
    seconds: float
    station: Station
    drive: tuple[Signal, ...] = ()
    delay: int = 1

    def run(self, roster: Roster, name: str, seed: int) -> Pointing:
        """Run one controller with one seed."""
        return self.held(roster.holder(name), seed, name)

    def held(self, pointer: Holder, seed: int, name: str = "pointing") -> Pointing:
        """Run a controller that is there already."""
        ground = self.ground(seed)
        run = point(
            self.plant,
            pointer,
            ground,
            rng=np.random.default_rng([seed, 1]),
            seconds=self.seconds,
            station=self.station,
            delay=self.delay,
            drive=self.drive,
            name=name,
            motion=self.motion,
            seed=seed,
        )
        # What a loop does while its sensors fail is forced upon it; whether it swings by itself is not told apart.
        if self.station.faults:
            return run
        return replace(run, swings=swinging(self.plant, pointer.navigator.wanted, ground, run))


Mapper = Callable[[Callable[[tuple[str, int]], Pointing], Iterable[tuple[str, int]]], Iterable[Pointing]]
"""`map`, or a pool's."""


def compete(course: Course, roster: Roster, names: Sequence[str], seeds: int, mapped: Mapper = map) -> Contest:
    """Run every controller with every seed; `mapped` may run several at once."""
    plan = [(name, seed) for seed in range(seeds) for name in names]
    runs = list(mapped(Entry(course, roster), plan))
    rows = [Row(name, tuple(run for run in runs if run.controller == name)) for name in names]
    plain = friction_effects(course.plant.rig.joints)
    beside = dict.fromkeys(term.effect.name for term in roster.model.terms if term.effect not in plain)
    return Contest(course.plant.rig.name, course.plant.rig.payload, tuple(rows), tuple(beside))


@dataclass(frozen=True, eq=False)
class Entry:
    """One run of a plan, as a function that another process can be given."""

    course: Course
    roster: Roster

    def __call__(self, plan: tuple[str, int]) -> Pointing:
        """Run a controller, by name, with a seed."""
        return self.course.run(self.roster, *plan)
