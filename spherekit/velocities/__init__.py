"""Kinematics and dynamics as expressions, compiled or run on arrays.

`kernel` makes a `Kernel`: a function of many configurations at once.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
