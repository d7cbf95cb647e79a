"""Options that several verbs share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from gimbal_pin.cli.paths import Reads, Writes, diagnosed, logs, maps, payloads, rigs, walked

if TYPE_CHECKING:
    from gimbal_pin.control.design import Wish


def optional(metavar: str, help: str, default: str = "") -> Any:
    """Describe an option that may be left out; `default` says what then is the case, where that is no plain value."""
    return arg(metavar=metavar, help=help, help_behavior_hint=default and f"(default: {default})")


RigName = Annotated[
    Positional[str], Reads(rigs), arg(metavar="RIG", help="bundled rig, URDF, or YAML that names a URDF")
]
Logs = Annotated[
    Positional[tuple[str, ...]],
    Reads(logs),
    arg(metavar="LOG …", help="CSV or Parquet; LOG@PAYLOAD names its payload", help_behavior_hint="(at least one)"),
]
Payload = Annotated[str | None, Reads(payloads), optional("NAME", "bundled payload or URDF", "the rig's own")]
Written = Annotated[Path | None, Writes()]
Json = Annotated[Written, optional("FILE", "write the result as JSON; - for standard output")]
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
PlatformSize = Annotated[float, arg(help="profile S times this")]
Output = Annotated[Path, Writes(), arg(aliases=["-o"], metavar="FILE", help="where to write")]
MaybeOutput = Annotated[
    Path | None, Writes(), arg(aliases=["-o"], metavar="FILE", help="where to write", help_behavior_hint="")
]
INTO = "folder for the files, made if it is not there; its run.json says which run they are of"
Folder = Annotated[Path, Writes(walked), arg(aliases=["-o"], metavar="DIR", help=INTO)]
MaybeFolder = Annotated[
    Path | None, Writes(diagnosed), arg(aliases=["-o"], metavar="DIR", help=INTO, help_behavior_hint="")
]
ModelFile = Annotated[
    Path | None,
    Reads(),
    optional("MODEL", "the plant: a model's YAML, from identify or diagnose", "the rig as its URDF states it"),
]
Seed = Annotated[int, arg(help="seed of everything random")]
Cutoff = Annotated[
    float | None, optional("HZ", "low-pass on every column and on the torque", "4; 12 where the base turns")
]
Alignment = Annotated[
    float | None, optional("SECONDS", "the torque acts that much later than its stamp", "half a sample")
]
Holdout = Annotated[
    str | None, optional("WHAT", "last-third, log:N or none", "the last third of one log, the last of several")
]
EstimatorName = Literal["weighted", "ols", "robust", "instrumental", "output-error", "ridge", "physical"]


@dataclass(frozen=True)
class Gains:
    """What is asked of the controller (`Wish`)."""

    kind: Literal["computed-torque", "pid"] = "computed-torque"
    bandwidth_hz: Annotated[
        float | None, arg(metavar="HZ", help="bandwidth, 8 Hz by default; with --disk-margin the highest that keeps it")
    ] = None
    disk_margin: Annotated[
        float | None,
        arg(metavar="MARGIN", help="disk margin (0 to 2) that every joint keeps over the model's uncertainty"),
    ] = None
    damping: Annotated[float, arg(help="damping of the tracking error")] = 1.0
    integral: Annotated[float, arg(help="speed of the integral action, in bandwidths; 0: none")] = 0.2
    delay: Annotated[float, arg(help="time from measurement to torque, s, without the hold")] = 0.001
    robust: Annotated[bool, arg(help="add Lyapunov redesign")] = False

    @property
    def wish(self) -> Wish:
        """What `tune` is asked for."""
        from gimbal_pin.control.design import Wish

        return Wish(**vars(self))


USUAL = Gains()
