"""Every module of scripts/ loads: a study that nobody runs for a week is still one."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "scripts"
MODULES = sorted(
    found.name
    for found in pkgutil.walk_packages([str(FOLDER)])
    if not found.name.endswith("__main__")
)
MAINS = sorted(f"{path.parent.name}.__main__" for path in FOLDER.glob("*/__main__.py"))


@pytest.mark.parametrize("name", [*MODULES, *MAINS])
def test_a_script_loads(name: str) -> None:
    importlib.import_module(name)
