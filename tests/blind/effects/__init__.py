"""Every effect that may be hidden: the published causes, each in one form or more, and those from outside."""

from __future__ import annotations

from .base import Context, Effect
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
from .outside_world import (
    BoucWen,
    Flywheel,
    FrictionSpots,
    RubbingStop,
    SoftBase,
    StickyBrake,
    Touch,
    Wind,
)
from .rigwide import (
    BaseTilt,
    EncoderOffset,
    OffDiagonalInertia,
    PayloadMass,
    PayloadShift,
    PlatformMotion,
    UnmeasuredMotion,
    diagonal,
)
from .structure import Armature, Backlash, CableSpring, JointFlexibility

PUBLISHED = (
    Stribeck, AsymmetricFriction, LoadFriction, Presliding, PlaceFriction, FrictionDrift, Drag,
    Cogging, TorqueRipple, TorqueGain, TorqueBias, ActuatorLag, Delay, Saturation, DeadZone,
    CableSpring, JointFlexibility, Backlash, Armature,
    PayloadShift, PayloadMass, EncoderOffset, BaseTilt, PlatformMotion, OffDiagonalInertia,
)  # fmt: skip
OUTSIDE = (
    SoftBase, VoltageLimit, Slosh, Rattle, HotMotor, Wind, CableWhip, CrossTalk, MountResonance, BoucWen,
    FrictionSpots, Touch, TorqueSteps, Flywheel, Dropouts, RubbingStop, SupplyHum, StickyBrake,
    UnmeasuredMotion,
)  # fmt: skip
TRUSTED = ("payload-shift", "payload-mass", "off-diagonal-inertia")
"""Causes that compare the given model with the data: their URDF is exact and says so."""
CATALOGUE = {kind.cause: kind for kind in PUBLISHED + OUTSIDE}

__all__ = [
    "CATALOGUE",
    "OUTSIDE",
    "PUBLISHED",
    "TRUSTED",
    "Context",
    "Effect",
    "PlatformMotion",
    "diagonal",
]
