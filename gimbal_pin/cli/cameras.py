"""``gimbal-pin identify LOG@PAYLOAD …``: several cameras on one gimbal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from gimbal_pin.cli.inputs import load_logs, load_rig, read_payload
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.effects import Effect
    from gimbal_pin.identification import Several


def list_tags(logs: Sequence[str]) -> list[str | None]:
    """Return the payloads that the logs are tagged with, each once, None for those without a tag."""
    from gimbal_pin.log.io import split_payload

    return list(dict.fromkeys(split_payload(log)[1] for log in logs))


def read_known_gimbal(rig: str, payload: str | None, logs: Sequence[str], known: str) -> Model:
    """Return what a model's YAML knows of a gimbal, with the camera that it was made with; others as `read_cameras`."""
    from gimbal_pin.identification import read_known

    return read_known(known, load_rig(rig, read_payload(known, payload, *list_tags(logs))))


def read_cameras(
    rig: str,
    payload: str | None,
    logs: Sequence[str],
    mapping: Sequence[str],
    known: str | None,
    extended: str | None,
) -> Callable[..., Several]:
    """Read logs of a new camera on a known gimbal, or of those that they are tagged with; return what identifies them.

    Args:
        rig: Its name.
        payload: The new camera.
        logs: LOG@PAYLOAD.
        mapping: Of their columns.
        known: A model's YAML of the gimbal with another camera.
        extended: One whose causes stand in the equations.
    """
    from gimbal_pin.identification import (
        identify_new,
        identify_several,
        read_model,
        refittable_effects,
    )

    if known is not None:
        loaded, read = load_logs(rig, payload, logs, mapping)
        return partial(identify_new, loaded, read, read_known_gimbal(rig, payload, logs, known))
    tags = [tag for tag in list_tags(logs) if tag is not None]
    if payload is not None or None in list_tags(logs):
        raise UsageError(
            "logs",
            "are only partly tagged with a payload",
            "tag each of them: LOG@PAYLOAD, no --payload",
        )
    pairs = {
        tag: load_logs(rig, None, [log for log in logs if log.endswith(f"@{tag}")], mapping)
        for tag in tags
    }
    rigs = {tag: pair[0] for tag, pair in pairs.items()}
    each = {tag: pair[1] for tag, pair in pairs.items()}
    causes: tuple[Effect, ...] = ()
    if extended is not None:
        causes = refittable_effects(
            read_model(extended, load_rig(rig, read_payload(extended, *tags)))
        )
    return partial(identify_several, rigs, each, causes)
