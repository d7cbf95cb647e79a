"""Every effect that may be hidden: the published causes, each in one form or more, and those from outside."""

from __future__ import annotations

from .base import Context, Effect, Law
from .drive import (
    ActuatorLag,
    Cogging,
    DeadZone,
    Delay,
    Saturation,
    TorqueBias,
    TorqueGain,
    TorqueRipple,
)
from .friction import (
    AsymmetricFriction,
    Drag,
    FrictionDrift,
    LoadFriction,
    PlaceFriction,
    Presliding,
    Stribeck,
)
from .hanging import CableWhip, MountResonance, Rattle, Slosh
from .outside_drive import CrossTalk, Dropouts, HotMotor, SupplyHum, TorqueSteps, VoltageLimit
from .outside_rig import Flywheel, SoftBase
from .outside_world import BoucWen, FrictionSpots, RubbingStop, StickyBrake, Touch, Wind
from .payload import OffDiagonalInertia, PayloadMass, PayloadShift, diagonal
from .rigwide import BaseTilt, EncoderOffset, PlatformMotion, UnmeasuredMotion
from .structure import Armature, Backlash, CableSpring, JointFlexibility

PUBLISHED: tuple[type[Effect], ...] = (
    Stribeck, AsymmetricFriction, LoadFriction, Presliding, PlaceFriction, FrictionDrift, Drag,
    Cogging, TorqueRipple, TorqueGain, TorqueBias, ActuatorLag, Delay, Saturation, DeadZone,
    CableSpring, JointFlexibility, Backlash, Armature,
    PayloadShift, PayloadMass, EncoderOffset, BaseTilt, PlatformMotion, OffDiagonalInertia,
)  # fmt: skip
OUTSIDE: tuple[type[Effect], ...] = (
    SoftBase, VoltageLimit, Slosh, Rattle, HotMotor, Wind, CableWhip, CrossTalk, MountResonance, BoucWen,
    FrictionSpots, Touch, TorqueSteps, Flywheel, Dropouts, RubbingStop, SupplyHum, StickyBrake,
    UnmeasuredMotion,
)  # fmt: skip
TRUSTED = ("payload-shift", "payload-mass", "off-diagonal-inertia")
"""Causes that compare the given model with the data: their URDF is exact and says so."""
CATALOGUE: dict[str, type[Effect]] = {kind.cause: kind for kind in PUBLISHED + OUTSIDE}

__all__ = [
    "CATALOGUE",
    "OUTSIDE",
    "PUBLISHED",
    "TRUSTED",
    "Context",
    "Effect",
    "Law",
    "PlatformMotion",
    "diagonal",
]
