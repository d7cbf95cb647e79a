"""``gimbal-pin track --platform``: options of a camera that is held on a platform that moves, and its pages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import UseAppendAction, arg

from gimbal_pin.cli.inputs import load_logs, read_platform
from gimbal_pin.cli.options import Effects, Map, Page, PlatformSize, Plotted, Yes, between, optional
from gimbal_pin.cli.present import tell
from gimbal_pin.cli.work import check_cost
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.control.judging import Judgement
    from gimbal_pin.control.tracking import Tracking
    from gimbal_pin.control.tuning import Stored
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.log.log import Log
    from gimbal_pin.pointing.recipe import Machine
    from gimbal_pin.pointing.result import Verified
    from gimbal_pin.rig.rig import Rig

MOTIONS = "--platform S, --platform-log FILE"
RECORDED = "or along a recorded motion: gyro_ and accel_ of the base link, low-passed at 20 Hz"
LEARNED = "a log of the rig on a shaken platform: model and the platform's spectrum come from it; --map is its own "
LEARNED += "where there is no --platform-log"
FAULTS = "let a sensor fail: frozen:platform-imu:3:4, nan:camera-gyro:2, dropped:3:3.01, clock:3:-1, in s"


@dataclass(frozen=True)
class Holding:
    """Options of a camera that is held still, and of its pages."""

    platform: Annotated[
        Literal["none", "S"], arg(help="hold the camera still on a platform that moves along profile S")
    ] = "none"
    platform_log: Annotated[Path | None, optional("FILE", RECORDED)] = None
    platform_size: PlatformSize = 1.0
    map: Map = ()
    learn: Annotated[str | None, optional("LOG", LEARNED, "one is simulated, 60 s")] = None
    effect: Effects = ()
    fault: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KIND:SENSOR:START:END", help=FAULTS)] = ()
    seeds: Annotated[
        int, between("--seeds", 1, 10000, kind=int), arg(help="runs on a platform, each with its own motion and noise")
    ] = 5
    seconds: Annotated[float, between("--seconds", 0.1, 3600, "s"), arg(help="length of each of these runs")] = 30.0
    yes: Yes = False
    jobs: Annotated[int, between("--jobs", 1, 64, kind=int), arg(help="processes that share these runs")] = 1
    plot: Annotated[Plotted, optional("FILE", "draw line of sight, spectrum and torque: .png, .svg or .pdf")] = None
    report: Annotated[Page, optional("FILE", "write a report: what the camera sees, errors, torque")] = None
    animation: Annotated[Page, optional("FILE", "write the rig on its platform as an offline page")] = None

    @property
    def moving(self) -> bool:
        """Whether the platform moves."""
        return self.platform != "none" or self.platform_log is not None

    def check(self) -> None:
        """Raise `UsageError` for what only a platform that moves has."""
        for option, given in (("--animation", self.animation), ("--plot", self.plot), ("--fault", self.fault)):
            if given and not self.moving:
                raise UsageError(option, "has no platform that moves", f"name a motion: {MOTIONS}")

    def taught(self, rig: str, payload: str | None) -> Log | None:
        """Return the log that teaches, if one is named; say what is wrong with its platform's IMU."""
        from gimbal_pin.checks import check_platform_log

        if self.learn is None:
            return None
        loaded, (log,) = load_logs(rig, payload, [self.learn], self.map if self.platform_log is None else ())
        if loaded.base in log.imus:
            tell(check_platform_log(log.t, log.imus[loaded.base], log.name).notes)
        return log

    def verified(
        self, rig: Rig, log: Log | None, plant: Model | None, tuned: Stored | None, machine: Machine | None, late: int
    ) -> Verified:
        """Hold the camera, see `verify`; `late`: samples from measurement to torque."""
        from gimbal_pin.pointing import parse_fault, verify

        path = self.platform_log
        recorded = None if path is None else read_platform(rig, self.platform, path, self.map, 1.0, 0.0, 1e-3, 0)
        known, law = (None, None) if tuned is None else (tuned.model, tuned.law)
        runs = self.seeds * (2 + (machine is not None))
        check_cost(self.yes, self.jobs, second_of_a_joint_on_a_platform=runs * self.seconds * rig.n)
        return verify(
            rig, log=log, plant=plant, known=known, law=law, machine=machine,
            recorded=recorded, size=self.platform_size, causes=self.effect,
            faults=tuple(parse_fault(text) for text in self.fault), seeds=self.seeds, seconds=self.seconds,
            jobs=self.jobs, delay=late,
        )  # fmt: skip

    def write(
        self, rig: Rig, held: Verified | None, steps: Tracking | None, plant: str, judged: Judgement | None
    ) -> None:
        """Write the pages that were asked for."""
        from gimbal_pin.log.io.files import atomic_write, open_replacement
        from gimbal_pin.report import pages
        from gimbal_pin.report.camera_chart import chart

        if self.plot is not None and held is not None:
            with open_replacement(self.plot) as temporary:
                chart(held).savefig(temporary)
        if self.report is not None:
            atomic_write(self.report, pages.carried(rig, held, steps, plant, judged))
        if self.animation is not None and held is not None:
            atomic_write(self.animation, pages.moving(rig, held))


STILL = Holding()
