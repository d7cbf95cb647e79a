"""What verbs read: rigs, logs, models and controllers by name, and options that must make sense."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gimbal_pin.cli.present import tell
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.control.tuning import StoredController
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.log.log import Array, Imu, Log
    from gimbal_pin.log.platform import Platform
    from gimbal_pin.regression import Filtering
    from gimbal_pin.report.origin import Origin
    from gimbal_pin.rig.rig import Rig


def load_rig(rig: str, payload: str | None) -> Rig:
    """Load a rig with the payload that was asked for; what is to be known of its file is told."""
    from gimbal_pin.rig.rig import Rig

    loaded = Rig.load(rig, payload)
    tell(loaded.notes)
    return loaded


def read_logs(
    rig: str,
    payload: str | None,
    logs: Sequence[str],
    mapping: Sequence[str],
    need_tau: bool = True,
) -> tuple[Rig, list[Log]]:
    """Return logs and their rig; joints that no log records are fixed in it, and that is told."""
    from gimbal_pin.log.io import log_in, open_table, split_payload
    from gimbal_pin.log.io.columns import find_unrecorded_joints
    from gimbal_pin.rig.rig import Rig

    loaded = load_rig(rig, payload)
    tables = [open_table(split_payload(log)[0]) for log in logs]
    if absent := find_unrecorded_joints(loaded, tables, mapping):
        held = ", ".join(f"{joint} {at:g}" for joint, at in absent.items())
        what = (
            "no log has a column of these joints, which are held at this angle (rad) or place (m)"
        )
        tell([f"{what}: {held}; 'fixed:' in the rig's YAML states another"])
        loaded = Rig.load(rig, payload, fixed=absent)
    # Each table is dropped as it is read: its text is as large as the log.
    return loaded, [
        log_in(tables.pop(0), loaded, mapping, split_payload(log)[1], need_tau) for log in logs
    ]


def load_logs(
    rig: str, payload: str | None, logs: Sequence[str], mapping: Sequence[str], moving: bool = False
) -> tuple[Rig, list[Log]]:
    """Load the rig with the logs' payload, and the logs; `moving`: joints that they hold still are fixed in it.

    Raises:
        UsageError: No log, or logs of different payloads: one identification knows one.
    """
    from gimbal_pin.log.io import split_payload
    from gimbal_pin.log.log import drop_repeated_logs

    if not logs:
        raise UsageError("LOG", "none was given", "name at least one log after the rig")
    tags = sorted({tag for _, tag in (split_payload(log) for log in logs) if tag is not None})
    if len(tags) > 1 or (
        tags and payload is None and any(split_payload(log)[1] is None for log in logs)
    ):
        what = f"are of several payloads ({', '.join(tags)}{' and one not named' if len(tags) == 1 else ''})"
        raise UsageError(
            "logs",
            what,
            "one payload at a time: give each payload's logs apart; only 'identify' takes several together",
        )
    camera = payload or (tags[0] if tags else None)
    loaded, read = read_logs(rig, camera, logs, mapping)
    read, repeated = drop_repeated_logs(read)
    tell([*repeated, *(event for log in read for event in log.events)])
    return fix_still_joints(loaded, read, rig, camera) if moving else (loaded, read)


def fix_still_joints(
    loaded: Rig, logs: list[Log], rig: str, payload: str | None
) -> tuple[Rig, list[Log]]:
    """Fix joints in a rig that rest in all of its logs, and tell that."""
    from gimbal_pin.log.io.columns import find_held_joints
    from gimbal_pin.rig.rig import Rig

    still = find_held_joints(logs)
    if not still:
        return loaded, logs
    held = ", ".join(f"{joint} {at:.3g}" for joint, at in still.items())
    tell(
        [
            f"these joints rest in all logs and are held at this angle (rad) or place (m): {held}; "
            "if one moved, check its encoder"
        ]
    )
    fixed = Rig.load(rig, payload, fixed={**loaded.config.fixed, **still})
    return fixed, [log.ordered(fixed) for log in logs]


def describe_run(verb: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a folder's ``run.json`` says of a verb that was given these arguments."""
    arguments = {
        name: vars(value) if is_dataclass(value) else value for name, value in given.items()
    }
    return {"verb": verb, "arguments": arguments}


def describe_origin(verb: Callable[..., None], given: Mapping[str, Any]) -> Origin:
    """Return what the head of a verb's page says of the call that it was given."""
    from gimbal_pin.cli.paths import list_read_files, spell_call
    from gimbal_pin.log.io.files import hash_file
    from gimbal_pin.report.origin import Origin

    inputs = [(file.name, hash_file(file)) for file in list_read_files(verb, given)]
    return Origin(datetime.now(timezone.utc), spell_call(verb, given), inputs)


def read_platform(
    rig: Rig, profile: str, log: Path | None, mapping: Sequence[str]
) -> Platform | None:
    """Return the platform's motion from a log, if there is one; `UsageError` if a profile is given beside it."""
    from gimbal_pin.log.platform import Platform

    if log is None:
        return None
    if profile != "none":
        raise UsageError("--platform", "is given beside --platform-log", "give one of the two")
    t, imu = read_base_motion(rig, log, mapping)
    return Platform.measured(t - t[0], imu, str(log))


def read_base_motion(rig: Rig, log: Path, mapping: Sequence[str]) -> tuple[Array, Imu]:
    """Return time, s, (N,), and what the base's IMU reported in a log; say what is wrong with it."""
    from gimbal_pin.checks import check_platform_log
    from gimbal_pin.log.io import read_imu

    t, imu, notes = check_platform_log(*read_imu(log, rig, rig.base, mapping), str(log))
    tell(notes)
    return t, imu


def choose_filter(cutoff: float | None, alignment: float | None) -> Filtering | None:
    """Return the filter that the options ask for, None where they ask for nothing."""
    from gimbal_pin.regression import Filtering

    if cutoff is None:
        return None if alignment is None else Filtering(alignment=alignment)
    return Filtering(cutoff=cutoff, alignment=alignment)


def read_plant(name: Path | None, rig: Rig) -> Model:
    """Return the model of a YAML, or the rig as its URDF states it."""
    from gimbal_pin.dynamics.model import nominal
    from gimbal_pin.identification import read_model

    return nominal(rig) if name is None else read_model(name, rig)


def read_tuned(name: str | Path, rig: Rig, has_plant: bool = True) -> StoredController:
    """Read a controller of a rig; one of another payload is noted where a plant is simulated, and refused elsewhere."""
    from gimbal_pin.control.tuning import read_controller

    stored = read_controller(name, rig)
    if stored.payload != rig.payload:
        what = f"is tuned for the payload {stored.payload}, and the rig {rig.name} carries {rig.payload}"
        if not has_plant:
            raise UsageError(str(name), what, "name the controller's own payload: --payload FILE")
        tell([f"{name} {what}"])
    return stored


def read_payload(name: str | Path | None, *given: str | None) -> str | None:
    """Return the payload that a model's or controller's YAML was made for, or None if it does not say.

    Of one that is not bundled the file: one of those `given`, or one beside the YAML, that is named so.
    """
    if name is None:
        return None
    from gimbal_pin.errors import ModelError
    from gimbal_pin.rig.files import bundled_payloads
    from gimbal_pin.rig.reading import read_yaml

    data = read_yaml(name, ModelError)
    payload = data.get("payload") if isinstance(data, dict) else None
    if payload in bundled_payloads() or not isinstance(payload, str):
        return payload if isinstance(payload, str) else None
    files = [Path(each) for each in given if each is not None] + [
        Path(name).with_name(f"{Path(payload).name}.urdf")
    ]
    return next((str(file) for file in files if file.stem == payload and file.is_file()), None)
