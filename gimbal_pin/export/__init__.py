"""Controllers for a gimbal's own processor: C99 sources, a package for ros2_control, tables for drives; and back."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
