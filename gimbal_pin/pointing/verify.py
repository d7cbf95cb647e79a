"""From a rig to the table: what it is, what a log teaches of it, every controller on the platform, the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tqdm import tqdm

from gimbal_pin.control.loop import Margins
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.model import Model, nominal
from gimbal_pin.platform import Platform
from gimbal_pin.pointing.bench import LEARNED, Recorded, Shaken, entered, learned, shaken_log, unbalanced
from gimbal_pin.pointing.contest import Contest, Course, Ground, Mapper, compete
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.roster import NAMES
from gimbal_pin.pointing.seen import Station
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.pointing.targets import Target, targets
from gimbal_pin.pointing.trust import drawn
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with


@dataclass(frozen=True, eq=False)
class Asked:
    """What a verification is asked for.

    Attributes:
        plant: The plant; None: where a log is given, a rig that it leaves possible, else the rig as its URDF states it,
            its payload 5 mm off the last axis.
        known: The model that the controllers know; None: from a log.
        recorded: Motion of the platform; None: profile S, one per seed.
        size: Profile S times this.
        names: Controllers; None: all.
        log: The log that teaches; None: one is simulated.
        find: True lets `diagnose` look for causes in that log.
        causes: Causes planted in the plant, as text.
        seeds: Runs of each controller.
        seconds: Length of a run, s; a recorded motion may end it sooner.
        jobs: Processes.
        delay: Samples from measurement to torque.
    """

    plant: Model | None = None
    known: Model | None = None
    recorded: Platform | None = None
    size: float = 1.0
    names: tuple[str, ...] | None = None
    log: Log | None = None
    find: bool = False
    causes: tuple[str, ...] = ()
    seeds: int = 5
    seconds: float = 30.0
    jobs: int = 1
    delay: int = 1


@dataclass(frozen=True, eq=False)
class Verified:
    """The result of `verify`.

    Attributes:
        contest: Every controller's runs.
        targets: The figures that count, beside their bounds.
        margins: Of the loop that all controllers have equal margins to.
        causes: What `diagnose` found and the controllers compensate, in sentences.
        late: How far ahead the platform's motion is foreseen, s, per distinct drive.
    """

    contest: Contest
    targets: tuple[Target, ...]
    margins: Margins
    causes: tuple[str, ...]
    late: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds (CONTRACT, `track`)."""
        return {
            "rig": self.contest.rig,
            "payload": self.contest.payload,
            **self.contest.to_dict(),
            "pointing_targets": [
                {"name": t.name, "value": t.value, "must": t.must, "aim": t.aim, "reached": t.verdict}
                for t in self.targets
            ],
            "pointing_margins": vars(self.margins),
            "compensated": list(self.causes),
        }


def verify(rig: Rig, asked: Asked) -> Verified:
    """Run every controller on a platform that moves, at equal margins, and judge what came out.

    Raises:
        UsageError: A controller that is unknown, a motion that is too short, a loop that diverges.
    """
    names = NAMES if asked.names is None else asked.names
    for name in names:
        if name not in NAMES:
            raise UsageError("--controllers", f"knows no '{name}'", f"there are {', '.join(NAMES)}")
    if asked.log is not None and asked.plant is None:
        model, causes = modelled(rig, asked.log, asked)
        known = model or identify(rig, [asked.log], holdout="none").model
        plant = drawn(known, np.random.default_rng(LEARNED))
        return replace(verify(rig, replace(asked, plant=plant, known=known, find=False)), causes=causes)
    plant, drive = plant_with(
        nominal(unbalanced(rig)) if asked.plant is None else asked.plant,
        [parse_effect(text, rig) for text in asked.causes],
    )
    log = shaken_log(plant, drive) if asked.log is None else asked.log
    model, causes = modelled(rig, log, asked)
    lesson = learned(rig, log, model=model)
    motion, kind, seconds = ground(rig, asked)
    course = Course(plant, motion, kind, seconds, Station.of(rig), drive, asked.delay)
    roster = entered(lesson, course)
    found = shared(course, asked, names, roster)
    late = max(lesson.model.late(roster.dt), default=0.0) + (asked.delay - 1) * roster.dt
    return Verified(found, targets(found, Sight(rig), late), roster.equal.margins, causes, roster.leads)


def modelled(rig: Rig, log: Log, asked: Asked) -> tuple[Model | None, tuple[str, ...]]:
    """Return the model that is known or that `diagnose` extends, None for the one that `identify` gives, and causes."""
    if not asked.find:
        return asked.known, ()
    found = diagnose(rig, [log], rng=np.random.default_rng(LEARNED))
    after = found.after
    if after is None or not found.findings:
        return asked.known, ()
    return after.model, tuple(finding.sentence for finding in found.findings)


def ground(rig: Rig, asked: Asked) -> tuple[Ground, str, float]:
    """Return the platform's motion, its name, and how long a run may last, s.

    As profile S, a recorded motion is taken for that of the point where the axes meet, see `Shaken`.
    """
    if asked.recorded is None:
        return Shaken(Sight(rig).centre, asked.seconds, size=asked.size), "S", asked.seconds
    lasting = float(asked.recorded.t[-1] - asked.recorded.t[0])
    return (
        Recorded(asked.recorded.about(Sight(rig).centre)),
        "log",
        min(asked.seconds, np.floor(lasting * 1000 - 1) / 1000),
    )


def shared(course: Course, asked: Asked, names: Sequence[str], roster: Any) -> Contest:
    """Run a contest, by several processes if so asked, under a bar."""
    total = len(names) * asked.seeds
    with tqdm(total=total, desc="pointing", unit="run", disable=None, leave=False, delay=2) as bar:

        def counted(mapped: Mapper) -> Mapper:
            def run(entry: Any, plan: Iterable[tuple[str, int]]) -> Iterable[Pointing]:
                for one in mapped(entry, plan):
                    bar.update()
                    yield one

            return run

        if asked.jobs == 1:
            return compete(course, roster, names, asked.seeds, counted(map))
        with ProcessPoolExecutor(asked.jobs) as pool:
            return compete(course, roster, names, asked.seeds, counted(pool.map))
