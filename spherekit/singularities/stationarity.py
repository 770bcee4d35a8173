"""The motions that close the loops, and what stands still in singular ones.

Where the closure Jacobian J has full rank, the configurations of a mechanism with g
freedoms are a manifold of g dimensions, and the rates that close the loops, J x = 0, are
its tangent space. Both are regular where inputs or the output are singular: where the
inputs stand still (type II) in a motion, or the output (type I).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import AnalysisError
from spherekit.geometry.triangle import perpendicular
from spherekit.geometry.vectors import cross
from spherekit.mechanism.mechanism import Mechanism, chosen_output
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.positions.linearisation import Linearisation
from spherekit.singularities.tangent_space import TangentSpace
from spherekit.wording import nearest


@dataclass(frozen=True)
class InputsLocked:
    """The inputs' variables stand still."""

    variables: tuple[int, ...]

    @property
    def count(self) -> int:
        """The number of inputs."""
        return len(self.variables)

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""
        chosen = np.eye(at.values.shape[1])[list(self.variables)]
        return np.tile(chosen, (len(at), 1, 1))

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        n, variables, many = space.directions.shape
        return np.zeros((n, many, self.count, variables))


@dataclass(frozen=True)
class OutputStationary:
    """A link does not turn, or a direction in it does not move, relative to another link.

    `link`, `relative_to` are numbers of bodies of the loops. `pointing` is a unit vector
    in the link's axes, or None where its whole orientation is the output. `way` (V,) is
    the sense in which each variable turns the link, along any way of pairs to it: by
    default along the tree of the loops.
    """

    link: int
    relative_to: int
    pointing: tuple[float, float, float] | None = None
    way: tuple[float, ...] | None = None

    @property
    def pole(self) -> Pole:
        """The two links, smaller number first."""
        return pole_of(self.link, self.relative_to)

    @property
    def count(self) -> int:
        """The freedoms that the output has: 3 of an orientation, 2 of a direction."""
        return 3 if self.pointing is None else 2

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        at = space.at
        watched, turning = self._watched_at(at)
        of_link = at.tree.paths[self.link][:, None] * at.vectors
        w = np.einsum("nvg,nvk->ngk", space.directions, of_link)
        moved = cross(w[:, :, None], watched[:, None])
        turned = self._between(at)[:, None] * space.turned
        change = moved @ np.swapaxes(turning, 1, 2)[:, None]
        return change + watched[:, None] @ np.swapaxes(turned, 2, 3)

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""
        watched, turning = self._watched_at(at)
        return watched @ np.swapaxes(turning, 1, 2)

    def _between(self, at: Linearisation) -> Floats:
        """Return how variables turn the output: (V,) 1, -1, or 0 for no part in it."""
        if self.way is not None:
            return np.array(self.way)
        return at.tree.paths[self.link] - at.tree.paths[self.relative_to]

    def _watched_at(self, at: Linearisation) -> tuple[Floats, Floats]:
        """Return directions (n, m, 3) about which the link may not turn, and what turns it.

        The latter (n, V, 3), the former all axes, or those across the direction.
        """
        axes = np.eye(3)
        if self.pointing is not None:
            direction = np.array(self.pointing)
            side = perpendicular(direction)
            axes = np.stack([side, cross(direction, side)], axis=1)
        watched = np.swapaxes(at.placed[:, self.link] @ axes, 1, 2)
        return watched, self._between(at)[:, None] * at.vectors

    def orientation(self, at: Linearisation) -> Floats:
        """Return (n, 3, 3), from the link's axes to those of the reference link."""
        return np.swapaxes(at.placed[:, self.relative_to], 1, 2) @ at.placed[:, self.link]

    def angular_velocity(self, space: TangentSpace, rates: Floats) -> Floats:
        """Return (n, k, 3) in the axes of body 0, of k rates (n, V, k)."""
        turning = self._between(space.at)[:, None] * space.at.vectors
        return np.einsum("nvk,nvd->nkd", rates, turning)


StationarityConstraint = InputsLocked | OutputStationary
"""Linear equations E x = 0 in the rates x of the variables."""


def output_of(
    mechanism: Mechanism,
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
) -> OutputStationary:
    """Return an output of a mechanism, by default its first one.

    Parameters
    ----------
    mechanism
        A mechanism that names outputs.
    output
        Name of an output.
    pointing
        Name of an R pair on the output's link, whose axis is the direction that counts,
        or a vector (3,) in that link's axes. By default, with two inputs, the direction
        that the output declares; else the link's orientation counts.

    Raises
    ------
    ModelError
        If there is no such output.
    AnalysisError
        If there is no such direction.
    """
    several = output is None and len(mechanism.outputs) > 1
    chosen = mechanism.outputs[0] if several else chosen_output(mechanism, output)
    number = mechanism.link_number
    direction = chosen.direction if len(mechanism.inputs) == 2 else None
    if pointing is not None:
        direction = _direction(mechanism, chosen.link, pointing)
    return OutputStationary(number[chosen.link], number[chosen.relative_to], direction)


def _direction(
    mechanism: Mechanism, link: str, pointing: str | Sequence[float]
) -> tuple[float, float, float]:
    if isinstance(pointing, str):
        axes = link_axes(mechanism)[link]
        if pointing not in axes:
            raise AnalysisError(
                f'{mechanism.name}: no R pair "{pointing}" is on link {link}'
                f"{nearest(pointing, axes) or ';'} R pairs: {', '.join(axes)}"
            )
        vector = axes[pointing]
    else:
        vector = np.asarray(pointing, dtype=float)
        size = np.linalg.norm(vector) if vector.shape == (3,) else np.nan
        if not 0.0 < size < np.inf:
            raise AnalysisError(
                f"{mechanism.name}: a pointing direction is a vector of three numbers, not "
                f"all zero, in the axes of link {link}; {pointing!r} is none"
            )
        vector = vector / size
    x, y, z = vector.tolist()
    return x, y, z
