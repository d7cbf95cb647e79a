"""What a person has chosen in the studio, and the way back: plain values, no page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from gimbal_pin.errors import UsageError


@dataclass(frozen=True)
class Slider:
    """A number that a person moves.

    Attributes:
        label: What it is called.
        low: Least value, SI.
        high: Largest value, SI.
        unit: What it is shown in.
        factor: What a value is multiplied by to be shown.
    """

    label: str
    low: float
    high: float
    unit: str = ""
    factor: float = 1.0

    def check_value(self, value: Any) -> float:
        """Return the value, or raise `UsageError` where it is no number between the bounds."""
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if is_number and self.low <= value <= self.high:
            return float(value)
        said = f"{self.factor * value:g}" if is_number else repr(value)
        ends = f"{self.factor * self.low:g} to {self.factor * self.high:g} {self.unit}"
        raise UsageError(self.label, f"is {said}", f"give {ends}".rstrip())


def bounded_choice(default: float | None, *slider: Any) -> Any:
    """Return a field of `StudioState` that a slider moves."""
    return field(default=default, metadata={"slider": Slider(*slider)})


@dataclass(frozen=True)
class StudioState:
    """What is chosen; None: as `tune` chooses it, or as the rig and its logs say.

    Bounds are those of the same options of `tune`, `track` and `identify`, and of the effects of a payload.

    Attributes:
        bandwidth_hz: Wanted bandwidth, Hz.
        disk_margin: Disk margin that every joint keeps.
        delay: Time from measurement to torque, s.
        x: How far the payload is moved along its frame, m.
        y: The same.
        z: The same.
        mass: What the payload weighs, kg.
        off: Causes that the controller does not know, as `list_causes` names them.
        payload: Another camera, a bundled payload's name or a file's path.
        judged: From when to when the logs, put one after another, only judge the model, s; the rest trains.
    """

    bandwidth_hz: float | None = bounded_choice(None, "bandwidth", 0.1, 100, "Hz")
    disk_margin: float | None = bounded_choice(None, "disk margin", 0.01, 1.99)
    delay: float | None = bounded_choice(None, "delay", 0, 0.05, "ms", 1e3)
    x: float = bounded_choice(0.0, "payload x", -0.5, 0.5, "mm", 1e3)
    y: float = bounded_choice(0.0, "payload y", -0.5, 0.5, "mm", 1e3)
    z: float = bounded_choice(0.0, "payload z", -0.5, 0.5, "mm", 1e3)
    mass: float | None = bounded_choice(None, "payload mass", 1e-4, 1e4, "kg")
    off: tuple[str, ...] = ()
    payload: str | None = None
    judged: tuple[float, float] | None = None

    def moved(self, name: str, value: Any) -> StudioState:
        """Return the state with one choice changed; another camera has its own place and mass.

        Raises:
            UsageError: There is no such choice, or its value is out of bounds.
        """
        known = {one.name: one.default for one in fields(self)}
        sliders = list_sliders()
        if name not in known:
            raise UsageError("studio", f"has no '{name}'", f"move {', '.join(known)}")
        if name in sliders:
            value = known[name] if value is None else sliders[name].check_value(value)
        elif name == "off":
            value = tuple(sorted({*value}))
        elif name == "judged" and value is not None:
            first, last = (Slider("judged part", 0.0, 1e10, "s").check_value(end) for end in value)
            if last <= first:
                raise UsageError(
                    "judged part",
                    f"ends at {last:g} s, not after {first:g}",
                    "mark some time of the log",
                )
            value = first, last
        if name == "payload" and value != self.payload:
            return replace(self, payload=value, x=0.0, y=0.0, z=0.0, mass=None)
        return replace(self, **{name: value})


def list_sliders() -> Mapping[str, Slider]:
    """Return the choices that are numbers, and their bounds."""
    return {one.name: one.metadata["slider"] for one in fields(StudioState) if one.metadata}


@dataclass(frozen=True)
class History:
    """States, oldest first: what undo goes back to, what is shown, and what redo returns to.

    Attributes:
        present: What is shown.
        past: What was shown before it.
        future: What was undone.
    """

    present: StudioState = StudioState()
    past: tuple[StudioState, ...] = ()
    future: tuple[StudioState, ...] = ()

    def moved(self, name: str, value: Any) -> History:
        """Return it after one more change; one that changes nothing leaves no trace. Raises as `StudioState.moved`."""
        state = self.present.moved(name, value)
        return self if state == self.present else History(state, (*self.past, self.present))

    def undone(self) -> History:
        """Return it one change earlier; at the first state the same."""
        return (
            History(self.past[-1], self.past[:-1], (self.present, *self.future))
            if self.past
            else self
        )

    def redone(self) -> History:
        """Return it one change later; at the last state the same."""
        return (
            History(self.future[0], (*self.past, self.present), self.future[1:])
            if self.future
            else self
        )

    def refused(self, state: StudioState) -> History:
        """Return it without a state that cannot be: shown is then the one before it, or the one after; if any is."""
        past, future = (
            tuple(one for one in side if one != state) for side in (self.past, self.future)
        )
        if self.present != state:
            return History(self.present, past, future)
        if past:
            return History(past[-1], past[:-1], future)
        return History(future[0], (), future[1:]) if future else self
