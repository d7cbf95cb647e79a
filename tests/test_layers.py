"""The house's order: a lower layer never imports a higher one, causes never import each other, nothing prints."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gimbal_pin"
FILES = sorted(PACKAGE.rglob("*.py"))

FILED = "reading bounded meshes records log limited urdf_checks urdf mending config floating rig_formats rig_files rig"
DATA = f"errors threads digits parameter controllers {FILED}"
SENSED = "naming clocks signals platform aboard profile gyros eccentricity calibration regressor imu"
ROWS = "holes rows replay"
LOOP = "sensors planting drive simulation"
MATHS = f"{SENSED} states reduction inertia consistency bodies effects model carrier plant {ROWS} estimators {LOOP}"
BEFORE = "suspicion halves wiring audit identification excitation control trajectories"
VERBS = f"{BEFORE} tuning experiment tracking diagnosis base pointing"
WHOLE = "checking new_rig balance payloads recognise online export"
EDGES = "io view report walk text cli"
ORDER = f"{DATA} {MATHS} {VERBS} {WHOLE} {EDGES}".split()
"""Modules and folders of the package, each of which imports only what stands before it."""

SHARED = {
    "effects": {
        "cause",
        "base",
        "signal",
        "rig_effect",
        "functions",
        "harmonic",
        "losses",
        "seen",
        "geared",
        "sprung",
        "loose",
    },
    # Some estimates start from simpler ones: the robust from the weighted, those that simulate from the physical.
    "estimators": {"base", "colour", "components", "weighted", "physical", "instrumental"},
}
"""Files in a folder of plug-ins that the others there may import."""
READERS = {"__init__", "parse", "plain", "resistance"}
"""Files beside the causes that are none: they use them all."""

HEAVY = {"control", "yourdfpy", "matplotlib", "scipy.optimize", "scipy.io", "meshcat", "pandas"}
HEAVY |= {"h5py", "rosbags", "pyulog", "casadi"}
NAMELESS = {"identification", "planting", "drive", "simulation", "diagnosis"}
"""Verbs that know causes, but none of them by name."""


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path, nodes: Iterator[ast.AST] | None = None) -> Iterator[tuple[int, str]]:
    """Yield line and full name of everything imported; ``from a import b`` gives ``a.b``."""
    for node in nodes or ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def at_load(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run when the module is loaded: not in functions, not for the type checker alone."""
    for child in ast.iter_child_nodes(node):
        checking = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
        if not checking and not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            yield child
            yield from at_load(child)


def room(path: Path) -> str:
    """The module or folder of the package that a file belongs to."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_file_keeps_the_house_rules(path: Path) -> None:
    own, inner = room(path), path.stem
    assert own in ORDER or own == "__init__", f"{own}: give it a place in ORDER"
    for line, name in imports(path):
        parts = name.split(".")
        where = f"{path}:{line}: imports {name}"
        if parts[0] != PACKAGE.name or parts[1] not in ORDER:
            continue
        assert own == "__init__" or ORDER.index(parts[1]) <= ORDER.index(own), f"{where}, which stands above it"
        if own in SHARED and parts[1] == own and inner not in READERS:
            assert parts[2] in SHARED[own], f"{where}: plug-ins do not import each other"
        if own in NAMELESS and parts[1] == "effects":
            assert not concrete(parts[2:]), f"{where}: it should not know this cause by name"
    for line, name in imports(path, at_load(tree(path))):
        heavy = [module for module in HEAVY if f"{name}.".startswith(f"{module}.")]
        assert not heavy, f"{path}:{line}: imports {name} when loaded, import it in the function that uses it"
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ExceptHandler):
            caught = ast.unparse(node.type) if node.type else "everything"
            passed_on = ast.unparse(node.body[-1]) == "raise"
            all_of_it = caught in ("everything", "Exception", "BaseException")
            assert passed_on or not all_of_it, f"{path}:{node.lineno}: catches {caught} and keeps it"
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "print":
            assert path == PACKAGE / "cli" / "present.py", f"{path}:{node.lineno}: prints, which `say` is for"


def concrete(name: list[str]) -> bool:
    """Tell whether a name inside `effects` belongs to one cause: its file, or the class in it."""
    files = {path.stem for path in (PACKAGE / "effects").glob("*.py")} - SHARED["effects"] - READERS
    return name[0] in files or name[0].lower() in {file.replace("_", "") for file in files}


def test_the_rules_are_about_files_that_exist() -> None:
    assert len(FILES) > 20
    for folder, names in SHARED.items():
        assert all((PACKAGE / folder / f"{name}.py").is_file() for name in names)
    assert concrete(["Stribeck"]) and concrete(["payload_shift", "PayloadShift"]) and not concrete(["Effect"])


def test_loading_the_command_line_loads_nothing_heavy() -> None:
    code = f"import sys, gimbal_pin.cli; print([name for name in {sorted(HEAVY)} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
