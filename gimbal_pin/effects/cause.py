"""What every physical cause says of itself, whatever it acts on: torque, command or rig."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, TypeVar

from gimbal_pin.effects.parameter import Parameter
from gimbal_pin.effects.seen import OperatingRange
from gimbal_pin.errors import UsageError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig

C = TypeVar("C", bound="Cause")


@dataclass(frozen=True)
class Cause(ABC):
    """One way in which a rig differs from its rigid model with Coulomb and viscous friction.

    A subclass is a frozen dataclass whose fields are the joint, if it sits at one, and its shape parameters: those in
    which its formula is not linear. Each kind of cause adds its formula: `Effect`, `Signal`, `RigEffect`.
    """

    name: ClassVar[str]
    """Its name, as `diagnose` says it."""
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    """Bounds, unit and default of the fields that are shape parameters; a default of nan must be stated."""
    chosen: ClassVar[tuple[str, ...]] = ()
    """Shape parameters that a search takes from those of `tried` as they are, and does not refine."""
    experiment: ClassVar[str]
    """The excitation that shows it best."""
    compensation: ClassVar[str]
    """How a controller makes up for it."""
    of_joint: ClassVar[bool] = True
    """False for a cause of the whole rig, which has no `joint`."""
    hidden: ClassVar[str] = "the rigid model and friction explain all that it would add on this log"
    """Why a log does not show it where it does not."""
    like_inertia: ClassVar[bool] = False
    """True if an inertia about the joint's axis may stand for it."""
    of_given_model: ClassVar[bool] = False
    """True if it is a difference of the given URDF from the data: a refitted rigid model takes it up."""

    def __post_init__(self) -> None:
        """Raise `UsageError` for a shape parameter outside its bounds."""
        for shape in self.shapes:
            value = getattr(self, shape.name)
            for number in value if isinstance(value, tuple) else (value,):
                check_within(shape, number, self.name)

    @property
    def place(self) -> str:
        """The joint's name, or "rig"."""
        return str(getattr(self, "joint", "rig"))

    @property
    def pieces(self) -> tuple[float, ...]:
        """What it is made of, where it may be made of any number of pieces: a harmonic's multiples; nothing else."""
        return ()

    def joined(self, other: Cause) -> Cause:
        """Return it with the pieces of another of its kind."""
        return self

    @property
    def coupled(self) -> bool:
        """Whether only other joints' torques can show it: a rig of one joint cannot."""
        return False

    @classmethod
    def inside(cls: type[C], *given: Any, **held: Any) -> C:
        """Return it with these fields, each shape parameter at the bound that it would lie beyond.

        So a search makes a cause from what a log shows, which may be a second long, or a hundred turns.
        """
        held |= {field.name: value for field, value in zip(fields(cls), given)}
        for shape in cls.shapes:
            if isinstance(value := held.get(shape.name), tuple):
                held[shape.name] = tuple(clip_to_bounds(shape, number) for number in value)
            elif value is not None:
                held[shape.name] = clip_to_bounds(shape, value)
        return cls(**held)

    def altered(self: C, **held: Any) -> C:
        """Return it with other values of some fields, as `inside`."""
        return self.inside(
            **{**{field.name: getattr(self, field.name) for field in fields(self)}, **held}
        )

    @classmethod
    def tried(cls, joint: str, seen: OperatingRange) -> tuple[Cause, ...]:
        """Return itself with the shape parameters that a search over a log starts from: a coarse grid."""
        return (cls(joint),) if cls.of_joint else (cls(),)  # type: ignore[call-arg]

    @classmethod
    def is_stated(cls, joint: str, rig: Rig) -> bool:
        """Whether the rig states it at a joint: then it is a part of every model, and never a finding."""
        return False

    def moved(self, name: str, value: float) -> Cause:
        """Return it with one shape parameter at another value, and with it what a fit would move along."""
        return self.altered(**{name: value})

    def akin(self, seen: OperatingRange) -> tuple[Cause, ...]:
        """Return other forms of it to go on from where a search has found it: such as are too dear for a grid."""
        return ()

    def blurred(self, seen: OperatingRange) -> tuple[str, ...]:
        """Names of causes whose other forms look the same on so little of the range as a log shows of the joint."""
        return ()

    @abstractmethod
    def says(self, values: Sequence[float] = ()) -> str:
        """Return what it does, with figures, in words a rig maker understands; `values` as in `shown`."""

    def sentence(self, values: Sequence[float] = ()) -> str:
        """``yaw: cogging, 0.055 N m at 42 per turn``; `values` as in `shown`."""
        return f"{self.place}: {self.name}, {self.says(values)}"

    def holds(self, values: Sequence[float] = ()) -> str:
        """Return which of its figures hold what other causes add beside it, within a sentence; nothing for most."""
        return ""

    def shown(
        self, values: Sequence[float] = (), covariance: Array | None = None
    ) -> tuple[Parameter, ...]:
        """Return its parameters as a person reads them, with units and standard deviations.

        Args:
            values: Coefficients of a torque effect; none for the other kinds.
            covariance: Their covariance, (k, k); None: not estimated.
        """
        return tuple(
            replace(shape, value=float(getattr(self, shape.name))) for shape in self.shapes
        )

    @classmethod
    def stated(cls) -> tuple[Parameter, ...]:
        """What a person states to plant it: names as in `shown`, with bounds, units and defaults."""
        return cls.shapes

    @classmethod
    def planted(cls, joint: str | None, given: Mapping[str, float]) -> Any:
        """Return what `simulation.plant_with` takes, from a value for each parameter of `stated`."""
        at = {"joint": joint} if cls.of_joint else {}
        return cls(**at, **{shape.name: given[shape.name] for shape in cls.shapes})

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; `plain.read_cause` reads it back."""
        held = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            "effect": self.name,
            **{key: list(x) if isinstance(x, tuple) else x for key, x in held.items()},
        }


def check_within(parameter: Parameter, value: float, owner: str) -> float:
    """Return the value; `UsageError` if it is outside the parameter's bounds."""
    if not parameter.lower <= value <= parameter.upper:
        raise UsageError(
            owner,
            f"{parameter.name} is {value:g}{parameter.in_units}",
            f"give {format_bounds(parameter)}",
        )
    return value


def clip_to_bounds(parameter: Parameter, value: float) -> float:
    """Return the value, or the bound that it is beyond."""
    return min(max(value, parameter.lower), parameter.upper)


def format_bounds(parameter: Parameter) -> str:
    """``0.001 to 10 rad/s``."""
    return f"{parameter.lower:g} to {parameter.upper:g}{parameter.in_units}"
