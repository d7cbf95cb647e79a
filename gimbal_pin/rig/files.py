"""Where a rig's file, its YAML and its payload lie: bundled, or named by a path."""

from __future__ import annotations

import importlib.resources
import os
import re
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from gimbal_pin.errors import PLACE, RigError, UsageError, shortened
from gimbal_pin.rig.config import Config, is_written, load_config, overlay_config

YAML_SUFFIXES = (".yaml", ".yml")
_RIG_SUFFIXES = (".urdf", ".xacro", ".sdf", ".xml")
"""Suffixes of the rig's file that is sought beside a YAML without `urdf:`."""


def bundled() -> Path:
    """Return the folder of the bundled rigs: inside the installed package, or beside it in a checkout."""
    inside = Path(str(importlib.resources.files("gimbal_pin"))) / "urdf"
    return inside if inside.is_dir() else Path(__file__).parents[2] / "urdf"


def bundled_rigs() -> tuple[str, ...]:
    """Names of the bundled rigs."""
    return tuple(sorted(path.stem for path in bundled().glob("*.urdf")))


def bundled_payloads() -> tuple[str, ...]:
    """Names of the bundled payloads."""
    return tuple(sorted(path.stem for path in (bundled() / "payloads").glob("*.urdf")))


def find_rig(rig: str | Path, above: tuple[Path, ...] = ()) -> tuple[Path, Config]:
    """Return the path of the rig's file and the configuration of a bundled name, rig's file, YAML or description.

    `above`: the YAML files that led here, resolved: none may name itself, directly or in a circle.
    """
    path = bundled() / f"{rig}.urdf" if str(rig) in bundled_rigs() else Path(rig)
    if _names_description(path):
        return find_description(path.name), Config()
    if not path.is_file():
        names = ", ".join(bundled_rigs())
        raise RigError(
            str(rig), "is neither a file nor a bundled rig", f"give a path, or one of {names}"
        )
    if path.suffix not in YAML_SUFFIXES:
        beside = path.with_suffix(".yaml")
        own = beside.is_file() and not is_written(beside)
        return path, _resolve_payload(load_config(beside), beside) if own else Config()
    if path.resolve() in above:
        raise RigError(str(path), "names itself as its rig", "name a URDF with 'urdf:'")
    config = _resolve_payload(load_config(path), path)
    target = find_target(path, config)
    if not os.path.exists(target):
        what = f"names '{shortened(str(target), PLACE)}', which is neither a file nor a bundled rig"
        raise RigError(f"{path}: urdf", what, "name a URDF, its path as seen from the YAML")
    if target.suffix not in YAML_SUFFIXES:
        return target, config
    base_path, base = find_rig(target, (*above, path.resolve()))
    return base_path, overlay_config(base, config)


def _names_description(path: Path) -> bool:
    """Whether what is no path that is there is called as robots of `robot_descriptions` are."""
    return not path.exists() and re.fullmatch(r"[a-z0-9_]+_description", path.name) is not None


def find_description(name: str) -> Path:
    """Return the URDF or MJCF of a robot of `robot_descriptions`, which clones it into its cache when first asked.

    Raises:
        UsageError: The package is not installed.
        RigError: It has no such robot, only one in xacro, or cannot fetch it.
    """
    if find_spec("robot_descriptions") is None:
        mend = "install it (pip install 'gimbal-pin[robots]'), or give a file"
        raise UsageError(
            name,
            "is neither a file nor a bundled rig; of other robots robot_descriptions knows",
            mend,
        )
    if find_spec(f"robot_descriptions.{name}") is None:
        mend = (
            "'python -m robot_descriptions list' names them; or give a file, or one of "
            + ", ".join(bundled_rigs())
        )
        raise RigError(
            name,
            "is neither a file nor a bundled rig, and robot_descriptions has none of that name",
            mend,
        )
    try:
        from git.exc import GitError

        found = import_module(f"robot_descriptions.{name}")
    except (ImportError, OSError, GitError) as error:
        raise RigError(
            name, f"cannot be fetched by robot_descriptions ({error})", "see to git and network"
        ) from error
    path = getattr(found, "URDF_PATH", None) or getattr(found, "MJCF_PATH", None)
    if path is None:
        raise RigError(name, "is described in xacro alone", "expand it to a URDF, and give that")
    return Path(path)


def _resolve_payload(config: Config, path: Path) -> Config:
    """Return the configuration with its payload's path made relative to the YAML that names it."""
    if config.payload is None or config.payload in bundled_payloads():
        return config
    return replace(config, payload=str(path.parent / config.payload))


def find_target(path: Path, config: Config) -> Path:
    """Return what a YAML's `urdf:` names: a bundled rig, a file relative to the YAML, or a robot's description."""
    if config.urdf is None:
        beside = [path.with_suffix(suffix) for suffix in _RIG_SUFFIXES]
        return next((file for file in beside if file.is_file()), beside[0])
    if config.urdf in bundled_rigs():
        return bundled() / f"{config.urdf}.yaml"
    named = path.parent / config.urdf
    return find_description(named.name) if _names_description(named) else named


def list_configs(rig: str) -> list[Path]:
    """Return the YAML files that the name of a rig that is there leads through."""
    path = bundled() / f"{rig}.urdf" if rig in bundled_rigs() else Path(rig)
    found = []
    while path.suffix in YAML_SUFFIXES:
        found.append(path)
        path = find_target(path, load_config(path))
    return found


def find_payload(payload: str) -> Path:
    """Return the URDF of a bundled payload or of a path."""
    path = (
        bundled() / "payloads" / f"{payload}.urdf"
        if payload in bundled_payloads()
        else Path(payload)
    )
    if not path.is_file():
        names = ", ".join(bundled_payloads())
        raise RigError(
            payload,
            "is neither a file nor a bundled payload",
            f"give a URDF, xacro, SDF or MJCF, or one of {names}",
        )
    return path
