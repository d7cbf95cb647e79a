"""Every effect that may be hidden: the published causes, each in one form or more, and those from outside."""

from .drive import (
    ActuatorLag,
    Cogging,
    CrossTalk,
    DeadZone,
    Delay,
    Dropouts,
    HotMotor,
    Saturation,
    SupplyHum,
    TorqueBias,
    TorqueGain,
    TorqueRipple,
    TorqueSteps,
    VoltageLimit,
)
from .friction import (
    AsymmetricFriction,
    BoucWen,
    Drag,
    FrictionDrift,
    FrictionSpots,
    LoadFriction,
    PlaceFriction,
    Presliding,
    RubbingStop,
    StickyBrake,
    Stribeck,
)
from .hanging import CableWhip, Flywheel, MountResonance, Rattle, Slosh
from .rigwide import (
    BaseTilt,
    EncoderOffset,
    OffDiagonalInertia,
    PayloadMass,
    PayloadShift,
    PlatformMotion,
    SoftBase,
    UnmeasuredMotion,
)
from .structure import Armature, Backlash, CableSpring, JointFlexibility, Touch, Wind

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
