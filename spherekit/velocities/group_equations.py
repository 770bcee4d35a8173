"""Velocity equations of a group, solved without a division by the determinant.

Each loop gives three scalar equations: sum of a_v x_v + c = 0 over its variables v, with
their vectors a_v, the unknown rates x_v and a known vector c. The rates times a determinant
D follow by Cramer's rule, without a division by D. They are regular at the dead centres of
every pair and vanish only if the rank of the equations drops. If equations are redundant,
this is the rank of the equations that were chosen as independent.

If two variables occur in one loop only (*private* variables, with the vectors a and b), the
component of the loop's equations along a x b is free of them. With such a pair of variables
in each loop, a group of k loops leads to k equations. A dyad, which has one loop, leads to
one equation. The private rates follow from the other rates. In groups other than dyads,
they are divided by |a x b|^2.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.symbolic.expression_graph import ADVICE_WITHOUT_EXPRESSIONS, Expr, dot
from spherekit.symbolic.vector_algebra import (
    Exprs,
    cofactors,
    constants,
    cross,
    determinant,
    vector_sum,
)
from spherekit.velocities.group_loops import find_group_loops

MAX_DETERMINANT_SIZE = 6
"""Largest number of equations that are solved together by determinants.

Larger: larger groups have expressions, whose length grows exponentially with the size.
"""

GROUND_DIRECTIONS = constants(np.eye(3))
"""Directions (3, 3) of the equations of a loop without private variables."""

MIN_INDEPENDENCE = 1e-6
"""Smallest part of an equation of unit size that no other equations determine.

Smaller parts count as rounding errors. Larger: mechanisms whose equations are nearly
dependent are refused. Smaller: equations that repeat each other can be chosen together.
"""

MIN_DIRECTION_SIZE = MIN_INDEPENDENCE
"""Length of the shortest direction relative to which the size of an equation is judged.

The direction is the normal of two axes, which is short if these are nearly parallel.
"""


class EquationChoice(NamedTuple):
    """Identifies one scalar component of the velocity equation of a loop.

    The velocity equation of a loop is a vector equation: the angular velocities of its
    pairs (joints) add up to zero. The components chosen for all loops are the equations to
    solve.

    A component is taken along a direction that turns with the mechanism. Components that
    are independent in one configuration therefore usually remain independent.

    Attributes
    ----------
    loop_index
        Index of the loop.
    variable
        Index of a variable of the loop. The component is along the vector of this variable:
        the angular velocity of its pair at unit rate. It is None if the loop has two
        private variables, which occur in no other loop. The component is then perpendicular
        to the vectors of both. So it does not contain their rates, and fewer rates are
        solved for together.
    """

    loop_index: int
    variable: int | None


@dataclass(frozen=True)
class LoopVectorEquation:
    """The velocity equation of a loop: sum of a_v x_v + c = 0, which has three components.

    The equation says that the angular velocities of the pairs (joints) around the loop add
    up to zero. x_v are the unknown rates of the variables v.

    Attributes
    ----------
    vectors
        By unknown variable v, its vector a_v (3,): the relative angular velocity of the
        links of its pair at unit rate. If the loop passes the pair from its second link to
        its first, the vector has the opposite sign.
    known_part
        (3,) the vector c, the sum of the known angular velocities of the loop's pairs.
    private
        Two variables that occur in no other loop and can be eliminated, or none.
    """

    vectors: dict[int, Exprs]
    known_part: Exprs
    private: Sequence[int]

    def normal_to_private(self) -> Exprs:
        """Return the direction perpendicular to the vectors of both private variables.

        Private variables are two variables of a loop that are eliminated from its vector
        equation. The component along the returned direction does not contain the private
        variables.
        """
        first, second = self.private
        return cross(self.vectors[first], self.vectors[second])


@dataclass(frozen=True)
class ScalarEquation:
    """One component of the velocity equation of a loop: direction . (sum a_v x_v + c) = 0.

    a_v are the vectors of the variables v, x_v their unknown rates, and c is the known
    part.

    Attributes
    ----------
    direction
        (3,) direction along which the component of the vector equation is taken.
    loop
        The vector equation.
    """

    direction: Exprs
    loop: LoopVectorEquation

    def coefficient(self, variable: int) -> Expr:
        """Return the factor of a variable's rate; 0 for a variable outside of the loop."""
        if variable not in self.loop.vectors:
            return 0.0
        return dot(self.direction, self.loop.vectors[variable])

    def known_term(self) -> Expr:
        """Return the term without unknown rates, direction . c."""
        return dot(self.direction, self.loop.known_part)


class GroupEquations:
    """The solution of the velocity equations of one group of an assembly.

    A group is a set of bodies that are closed together, such as a dyad. The rates of its
    pairs follow from the velocities of earlier groups and of the inputs.

    Attributes
    ----------
    mechanism
        The mechanism.
    pairs
        Indices of the pairs of the group.
    loops
        For each loop the pairs with their senses. A loop leads through pairs of the group
        and through pairs that are closed before.
    private_variables
        For each loop its two variables that are eliminated from its equations, or none.
    unknowns
        The variables whose rates are solved together.
    chosen_equations
        If equations of the group repeat each other, the independent ones. Otherwise None,
        and all equations are used.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        assembly: Assembly,
        group: Group,
        compute_vectors: Callable[[], Floats],
    ) -> None:
        """Choose loops, private variables and, if necessary, equations.

        Parameters
        ----------
        mechanism, assembly, group
            The mechanism, its groups in solving order, and one of these.
        compute_vectors
            Returns the vectors (variables, 3) of all variables at a closed configuration,
            at which independent equations are chosen. Called only if equations repeat each
            other.

        Raises
        ------
        EngineError
            If more than `MAX_DETERMINANT_SIZE` equations have to be solved together, or if
            the equations leave more than one motion.
        """
        self.mechanism = mechanism
        self.pairs = group.pairs
        earlier_groups = assembly.groups[: assembly.groups.index(group)]
        closed_pairs = [
            *assembly.inputs,
            *(pair for earlier_group in earlier_groups for pair in earlier_group.pairs),
        ]
        self.loops = find_group_loops(mechanism, group, closed_pairs)

        loop_counts = Counter(pair for loop in self.loops for pair, _ in loop)
        # For each loop the variables that occur in no other loop.
        exclusive_variables: list[list[int]] = []
        for loop in self.loops:
            variables: list[int] = []
            for pair, _ in reversed(loop):
                if loop_counts[pair] == 1 and pair in self.pairs:
                    variables += self._variables_of(pair)
            exclusive_variables.append(variables)
        group_variables = [v for pair in self.pairs for v in self._variables_of(pair)]
        # From a few equations that repeat each other, independent ones are chosen without
        # an elimination. In all other groups, two variables of each loop are eliminated
        # first.
        is_eliminating = not group.redundant or len(group_variables) > MAX_DETERMINANT_SIZE
        self.private_variables = [
            variables[:2] if is_eliminating and len(variables) > 1 else []
            for variables in exclusive_variables
        ]
        eliminated = {v for variables in self.private_variables for v in variables}
        self.unknowns = [v for v in group_variables if v not in eliminated]
        self.chosen_equations: list[EquationChoice] | None = None
        if group.redundant:
            self.chosen_equations = self._choose_equations(compute_vectors())
        if len(self.unknowns) > MAX_DETERMINANT_SIZE:
            raise EngineError(
                f"{mechanism.name}: a {group.kind} needs {len(self.unknowns)} equations to "
                "be solved together, but expressions can solve at most "
                f"{MAX_DETERMINANT_SIZE}",
                ADVICE_WITHOUT_EXPRESSIONS,
            )

    def _variables_of(self, pair: int) -> tuple[int, ...]:
        """Return the indices of the variables of a pair."""
        return self.mechanism.variables_of(pair)

    def _choose_equations(self, vectors: Floats) -> list[EquationChoice]:
        """Choose independent scalar velocity equations, one for each unknown rate.

        Some equations of a mechanism can follow from others. A QR decomposition with
        pivoting finds independent ones, at one configuration. The rates of the unknowns are
        later computed from the chosen equations only.

        Parameters
        ----------
        vectors
            (variables, 3) a vector for each variable of a pair at this configuration: the
            angular velocity of one link of the pair relative to the other, per unit rate of
            the variable.

        Raises
        ------
        EngineError
            If there are fewer independent equations than unknowns.
        """
        from scipy.linalg import qr

        row_by_equation = self._equation_rows(vectors)
        count = len(self.unknowns)
        equations = list(row_by_equation)
        rows = np.reshape([*row_by_equation.values()], (len(equations), count))
        _, triangle, order = qr(rows.T, mode="economic", pivoting=True)
        pivots = np.abs(np.diagonal(triangle))
        is_undetermined = len(pivots) < count
        if is_undetermined or np.min(pivots[:count], initial=1.0) < MIN_INDEPENDENCE:
            raise EngineError(
                f"{self.mechanism.name}: its velocity equations have more than one "
                "solution in the configuration in which they were chosen; change the range "
                "of the input",
                ADVICE_WITHOUT_EXPRESSIONS,
            )
        return [equations[k] for k in order[:count]]

    def _equation_rows(self, vectors: Floats) -> dict[EquationChoice, Floats]:
        """Return the coefficients of the unknown rates in all scalar velocity equations.

        Callers choose independent equations from these, or test whether the chosen ones are
        still independent. The velocity equation of a loop is a vector equation. Its
        components along several directions are scalar equations. `unknowns` are the
        variables for whose rates the equations are solved.

        Parameters
        ----------
        vectors
            (variables, 3) vectors of all variables at a closed configuration: relative
            angular velocities of the links of their pairs (joints) per unit rate.

        Returns
        -------
        For each equation (a loop and the choice of a direction) its coefficients
        (unknowns,). The coefficients are divided by the norm of the coefficients of all
        variables, so that equations can be compared.
        Equations in which all coefficients are rounding errors are left out.
        """
        row_by_equation: dict[EquationChoice, Floats] = {}
        # A loop lists its pairs, each with the sense 1 or -1 in which it is passed.
        for loop_index, loop in enumerate(self.loops):
            # For each variable the sense of its pair, or 0 if the loop does not pass it.
            senses = np.zeros(len(vectors))
            for pair, sense in loop:
                senses[list(self._variables_of(pair))] += sense
            # The velocity equation of the loop: the sum of these vectors times rates is
            # zero.
            loop_vectors = senses[:, None] * vectors
            # The directions of the components.
            directions = self._equation_directions(loop_index, senses, vectors)
            for equation, direction in directions.items():
                # The coefficients of all variables in this component of the equation.
                row = loop_vectors @ direction
                # The result has only the coefficients of the unknowns.
                if not _is_rounding_error(row, direction):
                    row_size = float(np.linalg.norm(row))
                    row_by_equation[equation] = row[self.unknowns] / row_size
        return row_by_equation

    def _equation_directions(
        self, loop_index: int, senses: Floats, vectors: Floats
    ) -> dict[EquationChoice, Floats]:
        """Return the directions (3,) of the components of a loop's velocity equation.

        The equation is a sum of vectors times rates. Its component along a direction is a
        scalar equation. Independent ones of these scalar equations are chosen later, so
        there may be more directions than the three that can be independent.

        If two variables of the loop occur in no other loop (private variables), there is
        one direction, perpendicular to their vectors. The component along this direction
        does not contain the two rates, which are computed afterwards. If the loop has no
        private variables, the vector of each of its variables is a direction. All
        directions turn with the mechanism. Components that are independent in one
        configuration therefore usually remain independent.

        Parameters
        ----------
        loop_index
            Index of the loop.
        senses
            (variables,) +1 or -1 if the loop passes the pair of a variable, otherwise 0.
        vectors
            (variables, 3) vectors of all variables: relative angular velocities of the
            links of their pairs per unit rate.
        """
        private = self.private_variables[loop_index]
        if private:
            first, second = private
            # The two vectors with the signs that they have in the equation of the loop.
            first_vector = senses[first] * vectors[first]
            second_vector = senses[second] * vectors[second]
            normal = np.cross(first_vector, second_vector)
            # None stands for this direction, which belongs to no single variable.
            return {EquationChoice(loop_index, None): normal}
        return {
            EquationChoice(loop_index, variable): vectors[variable]
            for variable in np.flatnonzero(senses).tolist()
        }

    def has_independent_equations(self, vectors: Floats) -> bool:
        """Return whether the chosen equations determine the rates at a configuration.

        If velocity equations of the group repeat each other, independent ones were chosen
        at another configuration. In other assembly modes (ways to assemble the links) the
        chosen equations can depend on each other.

        Parameters
        ----------
        vectors
            (variables, 3) vectors of all variables at the configuration: relative angular
            velocities of the links of their pairs per unit rate.
        """
        if self.chosen_equations is None:
            return True  # no equations repeat each other, so all are used
        row_by_equation = self._equation_rows(vectors)
        # `_equation_rows` leaves out equations whose coefficients are all zero at this
        # configuration. Such an equation determines nothing.
        if any(equation not in row_by_equation for equation in self.chosen_equations):
            return False
        rows = np.array([row_by_equation[equation] for equation in self.chosen_equations])
        least_singular_value = np.linalg.svd(rows, compute_uv=False)[-1]
        return bool(least_singular_value >= MIN_INDEPENDENCE)

    def solve_rates(
        self, vectors: Sequence[Exprs], known_velocities: Sequence[Exprs]
    ) -> tuple[dict[int, Expr], Expr]:
        """Return the rates of the variables of a group of links, times a determinant.

        The equation of each loop is sum of a_v x_v + c = 0. a_v are the vectors and x_v the
        rates of its unknown variables, and c is a known vector.

        If two variables of a loop occur in no other loop (private variables), they are
        eliminated from its equation. The remaining scalar equations form a square system
        for the rates of the other variables. Cramer's rule gives D x_v with the determinant
        D. Nothing is divided by D, so the result is finite where D is zero. There is one
        exception: in groups other than dyads, the rates of two private variables are not
        finite if their axes coincide.

        Parameters
        ----------
        vectors
            (3,) vector of each variable of the mechanism: the relative angular velocity of
            the links of its pair per unit rate.
        known_velocities
            (3,) for each pair (joint) of the mechanism the part of its relative angular
            velocity that does not depend on the unknown rates.

        Returns
        -------
        rates
            By variable of the group, its rate times the determinant.
        scale
            The determinant D.
        """
        loops = self._loop_equations(vectors, known_velocities)
        equations = self._scalar_equations(vectors, loops)
        # A row for each equation, with the coefficients of the unknown rates.
        matrix = [
            [equation.coefficient(v) for v in self.unknowns] for equation in equations
        ]
        known_terms = [equation.known_term() for equation in equations]
        scale = determinant(matrix)
        matrix_cofactors = cofactors(matrix)
        rates: dict[int, Expr] = {}
        for k, variable in enumerate(self.unknowns):
            # Cramer's rule: the rate times D is the determinant with minus the known terms
            # in the column of the unknown, expanded along this column.
            column = [row[k] for row in matrix_cofactors]
            rates[variable] = -1.0 * dot(known_terms, column)
        # The private variables were eliminated, so they are not among the `unknowns`. Their
        # rates times the determinant follow from the other rates. For a dyad (two links
        # joined by a pair) there are formulas with smaller rounding errors.
        is_dyad = len(loops) == 1 and len(self.unknowns) == 1
        for loop in loops:
            if not loop.private:
                continue
            if is_dyad:
                rates |= _solve_private_rates_of_dyad(loop, self.unknowns[0])
            else:
                rates |= _solve_private_rates(loop, scale, rates)
        return rates, scale

    def _loop_equations(
        self, vectors: Sequence[Exprs], known_velocities: Sequence[Exprs]
    ) -> list[LoopVectorEquation]:
        """Return the velocity equation of each loop: sum of a_v x_v + c = 0.

        The loops are those of a group of links that are placed together. The angular
        velocities of the pairs (joints) around a loop add up to zero. The variables v of
        pairs of this group have unknown rates x_v with the vectors a_v. The vector c is
        known. The caller takes scalar components of these equations, and solves them for
        the rates. If two variables occur in no other loop (private variables), they can be
        eliminated first. So each equation states its private variables.

        Parameters
        ----------
        vectors
            (3,) vector of each variable of the mechanism: the relative angular velocity of
            the links of its pair per unit rate.
        known_velocities
            (3,) for each pair of the mechanism the part of its relative angular velocity
            that does not depend on the unknown rates.
        """
        equations: list[LoopVectorEquation] = []
        for loop, private in zip(self.loops, self.private_variables, strict=True):
            vector_by_variable: dict[int, Exprs] = {}
            # The sense is 1 or -1, the direction in which the loop passes the pair.
            for pair, sense in loop:
                if pair in self.pairs:
                    for v in self._variables_of(pair):
                        vector_by_variable[v] = vectors[v] * float(sense)
            known_part = vector_sum(
                known_velocities[pair] * float(sense) for pair, sense in loop
            )
            equations.append(LoopVectorEquation(vector_by_variable, known_part, private))
        return equations

    def _scalar_equations(
        self, vectors: Sequence[Exprs], loops: Sequence[LoopVectorEquation]
    ) -> list[ScalarEquation]:
        """Return the scalar equations for the unknown rates.

        The vector equation of a loop says that the angular velocities of its pairs add up
        to zero. A loop can have two private variables, which occur in no other loop.

        - If some equations follow from others, the constructor has chosen independent
          components of the vector equations (`chosen_equations`). Only these components are
          returned. Each is along the vector of one variable, or at right angles to the
          vectors of both private variables of its loop.
        - If no equations were chosen, a loop with private variables gives one equation,
          without these two.
        - Any other loop gives three equations, along the ground axes.

        Parameters
        ----------
        vectors
            (3,) vector of each variable of the mechanism: the relative angular velocity of
            the links of its pair at unit rate.
        loops
            The vector equations of all loops.
        """
        equations: list[ScalarEquation] = []
        if self.chosen_equations is not None:
            for loop_index, variable in self.chosen_equations:
                loop = loops[loop_index]
                if variable is None:
                    # At right angles to the vectors of the private variables.
                    direction = loop.normal_to_private()
                else:
                    direction = vectors[variable]
                equations.append(ScalarEquation(direction, loop))
            return equations
        for loop in loops:
            has_private_variables = len(loop.private) > 0
            if has_private_variables:
                equations.append(ScalarEquation(loop.normal_to_private(), loop))
            else:
                equations += [ScalarEquation(axis, loop) for axis in GROUND_DIRECTIONS]
        return equations


def _is_rounding_error(coefficients: Floats, direction: Floats) -> bool:
    """Return whether all coefficients of a scalar velocity equation are rounding errors.

    An equation with such coefficients determines nothing, so the caller leaves it out. The
    coefficients are judged relative to the length of the direction.

    The direction itself can be a rounding error: the cross product of two parallel axes.
    The length of a shorter direction is therefore replaced by `MIN_DIRECTION_SIZE`.

    Parameters
    ----------
    coefficients
        (variables,) factors of the rates. Each is the scalar product of the direction and
        the vector of a variable, the angular velocity of its pair at unit rate.
    direction
        (3,) direction of this component of the loop's vector equation, of any length.
    """
    row_size = float(np.linalg.norm(coefficients))
    direction_size = float(np.linalg.norm(direction))
    smallest_size = MIN_INDEPENDENCE * max(direction_size, MIN_DIRECTION_SIZE)
    # NaN also counts as a rounding error.
    return not row_size > smallest_size


def _solve_private_rates(
    loop: LoopVectorEquation, scale: Expr, rates: Mapping[int, Expr]
) -> dict[int, Expr]:
    """Return the rates of the private variables of a loop, times the determinant D.

    Private variables occur in no other loop, so they were eliminated. The other rates are
    known, times D. Let x and y be D times the two private rates, and a and b their vectors.
    The velocity equation of the loop, times D, is

        x a + y b + s = 0.

    The known vector s is D times `known_part`, plus the sum of a_v (D x_v) over the other
    variables v with the vectors a_v. The component of the loop equation along
    n = a x b was solved before, so s is at right angles to n. The scalar products of the
    equation with n x b and with a x n give

        x = (n x b) . s / |n|^2,   y = (a x n) . s / |n|^2.

    Parameters
    ----------
    loop
        The velocity equation of the loop.
    scale
        The determinant D of the equations for the other rates.
    rates
        Rates times D of the other variables, by variable.

    Returns
    -------
    x and y, each by the index of the variable to which it belongs.
    """
    first, second = loop.private
    a = loop.vectors[first]
    b = loop.vectors[second]
    s = loop.known_part * scale
    for variable, vector in loop.vectors.items():
        if variable not in loop.private:
            s = s + vector * rates[variable]
    n = cross(a, b)
    inverse_square = 1.0 / dot(n, n)
    # With the division first, calls with other vectors s (for other inputs, or for
    # accelerations) share the expressions of the quotients.
    return {
        first: dot(cross(n, b) * inverse_square, s),
        second: dot(cross(a, n) * inverse_square, s),
    }


def _solve_private_rates_of_dyad(loop: LoopVectorEquation, third: int) -> dict[int, Expr]:
    """Return the rates of the private variables of a dyad, times its determinant D.

    A dyad (two links joined by a pair) has one loop with three unknown rates x, y and z:
    x a + y b + z d + c = 0. Here a, b and d are the vectors of the variables, and c is
    known. Private variables occur in no other loop. In a dyad, two of the three variables
    are eliminated as its private ones, here those with the rates x and y. The determinant
    is D = (a x b) . d. By Cramer's rule

        D x = b . (c x d),   D y = -a . (c x d).

    The factor D stays, because a division would fail where D is zero. The formulas do not
    use z, because digits may cancel in the sum z d + c.

    Parameters
    ----------
    loop
        The velocity equation of the loop.
    third
        The variable that is not private, with the vector d.

    Returns
    -------
    D x and D y, each by the index of the variable to which it belongs.
    """
    first, second = loop.private
    a = loop.vectors[first]
    b = loop.vectors[second]
    c_cross_d = cross(loop.known_part, loop.vectors[third])
    return {first: dot(b, c_cross_d), second: -1.0 * dot(a, c_cross_d)}
