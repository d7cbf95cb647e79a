"""The house's order: a lower layer never imports a higher one, causes never import each other, nothing prints."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gimbal_pin"
FILES = sorted(PACKAGE.rglob("*.py"))
ROOMS = sorted({path.relative_to(PACKAGE).parts[0] for path in FILES})

BELOW = (
    "errors rig log effects dynamics regression checks identification excitation control diagnosis"
)
ORDER = f"{BELOW} pointing export fleet report studio cli".split()
"""Rooms of the package, each of which imports only what stands before it."""

SHARED = {
    "effects": {
        "parameter",
        "cause",
        "base",
        "signal",
        "rig_effect",
        "functions",
        "harmonic",
        "losses",
        "seen",
        "geared",
        "torque_table",
    },
}
"""Files in a folder of plug-ins that the others there may import."""
READERS = {"__init__", "parse", "plain", "resistance"}
"""Files beside the causes that are none: they use them all."""

HEAVY = {"control", "yourdfpy", "matplotlib", "scipy.optimize", "scipy.io", "meshcat", "pandas"}
HEAVY |= {"h5py", "rosbags", "pyulog", "casadi", "serial", "mcap_ros2", "rerun"}
LOOKED_AT = ("rig/brief", "gimbal_pin.report.pages")
"""The one import of a higher room, by whom and of what: `Record` asks how it looks when a person looks at it."""
NAMELESS = ("identification", "dynamics/apply", "dynamics/drive", "dynamics/simulation")
"""Verbs that know causes, but none of them by name."""

OPENS_WITHOUT_A_NOUN_OR_VERB = re.compile(
    r"(What|Whether|How|By how|The same|Of |And |As |Where|Nothing|Such|That |Those|Beside|Again)\b"
)
TO_REWRITE = set((Path(__file__).parent / "to_rewrite.txt").read_text(encoding="utf-8").split())
"""Files that still break the rules of style below. The list only shrinks: a file that keeps them must leave it."""


@cache
def parse(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path, nodes: Iterator[ast.AST] | None = None) -> Iterator[tuple[int, str]]:
    """Yield line and full name of all imports; ``from a import b`` and ``import_module("a.b")`` give ``a.b``."""
    for node in nodes or ast.walk(parse(path)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (
                (node.lineno, name.value) for name in node.args if isinstance(name, ast.Constant)
            )


def at_load(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run when the module is loaded: not in functions, not for the type checker alone."""
    for child in ast.iter_child_nodes(node):
        checking = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
        if not checking and not isinstance(
            child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
        ):
            yield child
            yield from at_load(child)


def inside(path: Path) -> str:
    """The path of a file within the package, without its suffix."""
    return path.relative_to(PACKAGE).with_suffix("").as_posix()


@pytest.mark.parametrize("room", ROOMS)
def test_imports_keep_the_order_of_the_rooms(room: str) -> None:
    assert room.removesuffix(".py") in (*ORDER, "__init__"), f"{room}: give it a place in ORDER"
    for path in FILES:
        if path.relative_to(PACKAGE).parts[0] == room:
            check_imports(path)


def check_imports(path: Path) -> None:
    place = inside(path)
    own = place.partition("/")[0]
    plugins = next((folder for folder in SHARED if place.startswith(f"{folder}/")), None)
    for line, name in imports(path):
        parts = name.split(".")
        where = f"{path}:{line}: imports {name}"
        if parts[0] != PACKAGE.name or parts[1] not in ORDER:
            continue
        is_below = place == "__init__" or ORDER.index(parts[1]) <= ORDER.index(own)
        assert is_below or (place, name) == LOOKED_AT, f"{where}, which stands above it"
        if plugins and path.stem not in READERS and parts[1] == plugins:
            assert parts[2] in SHARED[plugins], f"{where}: plug-ins do not import each other"
        if place.startswith(NAMELESS) and parts[1] == "effects":
            assert not concrete(parts[2:]), f"{where}: it should not know this cause by name"
    for line, name in imports(path, at_load(parse(path))):
        heavy = [module for module in HEAVY if f"{name}.".startswith(f"{module}.")]
        assert not heavy, f"{path}:{line}: imports {name} when loaded, not in what uses it"


def test_no_error_is_kept_and_one_file_prints() -> None:
    for path in FILES:
        for node in ast.walk(parse(path)):
            where = f"{path}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.ExceptHandler):
                caught = ast.unparse(node.type) if node.type else "Exception"
                if caught in ("Exception", "BaseException"):
                    assert ast.unparse(node.body[-1]) == "raise", f"{where}: keeps {caught}"
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "print":
                assert inside(path) == "cli/present", f"{where}: prints, which `say` is for"


def concrete(name: list[str]) -> bool:
    """Tell whether a name inside `effects` belongs to one cause: its file, or the class in it."""
    files = {path.stem for path in (PACKAGE / "effects").glob("*.py")} - SHARED["effects"] - READERS
    return name[0] in files or name[0].lower() in {file.replace("_", "") for file in files}


def test_only_the_errors_stand_beside_the_rooms() -> None:
    assert {path.stem for path in PACKAGE.glob("*.py")} == {"__init__", "errors"}
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} == {*ORDER} - {"errors"}


def test_no_module_imports_itself_by_way_of_others() -> None:
    modules = {
        ".".join((PACKAGE.name, *inside(path).split("/"))).removesuffix(".__init__"): path
        for path in FILES
    }
    needs = {
        module: {
            name if name in modules else name.rpartition(".")[0]
            for _, name in imports(path, at_load(parse(path)))
        }
        for module, path in modules.items()
    }
    order = TopologicalSorter(
        {module: found & modules.keys() - {module} for module, found in needs.items()}
    )
    assert len(list(order.static_order())) == len(modules)  # a circle raises CycleError


def test_studies_import_what_the_package_has() -> None:
    """No test runs most of them: a name that was moved or renamed shows here."""
    for path in (PACKAGE.parent / "scripts").rglob("*"):
        text = path.read_bytes() if path.is_file() else b""
        if path.suffix == ".py" or text.startswith(b"#!/usr/bin/env python"):
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.ImportFrom) and f"{node.module}".startswith("gimbal_pin"):
                    found = importlib.import_module(str(node.module))
                    for alias in node.names:
                        assert hasattr(found, alias.name), (path, ast.unparse(node))


def test_loading_the_command_line_and_a_rig_loads_nothing_heavy() -> None:
    load = "import sys, gimbal_pin.cli; from gimbal_pin.rig.rig import Rig; Rig.load('turret')"
    code = f"{load}; print([name for name in {sorted(HEAVY)} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def packs_assignments(tree: ast.Module) -> bool:
    """Return whether a statement assigns unrelated expressions side by side, as in ``a, b = f(x), g(y)``."""
    return any(
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
        and not all(isinstance(value, (ast.Name, ast.Constant)) for value in node.value.elts)
        for node in ast.walk(tree)
    )


def yield_docstrings(tree: ast.Module) -> Iterator[str]:
    """Yield the docstrings of modules, classes, functions, constants and fields."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else ():
            value = getattr(statement, "value", None)
            if (
                isinstance(statement, ast.Expr)
                and isinstance(value, ast.Constant)
                and isinstance(value.value, str)
            ):
                yield value.value.strip()


def test_files_keep_the_rules_of_style_or_are_listed() -> None:
    broken = {
        inside(path)
        for path in FILES
        if packs_assignments(parse(path))
        or any(map(OPENS_WITHOUT_A_NOUN_OR_VERB.match, yield_docstrings(parse(path))))
    }
    assert not broken - TO_REWRITE, (
        "these pack assignments, or a docstring opens without a noun or verb"
    )
    assert not TO_REWRITE - broken, "take these off tests/to_rewrite.txt"
