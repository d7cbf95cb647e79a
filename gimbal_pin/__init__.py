"""Identify, diagnose, tune and show a camera gimbal from its URDF and a log.

The public names are what a person at a prompt needs; each is imported when it is first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
