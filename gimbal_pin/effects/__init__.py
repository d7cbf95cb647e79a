"""Causes: one small class in one file each, exported here; exporting is registering."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import lazy_loader

from gimbal_pin.effects.actuator_lag import ActuatorLag as ActuatorLag
from gimbal_pin.effects.armature import Armature as Armature
from gimbal_pin.effects.asymmetric_friction import AsymmetricFriction as AsymmetricFriction
from gimbal_pin.effects.backlash import Backlash as Backlash
from gimbal_pin.effects.base import Effect as Effect
from gimbal_pin.effects.base import Sample as Sample
from gimbal_pin.effects.base import Term as Term
from gimbal_pin.effects.base_tilt import BaseTilt as BaseTilt
from gimbal_pin.effects.cable_spring import CableSpring as CableSpring
from gimbal_pin.effects.cause import Cause as Cause
from gimbal_pin.effects.cogging import Cogging as Cogging
from gimbal_pin.effects.coulomb import Coulomb as Coulomb
from gimbal_pin.effects.coupled import Coupled as Coupled
from gimbal_pin.effects.coupled import CoupledFriction as CoupledFriction
from gimbal_pin.effects.coupled import CoupledRotor as CoupledRotor
from gimbal_pin.effects.dead_zone import DeadZone as DeadZone
from gimbal_pin.effects.delay import Delay as Delay
from gimbal_pin.effects.encoder_offset import EncoderOffset as EncoderOffset
from gimbal_pin.effects.friction_drift import FrictionDrift as FrictionDrift
from gimbal_pin.effects.harmonic import Harmonic as Harmonic
from gimbal_pin.effects.joint_flexibility import JointFlexibility as JointFlexibility
from gimbal_pin.effects.load_dependent_friction import (
    LoadDependentFriction as LoadDependentFriction,
)
from gimbal_pin.effects.losses import Losses as Losses
from gimbal_pin.effects.off_diagonal_inertia import OffDiagonalInertia as OffDiagonalInertia
from gimbal_pin.effects.parameter import Parameter as Parameter
from gimbal_pin.effects.payload_mass import PayloadMass as PayloadMass
from gimbal_pin.effects.payload_shift import PayloadShift as PayloadShift
from gimbal_pin.effects.position_dependent_friction import (
    PositionDependentFriction as PositionDependentFriction,
)
from gimbal_pin.effects.presliding import Presliding as Presliding
from gimbal_pin.effects.quadratic_drag import QuadraticDrag as QuadraticDrag
from gimbal_pin.effects.resistance import Resistance as Resistance
from gimbal_pin.effects.rig_effect import RigEffect as RigEffect
from gimbal_pin.effects.rig_effect import get_payload as get_payload
from gimbal_pin.effects.rotor import Rotor as Rotor
from gimbal_pin.effects.saturation import Saturation as Saturation
from gimbal_pin.effects.seen import OperatingRange as OperatingRange
from gimbal_pin.effects.signal import JointLoad as JointLoad
from gimbal_pin.effects.signal import Signal as Signal
from gimbal_pin.effects.stribeck import Stribeck as Stribeck
from gimbal_pin.effects.torque_bias import TorqueBias as TorqueBias
from gimbal_pin.effects.torque_gain import TorqueGain as TorqueGain
from gimbal_pin.effects.torque_ripple import TorqueRipple as TorqueRipple
from gimbal_pin.effects.viscous import Viscous as Viscous

if TYPE_CHECKING:
    from gimbal_pin.effects.parse import parse_effect as parse_effect
    from gimbal_pin.effects.plain import read_cause as read_cause
    from gimbal_pin.effects.plain import read_term as read_term
    from gimbal_pin.effects.torque_table import TorqueTable as TorqueTable

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "parse": ["parse_effect"],
        "plain": ["read_cause", "read_term"],
        "torque_table": ["TorqueTable"],
    },
)
"""What reads causes needs all of them, so it is imported on first use."""

ALWAYS: tuple[type[Effect], ...] = (Coulomb, Viscous)
"""Friction that is part of every model, and no finding."""
PLAIN: tuple[type[Effect], ...] = (*ALWAYS, Rotor, CoupledRotor, CoupledFriction)
"""What is part of a model without being found: friction, and what the rig states of rotors and couplings."""

CAUSES: Mapping[str, type[Cause]] = MappingProxyType(
    {
        kind.name: kind
        for kind in tuple(vars().values())
        if isinstance(kind, type)
        and issubclass(kind, Cause)
        and hasattr(kind, "name")
        and kind not in PLAIN
    }
)
"""Every physical cause by its name but platform-motion, which is measured rather than fitted."""
