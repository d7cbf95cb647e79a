"""Pages from templates: what is put in is escaped unless the template calls it safe."""

from __future__ import annotations

from importlib.resources import files
from typing import Any


def filled(package: str, name: str, **values: Any) -> str:
    """Return the template of a package, all of whose values are given."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(files(package).joinpath(name).read_text(encoding="utf-8")).render(**values)
