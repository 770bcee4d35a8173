from .kernels import Kernel as Kernel
from .kernels import kernel as kernel
