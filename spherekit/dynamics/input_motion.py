"""Base class of results that contain the motion of the inputs.

`q`, `dq` and `ddq` are short names for value, rate and acceleration of a single input.
"""

from spherekit.arrays import Floats
from spherekit.errors import SolveError


def only_column(columns: Floats) -> Floats:
    """Return the values (...) of the only input from an array (..., inputs).

    Raises
    ------
    SolveError
        If there are several inputs.
    """
    if columns.shape[-1] != 1:
        raise SolveError(
            "this attribute exists only for mechanisms with one input, but there are "
            f"{columns.shape[-1]} inputs; use the attribute with all inputs instead, such "
            "as inputs for q, or torques for tau"
        )
    return columns[..., 0]


class InputMotion:
    """Base class of results that contain the motion of the inputs (driven joint angles).

    Its properties are short names for mechanisms with a single input. With several inputs
    they raise `SolveError`.

    Attributes
    ----------
    inputs, input_rates, input_accelerations
        (n, inputs) values (rad), rates (rad/s) and accelerations (rad/s2) of the inputs, at
        n samples.
    """

    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats

    @property
    def q(self) -> Floats:
        """(n,) variable of the only input, rad."""
        return only_column(self.inputs)

    @property
    def dq(self) -> Floats:
        """(n,) rate of the only input, rad/s."""
        return only_column(self.input_rates)

    @property
    def ddq(self) -> Floats:
        """(n,) acceleration of the only input, rad/s2."""
        return only_column(self.input_accelerations)
