"""The inputs of poses in working modes, with measures of how near singularities are.

The measures are those of C. Gosselin and J. Angeles, Singularity analysis of
closed-loop kinematic chains (1990), made free of units. With the other inputs free, a
locked input leaves the output a plane of angular velocities; n_i is its normal.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import SolveError
from spherekit.motion.assembly_modes import label_of
from spherekit.output.dyads import Signs
from spherekit.output.measures import reciprocal
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Inverse:
    """The inputs of n poses in m working modes, and how near they are to singularities.

    Attributes
    ----------
    modes
        The signs of each mode's dyads, see `Inverse.labels`.
    inputs
        (m, n, inputs) rad in (-pi, pi], in the order of the mechanism's inputs; NaN
        where the status is neither OK nor AT_SINGULARITY.
    status
        (m, n) values of `Status`: OK, OUT_OF_REACH, or AT_SINGULARITY where a dyad of the
        mode is stretched or folded, or can turn about two axes that coincide.
    margin
        (m, n) rad: by how much the pose is within reach; negative outside. The least over
        the dyads of the arc that is left between the outer axes of a dyad until it is
        stretched or folded.
    limiting
        (m, n) the number of the dyad that the margin belongs to, see `legs` of
        `InverseKinematics`.
    type_1
        (m, n, inputs): how fast the output turns about n_i per unit rate of input i; 0 at
        a type I singularity of that input. At most 1 for an input on the base, where it
        is the sine of the angle between its axis and the plane of the next link.
    normals
        (m, n, inputs, 3) the unit n_i in axes of the link that the output is seen from,
        in the sense in which the input's rate is positive; None if not asked for.
    slope
        (m, n) where a bar gives the output's turn: the derivative of the cosine between
        its axes by that turn. The turn is known to rounding over the slope; where it is
        0, two solutions meet or the output can turn. None without a bar.
    measure
        What computes `type_2`.
    """

    modes: tuple[Signs, ...]
    inputs: Floats
    status: NDArray[np.int8]
    margin: Floats
    limiting: NDArray[np.int8]
    type_1: Floats
    measure: Callable[[], Floats] = field(repr=False)
    normals: Floats | None = None
    slope: Floats | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """The signs of the modes as text, ``+-+``."""
        return tuple(map(label_of, self.modes))

    @cached_property
    def type_2(self) -> Floats:
        """How surely the inputs hold the output (m, n), from 0 at a type II singularity.

        See `spherekit.rates.transmission`. It takes several times as long as all else,
        when it is asked for.
        """
        return self.measure()

    @cached_property
    def jacobian(self) -> Floats:
        """Angular velocity (m, n, 3, inputs) of the output per unit rate of each input.

        In axes of the link that the output is seen from. Of a pointing output the part at
        right angles to its direction. NaN or endless at a type II singularity.

        Raises
        ------
        SolveError
            If the normals were not asked for.
        """
        if self.normals is None:
            raise SolveError("the Jacobian needs the normals: ask with normals=True")
        rows = self.normals / self.type_1[..., None]
        along = None
        if rows.shape[2] == 2:
            along = np.cross(rows[..., 0, :], rows[..., 1, :])
        columns, volume = reciprocal(rows, along)
        return np.swapaxes(columns, -1, -2) / volume[..., None, None]
