"""Every module of scripts/ loads, also the studies that are rarely run."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "scripts"


def test_scripts_load() -> None:
    for found in pkgutil.walk_packages([str(FOLDER)]):
        importlib.import_module(found.name)
