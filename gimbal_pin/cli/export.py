"""``gimbal-pin export``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from gimbal_pin.cli.inputs import load_rig, measured_motion, mounted, read_controller, run_of
from gimbal_pin.cli.options import Json, Map, Payload, optional
from gimbal_pin.cli.paths import Reads, Writes, in_folder, logs, rigs
from gimbal_pin.cli.present import present
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.control.tuning import Stored
    from gimbal_pin.export import Exported
    from gimbal_pin.rig.rig import Rig


REFUSALS = (
    ("runs a controller of other joints or terms", "flash the sources that --c writes"),
    (
        "refuses these gains or terms: out of the range that gimbal_link.h states",
        "tune for the delay of the gimbal that runs",
    ),
    ("has another secret, or none", "give gimbal_link_start and --secret the same"),
    ("was tuned by a host whose clock is ahead", "set this machine's clock"),
)
"""What a gimbal's status means, from 1 on, and the correction."""


def sources(value: Path, given: Any) -> list[Path]:
    """Files that `export` may put into the folder of `--c`."""
    from gimbal_pin.export import NAMES

    return in_folder(value, NAMES)


def packaged(value: Path, given: Any) -> list[Path]:
    """Files that `export` may put into the folder of `--ros2`."""
    from gimbal_pin.export.ros2 import NAMES

    return in_folder(value, NAMES)


def headers(value: Path, given: Any) -> list[Path]:
    """Files that `export` may put into the folder of `--simplefoc`."""
    from gimbal_pin.export.tables import SIMPLEFOC

    return in_folder(value, SIMPLEFOC)


def export(
    controller: Annotated[
        Positional[str], Reads(), arg(metavar="CONTROLLER", help="a controller's YAML, from 'gimbal-pin tune'")
    ],
    *,
    c: Annotated[
        Path | None, Writes(sources, run=True), optional("DIR", "folder for the C99 sources, made if it is not there")
    ] = None,
    ros2: Annotated[
        Path | None,
        Writes(packaged, run=True),
        optional("DIR", "folder for a package of ros2_control: a plugin, its YAML and the identified URDF"),
    ] = None,
    simplefoc: Annotated[
        Path | None,
        Writes(headers, run=True),
        optional(
            "DIR", "folder for tables of cogging and friction, with a sketch of SimpleFOC that feeds them forward"
        ),
    ] = None,
    odrive: Annotated[
        Path | None,
        Writes(suffixes=(".json",)),
        optional("FILE", "the same tables as an ODrive indexes them, .json"),
    ] = None,
    live: Annotated[
        str | None,
        optional("ADDRESS", "send gains and feed-forward to a running gimbal: udp://HOST:PORT or serial:DEVICE@BAUD"),
    ] = None,
    secret: Annotated[
        Path | None, Reads(), optional("FILE", "secret of the gimbal that --live tunes: 32 hexadecimal digits")
    ] = None,
    rig: Annotated[
        str | None, Reads(rigs), optional("RIG", "URDF or YAML of the rig", "the bundled rig that CONTROLLER names")
    ] = None,
    payload: Payload = None,
    platform_log: Annotated[
        Path | None,
        Reads(logs),
        optional(
            "FILE",
            "how the platform moves in use, for the forecast: gyro_ and accel_ of the base link",
            "half of profile S, as if shaken by hand",
        ),
    ] = None,
    map: Map = (),
    json: Json = None,
) -> None:
    """Write a controller as C99, for ros2_control, SimpleFOC or ODrive; or tune a gimbal that runs."""
    asked_for = run_of("export", locals())
    from gimbal_pin.export.tables import odrive as indexed
    from gimbal_pin.export.tables import simplefoc as tabled
    from gimbal_pin.log.io.files import to_json
    from gimbal_pin.log.io.link import read_secret

    if all(target is None for target in (c, ros2, simplefoc, odrive, live)):
        raise UsageError("export", "is not told what to write", "add --c, --ros2, --simplefoc, --odrive or --live")
    if map and platform_log is None:
        raise UsageError("--map", "has no log to map", "name it with --platform-log FILE")
    if (live is None) != (secret is None):
        option, other = ("--secret", "--live") if live is None else ("--live", "--secret")
        raise UsageError(
            option, f"is given without {other}", "tune with --live ADDRESS --secret FILE, the gimbal's own"
        )
    shared = None if secret is None else read_secret(secret)
    loaded = rig_of(controller, rig, payload)
    stored = read_controller(controller, loaded)
    folders: list[tuple[Path, Mapping[str, str]]] = []
    said: dict[str, Any] = {"schema": 1}
    if simplefoc is not None:
        folders.append((simplefoc, tabled(stored.model)))
    table = None if odrive is None else to_json(indexed(stored.model), 1)
    if c is not None or ros2 is not None or live is not None:
        found = exported(stored, loaded, platform_log, map)
        said = found.to_dict()
        if c is not None:
            folders.append((c, found.files))
        if ros2 is not None:
            from gimbal_pin.export.ros2 import package

            folders.append((ros2, package(stored, found.files)))
        if live is not None and shared is not None:
            said["live"] = tuned(live, found.tuning, shared)
    lines = written(folders, odrive, table, asked_for)
    if c is not None:
        lines.append(text.exported(found, c))
    if live is not None:
        lines.append(f"{live}: gains and feed-forward are in force")
    present("\n".join(lines), {**said, "written": [str(folder) for folder, _ in folders]}, json)


def exported(stored: Stored, loaded: Rig, platform_log: Path | None, map: Map) -> Exported:
    """Return the C99 sources of a controller, its forecast for a platform that moves as in a log."""
    from gimbal_pin.export import export_controller as run

    return run(stored, None if platform_log is None else measured_motion(loaded, platform_log, map))


def written(
    folders: Sequence[tuple[Path, Mapping[str, str]]], odrive: Path | None, table: str | None, asked_for: Any
) -> list[str]:
    """Write every folder, each whole or not at all, and the table of ODrives; return a line for each."""
    from gimbal_pin.log.io.files import atomic_write, write_run

    for folder, content in folders:
        writers: dict[str, Callable[[Path], object]] = {
            name: partial(atomic_write, content=body) for name, body in content.items()
        }
        write_run(folder, writers, asked_for)
    if odrive is not None and table is not None:
        atomic_write(odrive, table)
    return [f"{len(content)} files → {folder}" for folder, content in folders] + [f"→ {odrive}"] * (odrive is not None)


def tuned(address: str, body: bytes, secret: bytes) -> str:
    """Send gains and feed-forward to a running gimbal.

    Raises:
        UsageError: It refuses them, or the address is none.
        LogError: It cannot be reached, or does not answer.
    """
    from gimbal_pin.log.io.link import send_parameters

    if status := send_parameters(address, body, secret):
        raise UsageError(address, *REFUSALS[min(status, len(REFUSALS)) - 1])
    return address


def rig_of(controller: str, rig: str | None, payload: str | None) -> Rig:
    """Load the rig of a controller's YAML, which knows bundled rigs by name.

    Raises:
        UsageError: It is of a rig that is not bundled, and no file of that is named.
        ModelError: It does not name a rig.
    """
    from gimbal_pin.rig.files import bundled_rigs
    from gimbal_pin.rig.reading import read_yaml

    data = read_yaml(controller, ModelError)
    name = data.get("rig") if isinstance(data, dict) else None
    if not isinstance(name, str) and rig is None:
        raise ModelError(controller, "holds no controller", "make one with: gimbal-pin tune RIG MODEL -o FILE")
    if rig is None and name not in bundled_rigs():
        raise UsageError("--rig", f"is missing: {controller} is for {name}, which is no bundled rig", "name its file")
    return load_rig(str(name) if rig is None else rig, payload or mounted(controller))
