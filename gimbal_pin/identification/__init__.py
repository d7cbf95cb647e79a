"""From logs to a model with uncertainty: `identify`, its estimators, cameras, bodies, balance and the test of bias."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
