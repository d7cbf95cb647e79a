"""What a verb says: text for a person, JSON for a program."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def present(told: str, result: Mapping[str, Any], json: Path | None) -> None:
    """Print what a person reads, or write what a program reads; with ``--json -`` only the latter is printed."""
    from gimbal_pin.io.files import to_json, write_json

    if json is not None and str(json) == "-":
        print(to_json(result), end="")
        return
    print(told)
    if json is not None:
        write_json(result, json)
