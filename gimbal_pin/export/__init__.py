"""Controllers for a gimbal's own processor: C99 sources, a package for ros2_control, tables for drives; and back."""

from gimbal_pin.export.compiled import CompiledLaw, CompiledPointer, Library
from gimbal_pin.export.sources import NAMES, Exported, export_controller, holder

__all__ = ["NAMES", "CompiledLaw", "CompiledPointer", "Exported", "Library", "export_controller", "holder"]
