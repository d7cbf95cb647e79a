"""What the simulation gets wrong, why, and how much is gained by knowing.

log → audit → refitted model → evidence in rows of unit noise → causes tried, composed and pruned → rivals → verdict
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
