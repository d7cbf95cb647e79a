"""From a rig to the table: what it is, what a log teaches of it, every controller on the platform, the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gimbal_pin.control.controllers import BASELINE, COMPILED, TUNED
from gimbal_pin.control.laws import ComputedTorque, JointPid
from gimbal_pin.control.laws.loop import Margins, worst
from gimbal_pin.control.laws.uncertainty import draw_model
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import plant_with
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import LEARNED, WANTED, Recorded, Shaken, learn_roster, shaken_log, unbalanced
from gimbal_pin.pointing.measurement import Fault, Station
from gimbal_pin.pointing.result import Contest
from gimbal_pin.pointing.roster import NAMES, Machine, slack
from gimbal_pin.pointing.run import Course, Ground, compete
from gimbal_pin.pointing.sight import Sight, unable
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True, eq=False)
class Asked:
    """What a verification is asked for.

    Attributes:
        plant: The plant; None: where a log is given, a rig that it leaves possible, else the rig as its URDF states it,
            its payload 5 mm off the last axis.
        known: The model that the controllers know; None: from a log.
        recorded: Motion of the platform; None: profile S, one per seed.
        profile: True runs profile S beside a recorded motion.
        size: Profile S times this.
        names: Controllers; None: all.
        log: The log that teaches; None: one is simulated.
        causes: Causes planted in the plant, as text.
        faults: What goes wrong with the sensors, in every run.
        seeds: Runs of each controller.
        seconds: Length of a run, s; a recorded motion may end it sooner.
        jobs: Processes.
        delay: Samples from measurement to torque.
        law: A law whose gains hold the camera as "tuned", beside those of equal margins; None: none.
        machine: What holds the camera as "compiled", beside its `law`; None: nothing.
    """

    plant: Model | None = None
    known: Model | None = None
    recorded: Platform | None = None
    profile: bool = False
    size: float = 1.0
    names: tuple[str, ...] | None = None
    log: Log | None = None
    causes: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    seeds: int = 5
    seconds: float = 30.0
    jobs: int = 1
    delay: int = 1
    law: JointPid | ComputedTorque | None = None
    machine: Machine | None = None

    @property
    def whom(self) -> tuple[str, ...]:
        """Names of the controllers.

        Raises:
            UsageError: One is unknown.
        """
        every = NAMES if self.law is None else (*NAMES, TUNED)
        every = every if self.machine is None else (*every, COMPILED)
        names = every if self.names is None else self.names
        for name in names:
            if name not in every:
                raise UsageError("--controllers", f"knows no '{name}'", f"there are {', '.join(every)}")
        return names


@dataclass(frozen=True, eq=False)
class Verified:
    """The result of `verify`.

    Attributes:
        contest: Every controller's runs: on profile S, on a recorded motion where that was asked for alone.
        margins: Of the world-frame PID, the worst of its joints: all controllers have equal margins to it.
        recorded: The runs on a recorded motion, where there are some on profile S as well.
        loops: Controller → the margins of its loops, joint by joint.
        failed: Whether sensors failed because that was asked for.
    """

    contest: Contest
    margins: Margins
    recorded: Contest | None = None
    loops: Mapping[str, tuple[Margins, ...]] = field(default_factory=dict)
    failed: bool = False

    __repr__ = brief

    @property
    def contests(self) -> tuple[Contest, ...]:
        """The runs of every motion, profile S first."""
        return (self.contest,) if self.recorded is None else (self.contest, self.recorded)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names."""
        return self.contest.rows[0].runs[0].joints

    @property
    def slack(self) -> tuple[str, ...]:
        """Whose loops are too slow to hold the camera, in sentences."""
        return slack(self.loops, self.joints)

    def to_dict(self) -> dict[str, Any]:
        """Return what `track --json` writes."""
        return {
            "rig": self.contest.rig,
            "payload": self.contest.payload,
            **self.contest.to_dict(),
            "pointing": [row for contest in self.contests for row in contest.to_dict()["pointing"]],
            "pointing_margins": vars(self.margins),
            "pointing_loops": {
                name: {joint: vars(own) for joint, own in zip(self.joints, found)} for name, found in self.loops.items()
            },
            "too_slow": list(self.slack),
        }


def verify(rig: Rig, asked: Asked) -> Verified:
    """Run every controller on a platform that moves as asked, at equal margins, and judge what came out.

    Raises:
        UsageError: A rig that cannot hold its camera (see `unable`), a controller that is unknown, a motion that is too
            short, a loop that diverges.
    """
    names = asked.whom
    if reason := unable(rig, WANTED):
        raise UsageError(f"rig {rig.name}", f"cannot hold its camera: {reason}", "state or change that in its YAML")
    known, given = asked.known, asked.plant
    if asked.log is not None and given is None:
        known = known or identify(rig, [asked.log], holdout="none").model
        given = draw_model(known, np.random.default_rng(LEARNED))
    planted = [parse_effect(text, rig) for text in asked.causes]
    plant, drive = plant_with(nominal(unbalanced(rig)) if given is None else given, planted)
    log = shaken_log(plant, drive) if asked.log is None else asked.log
    station = Station.of(rig, asked.faults)
    roster = replace(learn_roster(rig, log, station, known, delay=asked.delay), law=asked.law, machine=asked.machine)
    courses = [Course(plant, *motion, station, drive, asked.delay) for motion in grounds(rig, asked)]
    ran = [compete(course, roster, names, asked.seeds, asked.jobs) for course in courses]
    return Verified(
        ran[0],
        worst(list(roster.margins(BASELINE))),
        recorded=ran[1] if len(ran) > 1 else None,
        loops={name: roster.margins(name) for name in names},
        failed=bool(asked.faults),
    )


def grounds(rig: Rig, asked: Asked) -> list[tuple[Ground, str, float]]:
    """Return the platform's motions that are asked for, their names, and how long a run may last, s.

    As profile S, a recorded motion is taken for that of the point where the axes meet, see `Shaken`.
    """
    centre, out = Sight(rig).centre, list[tuple[Ground, str, float]]()
    if asked.profile or asked.recorded is None:
        out.append((Shaken(centre, asked.seconds, size=asked.size), "S", asked.seconds))
    if asked.recorded is not None:
        lasting = float(asked.recorded.t[-1] - asked.recorded.t[0])
        longest = min(asked.seconds, np.floor(lasting * 1000 - 1) / 1000)
        out.append((Recorded(asked.recorded.about(centre)), "log", longest))
    return out
