"""What a case shall be: every choice that a stratified sample makes; the rest follows from the seed."""

from __future__ import annotations

from dataclasses import dataclass

STRATA = {
    "clean": 0, "single": 1, "pair": 2, "outside": 3, "drive-clean": 8, "drive-single": 9, "mismatched": 12,
}  # fmt: skip
"""Name → part of the seed of its draws."""
SHARES = (0.003, 0.01, 0.03, 0.1, 0.3)
LEVELS = ("clean", "dirty")
ALIGNED = ("delay", "actuator-lag")
"""Effects that a shift between channels looks like."""


@dataclass(frozen=True)
class Hidden:
    """A cause, the form it takes, its wanted rms as a share of the joint's torque rms, and which joint (0–1 of all)."""

    cause: str
    form: str
    share: float
    place: float


@dataclass(frozen=True)
class Plan:
    """One case. `data`: a fault of the data and its form; `trusted`: the URDF is exact and says so."""

    seed: int
    stratum: str
    hidden: tuple[Hidden, ...] = ()
    data: tuple[str, str] | None = None
    axes: int = 3
    level: str = "clean"
    excitation: str = "multisine"
    rate: float = 500.0
    seconds: float = 30.0
    trusted: bool = False


@dataclass(frozen=True)
class DrivePlan(Plan):
    """One case as people log it, through a drive's sensors. `arm`: a serial arm, no gimbal; `repeats`: how often one
    motion is made (1: no repeats); `turns`: what a continuous joint travels in the log, revolutions (0: none does);
    `idle`: one joint is "held" still, "unlogged" (and stands at the URDF's zero), "bolted" (the same, and "fixed" in
    the URDF), or ""; `camera_off`: by what share the camera is off its URDF's mass; `aligned`: channels not shifted."""

    variant: str = "plain"
    arm: bool = False
    repeats: int = 1
    turns: float = 0.0
    idle: str = ""
    camera_off: float = 0.0
    aligned: bool = False
