"""Print what the package is made of: lines per room, and the counts of names that may only fall.

``tests/test_layers.py`` holds the counts: CEILINGS there.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
PACKAGE = TOP / "gimbal_pin"


@cache
def parse(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def top_level_names(tree: ast.Module) -> Iterator[tuple[str, bool]]:
    """Yield what a module defines at its top: name, and whether it is a function; ``__all__`` and its like are none."""
    for node in tree.body:
        names: list[str] = []
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names = [node.name]
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [part.id for one in targets for part in ast.walk(one) if isinstance(part, ast.Name)]
        yield from ((name, isinstance(node, ast.FunctionDef)) for name in names if not name.startswith("__"))


@cache
def listed_names(room: str) -> set[str]:
    """Return what the stub of a room lists, nothing where it has none."""
    stub = PACKAGE / room / "__init__.pyi"
    nodes = parse(stub).body if stub.is_file() else []
    return {alias.name for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names}


def deep_imports(tree: ast.Module) -> Iterator[str]:
    """Yield ``gimbal_pin.room.module.name`` for what is imported past a room's own list of names."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{PACKAGE.name}."):
            _, room, *modules = str(node.module).split(".")
            for alias in node.names:
                path = PACKAGE.joinpath(room, *modules, alias.name)
                is_module = path.is_dir() or path.with_suffix(".py").is_file()
                if modules or (is_module and alias.name not in listed_names(room)):
                    yield f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.count(".") > 1 and PACKAGE.name in alias.name)


def count_lines(folder: Path) -> int:
    """Return the lines of the Python files in a folder."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in folder.rglob("*.py"))


def count_names() -> dict[str, int]:
    """Return what is counted of names → how many."""
    modules = [list(top_level_names(parse(path))) for path in sorted(PACKAGE.rglob("*.py"))]
    homes = Counter(name for module in modules for name in {name for name, _ in module})
    functions = [name for module in modules for name, is_function in module if is_function and name != "main"]
    deep = [name for path in (TOP / "tests").rglob("*.py") for name in deep_imports(parse(path))]
    return {
        "names at the top of more than one module": sum(count > 1 for count in homes.values()),
        "percent of functions that are one word": round(
            100 * sum("_" not in name.strip("_") for name in functions) / len(functions)
        ),
        "upper-case constants": sum(name.isupper() for module in modules for name, _ in module),
        "distinct deep names imported by the tests": len(set(deep)),
    }


def main() -> None:
    """Print lines and counts."""
    folders = [*sorted(path.parent for path in PACKAGE.glob("*/__init__.py")), PACKAGE, TOP / "tests", TOP / "scripts"]
    for folder in folders:
        print(f"{count_lines(folder):7d} lines  {folder.relative_to(TOP)}/")
    for what, count in count_names().items():
        print(f"{count:7d} {what}")


if __name__ == "__main__":
    main()
