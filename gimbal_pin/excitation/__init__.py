"""Excitation design: criteria, Fourier series, limits, and the search that joins them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
