"""What a case shall be: every choice that a stratified sample makes; the rest follows from the seed."""

from __future__ import annotations

from dataclasses import dataclass

STRATA = ("clean", "single", "pair", "outside", "mixed", "data", "held-out", "corrupted")
SHARES = (0.003, 0.01, 0.03, 0.1, 0.3)
LEVELS = ("clean", "dirty")


@dataclass(frozen=True)
class Hidden:
    """A cause, the form it takes, its wanted rms as a share of the joint's torque rms, and which joint (0–1 of all)."""

    cause: str
    form: str
    share: float
    place: float


@dataclass(frozen=True)
class Plan:
    """One case. `data`: a data cause and its form; `window`: the part of the log that it touches, as shares of it;
    `start`: when effects begin, likewise; `trusted`: the URDF is exact and says so."""

    seed: int
    stratum: str
    hidden: tuple[Hidden, ...] = ()
    data: tuple[str, str] | None = None
    window: tuple[float, float] = (0.0, 1.0)
    start: float = 0.0
    axes: int = 3
    level: str = "clean"
    excitation: str = "multisine"
    rate: float = 500.0
    seconds: float = 30.0
    trusted: bool = False

    @property
    def formula(self) -> bool:
        """Whether the logged torque is nothing but the controller's formula of the other channels."""
        return self.data is not None and self.data[0] == "commanded-torque"
