"""Controllers for a gimbal's own processor: C99 sources, and a compiled controller back in the simulation."""

from gimbal_pin.export.compiled import CompiledLaw, CompiledPointer, Library
from gimbal_pin.export.sources import NAMES, Exported, export, holder

__all__ = ["NAMES", "CompiledLaw", "CompiledPointer", "Exported", "Library", "export", "holder"]
