"""Beyond one rig: many units of work on any executor, Monte Carlo over rigs that differ, and units of a fleet."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
