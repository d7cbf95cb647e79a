"""``gimbal-pin rigs``."""

from __future__ import annotations

from gimbal_pin.cli.options import Json
from gimbal_pin.cli.present import present
from gimbal_pin.report import text


def rigs(*, json: Json = None) -> None:
    """List the bundled rigs and payloads."""
    from gimbal_pin.dynamics.checking import list_bundled

    listed = list_bundled()
    present(text.rigs(listed), listed, json)
