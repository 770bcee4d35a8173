"""The transmission measure: how firmly locked inputs hold an output.

Suppose that the pairs have play: the angular velocities of the two links of pair e differ
by an allowed rate and by an additional misfit m_e. With locked inputs, the output can
only move with some misfits. The measure compares the smallest such misfits with the
smallest ones if all pairs are locked:

    transmission^2 = rho min (sum of |m_e|^2)   over all rates that turn the output by 1.

The number rho belongs to an electric network in which each link is a node and each pair is
a resistance of 1. It is the resistance between the output link and its reference link.

- The transmission is 0 exactly at singularities of type II: the output can move while the
  inputs rest, because its Jacobian is singular or because loops lose their rank.
- It is 1 if every pair is locked. 1 / transmission is the factor by which play moves the
  output more than in this case.
- It does not depend on the choice of loops, ground, frame, or units of the variables.

It is computed as follows. Misfits that go around no loop only move the output. All other
misfits are J x, where x are the rates of the passive pairs, and J are the loop equations on
an orthonormal basis of the cycles of the graph. If A x is the part of x on the path to the
output, then

    transmission^-2 = 1 + |A J^+|^2 / rho.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import LoopTree

MAX_INVERSE_ENTRY = 1e10
"""Largest entry of the inverse of the loop equations that is trusted.

If an entry is larger, a motion of the passive pairs is opposed by rounding alone, and
singular values decide whether it moves the output. Larger: rounding errors are taken for
equations. Smaller: the slower computation by singular values is used more often.
"""

MIN_OUTPUT_MOTION = 1e-8
"""Smallest motion of the output, relative to the motion of the passive pairs.

A smaller motion counts as rest. Larger: outputs that a self-motion of other links moves
a little count as held. Smaller: rounding errors count as motions.
"""

TRANSMISSION_BATCH_ROWS = 4096
"""Number of rows that are computed at once. Larger: fewer calls, more memory."""


@dataclass(frozen=True)
class Transmission:
    """The transmission measure of one output of a mechanism.

    The measure says, from 0 to 1, how well locked inputs fix the output if the pairs have
    play.

    Attributes
    ----------
    tree
        The loops of the mechanism.
    driven
        Indices of the variables that the inputs lock.
    link
        Index of the output link.
    relative_to
        Index of the reference link, from which the output is seen.
    direction
        (3,) the direction in which the output points, in the axes of its link. A rotation
        about it does not count as motion of the output. None for the whole orientation.
    """

    tree: LoopTree
    driven: tuple[int, ...]
    link: int
    relative_to: int
    direction: tuple[float, float, float] | None = None

    @staticmethod
    def from_mechanism(mechanism: Mechanism, output: Output) -> "Transmission":
        """Return the measure of how well the locked inputs of a mechanism hold an output.

        If there are two inputs and the output declares a direction, only changes of this
        direction count, because two inputs cannot control the whole orientation.
        """
        driven = [mechanism.variables_of(pair)[0] for pair in driven_pairs(mechanism)]
        return Transmission(
            tree=LoopTree.of_mechanism(mechanism),
            driven=tuple(driven),
            link=mechanism.link_number[output.link],
            relative_to=mechanism.link_number[output.relative_to],
            direction=output.direction if len(driven) == 2 else None,
        )

    def measure_configurations(self, closure: Closure, values: Floats) -> Floats:
        """Return the transmission measure (n,) of n configurations, from 0 to 1.

        At 0 the output can move although the inputs are locked. The measure is NaN if a
        configuration is NaN.

        Parameters
        ----------
        closure
            The loops of the mechanism.
        values
            (n, variables) closed configurations (rad).
        """
        linearisation = closure.linearise(values)
        directions = self.output_directions(linearisation.rotations)
        return self.measure(linearisation.vectors, directions)

    def output_directions(self, rotations: Floats) -> Floats | None:
        """Return the pointing direction (n, 3) of the output; None for a whole orientation.

        Parameters
        ----------
        rotations
            (n, links, 3, 3) rotations from link axes to a common frame.
        """
        if self.direction is None:
            return None
        return rotations[:, self.link] @ np.array(self.direction)

    @np.errstate(over="ignore")
    def measure(self, vectors: Floats, directions: Floats | None = None) -> Floats:
        """Return the transmission (n,), from 0 at a singularity of type II to 1.

        At a singularity of type II the output can move although the inputs are locked. The
        measure assumes that the pairs (joints) have play. Passive pairs are those that no
        input locks. With play, they can move at any rates x, and the output then moves by
        A x. Without play, the relative velocities of the pairs add up to 0 around each
        loop. Here their sums are the opening rates J x, with the loop equations J. The play
        takes them up. So play moves the output by up to |A J^+| times its size.

        Play whose sum around every loop is 0 opens no loop. It moves the output by up to
        sqrt(rho) times its size, even if all pairs are locked. The transmission is the
        largest motion of the output if all pairs are locked, divided by the largest motion
        if only the inputs are locked, by play of the same size:

            transmission = sqrt(rho / (rho + |A J^+|^2)) = 1 / sqrt(1 + |A J^+|^2 / rho).

        The number rho belongs to an electric network with links as nodes and pairs as
        resistances of 1. It is the resistance between the output link and its reference
        link, which is the sum of the squares of the `_path_currents`. The transmission is
        NaN in rows in which an argument is not finite.

        Parameters
        ----------
        vectors
            (n, variables, 3) vectors of the variables in a common frame: the angular
            velocity of the second link of a pair relative to the first, per unit rate of
            the variable. Their lengths do not matter, because they are scaled to 1.
        directions
            (n, 3) unit vectors of an output that is a direction, in the same frame.
        """
        transmission = nans(len(vectors))
        is_finite = all_finite(vectors, (1, 2))
        if directions is not None:
            is_finite &= all_finite(directions, 1)
        all_rows = np.flatnonzero(is_finite)
        passive_pairs = [
            self.tree.pair_of_variable[v] for v in passive_variables(self.tree, self.driven)
        ]
        currents = self._path_currents
        for start in range(0, len(all_rows), TRANSMISSION_BATCH_ROWS):
            rows = all_rows[start : start + TRANSMISSION_BATCH_ROWS]
            equations = passive_equations(self.tree, self.driven, vectors[rows])
            # Rows of zeros make J square if there are fewer equations than unknowns.
            missing = max(0, len(passive_pairs) - equations.matrix.shape[1])
            loops = np.pad(equations.matrix, ((0, 0), (0, missing), (0, 0)))
            # A: the motion of the output per unit rate of each passive variable.
            output_motion = currents[passive_pairs] * equations.unit_vectors
            # A rotation about the direction of the output does not count.
            if directions is not None:
                axes = directions[rows][:, :, None]
                output_motion -= axes * np.sum(axes * output_motion, axis=1, keepdims=True)
            # A J^+ is the motion of the output per unit opening rate of the loops. If J is
            # nearly singular, its inverse is determined by rounding errors. Rows with such
            # a J are computed by singular values instead.
            inverse = left_inverse(loops)
            motion_per_opening = output_motion @ inverse
            # The condition is negated, so that NaN counts as too large.
            is_weak = ~(max_abs(inverse, (1, 2)) < MAX_INVERSE_ENTRY)
            motion_per_opening[is_weak] = _output_motion_per_opening(
                output_motion[is_weak], loops[is_weak]
            )
            size = np.linalg.norm(motion_per_opening, 2, axis=(1, 2))
            transmission[rows] = 1.0 / np.sqrt(1.0 + size**2 / (currents @ currents))
        return transmission

    @cached_property
    def _path_currents(self) -> Floats:
        """(pairs,) the currents in all pairs of an electric network like the mechanism.

        Links are nodes, and pairs are unit resistances. The current 1 enters at the link
        from which the output is seen, and leaves at the output link. The sum of the squares
        of the currents is the resistance rho between the two links.
        """
        potentials = np.linalg.pinv(self.tree.incidence.T, rcond=1e-9)
        return potentials[:, self.link] - potentials[:, self.relative_to]


def passive_variables(tree: LoopTree, driven: Sequence[int]) -> list[int]:
    """Return the indices of the variables that no input locks."""
    return [v for v in range(len(tree.pair_of_variable)) if v not in driven]


@dataclass(frozen=True)
class PassiveEquations:
    """The loop equations J x = 0 of the passive pairs, scaled for measures of singularity.

    Passive pairs (joints) are those that no input locks. The singular values of J show how
    firmly the locked inputs hold the links: at 0, some links can move. The equations are
    scaled such that the singular values are between 0 and 1. They do not depend on the
    units of the variables or on the choice of the loops.

    The unknowns x are scaled as follows. A pair allows relative angular velocities along a
    line, or in a plane if it has two variables. One unit vector spans the line, and two
    unit vectors at right angles span the plane. x are the rates along all unit vectors.

    The equation of a loop says that the angular velocities of its pairs add up to zero. In
    this sum, a pair has the coefficient 1 or -1 if the loop passes it, otherwise 0. So each
    loop has a row of coefficients of all pairs. These rows are replaced by linear
    combinations of them that are orthonormal, and each new row gives an equation.

    Attributes
    ----------
    unit_vectors
        (n, 3, passive) the unit vectors, one for each passive variable.
    matrix
        (n, 3 loops, passive) the matrix J. Its rows are the three components of the first
        equation, then the three components of the second, and so on. If J x is not 0, loops
        open.
    """

    unit_vectors: Floats
    matrix: Floats


def passive_equations(
    tree: LoopTree, driven: Sequence[int], vectors: Floats
) -> PassiveEquations:
    """Return the velocity equations of loops for the variables that no input locks.

    The equations show whether, and how easily, links move although the inputs are locked.
    In the vector equation of a loop, each variable has its vector times a coefficient. The
    coefficient is 1 or -1 if the loop passes the pair (joint) of the variable, otherwise 0.
    Two changes make the singular values of the equations independent of the units of the
    variables and of the choice of the loops:

    - The one or two vectors of each pair are replaced by one or two orthonormal vectors
      with the same span.
    - The equations of the loops are replaced by as many linear combinations of them. Row i
      of `tree.cycles` (loops, pairs) has the coefficient of each pair in combination i. The
      rows are orthonormal. They are computed from the graph of links and pairs, so it does
      not matter which loops describe this graph.

    Parameters
    ----------
    tree, driven
        The loops, and the variables that inputs lock.
    vectors
        (n, variables, 3) vectors of the variables in one frame: the relative angular
        velocity of the links of a pair per unit rate of the variable.
    """
    passive = passive_variables(tree, driven)
    orthonormal_vectors = _orthonormal_vectors(tree, vectors)[:, passive]
    unit_vectors = np.swapaxes(orthonormal_vectors, 1, 2)  # (n, 3, passive)
    # (loops, passive) coefficient of each variable in each linear combination: that of its
    # pair.
    pair_of_each = [tree.pair_of_variable[v] for v in passive]
    coefficients = tree.cycles[:, pair_of_each]
    equations = np.zeros((len(vectors), len(coefficients), 3, len(passive)))
    for loop, loop_coefficients in enumerate(coefficients):
        equations[:, loop] = loop_coefficients * unit_vectors
    return PassiveEquations(
        unit_vectors=unit_vectors,
        matrix=equations.reshape(len(vectors), 3 * len(coefficients), len(passive)),
    )


def input_authority(tree: LoopTree, driven: Sequence[int], vectors: Floats) -> Floats:
    """Return how firmly locked inputs prevent any motion of the links.

    The variables that no input locks are called passive. If a singular value of the loop
    equations of the passive variables is 0, the links can move although the inputs are
    locked.

    Parameters
    ----------
    tree, driven
        The loops, and the variables that inputs lock.
    vectors
        (n, variables, 3) vectors of the variables: the relative angular velocity of the
        links of a pair (joint) per unit rate of the variable.

    Returns
    -------
    (2, n) the smallest singular value of the `passive_equations`, and its ratio to the
    largest one. Both are 0 if a link can move while the inputs rest, 1 without passive
    pairs, and NaN if the vectors are NaN.
    """
    authority = nans((2, len(vectors)))
    is_finite = all_finite(vectors, (1, 2))
    loops = passive_equations(tree, driven, vectors[is_finite]).matrix
    equation_count, passive_count = loops.shape[1:]
    if not passive_count:
        authority[:, is_finite] = 1.0
    # With fewer equations than variables, some motion is always possible.
    elif equation_count < passive_count:
        authority[:, is_finite] = 0.0
    else:
        sizes = np.linalg.svd(loops, compute_uv=False)
        authority[0, is_finite] = sizes[:, -1]
        authority[1, is_finite] = sizes[:, -1] / sizes[:, 0]
    return authority


def _orthonormal_vectors(tree: LoopTree, vectors: Floats) -> Floats:
    """Return orthonormal vectors (n, variables, 3) for the variables of each pair (joint).

    `vectors` (n, variables, 3) are the relative angular velocities of the links of a pair
    per unit rate of each of its variables. An R pair has one variable, a contact one or
    two. The results span the same velocities for each pair, but do not depend on the units
    of the variables. Zero vectors stay zero.

    If both vectors of a contact are parallel, the second result is zero, or has an
    arbitrary direction due to rounding.
    """
    lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
    units = vectors / np.where(lengths > 0.0, lengths, 1.0)
    for v, owner in enumerate(tree.pair_of_variable):
        if v and tree.pair_of_variable[v - 1] == owner:
            # The second vector of a contact loses its component along the first
            # (Gram-Schmidt). `second` is a view, so `units` changes in place.
            first = units[:, v - 1]
            second = units[:, v]
            second -= first * np.sum(first * second, axis=1, keepdims=True)
            length = np.linalg.norm(second, axis=1, keepdims=True)
            second /= np.where(length > 0.0, length, 1.0)
    return units


def _output_motion_per_opening(output_motion: Floats, loop_equations: Floats) -> Floats:
    """Return how much the output moves per unit opening of the loops, near a singularity.

    The caller computes the transmission measure from the result. The passive pairs (joints
    that no input locks) have play and move at the rates x. The output then moves by A x.
    The relative velocities around the loops need not add up to 0. Their sums J x are called
    the opening rates of the loops. The result is A J^+ with the pseudo-inverse J^+.

    The singular value decomposition J = U diag(s) V^T gives

        A J^+ = (A V) diag(1 / s) U^T.

    A column of V is a motion of the passive pairs, in which the loops open at the rate s.
    Near a singularity, an s can be only a rounding error. If the output rests in the motion
    of this s, 1 / s is replaced by 0, because the motion does not matter.

    Parameters
    ----------
    output_motion
        (n, 3, passive) the matrix A: angular velocity of the output per unit rate of each
        passive variable.
    loop_equations
        (n, equations, passive) the matrix J: opening rates of the loops per unit rate of
        each passive variable.

    Returns
    -------
    (n, 3, equations) angular velocity of the output per unit opening rate.
    """
    u, openings, v_transposed = np.linalg.svd(loop_equations, full_matrices=False)
    # (n, 3, motions) angular velocity of the output in each motion of the passive pairs.
    output_in_motions = output_motion @ np.swapaxes(v_transposed, 1, 2)
    output_speeds = np.linalg.norm(output_in_motions, axis=1)
    inverse_openings = _invert_openings(openings, output_speeds)
    output_per_opening = output_in_motions * inverse_openings[:, None]
    return output_per_opening @ np.swapaxes(u, 1, 2)


def _invert_openings(openings: Floats, output_speeds: Floats) -> Floats:
    """Return 1 / opening for each motion of the passive pairs, but 0 for harmless motions.

    Passive pairs (joints) are those that no input locks. A motion here is any set of rates
    of these pairs. Most motions open the loops: the relative velocities around a loop do
    not add up to 0. The caller needs the reciprocals because the motion of the output,
    divided by the opening rate, says how much the output moves per unit opening.

    If a motion opens no loop, the links can really move although the inputs are locked. If
    the output moves in this motion, 1 / opening is practically infinite, which shows that
    nothing prevents the motion. If the output rests, the motion is harmless for this
    output, and the result is 0.

    Parameters
    ----------
    openings
        (n, motions) rates at which the loops open in the motions. They are the singular
        values of the loop equations, and the motions are the right singular vectors.
    output_speeds
        (n, motions) angular speed of the output in each motion.

    Returns
    -------
    (n, motions) reciprocals.
    """
    # An opening below this limit is a rounding error.
    opens_no_loop = openings < 1.0 / MAX_INVERSE_ENTRY
    output_rests = output_speeds < MIN_OUTPUT_MOTION
    # The limit 1e-300 prevents a division by zero.
    inverse_openings = 1.0 / np.maximum(openings, 1e-300)
    return np.where(opens_no_loop & output_rests, 0.0, inverse_openings)
