"""``gimbal-pin export``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import describe_run, load_rig, read_base_motion, read_payload, read_tuned
from gimbal_pin.cli.paths import Writes
from gimbal_pin.cli.present import present, tell
from gimbal_pin.errors import ModelError, UsageError


def list_c_files(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the files that `export` puts into the folder of `--c`."""
    from gimbal_pin.export import EXPORTED_FILES

    return EXPORTED_FILES


def list_ros2_files(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the files that `export` puts into the folder of `--ros2`."""
    from gimbal_pin.export.ros2 import PACKAGE_FILES

    return PACKAGE_FILES


def list_simplefoc_files(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the files that `export` puts into the folder of `--simplefoc`."""
    from gimbal_pin.export.tables import SIMPLEFOC

    return SIMPLEFOC


def export(
    controller: Annotated[
        Positional[str],
        arg(metavar="CONTROLLER", help="a controller's YAML, from 'gimbal-pin tune'"),
    ],
    *,
    c: Annotated[opt.Folder, Writes(run=list_c_files)] = None,
    ros2: Annotated[opt.Folder, Writes(run=list_ros2_files)] = None,
    simplefoc: Annotated[opt.Folder, Writes(run=list_simplefoc_files)] = None,
    odrive: Annotated[opt.File, Writes((".json",))] = None,
    mjcf: opt.Mjcf = None,
    rig: opt.OtherRig = None,
    payload: opt.Payload = None,
    platform_log: opt.File = None,
    map: opt.Map = (),
    json: opt.Json = None,
) -> None:
    """Write a controller as C99, for ros2_control, SimpleFOC, ODrive or MuJoCo.

    Args:
        c: folder for the C99 sources, made if it is not there
        ros2: folder for a package of ros2_control: a plugin, its YAML and the identified URDF
        simplefoc: folder for tables of cogging and friction, with a sketch of SimpleFOC that feeds them forward
        odrive: the same tables as an ODrive indexes them, .json
        mjcf: the model for MuJoCo: bodies, friction, rotors, springs and drives; what it cannot hold is told
        rig: bundled rig, URDF or YAML (default: the one that CONTROLLER was tuned for)
        platform_log: how the platform moves: gyro_ and accel_ of the base link (default: half of profile S)
    """
    asked = describe_run("export", locals())
    from gimbal_pin.export import export_controller, tables
    from gimbal_pin.export.mjcf import convert_to_mjcf
    from gimbal_pin.export.ros2 import package
    from gimbal_pin.log.io.files import atomic_write, to_json, write_run
    from gimbal_pin.report.sections.control import show_export

    if all(target is None for target in (c, ros2, simplefoc, odrive, mjcf)):
        options = "--c, --ros2, --simplefoc, --odrive or --mjcf"
        raise UsageError("export", "is not told what to write", f"add {options}")
    if map and platform_log is None:
        raise UsageError("--map", "has no log to map", "name it with --platform-log FILE")
    loaded = load_rig(
        find_controller_rig(controller) if rig is None else rig, payload or read_payload(controller)
    )
    stored = read_tuned(controller, loaded, has_plant=False)
    folders: list[tuple[Path, Mapping[str, str]]] = []
    folders += [] if simplefoc is None else [(simplefoc, tables.simplefoc(stored.model))]
    table = None if odrive is None else to_json(tables.odrive(stored.model), 1)
    simulated, notes = ("", ()) if mjcf is None else convert_to_mjcf(stored.model)
    result: dict[str, Any] = {"schema": 1, "notes": list(notes)}
    if c is not None or ros2 is not None:
        found = export_controller(
            stored, None if platform_log is None else read_base_motion(loaded, platform_log, map)
        )
        result |= found.to_dict()
        folders += [] if c is None else [(c, found.files)]
        folders += [] if ros2 is None else [(ros2, package(stored, found.files))]
    for folder, content in folders:
        write_run(
            folder,
            {name: partial(atomic_write, content=body) for name, body in content.items()},
            asked,
        )
    if c is not None and not loaded.config.imus:
        tell(
            [
                f"{loaded.name} names no IMUs, by which the main loop holds the camera: run gimbal_tracking_step"
            ]
        )
    if odrive is not None and table is not None:
        atomic_write(odrive, table)
    if mjcf is not None:
        atomic_write(mjcf, simulated)
        tell(notes)
    told = [f"{len(content)} files → {folder}" for folder, content in folders]
    told += [f"→ {file}" for file in (odrive, mjcf) if file is not None]
    told += [] if c is None else [show_export(found, c).to_text()]
    present("\n".join(told), {**result, "written": [str(folder) for folder, _ in folders]}, json)


def find_controller_rig(controller: str) -> str:
    """Return the rig of a controller's YAML: the file that it names, as seen from it, or a bundled rig.

    Raises:
        UsageError: Neither is there.
        ModelError: It does not name a rig.
    """
    from gimbal_pin.rig.files import bundled_rigs
    from gimbal_pin.rig.reading import read_yaml

    data = read_yaml(controller, ModelError)
    name, file = (data.get("rig"), data.get("rig_file")) if isinstance(data, dict) else (None, None)
    if not isinstance(name, str):
        raise ModelError(
            controller, "holds no controller", "make one with: gimbal-pin tune RIG MODEL -o FILE"
        )
    if isinstance(file, str) and (path := Path(controller).parent / file).is_file():
        return str(path)
    if name not in bundled_rigs():
        what = f"is missing: {controller} is for {name}, which is no bundled rig and names no file that is there"
        raise UsageError("--rig", what, "name its file")
    return name
