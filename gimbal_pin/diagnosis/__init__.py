"""Find what the simulation gets wrong, name the cause, and measure what knowing it gains.

prepare → rows → noise → search → rivals → held-out errors → verdict
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
