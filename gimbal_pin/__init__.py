"""Identify, diagnose, tune and show a camera gimbal from its URDF and a log.

The names below are what a person at a prompt needs; each is imported when it is first used.
"""

from __future__ import annotations

import typing

if typing.TYPE_CHECKING:
    from gimbal_pin.control.experiment import bench_run as bench_run
    from gimbal_pin.control.tracking import track as track
    from gimbal_pin.control.tuning import tune as tune
    from gimbal_pin.diagnosis import rehearse as rehearse
    from gimbal_pin.dynamics.checking import check as check
    from gimbal_pin.dynamics.model import nominal as nominal
    from gimbal_pin.dynamics.simulation import simulate as simulate
    from gimbal_pin.errors import GimbalPinError as GimbalPinError
    from gimbal_pin.excitation import excite as excite
    from gimbal_pin.export.sources import export_controller as export_controller
    from gimbal_pin.fleet.fleet import compare_fleet as compare_fleet
    from gimbal_pin.fleet.montecarlo import monte_carlo as monte_carlo
    from gimbal_pin.identification import Online as Online
    from gimbal_pin.identification import identify as identify
    from gimbal_pin.log.io import read_log as read_log
    from gimbal_pin.log.io import write_log as write_log
    from gimbal_pin.log.log import Log as Log
    from gimbal_pin.log.platform import Platform as Platform
    from gimbal_pin.log.profile import profile_s as profile_s
    from gimbal_pin.report.pipeline import auto as auto
    from gimbal_pin.report.view import animate as animate
    from gimbal_pin.rig.rig import Rig as Rig

__version__ = "0.1.0"

HOMES = {
    "GimbalPinError": "errors",
    "Log": "log.log",
    "Online": "identification",
    "Platform": "log.platform",
    "Rig": "rig.rig",
    "animate": "report.view",
    "auto": "report.pipeline",
    "bench_run": "control.experiment",
    "check": "dynamics.checking",
    "compare_fleet": "fleet.fleet",
    "diagnose": "diagnosis",
    "excite": "excitation",
    "export_controller": "export.sources",
    "identify": "identification",
    "monte_carlo": "fleet.montecarlo",
    "nominal": "dynamics.model",
    "profile_s": "log.profile",
    "read_log": "log.io",
    "rehearse": "diagnosis",
    "simulate": "dynamics.simulation",
    "track": "control.tracking",
    "tune": "control.tuning",
    "write_log": "log.io",
}
"""Name → the module it lives in."""

__all__ = list(HOMES)


def __dir__() -> list[str]:
    """Return the public names, which are not there before their first use, and Python's own."""
    return sorted([*(name for name in globals() if name.startswith("__")), *HOMES])


def __getattr__(name: str) -> typing.Any:
    """Import a name on first use (PEP 562): the command line starts without loading everything."""
    if name not in HOMES:
        raise AttributeError(f"module 'gimbal_pin' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(f"gimbal_pin.{HOMES[name]}"), name)
