"""What is wrong with the data of a log: a log in; the repaired log, what was altered and the faults out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
