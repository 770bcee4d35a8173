"""Types of arrays, named once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Integers = NDArray[np.int64]
SmallIntegers = NDArray[np.int8]
Array = NDArray[Any]
Complexes = NDArray[np.complex128]
