"""What was written of a controller, and what a step of it costs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gimbal_pin.report.text.cells import table

if TYPE_CHECKING:
    from gimbal_pin.export import Exported


def exported(found: Exported, folder: Path) -> str:
    """Cost of a step, how the equations agree with Pinocchio, and how to build it."""
    rows = [[name, str(count)] for name, count in found.operations.items()]
    return "\n".join(
        [
            f"{len(found.files)} files → {folder}; begin with {folder / 'README.md'}",
            table("of a step", "operations", rows=rows),
            f"memory: {found.memory} bytes",
            f"equations agree with Pinocchio to {found.difference:.1g} in double precision",
            f"build: cmake -S {folder} -B {folder / 'build'} && cmake --build {folder / 'build'}",
        ]
    )
