"""From a rig to the table: what it is, what a log teaches of it, every controller on the platform, the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gimbal_pin.control.controllers import BASELINE, COMPILED, TUNED
from gimbal_pin.control.laws import ComputedTorque, JointPid
from gimbal_pin.control.laws.loop import Margins, worst
from gimbal_pin.control.laws.uncertainty import draw_model
from gimbal_pin.control.tracking import Tracking
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.diagnosis.result import Finding
from gimbal_pin.dynamics.model import Model, nominal
from gimbal_pin.dynamics.simulation import plant_with
from gimbal_pin.effects import Term
from gimbal_pin.effects.cause import Cause
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Log
from gimbal_pin.log.platform import Platform
from gimbal_pin.pointing.bench import LEARNED, WANTED, Recorded, Shaken, learn_roster, shaken_log, unbalanced
from gimbal_pin.pointing.demand import Demand
from gimbal_pin.pointing.measurement import Fault, Station
from gimbal_pin.pointing.result import Contest
from gimbal_pin.pointing.roster import NAMES, Machine, slack
from gimbal_pin.pointing.run import Course, Ground, compete
from gimbal_pin.pointing.sight import Sight, unable
from gimbal_pin.pointing.sweep import Sweep, sweep
from gimbal_pin.pointing.targets import Target, step_targets, stepped, targets
from gimbal_pin.rig.brief import brief
from gimbal_pin.rig.rig import Rig


def split_causes(known: Model, causes: Sequence[str]) -> tuple[dict[str, Cause], dict[str, Cause]]:
    """Return the planted causes, by their text, that a model has at the same place, and the others."""
    planted = {text: parse_effect(text, known.rig) for text in causes}
    own: dict[str, Cause] = {text: one.effect if isinstance(one, Term) else one for text, one in planted.items()}
    every = (*known.drive, *known.changes, *(term.effect for term in known.terms))
    there = {(cause.name, cause.place) for cause in every}
    has = {text: cause for text, cause in own.items() if (cause.name, cause.place) in there}
    return has, {text: cause for text, cause in own.items() if text not in has}


def planted_once(known: Model, causes: Sequence[str]) -> None:
    """Raise `UsageError` for a cause to be planted in a plant that has it, as the log that it is drawn from shows."""
    for text in split_causes(known, causes)[0]:
        what = "is in the plant already: it was found in the log that the plant is drawn from"
        raise UsageError(f"--effect {text}", what, "leave it out; plant only what that log does not show")


def missed(
    known: Model, causes: Sequence[str], sought: bool, findings: Sequence[Finding], recorded: bool = False
) -> tuple[str, ...]:
    """Return sentences about planted causes that a model does not have; what bodies take up, every fit finds.

    Args:
        known: The model that the controllers know.
        causes: What was planted, as text.
        sought: Whether `diagnose` looked for causes.
        findings: What it found.
        recorded: Whether that log was given, so that it need not be of the plant.
    """
    out = []
    for cause in split_causes(known, causes)[1].values():
        said = f"{cause.place}: {cause.name} was planted, and "
        stead = [one.cause for one in findings if cause.name in one.alike and one.joint in (cause.place, None)]
        if cause.of_given_model:
            continue
        if not sought:
            said += f"nobody looked for it (--find does{', if the log was recorded with it' * recorded})"
        elif stead:
            said += f"diagnose did not find it in the log; it told {stead[0]}, which this log cannot tell from it"
        else:
            said += (
                "diagnose did not find it in the log" + ", which shows it only if it was recorded with it" * recorded
            )
        out.append(said)
    return tuple(out)


@dataclass(frozen=True, eq=False)
class Asked:
    """What a verification is asked for.

    Attributes:
        plant: The plant; None: where a log is given, a rig that it leaves possible, else the rig as its URDF states it,
            its payload 5 mm off the last axis.
        known: The model that the controllers know; None: from a log.
        recorded: Motion of the platform; None: profile S, one per seed.
        profile: True runs profile S beside a recorded motion.
        steps: True runs the thesis's steps on a base that stands, too.
        size: Profile S times this.
        names: Controllers; None: all.
        log: The log that teaches; None: one is simulated.
        find: True lets `diagnose` look for causes in that log.
        causes: Causes planted in the plant, as text.
        faults: What goes wrong with the sensors, in every run.
        seeds: Runs of each controller.
        seconds: Length of a run, s; a recorded motion may end it sooner.
        jobs: Processes.
        delay: Samples from measurement to torque.
        law: A law whose gains hold the camera as "tuned", beside those of equal margins; None: none.
        machine: What holds the camera as "compiled", beside its `law`; None: nothing.
        sweep: True also holds it with models that are wrong on purpose.
    """

    plant: Model | None = None
    known: Model | None = None
    recorded: Platform | None = None
    profile: bool = False
    steps: bool = False
    size: float = 1.0
    names: tuple[str, ...] | None = None
    log: Log | None = None
    find: bool = False
    causes: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    seeds: int = 5
    seconds: float = 30.0
    jobs: int = 1
    delay: int = 1
    law: JointPid | ComputedTorque | None = None
    machine: Machine | None = None
    sweep: bool = False

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
        targets: The figures that count, beside their bounds.
        margins: Of the world-frame PID, the worst of its joints: all controllers have equal margins to it.
        causes: What `diagnose` found and the controllers compensate, in sentences.
        recorded: The runs on a recorded motion, where there are some on profile S as well.
        demand: What the recorded motion asks of the motors, where it asks for more than they have.
        steps: How the thesis's steps were followed, where that was asked for.
        sweep: Jitter against the model's error, where that was asked for.
        loops: Controller → the margins of its loops, joint by joint.
        missed: What was planted and the controllers do not know, in sentences.
        failed: Whether sensors failed because that was asked for.
    """

    contest: Contest
    targets: tuple[Target, ...]
    margins: Margins
    causes: tuple[str, ...]
    recorded: Contest | None = None
    demand: Demand | None = None
    steps: Tracking | None = None
    sweep: Sweep | None = None
    loops: Mapping[str, tuple[Margins, ...]] = field(default_factory=dict)
    missed: tuple[str, ...] = ()
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
        more: dict[str, Any] = {} if self.steps is None else {"experiments": self.steps.to_dict()["experiments"]}
        if self.demand is not None:
            more["pointing_demand"] = self.demand.to_dict(self.contests[-1])
        if self.sweep is not None:
            more["pointing_sweep"] = self.sweep.to_dict()
        return {
            "rig": self.contest.rig,
            "payload": self.contest.payload,
            **self.contest.to_dict(),
            "pointing": [row for contest in self.contests for row in contest.to_dict()["pointing"]],
            "pointing_targets": [
                {"name": t.name, "value": t.value, "must": t.must, "aim": t.aim, "reached": t.verdict}
                for t in self.targets
            ],
            "pointing_margins": vars(self.margins),
            "pointing_loops": {
                name: {joint: vars(own) for joint, own in zip(self.joints, found)} for name, found in self.loops.items()
            },
            "compensated": list(self.causes),
            "not_compensated": list(self.missed),
            "too_slow": list(self.slack),
            **more,
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
    if asked.log is not None and asked.plant is None:
        model, found = modelled(rig, asked.log, asked)
        known = model or identify(rig, [asked.log], holdout="none").model
        planted_once(known, asked.causes)
        plant = draw_model(known, np.random.default_rng(LEARNED))
        held = verify(rig, replace(asked, plant=plant, known=known, find=False))
        sentences = tuple(finding.sentence for finding in found)
        return replace(held, causes=sentences, missed=missed(known, asked.causes, asked.find, found, True))
    plant, drive = plant_with(
        nominal(unbalanced(rig)) if asked.plant is None else asked.plant,
        [parse_effect(text, rig) for text in asked.causes],
    )
    log = shaken_log(plant, drive) if asked.log is None else asked.log
    model, findings = modelled(rig, log, asked)
    station = Station.of(rig, asked.faults)
    roster = learn_roster(rig, log, station, model, delay=asked.delay)
    roster = replace(roster, law=asked.law, machine=asked.machine)
    courses = [Course(plant, *motion, station, drive, asked.delay) for motion in grounds(rig, asked)]
    ran = [compete(course, roster, names, asked.seeds, asked.jobs) for course in courses]
    late = max(roster.model.late(roster.dt), default=0.0) + (asked.delay - 1) * roster.dt
    judged = [target for contest in ran for target in targets(contest, Sight(rig), late)]
    demand, steps = None, None
    if courses[-1].motion == "log":
        motion, seconds = courses[-1].ground(0), courses[-1].seconds
        demand = Demand.of(plant, WANTED, motion.part(slice(np.searchsorted(motion.t, seconds, "right"))))
    if asked.steps:
        steps = stepped(replace(plant, drive=(*plant.drive, *drive)), roster.model, roster.dt, asked.delay)
        judged += step_targets(steps)
    return Verified(
        ran[0],
        tuple(judged),
        worst(list(roster.margins(BASELINE))),
        tuple(finding.sentence for finding in findings),
        recorded=ran[1] if len(ran) > 1 else None,
        demand=demand if demand is not None and demand.weak else None,
        steps=steps,
        sweep=sweep(courses[0], roster) if asked.sweep else None,
        loops={name: roster.margins(name) for name in names},
        missed=missed(roster.model, asked.causes, asked.find, findings, asked.log is not None),
        failed=bool(asked.faults),
    )


def modelled(rig: Rig, log: Log, asked: Asked) -> tuple[Model | None, tuple[Finding, ...]]:
    """Return the model that is known or that `diagnose` extends, None for the one that `identify` gives; findings."""
    if not asked.find:
        return asked.known, ()
    found = diagnose(rig, [log], rng=np.random.default_rng(LEARNED))
    if not found.is_extended:
        return asked.known, ()
    return found.after, found.lacking


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
