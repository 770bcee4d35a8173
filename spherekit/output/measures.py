"""How inputs move with an output, and the measures of type I that follow."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.sphere.rotation import Floats, cross


@final
@dataclass(frozen=True)
class InputRates:
    """Rates of the inputs, linear in the output's angular velocity w: top . w / bottom.

    `tops` (n, inputs, 3) and `bottoms` (n, inputs) or (n, 1); both stay finite at a
    singular configuration.
    """

    tops: Floats
    bottoms: Floats

    @staticmethod
    def of_turns(turns: Floats, directions: Floats | None) -> "InputRates":
        """Return what follows from the output's velocities (n, 3, inputs) per input rate.

        Those of three inputs; or those of two with `directions` (n, 3), of which the part
        at right angles to these counts.
        """
        across, volume = reciprocal(np.swapaxes(turns, 1, 2), directions)
        return InputRates(across, volume[:, None])

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates per unit angular velocity of the output."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.tops / self.bottoms[..., None]

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `spherekit.output.inverse.Inverse`."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.abs(self.bottoms) / np.linalg.norm(self.tops, axis=2))


def reciprocal(vectors: Floats, along: Floats | None) -> tuple[Floats, Floats]:
    """Return the vectors reciprocal to others times their volume, and that volume.

    Of three vectors (..., 3, 3), in rows; or of two (..., 2, 3) and what stands beside
    them, `along` (..., 3), of which only the first two are returned.
    """
    a, b = vectors[..., 0, :], vectors[..., 1, :]
    third = vectors[..., 2, :] if along is None else along
    every = [cross(b, third), cross(third, a)]
    if along is None:
        every.append(cross(a, b))
    return np.stack(every, axis=-2), np.sum(a * every[0], axis=-1)
