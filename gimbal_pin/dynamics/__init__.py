"""Rigid-body dynamics on a base that may move: regressor, base parameters, the model, and the simulated plant."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
