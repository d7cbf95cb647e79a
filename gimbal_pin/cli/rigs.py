"""``gimbal-pin rigs``."""

from __future__ import annotations

from gimbal_pin.cli.options import Json
from gimbal_pin.cli.present import present


def rigs(*, json: Json = None) -> None:
    """List the bundled rigs and payloads."""
    from gimbal_pin.dynamics.checking import list_bundled
    from gimbal_pin.report.sections.data import show_bundled

    listed = list_bundled()
    present(show_bundled(listed).to_text(), listed, json)
