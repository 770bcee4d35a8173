"""Kinematics and dynamics as expressions, compiled or run on arrays.

`kernel` makes a `Kernel`: a function of many configurations at once.
"""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered

if TYPE_CHECKING:
    from spherekit.velocities.kernels import Kernel as Kernel
    from spherekit.velocities.kernels import kernel as kernel

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
