"""The motion of the inputs in rows, and what of it a single input is called."""

import numpy as np

from spherekit.errors import SolveError
from spherekit.sphere.rotation import Floats


def single(columns: Floats) -> Floats:
    """Return the only one of columns (..., inputs); `SolveError` with several inputs."""
    if columns.shape[-1] != 1:
        raise SolveError(
            f"there are {columns.shape[-1]} inputs; read inputs, input_rates, "
            "input_accelerations or torques"
        )
    return np.asarray(columns[..., 0])


class InputMotion:
    """Records with the inputs, their rates and accelerations in columns (n, inputs)."""

    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats

    @property
    def q(self) -> Floats:
        """(n,) variable of the only input, rad; `SolveError` with several, as all below."""
        return single(self.inputs)

    @property
    def dq(self) -> Floats:
        """(n,) its rate, rad/s."""
        return single(self.input_rates)

    @property
    def ddq(self) -> Floats:
        """(n,) its acceleration, rad/s2."""
        return single(self.input_accelerations)
