"""The rates that close the loops at given configurations, and their derivatives.

J is the closure Jacobian and x are rates of the V pair variables. The loops stay closed if
J x = 0. Where J has full rank, the configurations of a mechanism with g degrees of freedom
are a manifold of g dimensions, and the rates with J x = 0 are its tangent space. They are
regular at singularities of inputs and outputs too, because J does not distinguish inputs
from other variables.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import AnalysisError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly
from spherekit.planning.submechanism import moving_pairs
from spherekit.positions.linear_equations import REDUNDANT_EQUATION_RATIO
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_tree import LoopTree

SMALLEST_NORMAL = float(np.finfo(float).tiny)
"""Smallest normal float64. It replaces a divisor of zero, so that no division fails."""


@dataclass(frozen=True)
class OutputPart:
    """The pairs (joints) of a mechanism that take part in the motion of one output.

    The output is the motion of its link relative to another link, the reference link. A
    motion in which only other pairs move is no singularity of this output.

    Attributes
    ----------
    tree
        The loops that these pairs close, as a tree of links with the reference link as
        root.
    variables
        Variables of these pairs, by their indices in the whole mechanism.
    driven
        The variables among them that are inputs.
    variable_senses
        (V,) a factor for each variable of the whole mechanism. With these factors the
        angular velocities of the pairs add up to the angular velocity of the output. The
        sum runs along the path in the tree from the reference link to the output link. The
        factor is +1 if the path goes from the first to the second link of the pair, -1 in
        the other sense, and 0 for a pair that is not on the path.
    """

    tree: LoopTree
    variables: tuple[int, ...]
    driven: tuple[int, ...]
    variable_senses: tuple[float, ...]


def find_output_part(
    mechanism: Mechanism, assembly: Assembly, link: int, relative_to: int
) -> OutputPart | None:
    """Return the part of a mechanism that moves a link relative to another link.

    Singularities of an output are searched in this part only. Other pairs (joints) do not
    affect the output.

    Parameters
    ----------
    mechanism, assembly
        The mechanism, and the order in which its groups of links are assembled.
    link, relative_to
        Indices of the output link and of its reference link.

    Returns
    -------
    The part, or None if all pairs take part.

    Raises
    ------
    AnalysisError
        If both links are the same.
    """
    if link == relative_to:
        raise AnalysisError(
            f"{mechanism.name}: the output is link {mechanism.links[link]} relative to "
            "itself, which never moves; singularities need two different links"
        )
    pairs = moving_pairs(mechanism, assembly, (link, relative_to))
    if len(pairs) == len(mechanism.pairs):
        return None
    owners = mechanism.variable_owners
    variables = tuple(variable for variable, owner in enumerate(owners) if owner in pairs)
    tree = _make_tree(mechanism, pairs, variables, first_links=(relative_to, link))
    # The reference link is body 0, the root. The output link is body 1. The path to it has
    # a sense +1, -1 or 0 for each variable.
    output_path = tree.paths[1]
    variable_senses = np.zeros(len(owners))
    variable_senses[list(variables)] = output_path
    # An input is an R pair, which has only one variable.
    input_variables = [mechanism.variables_of(pair)[0] for pair in assembly.inputs]
    driven = tuple(variable for variable in input_variables if variable in variables)
    return OutputPart(tree, variables, driven, tuple(variable_senses.tolist()))


def _make_tree(
    mechanism: Mechanism,
    pairs: tuple[int, ...],
    variables: tuple[int, ...],
    first_links: tuple[int, int],
) -> LoopTree:
    """Return the links and loops of a part of a mechanism, given by its pairs (joints).

    The part has all pairs that affect one output, and singularities are searched in it. A
    `LoopTree` numbers its bodies and pairs from 0 without gaps. The links and pairs of the
    mechanism therefore get new indices.

    Parameters
    ----------
    mechanism
        The whole mechanism, with its own indices of links, pairs and variables.
    pairs, variables
        Indices of the pairs, and of the variables of these pairs.
    first_links
        The reference link of the output, which becomes body 0 (the root of the tree), and
        the output link, which becomes body 1.
    """
    links = list(first_links)
    for pair in pairs:
        links += mechanism.ends[pair]
    # Each link once, in this order. Its position is the index of its body.
    distinct_links = list(dict.fromkeys(links))
    body_of_link = {link: body for body, link in enumerate(distinct_links)}
    new_number_of_pair = {pair: number for number, pair in enumerate(pairs)}

    ends: list[tuple[int, int]] = []
    for pair in pairs:
        first_link, second_link = mechanism.ends[pair]
        ends.append((body_of_link[first_link], body_of_link[second_link]))
    owners = mechanism.variable_owners
    return LoopTree(
        count=len(distinct_links),
        ends=tuple(ends),
        pair_of_variable=tuple(
            new_number_of_pair[owners[variable]] for variable in variables
        ),
    )


@dataclass(frozen=True)
class ConfigurationChanges:
    """Directions in which n configurations change, to differentiate functions along them.

    Attributes
    ----------
    linearisation
        The n configurations, with the velocities of the links per unit rate of each
        variable.
    directions
        (n, V, d) for each configuration d directions: changes of the V pair variables.
    """

    linearisation: Linearisation
    directions: Floats

    @cached_property
    def vector_derivatives(self) -> Floats:
        """(n, d, V, 3) derivatives of the velocity vectors along the d directions.

        Along each direction all variables change together. The velocity vector of a
        variable is the relative angular velocity of the two links of its pair when the
        variable changes at unit rate.
        """
        derivatives = [
            self.linearisation.vector_rates(self.linearisation.body_rates(changes))
            for changes in np.moveaxis(self.directions, 2, 0)
        ]
        return np.stack(derivatives, axis=1)


@dataclass(frozen=True)
class TangentSpace:
    """Rates that close the loops, at n configurations of a mechanism with V variables.

    These are the rates x with J x = 0, where J is the Jacobian of the loop closure. The
    loops belong to the whole mechanism or only to an `OutputPart`. The space has k
    dimensions.

    Attributes
    ----------
    linearisation
        Orientations, velocity vectors and closure residual at the configurations.
    tree, variables
        The loops, and the indices of the variables that take part in them.
    basis
        (n, V, k) orthonormal rates that close the loops, zero for other variables. If J
        has as many rows as its rank, the last column has the sense with
        det [J; basis^T] > 0. If a reference basis was given, the basis is aligned to it.
    jacobian_inverse
        (n, variables, 3 loops) pseudo-inverse of J.
    reciprocal_condition
        (n,) the last of the singular values that belong to the rank of J at regular
        configurations, over the greatest one; 1 without loops. At 0 the closure equations
        lose rank. Also 0 if J is not finite.
    has_fixed_sense
        Whether J alone determines the sense of the basis.
    """

    linearisation: Linearisation
    tree: LoopTree
    variables: Indices
    basis: Floats
    jacobian_inverse: Floats
    reciprocal_condition: Floats
    has_fixed_sense: bool

    @property
    def dimension(self) -> int:
        """The number k of independent rates that close the loops."""
        return int(self.basis.shape[2])

    @cached_property
    def closed_changes(self) -> ConfigurationChanges:
        """The changes along the k columns of `basis`, which keep the loops closed."""
        return ConfigurationChanges(self.linearisation, self.basis)

    @cached_property
    def closing_step(self) -> Floats:
        """(n, V) the shortest Newton step that closes loops which are slightly open (rad).

        The step is defined for a whole mechanism only, not for a part.
        """
        residual = self.linearisation.residual
        return -np.einsum("nve,ne->nv", self.jacobian_inverse, residual)

    def rate_corrections(self, changes: ConfigurationChanges) -> Floats:
        """Return how rates must change with the configuration to keep the loops closed.

        The rates x of the pair variables close the loops if J x = 0, with the closure
        Jacobian J. If the configuration changes, J changes by J', and x has to change too.
        The smallest change of x that keeps J x = 0 to first order is -J^+ J' x. J^+ is the
        pseudo-inverse of J. Callers multiply the returned matrices by rates x to get the
        change of x.

        Parameters
        ----------
        changes
            d directions in which the n configurations change.

        Returns
        -------
        (n, d, V, V) the matrices -J^+ J', for all V variables of the mechanism. The rows
        and columns of variables outside of the loops are zero.
        """
        n, direction_count, variable_count, _ = changes.vector_derivatives.shape
        corrections = np.zeros((n, direction_count, variable_count, variable_count))
        rows, columns = np.ix_(self.variables, self.variables)
        corrections[:, :, rows, columns] = -self.jacobian_inverse[
            :, None
        ] @ self._jacobian_derivatives(changes)
        return corrections

    def _jacobian_derivatives(self, changes: ConfigurationChanges) -> Floats:
        """Return the derivatives of the closure Jacobian J along d directions of change.

        J x = 0 says that rates x of the pair variables keep the loops closed. J is a linear
        function of the velocity vector of each variable, the angular velocity per unit
        rate. So the same function of the derivatives of these vectors is the derivative of
        J.

        Parameters
        ----------
        changes
            d directions in which the n configurations change.

        Returns
        -------
        (n, d, 3 loops, variables) derivatives, for the variables in the loops.
        """
        vector_derivatives = changes.vector_derivatives[:, :, self.variables]
        n, direction_count, variable_count, _ = vector_derivatives.shape
        # `jacobian` expects one axis of samples, so configurations and directions share one
        # axis.
        derivatives = self.tree.jacobian(vector_derivatives.reshape(-1, variable_count, 3))
        _, equation_count, _ = derivatives.shape
        return derivatives.reshape(n, direction_count, equation_count, variable_count)

    def to_rates(self, coordinates: Floats) -> Floats:
        """Return the rates (n, V) that have the given coordinates (n, k) in the basis."""
        return np.einsum("nvk,nk->nv", self.basis, coordinates)


@dataclass(frozen=True)
class SingularValueDecomposition:
    """Full singular value decompositions M = left diag(values) right of n matrices (j, k).

    Attributes
    ----------
    left
        (n, j, j) orthogonal matrices with the left singular vectors in columns.
    values
        (n, min(j, k)) singular values in descending order.
    right
        (n, k, k) orthogonal matrices with the right singular vectors in rows.
    is_finite
        (n,) whether all numbers of the matrix are finite. A matrix with NaN or infinity was
        replaced by zero, because LAPACK fails otherwise.
    """

    left: Floats
    values: Floats
    right: Floats
    is_finite: Bools


def decompose(matrices: Floats) -> SingularValueDecomposition:
    """Return the singular value decompositions of matrices (n, j, k)."""
    is_finite = all_finite(matrices, (1, 2))
    left, values, right = np.linalg.svd(np.where(is_finite[:, None, None], matrices, 0.0))
    return SingularValueDecomposition(left, values, right, is_finite)


def tangent_space(
    linearisation: Linearisation,
    dimension: int,
    reference_basis: Floats | None = None,
    part: OutputPart | None = None,
) -> TangentSpace:
    """Return the rates that close the loops at configurations.

    They are the rates x of the V variables with J x = 0, where J is the Jacobian of the
    loop closure: the null space of J, from its singular value decomposition.

    Parameters
    ----------
    linearisation
        The n configurations. Where J is not finite, `basis` and `jacobian_inverse` are NaN.
    dimension
        Number k of independent rates that close the loops, as known from the mobility.
    reference_basis
        (n, V, k) the basis is rotated within the tangent space to be as near as possible
        to this one, so that bases of neighbouring configurations are comparable.
    part
        If it is given, only the loops of this part of the mechanism are closed, and all
        other variables rest.
    """
    variable_count = linearisation.values.shape[1]
    if part is None:
        tree = linearisation.tree
        variables = np.arange(variable_count, dtype=np.intp)
    else:
        tree = part.tree
        variables = np.array(part.variables, dtype=np.intp)
    jacobian = tree.jacobian(linearisation.vectors[:, variables])
    n, rows, columns = jacobian.shape
    rank = columns - dimension
    svd = decompose(jacobian)
    # The last right singular vectors are the null space of J. Their senses are arbitrary.
    part_basis = np.swapaxes(svd.right[:, rank:], 1, 2).copy()
    if reference_basis is not None:
        # Orthogonal Procrustes problem: the rotation of the basis nearest to the reference.
        overlap = np.swapaxes(part_basis, 1, 2) @ reference_basis[:, variables]
        overlap_left, _, overlap_right = np.linalg.svd(overlap)
        part_basis = part_basis @ (overlap_left @ overlap_right)
    elif rows == rank and dimension:
        # The sign of the determinant of [J; basis^T]. Its other factors are positive
        # singular values.
        sense = np.linalg.det(svd.left) * np.linalg.det(svd.right)
        part_basis[:, :, -1] *= np.where(sense < 0.0, -1.0, 1.0)[:, None]

    # Equations that repeat others up to rounding are left out of the pseudo-inverse.
    threshold = np.maximum(REDUNDANT_EQUATION_RATIO * svd.values[:, :1], SMALLEST_NORMAL)
    divisors = np.where(svd.values[:, :rank] > threshold, svd.values[:, :rank], np.inf)
    scaled = np.swapaxes(svd.right[:, :rank], 1, 2) / divisors[:, None]
    inverse = scaled @ np.swapaxes(svd.left[:, :, :rank], 1, 2)
    part_basis[~svd.is_finite] = np.nan
    inverse[~svd.is_finite] = np.nan

    # Variables outside of the part do not move.
    basis = np.zeros((n, variable_count, dimension))
    basis[:, variables] = part_basis
    reciprocal_condition = np.ones(n)
    if rank:
        reciprocal_condition = svd.values[:, rank - 1] / np.maximum(
            svd.values[:, 0], SMALLEST_NORMAL
        )
    return TangentSpace(
        linearisation=linearisation,
        tree=tree,
        variables=variables,
        basis=basis,
        jacobian_inverse=inverse,
        reciprocal_condition=reciprocal_condition,
        has_fixed_sense=rows == rank and reference_basis is None,
    )
