"""Options that several verbs share; those of one verb are described in its docstring."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from tyro.conf import Positional, UseAppendAction, arg
from tyro.constructors import PrimitiveConstructorSpec

from gimbal_pin.cli import paths
from gimbal_pin.cli.paths import Reads, Writes
from gimbal_pin.errors import UsageError, shortened

if TYPE_CHECKING:
    from gimbal_pin.control.laws.design import Wish
    from gimbal_pin.dynamics.model import Model

T = TypeVar("T")
Maybe = Annotated[T | None, arg(help_behavior_hint="")]
"""An option that may be left out: its description says what is the case then."""
File = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
Folder = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
Repeated = Annotated[UseAppendAction[tuple[str, ...]], arg(help_behavior_hint="(repeatable)")]


def between(
    option: str, low: float, high: float, unit: str = "", kind: type[int] | type[float] = float
) -> Any:
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
        raise UsageError(
            option,
            f"is {shortened(said, 40)}",
            f"give {number} {' to '.join(ends)} {unit}".rstrip(),
        )

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{'..'.join(ends)} {unit}".rstrip(),
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, (int, float)),
        str_from_instance=lambda value: [str(value)],
    )


def optional(metavar: str | None, help: str, default: str = "") -> Any:
    """Describe an option that may be left out; `default` says what then is the case, where that is no plain value."""
    return arg(metavar=metavar, help=help, help_behavior_hint=default and f"(default: {default})")


RIG_FILES = Reads(paths.list_rig_files)
RigName = Annotated[
    Positional[str],
    RIG_FILES,
    arg(
        metavar="RIG",
        help="bundled rig, URDF, xacro, SDF, MJCF, NAME_description, or a YAML that names one",
    ),
]
OtherRig = Annotated[Maybe[str], RIG_FILES, arg(metavar="RIG")]
Logs = Annotated[
    Positional[tuple[str, ...]],
    arg(
        metavar="LOG …",
        help="CSV, Parquet, NumPy, MATLAB, ROS bag, LeRobot, ULog; A.csv+B.csv: one log; LOG@PAYLOAD names its payload",
        help_behavior_hint="(at least one)",
    ),
]
Payload = Annotated[
    str | None,
    Reads(paths.list_payload_files),
    optional("NAME", "bundled payload or URDF", "the rig's own"),
]
Mass = Annotated[
    float | None,
    between("--mass", 1e-4, 1e4, "kg"),
    optional(
        None,
        "what the payload weighs on a scale: its place and balance then stand on that",
        "as the log shows",
    ),
]
ModelFile = Annotated[
    Path | None,
    optional(
        "MODEL",
        "the plant: a model's YAML, from identify or diagnose",
        "the rig as its URDF states it",
    ),
]
Map = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        metavar="COLUMN=SOURCE",
        help="q_yaw=pos1, tau_yaw=iq*0.0276, t=time, or a YAML file of these",
    ),
]
Effects = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        metavar="CAUSE:JOINT:NAME=VALUE,…",
        help="plant a cause, e.g. cogging:yaw:amplitude=0.1,harmonic=42; 'simulate RIG --effect help' lists all",
    ),
]
TO = arg(aliases=["-o"], help="where to write")
Output = Annotated[Path, Writes(paths.list_log_suffixes), TO, arg(metavar="FILE")]
MaybeOutput = Annotated[File, Writes(paths.list_log_suffixes), TO]
MaybeYaml = Annotated[File, Writes((".yaml", ".yml")), TO]
INTO = arg(
    aliases=["-o"],
    help="folder for the files, made if it is not there; its run.json says of which run",
)
AutoFolder = Annotated[Path, Writes(run=paths.list_auto_files), INTO, arg(metavar="DIR")]
Results = Annotated[
    Path,
    arg(
        aliases=["-o"],
        metavar="DIR",
        help="folder for the results; a run that was interrupted continues there",
    ),
]
Urdf = Annotated[File, Writes((".urdf", ".xml"))]
Mjcf = Annotated[File, Writes((".xml", ".mjcf"))]
Mcap = Annotated[
    File,
    Writes((".mcap",)),
    arg(
        help="write measured, model's and residual torque as JointState, for Foxglove and PlotJuggler"
    ),
]
Rrd = Annotated[File, Writes((".rrd",)), arg(help="write the same with the moving rig, for Rerun")]
Page = Annotated[File, Writes((".html",))]
Plotted = Annotated[File, Writes(paths.list_plot_suffixes)]
Json = Annotated[
    File, Writes((".json", ".jsonl")), arg(help="write the result as JSON; - for standard output")
]
Verbose = Annotated[bool, arg(help="print all that was found, not the outcome alone")]
LiveView = Annotated[bool, arg(help="show the result in a browser on this machine")]
Seed = Annotated[
    int, between("--seed", 0, 2**32 - 1, kind=int), arg(help="seed of everything random")
]
# The largest is a shock of 10 g for profile S, of 1 m/s² rms.
PlatformSize = Annotated[
    float, between("--platform-size", 0, 100), arg(help="profile S times this")
]
TorqueNoise = Annotated[
    float,
    between("--torque-noise", 0, 10),
    arg(help="noise on the reported torque, share of its rms"),
]
# A filter of 0.1 Hz remembers longer than most logs last; over 1 kHz no gimbal's mechanics answer.
CUTOFF_RANGE = between("--cutoff", 0.1, 1000, "Hz")
Cutoff = Annotated[
    float | None,
    CUTOFF_RANGE,
    optional(None, "low-pass on every column and on the torque", "4; 12 where the base turns"),
]
# A torque that is off by more than a second is no matter of alignment.
Alignment = Annotated[
    float | None,
    between("--alignment", -1, 1, "s"),
    optional(None, "the torque acts that much later than its stamp", "as the log says"),
]
Holdout = Annotated[
    str | None,
    optional("WHAT", "last-third, log:N or none", "the last third of one log, the last of several"),
]
EstimatorName = Annotated[
    Literal["weighted", "ols", "robust", "instrumental", "output-error", "ridge", "physical"],
    arg(help="how parameters are estimated from the equations"),
]
# 1 kHz is what controllers are sampled at: from a tenth of that on no loop of theirs is one.
HERTZ = between("--bandwidth-hz", 0.1, 100, "Hz")
DELAY_SAMPLES = between("--delay-samples", 0, 50, kind=int)
"""As `tune` allows: a gimbal cannot be held with more."""
Workers = Annotated[
    int,
    between("--workers", 0, 4096, kind=int),
    arg(
        help="processes of this machine without --scheduler; 0: one per processor, 1: only this one"
    ),
]
Scheduler = Annotated[
    str | None, optional("tcp://HOST:PORT", "run on the Dask cluster of this scheduler instead")
]
Plants = Annotated[
    int,
    between("--plants", 1, 10000, kind=int),
    arg(help="perturbed plants on which the controller is judged beside a PID"),
]


@dataclass(frozen=True)
class Gains:
    """What is asked of the controller (`Wish`).

    Attributes:
        kind: the law
        bandwidth_hz: bandwidth (default: 8 Hz; with --disk-margin the highest that keeps it)
        disk_margin: disk margin that every joint keeps over the model's uncertainty
        damping: damping of the tracking error
        integral: speed of the integral action, in bandwidths; 0: none
        delay: time from measurement to torque, without the hold (default: as the logs show, one sample at least)
        dt: sampling interval of the controller (default: the logs')
        robust: add Lyapunov redesign
    """

    kind: Literal["computed-torque", "pid"] = "computed-torque"
    bandwidth_hz: Annotated[Maybe[float], HERTZ] = None
    disk_margin: Annotated[Maybe[float], between("--disk-margin", 0.01, 1.99)] = None
    damping: Annotated[float, between("--damping", 0.05, 20)] = 1.0
    integral: Annotated[float, between("--integral", 0, 10)] = 0.2
    delay: Annotated[Maybe[float], between("--delay", 0, 0.05, "s")] = None
    dt: Annotated[Maybe[float], between("--dt", 1e-5, 0.1, "s")] = None
    robust: bool = False

    def to_wish(self, model: Model) -> Wish:
        """Return what `tune` is asked for with a model."""
        from gimbal_pin.control.laws.design import Wish

        return Wish.of(
            model,
            self.dt,
            self.delay,
            kind=self.kind,
            bandwidth_hz=self.bandwidth_hz,
            damping=self.damping,
            integral=self.integral,
            disk_margin=self.disk_margin,
            robust=self.robust,
        )


GAINS_READER = Gains()
