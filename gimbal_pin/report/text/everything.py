"""All that `auto` found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gimbal_pin.report.text.camera import verified
from gimbal_pin.report.text.cells import table
from gimbal_pin.report.text.loops import tracking, tuning
from gimbal_pin.report.text.parameters import identified
from gimbal_pin.report.text.wrong import diagnosis

if TYPE_CHECKING:
    from gimbal_pin.report.pipeline import Auto


def auto(found: Auto, command: str = "") -> str:
    """Everything that `auto` found, and where its files lie; `command`: the call that would diagnose its logs."""
    files = table("file", "", rows=[(what, str(path)) for what, path in found.files.items()])
    parts = [
        identified(found.identified),
        f"not diagnosed: {found.undiagnosed}" if found.diagnosis is None else diagnosis(found.diagnosis, {}, command),
        tuning(found.tuning),
        tracking(found.tracking, found.plant),
        f"no camera held on a platform: {found.why}" if found.held is None else verified(found.held),
        files,
        f"open {found.files['report']}",
    ]
    return "\n\n".join(parts)
