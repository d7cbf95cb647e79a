"""``gimbal-pin track --platform``: options of a camera that is held on a platform that moves, and its pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import UseAppendAction, arg

from gimbal_pin.cli.inputs import carried, load_logs
from gimbal_pin.cli.options import Effects, Page, PlatformSize, Plotted, Yes, between, optional
from gimbal_pin.cli.paths import Reads, logs, maps
from gimbal_pin.cli.present import noted
from gimbal_pin.cli.work import affordable
from gimbal_pin.control.controllers import COMPILED, HOLDING, TUNED
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Law
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.log.log import Log
    from gimbal_pin.pointing import Verified
    from gimbal_pin.pointing.roster import Machine
    from gimbal_pin.rig.rig import Rig

MOTIONS = "--platform S, --platform-log FILE"
GIVEN = {TUNED: "the gains of CONTROLLER", COMPILED: "the same, compiled, from --compiled"}
THERE = "; ".join(f"{name} ({what})" for name, what in {**HOLDING, **GIVEN}.items())


@dataclass(frozen=True)
class Holding:
    """Options of a camera that is held still."""

    platform: Annotated[
        Literal["none", "S"], arg(help="hold the camera still on a platform that moves along profile S")
    ] = "none"
    platform_log: Annotated[
        Path | None,
        Reads(logs),
        optional("FILE", "and, or, along a recorded motion: gyro_ and accel_ of the base link, low-passed at 20 Hz"),
    ] = None
    platform_size: PlatformSize = 1.0
    map: Annotated[
        UseAppendAction[tuple[str, ...]],
        Reads(maps),
        arg(
            metavar="COLUMN=SOURCE",
            help="columns of --platform-log, of --learn where that is the only log: gyro_base_x=gx*pi/180, t=time, or "
            "a YAML file of these; repeatable",
        ),
    ] = ()
    controllers: Annotated[str | None, optional("NAME,…", f"who meets the platform: {THERE}", "all")] = None
    learn: Annotated[
        str | None,
        Reads(logs),
        optional(
            "LOG",
            "a log of the rig on a shaken platform: model and the platform's spectrum come from it",
            "one is simulated, 60 s",
        ),
    ] = None
    effect: Effects = ()
    fault: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(
            metavar="KIND:SENSOR:START:END",
            help="let a sensor fail: frozen:platform-imu:3:4, nan:camera-gyro:2, dropped:3:3.01, clock:3:-1, in s; "
            "repeatable",
        ),
    ] = ()
    seeds: Annotated[
        int, between("--seeds", 1, 10000, kind=int), arg(help="runs on a platform, each with its own motion and noise")
    ] = 5
    seconds: Annotated[float, between("--seconds", 0.1, 3600, "s"), arg(help="length of each of these runs")] = 30.0
    yes: Yes = False
    jobs: Annotated[int, between("--jobs", 1, 64, kind=int), arg(help="processes that share these runs")] = 1

    @property
    def moving(self) -> bool:
        """Whether the platform moves."""
        return self.platform != "none" or self.platform_log is not None

    def check(self) -> None:
        """Raise `UsageError` for what does not go together."""
        if not self.moving and self.fault:
            raise UsageError("--fault", "goes with a platform that moves", f"give {MOTIONS}")

    def taught(self, rig: str, payload: str | None) -> Log | None:
        """Return the log that teaches, if one is named; say what is wrong with its platform's IMU."""
        from gimbal_pin.checks import check_platform_log

        if self.learn is None:
            return None
        own: Sequence[str] = () if self.platform_log is not None else self.map
        loaded, (log,) = load_logs(rig, payload, [self.learn], own)
        if loaded.base in log.imus:
            noted(check_platform_log(log.t, log.imus[loaded.base], log.name).notes)
        return log

    def verified(
        self,
        rig: Rig,
        plant: Model | None,
        known: Model | None,
        law: Law | None,
        log: Log | None,
        late: int,
        machine: Machine | None = None,
    ) -> Verified:
        """Hold the camera, and judge it; what is given beside the rig is what `Asked` calls so, `late` its delay."""
        from gimbal_pin.pointing.measurement import parse_fault
        from gimbal_pin.pointing.verify import Asked, verify

        asked = Asked(
            plant=plant,
            known=known,
            law=law,
            log=log,
            recorded=carried(rig, "none", self.platform_log, self.map, 1.0, 0.0, 1e-3, 0),
            profile=self.platform == "S",
            size=self.platform_size,
            names=None if self.controllers is None else tuple(self.controllers.split(",")),
            causes=tuple(self.effect),
            faults=tuple(parse_fault(text) for text in self.fault),
            seeds=self.seeds,
            seconds=self.seconds,
            jobs=self.jobs,
            delay=late,
            machine=machine,
        )
        runs = len(asked.whom) * self.seeds * (1 + (asked.recorded is not None and asked.profile))
        affordable(self.yes, self.jobs, second_of_a_joint_on_a_platform=runs * self.seconds * rig.n)
        return verify(rig, asked)


@dataclass(frozen=True)
class Pages:
    """Pictures and pages that are asked for."""

    plot: Annotated[
        Plotted, optional("FILE", "draw line of sight, spectrum, torque and budget: .png, .svg or .pdf")
    ] = None
    report: Annotated[Page, optional("FILE", "write a report: what the camera sees, errors, torque")] = None
    animation: Annotated[Page, optional("FILE", "write the rig on its platform as an offline page")] = None

    def check(self, moving: bool) -> None:
        """Raise `UsageError` for a picture of a platform that stands."""
        for option, path in (("--animation", self.animation), ("--plot", self.plot)):
            if path is not None and not moving:
                raise UsageError(option, "has no platform to show", f"name a motion: {MOTIONS}")

    def write(
        self, rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None
    ) -> None:
        """Write them."""
        from gimbal_pin.log.io.files import atomic_write, open_replacement
        from gimbal_pin.report.camera_chart import chart
        from gimbal_pin.report.pages import carried as whole
        from gimbal_pin.report.pages import moving

        if self.plot is not None and held is not None:
            with open_replacement(self.plot) as temporary:
                chart(held.contest).savefig(temporary)
        if self.report is not None:
            atomic_write(self.report, whole(rig, held, steps, plant, judged))
        if self.animation is not None and held is not None:
            atomic_write(self.animation, moving(rig, held))


STILL, NO_PAGES = Holding(), Pages()
