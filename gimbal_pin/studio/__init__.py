"""A local page on which a rig is tuned by hand: plain choices, figures of them, and a thin page above both."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
