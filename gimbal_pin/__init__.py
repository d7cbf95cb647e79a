"""Identify, diagnose, tune and show a camera gimbal from its URDF and a log.

The names below are what a person at a prompt needs; each is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gimbal_pin.errors import GimbalPinError as GimbalPinError
    from gimbal_pin.excitation import excite as excite
    from gimbal_pin.experiment import bench_run as bench_run
    from gimbal_pin.identification import identify as identify
    from gimbal_pin.io import read_log as read_log
    from gimbal_pin.io import write_log as write_log
    from gimbal_pin.log import Log as Log
    from gimbal_pin.model import nominal as nominal
    from gimbal_pin.online import Online as Online
    from gimbal_pin.platform import Platform as Platform
    from gimbal_pin.profile import profile_s as profile_s
    from gimbal_pin.rig import Rig as Rig
    from gimbal_pin.simulation import simulate as simulate
    from gimbal_pin.tracking import track as track
    from gimbal_pin.tuning import tune as tune
    from gimbal_pin.walk import auto as auto

__version__ = "0.1.0"

HOMES = {
    "GimbalPinError": "errors",
    "Log": "log",
    "Online": "online",
    "Platform": "platform",
    "Rig": "rig",
    "auto": "walk",
    "bench_run": "experiment",
    "diagnose": "diagnosis",
    "excite": "excitation",
    "identify": "identification",
    "nominal": "model",
    "profile_s": "profile",
    "read_log": "io",
    "simulate": "simulation",
    "track": "tracking",
    "tune": "tuning",
    "write_log": "io",
}
"""Name → the module it lives in."""

__all__ = list(HOMES)


def __dir__() -> list[str]:
    """Return the public names, which are not there before their first use."""
    return sorted([*globals(), *HOMES])


def __getattr__(name: str) -> Any:
    """Import a name on first use (PEP 562): the command line starts without loading everything."""
    if name not in HOMES:
        raise AttributeError(f"module 'gimbal_pin' has no attribute '{name}'")
    return getattr(importlib.import_module(f"gimbal_pin.{HOMES[name]}"), name)
