"""Conditions that the inputs, or an output, stand still: E x = 0 in the rates x.

At a singularity of type II a motion x of the mechanism exists in which the inputs stand
still. At a singularity of type I the output stands still although inputs move. Either
condition is a set of m linear equations E x = 0 in the rates x (V,) of the pair variables.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import AnalysisError
from spherekit.geometry.triangle import perpendicular
from spherekit.geometry.vectors import cross
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import chosen_output
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.positions.linearisation import Linearisation
from spherekit.singularities.tangent_space import ConfigurationChanges, TangentSpace
from spherekit.wording import nearest


@dataclass(frozen=True)
class InputsLocked:
    """The condition E x = 0 that inputs rest, for rates x of the V pair variables.

    At a singularity of type II the mechanism can move with rates x that satisfy this
    condition.

    Attributes
    ----------
    variables
        Indices of the inputs among the pair variables.
    """

    variables: tuple[int, ...]

    @property
    def equation_count(self) -> int:
        """The number m of equations, which is the number of inputs."""
        return len(self.variables)

    def equations(self, linearisation: Linearisation) -> Floats:
        """Return the matrix E (n, m, V) of the condition at n configurations."""
        input_rows = np.eye(linearisation.values.shape[1])[list(self.variables)]
        return np.tile(input_rows, (len(linearisation), 1, 1))

    def equation_derivatives(self, changes: ConfigurationChanges) -> Floats:
        """Return the derivatives (n, d, m, V) of E along d changes of n configurations.

        E (m, V) is the matrix of the condition E x = 0 that the m inputs rest. x are the
        rates of the V variables.

        The derivatives are zero. E selects the rates of the inputs, so it is the same
        in all configurations.
        """
        n, variables, direction_count = changes.directions.shape
        return np.zeros((n, direction_count, self.equation_count, variables))


@dataclass(frozen=True)
class OutputStationary:
    """The condition E x = 0 that an output link does not turn relative to another link.

    x are the rates of the V variables. If the output is a pointing direction, only this
    direction has to rest, and the link may turn about it.

    Attributes
    ----------
    link, relative_to
        Indices of the output link and of its reference link, as bodies of the loops.
    pointing
        Unit vector in the axes of the output link, or None if the orientation of the link
        is the output.
    variable_senses
        (V,) the sense, +1 or -1, in which a path of pairs from the reference link to the
        output link passes each variable; 0 for variables that are not on the path. By
        default (None) the path follows the spanning tree of the loops.
    """

    link: int
    relative_to: int
    pointing: tuple[float, float, float] | None = None
    variable_senses: tuple[float, ...] | None = None

    @property
    def pole(self) -> Pole:
        """The indices of the two links, the smaller one first."""
        return pole_of(self.link, self.relative_to)

    @property
    def equation_count(self) -> int:
        """The number m of equations: 3 for an orientation, 2 for a direction."""
        return 3 if self.pointing is None else 2

    def equations(self, linearisation: Linearisation) -> Floats:
        """Return E (n, m, V): components of the output's angular velocity per unit rates.

        The output rests if E x = 0 for the rates x of the V variables.

        The m rows of E are components along the directions of `_constrained_directions`.
        """
        directions = self._constrained_directions(linearisation)
        angular_velocities = self._angular_velocities(linearisation)
        return directions @ np.swapaxes(angular_velocities, 1, 2)

    def equation_derivatives(self, changes: ConfigurationChanges) -> Floats:
        """Return the derivatives (n, d, m, V) of E along d changes of the configuration.

        E x = 0 says that the output does not turn about m axes fixed in its link, where x
        (V,) are the rates of the pair variables. E is the product A W^T. The rows of A (m,
        3) are the axes. The rows of W (V, 3) are the angular velocity of the output per
        unit rate of each variable. Both change with the configuration, so dE = dA W^T + A
        dW^T. Callers compute from dE how E x changes near a singularity, where it is zero.

        `changes` has d directions in the space of the variables for each of n
        configurations.
        """
        linearisation = changes.linearisation
        axes = self._constrained_directions(linearisation)
        angular_velocities = self._angular_velocities(linearisation)
        axis_derivatives = self._constrained_direction_derivatives(changes)
        velocity_derivatives = self._angular_velocity_derivatives(changes)
        # The array axes of the products are configuration n, direction d, then matrices. A
        # and W get an axis of length 1 for d.
        from_axes = axis_derivatives @ np.swapaxes(angular_velocities, 1, 2)[:, None]
        from_velocities = axes[:, None] @ np.swapaxes(velocity_derivatives, 2, 3)
        return from_axes + from_velocities

    def _constrained_direction_derivatives(self, changes: ConfigurationChanges) -> Floats:
        """Return the derivatives (n, d, m, 3) of `_constrained_directions` along d changes.

        These m directions, about which the output may not turn, are fixed in the output
        link. If the link rotates by the vector w, a direction a changes by w x a.
        """
        directions = self._constrained_directions(changes.linearisation)
        rotations = self._link_velocity(changes)
        return cross(rotations[:, :, None], directions[:, None])

    def _angular_velocity_derivatives(self, changes: ConfigurationChanges) -> Floats:
        """Return the derivatives (n, d, V, 3) of `_angular_velocities` along d changes."""
        path_senses = self._path_senses(changes.linearisation)
        return path_senses[:, None] * changes.vector_derivatives

    def _link_velocity(self, changes: ConfigurationChanges) -> Floats:
        """Return the rotation (n, d, 3) of the output link along d changes.

        Along each change the variables have certain rates. The rotation is relative to the
        ground: the sum of sense times rate times velocity vector over all variables. The
        velocity vector of a variable is the angular velocity of its pair at unit rate. The
        sense is 1 or -1 on the path from the ground (body 0) to the link, and 0 elsewhere.
        """
        senses_from_ground = changes.linearisation.tree.paths[self.link]
        link_vectors = senses_from_ground[:, None] * changes.linearisation.vectors
        # n configuration, v variable, d direction of change, k component.
        return np.einsum("nvd,nvk->ndk", changes.directions, link_vectors)

    def _path_senses(self, linearisation: Linearisation) -> Floats:
        """Return the sense (V,) in which each variable turns the output.

        The output is the motion of the output link relative to its reference link. The
        sense is +1 or -1 on a path of pairs from the reference link to the output link, and
        0 for variables that are not on the path.
        """
        if self.variable_senses is not None:
            return np.array(self.variable_senses)
        paths = linearisation.tree.paths
        return paths[self.link] - paths[self.relative_to]

    def _angular_velocities(self, linearisation: Linearisation) -> Floats:
        """Return the output's angular velocity (n, V, 3) per unit rate of each variable.

        There is a vector for each of V variables, with components along the axes of body 0
        (the ground).
        """
        return self._path_senses(linearisation)[:, None] * linearisation.vectors

    def _constrained_directions(self, linearisation: Linearisation) -> Floats:
        """Return unit vectors (n, m, 3) about which the output must not turn if it rests.

        The vectors are fixed in the output link, with components in the axes of body 0 (the
        ground). For an orientation, these are the three axes of the link. For a pointing
        direction, these are two directions at right angles to the pointing direction.
        """
        link_directions = np.eye(3)
        if self.pointing is not None:
            pointing = np.array(self.pointing)
            side = perpendicular(pointing)
            link_directions = np.stack([side, cross(pointing, side)], axis=1)
        return np.swapaxes(linearisation.rotations[:, self.link] @ link_directions, 1, 2)

    def orientation(self, linearisation: Linearisation) -> Floats:
        """Return the rotation (n, 3, 3) from the output link's to its reference's axes."""
        placed = linearisation.rotations
        return np.swapaxes(placed[:, self.relative_to], 1, 2) @ placed[:, self.link]

    def angular_velocity(self, space: TangentSpace, rates: Floats) -> Floats:
        """Return the angular velocity of the output link for k sets of rates.

        The angular velocity is relative to the reference link of the output.

        Parameters
        ----------
        space
            n configurations, with the motions that are possible in them.
        rates
            (n, V, k) rates of the V pair variables.

        Returns
        -------
        (n, k, 3) components along the axes of the ground.
        """
        # (n, V, 3) angular velocity of the output link per unit rate of each variable.
        angular_velocities = self._angular_velocities(space.linearisation)
        return np.einsum("nvk,nvd->nkd", rates, angular_velocities)


StationarityConstraint = InputsLocked | OutputStationary
"""Linear equations E x = 0 in the rates x of the variables."""


def output_of(
    mechanism: Mechanism,
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
) -> OutputStationary:
    """Return the condition that an output of a mechanism rests, by default its first one.

    At a singularity of type I the output rests while an input moves.

    Parameters
    ----------
    mechanism
        A mechanism that names outputs.
    output
        Name of an output.
    pointing
        The direction that must rest: the name of an R pair on the output's link, for the
        axis of this pair, or a vector (3,) in the link's axes. If it is not given, the
        number of inputs decides. With two inputs it is the direction that the output
        declares: a direction has two degrees of freedom, as many as there are inputs. With
        another number, or without a declared direction, the orientation of the link must
        rest.

    Raises
    ------
    ModelError
        If there is no such output.
    AnalysisError
        If there is no such direction.
    """
    # The first of several outputs is the default. `chosen_output` would refuse to choose
    # one.
    if output is None and len(mechanism.outputs) > 1:
        declared = mechanism.outputs[0]
    else:
        declared = chosen_output(mechanism, output)
    number = mechanism.link_number
    direction = declared.direction if len(mechanism.inputs) == 2 else None
    if pointing is not None:
        # A direction that is given takes precedence.
        direction = _unit_direction(mechanism, declared.link, pointing)
    return OutputStationary(number[declared.link], number[declared.relative_to], direction)


def _unit_direction(
    mechanism: Mechanism, link: str, pointing: str | Sequence[float]
) -> tuple[float, float, float]:
    """Return a direction as a unit vector in the axes of a link.

    A pointing output is a direction of its link, for example of a camera.

    Parameters
    ----------
    mechanism, link
        The mechanism, and the name of the link.
    pointing
        Name of an R pair (revolute joint) on the link, for the axis of the pair, or a
        vector (3,) of any length.

    Raises
    ------
    AnalysisError
        If `pointing` is neither the name of such a pair nor such a vector.
    """
    if isinstance(pointing, str):
        axes = link_axes(mechanism)[link]
        if pointing not in axes:
            raise AnalysisError(
                f'{mechanism.name}: no R pair "{pointing}" is on link {link}'
                f"{nearest(pointing, axes) or '.'} R pairs: {', '.join(axes)}"
            )
        vector = axes[pointing]
    else:
        try:
            vector = np.asarray(pointing, dtype=float)
        except (TypeError, ValueError):
            # No numbers, or sequences of different lengths: the next lines refuse it.
            vector = np.full(3, np.nan)
        # An array of another shape gets the size NaN, so that the next line refuses it.
        largest = np.max(np.abs(vector)) if vector.shape == (3,) else np.nan
        if not 0.0 < largest < np.inf:
            raise AnalysisError(
                f"{mechanism.name}: pointing: found {pointing!r}, expected a vector of "
                f"three finite numbers, not all zero, in the axes of link {link}"
            )
        # Squares of very large or very small components would overflow or become zero.
        vector = vector / largest
        vector = vector / np.linalg.norm(vector)
    x, y, z = vector.tolist()
    return x, y, z
