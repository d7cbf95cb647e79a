"""Control laws, their tuning, and how well they track; an experiment on the bench under one of them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
