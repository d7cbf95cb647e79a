"""Holding the camera still while the platform moves.

`Controller` runs in one's own loop: ``torque = controller.step(measurement)``. ``verify(rig)`` compares it
with a PID on a simulated platform.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
