"""``gimbal-pin export``."""

from __future__ import annotations

from collections.abc import Callable
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
    from gimbal_pin.rig.rig import Rig


def sources(value: Path, given: Any) -> list[Path]:
    """Files that `export` may put into a folder."""
    from gimbal_pin.export import NAMES

    return in_folder(value, NAMES)


def export(
    controller: Annotated[
        Positional[str], Reads(), arg(metavar="CONTROLLER", help="a controller's YAML, from 'gimbal-pin tune'")
    ],
    *,
    c: Annotated[
        Path, Writes(sources, run=True), arg(metavar="DIR", help="folder for the C99 sources, made if it is not there")
    ],
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
    """Write a controller as C99 for the gimbal's own processor."""
    asked_for = run_of("export", locals())
    from gimbal_pin.export import export as run
    from gimbal_pin.log.io.files import atomic_write, write_run

    if map and platform_log is None:
        raise UsageError("--map", "has no log to map", "name it with --platform-log FILE")
    loaded = rig_of(controller, rig, payload)
    imu = None if platform_log is None else measured_motion(loaded, platform_log, map)
    found = run(read_controller(controller, loaded), imu)
    writers: dict[str, Callable[[Path], object]] = {
        name: partial(atomic_write, content=content) for name, content in found.files.items()
    }
    write_run(c, writers, asked_for)
    present(text.exported(found, c), found.to_dict(), json)


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
