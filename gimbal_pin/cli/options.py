"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg
from tyro.constructors import PrimitiveConstructorSpec

from gimbal_pin.cli.paths import (
    Reads,
    Writes,
    diagnosed,
    log_suffixes,
    logs,
    maps,
    payloads,
    plot_suffixes,
    rigs,
    walked,
)
from gimbal_pin.errors import UsageError, shortened

if TYPE_CHECKING:
    from gimbal_pin.control.laws.design import Wish
    from gimbal_pin.fleet.engine import Capacity, ExecutorFactory


def optional(metavar: str | None, help: str, default: str = "") -> Any:
    """Describe an option that may be left out; `default` says what then is the case, where that is no plain value."""
    return arg(metavar=metavar, help=help, help_behavior_hint=default and f"(default: {default})")


def between(option: str, low: float, high: float, unit: str = "", kind: type[int] | type[float] = float) -> Any:
    """Read an option's number, which must lie between two bounds; ``--help`` shows them where the value stands.

    Raises:
        UsageError: It is something else, a NaN for one.
    """
    ends = [f"{end:.10g}" for end in (low, high)]

    def read(words: list[str]) -> float:
        try:
            if words[0].isascii() and low <= (value := kind(words[0])) <= high:
                return value
            said = words[0].strip()
        except (ValueError, OverflowError):
            said = f"'{words[0]}'"
        number = "a whole number from" if kind is int else ""
        raise UsageError(option, f"is {shortened(said, 40)}", f"give {number} {' to '.join(ends)} {unit}".rstrip())

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{'..'.join(ends)} {unit}".rstrip(),
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, (int, float)),
        str_from_instance=lambda value: [str(value)],
    )


RigName = Annotated[
    Positional[str],
    Reads(rigs),
    arg(metavar="RIG", help="bundled rig, URDF, xacro, SDF or MJCF, or a YAML that names one"),
]
Logs = Annotated[
    Positional[tuple[str, ...]],
    Reads(logs),
    arg(
        metavar="LOG …",
        help="CSV, Parquet, NumPy, MATLAB, ROS bag or ULog; A.csv+B.csv: one log; LOG@PAYLOAD names its payload",
        help_behavior_hint="(at least one)",
    ),
]
Payload = Annotated[str | None, Reads(payloads), optional("NAME", "bundled payload or URDF", "the rig's own")]
Mass = Annotated[
    float | None,
    between("--mass", 1e-4, 1e4, "kg"),
    optional(None, "what the payload weighs on a scale: its place and balance then stand on that", "as the log shows"),
]
Page = Annotated[Path | None, Writes(suffixes=(".html",))]
Plotted = Annotated[Path | None, Writes(chosen=plot_suffixes)]
Json = Annotated[
    Path | None,
    Writes(suffixes=(".json", ".jsonl")),
    optional("FILE", "write the result as JSON; - for standard output"),
]
Map = Annotated[
    UseAppendAction[tuple[str, ...]],
    Reads(maps),
    arg(metavar="COLUMN=SOURCE", help="q_yaw=pos1, tau_yaw=iq*0.0276, t=time, or a YAML file of these; repeatable"),
]
Effects = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        metavar="CAUSE:JOINT:NAME=VALUE,…",
        help="plant a cause, e.g. cogging:yaw:amplitude=0.1,harmonic=42; 'simulate RIG --effect help' lists all",
    ),
]
# The largest is a shock of 10 g for profile S, of 1 m/s² rms.
PlatformSize = Annotated[float, between("--platform-size", 0, 100), arg(help="profile S times this")]
Output = Annotated[Path, Writes(chosen=log_suffixes), arg(aliases=["-o"], metavar="FILE", help="where to write")]
INTO_FILE = arg(aliases=["-o"], metavar="FILE", help="where to write", help_behavior_hint="")
MaybeOutput = Annotated[Path | None, Writes(chosen=log_suffixes), INTO_FILE]
MaybeYaml = Annotated[Path | None, Writes(suffixes=(".yaml", ".yml")), INTO_FILE]
INTO = "folder for the files, made if it is not there; its run.json says which run they are of"
Folder = Annotated[Path, Writes(walked, run=True), arg(aliases=["-o"], metavar="DIR", help=INTO)]
MaybeFolder = Annotated[
    Path | None, Writes(diagnosed, run=True), arg(aliases=["-o"], metavar="DIR", help=INTO, help_behavior_hint="")
]
ModelFile = Annotated[
    Path | None,
    Reads(),
    optional("MODEL", "the plant: a model's YAML, from identify or diagnose", "the rig as its URDF states it"),
]
Yes = Annotated[bool, arg(help="begin even what takes over ten minutes, or over half of the memory")]
Verbose = Annotated[bool, arg(help="print all that was found, not the outcome alone")]
Seed = Annotated[int, between("--seed", 0, 2**32 - 1, kind=int), arg(help="seed of everything random")]
# A filter of 0.1 Hz remembers longer than most logs last; over 1 kHz no gimbal's mechanics answer.
BAND = between("--cutoff", 0.1, 1000, "Hz")
Cutoff = Annotated[
    float | None, BAND, optional(None, "low-pass on every column and on the torque", "4; 12 where the base turns")
]
# A torque that is off by more than a second is no matter of alignment.
Alignment = Annotated[
    float | None,
    between("--alignment", -1, 1, "s"),
    optional(None, "the torque acts that much later than its stamp", "half a sample"),
]
Holdout = Annotated[
    str | None, optional("WHAT", "last-third, log:N or none", "the last third of one log, the last of several")
]
EstimatorName = Literal["weighted", "ols", "robust", "instrumental", "output-error", "ridge", "physical"]


# 1 kHz is what controllers are sampled at: from a tenth of that on no loop of theirs is one.
HERTZ = between("--bandwidth-hz", 0.1, 100, "Hz")
DELAY_SAMPLES = between("--delay-samples", 0, 50, kind=int)
"""As `tune` allows: a gimbal cannot be held with more."""


@dataclass(frozen=True)
class Gains:
    """What is asked of the controller (`Wish`)."""

    kind: Literal["computed-torque", "pid"] = "computed-torque"
    bandwidth_hz: Annotated[
        float | None, HERTZ, arg(help="bandwidth, 8 Hz by default; with --disk-margin the highest that keeps it")
    ] = None
    disk_margin: Annotated[
        float | None,
        between("--disk-margin", 0.01, 1.99),
        arg(help="disk margin that every joint keeps over the model's uncertainty"),
    ] = None
    damping: Annotated[float, between("--damping", 0.05, 20), arg(help="damping of the tracking error")] = 1.0
    integral: Annotated[
        float, between("--integral", 0, 10), arg(help="speed of the integral action, in bandwidths; 0: none")
    ] = 0.2
    delay: Annotated[
        float | None,
        between("--delay", 0, 0.05, "s"),
        optional(None, "time from measurement to torque, without the hold", "one sample"),
    ] = None
    dt: Annotated[
        float | None,
        between("--dt", 1e-5, 0.1, "s"),
        optional(None, "sampling interval of the controller", "the logs'"),
    ] = None
    robust: Annotated[bool, arg(help="add Lyapunov redesign")] = False

    def to_wish(self, dt: float | None) -> Wish:
        """Return what `tune` is asked for; `dt`: the sampling interval where no option states it, s."""
        from gimbal_pin.control.laws.design import Wish

        return Wish.sampled(**{**vars(self), "dt": self.dt or dt})


Plants = Annotated[
    int,
    between("--plants", 1, 10000, kind=int),
    arg(help="perturbed plants on which the controller is judged beside a PID"),
]

USUAL = Gains()


@dataclass(frozen=True)
class Workers:
    """Options of what runs many units."""

    workers: Annotated[
        int,
        between("--workers", 0, 4096, kind=int),
        arg(help="processes of this machine; 0: one per processor, 1: no other than this one"),
    ] = 0
    scheduler: Annotated[
        str | None, optional("tcp://HOST:PORT", "run on the Dask cluster of this scheduler instead")
    ] = None
    yes: Yes = False

    @contextmanager
    def running(self) -> Iterator[tuple[ExecutorFactory | None, int | Capacity]]:
        """Return what runs the units, None for processes of this machine, and how many at once."""
        from gimbal_pin.fleet.engine import dask_executors

        if self.scheduler is None:
            yield None, self.workers
            return
        with dask_executors(self.scheduler) as (factory, capacity):
            yield factory, self.workers or capacity


HERE = Workers()
