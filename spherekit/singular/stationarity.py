"""What stands still in a singular motion: the inputs (type II), or the output (type I)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, final

import numpy as np

from spherekit.conventions import nearest
from spherekit.errors import AnalysisError
from spherekit.model.geometry import link_axes
from spherekit.model.mechanism import Mechanism
from spherekit.model.outputs import chosen_output
from spherekit.motion.linearisation import Linearisation
from spherekit.singular.tangent_space import TangentSpace
from spherekit.sphere.rotation import Floats, cross, perpendicular


class StationarityConstraint(Protocol):
    """Linear equations E x = 0 in the rates x of the variables."""

    @property
    def count(self) -> int:
        """The number m of equations."""

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""


@final
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
        chosen = np.zeros((len(at), self.count, at.values.shape[1]))
        chosen[:, range(self.count), list(self.variables)] = 1.0
        return chosen

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        n, variables = space.at.values.shape
        return np.zeros((n, space.freedoms + 1, self.count, variables))


@final
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
    def pole(self) -> tuple[int, int]:
        """The two links, smaller number first."""
        a, b = sorted((self.link, self.relative_to))
        return a, b

    @property
    def count(self) -> int:
        """The freedoms that the output has: 3 of an orientation, 2 of a direction."""
        return 3 if self.pointing is None else 2

    @property
    def _watched(self) -> Floats:
        """Directions (3, m) in the link along which it may not turn."""
        if self.pointing is None:
            return np.eye(3)
        direction = np.array(self.pointing)
        side = perpendicular(direction)
        return np.stack([side, cross(direction, side)], axis=1)

    def changes(self, space: TangentSpace) -> Floats:
        """Return the derivatives (n, g + 1, m, V) of E along the directions."""
        at = space.at
        watched, turning = self._watched_at(at)
        of_link = at.tree.paths[self.link][:, None] * at.vectors
        w = np.einsum("nvg,nvk->ngk", space.directions, of_link)
        moved = cross(w[:, :, None], watched[:, None])
        turned = self._between(at)[:, None] * space.turned
        change = moved @ np.swapaxes(turning, 1, 2)[:, None]
        return np.asarray(change + watched[:, None] @ np.swapaxes(turned, 2, 3))

    def equations(self, at: Linearisation) -> Floats:
        """Return E (n, m, V)."""
        watched, turning = self._watched_at(at)
        return np.asarray(watched @ np.swapaxes(turning, 1, 2))

    def _between(self, at: Linearisation) -> Floats:
        """Return how variables turn the output: (V,) 1, -1, or 0 for no part in it."""
        if self.way is not None:
            return np.array(self.way)
        return np.asarray(at.tree.paths[self.link] - at.tree.paths[self.relative_to])

    def _watched_at(self, at: Linearisation) -> tuple[Floats, Floats]:
        """Return the watched directions (n, m, 3), and what turns the link (n, V, 3)."""
        watched = np.swapaxes(at.placed[:, self.link] @ self._watched, 1, 2)
        return watched, self._between(at)[:, None] * at.vectors

    def orientation(self, at: Linearisation) -> Floats:
        """Return (n, 3, 3), from the link's axes to those of the reference link."""
        reference = np.swapaxes(at.placed[:, self.relative_to], 1, 2)
        return np.asarray(reference @ at.placed[:, self.link])

    def angular_velocity(self, space: TangentSpace, rates: Floats) -> Floats:
        """Return (n, k, 3) in the axes of body 0, of k rates (n, V, k)."""
        turning = self._between(space.at)[:, None] * space.at.vectors
        return np.asarray(np.einsum("nvk,nvd->nkd", rates, turning))


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
    x, y, z = vector
    return float(x), float(y), float(z)
