"""Velocity equations of a group, solved without a division by the determinant.

Each loop gives three scalar equations: sum of a_v x_v + c = 0 over its variables v, with
their vectors a_v, the unknown rates x_v and a known vector c. The rates times a determinant
D are polynomials in the vectors (Cramer's rule). They are regular at the dead centres of
every pair and vanish only if the rank of the equations drops.

If two variables occur in one loop only (*private* variables, with the vectors a and b), the
component of the loop's equations along a x b is free of them. With such a pair of variables
in each loop, a group of k loops leads to k equations. A dyad, which has one loop, leads to
one equation. The private rates follow from the other rates.
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

Larger: larger groups have expressions, whose length grows with the factorial of the size.
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
    """Says which component of the vector equation of a loop is one of the equations solved.

    Attributes
    ----------
    loop_index
        Index of the loop.
    variable
        Number of the variable of the loop along whose vector the component is taken. None
        if it is perpendicular to the vectors of the two private variables of the loop,
        which occur in no other loop. The equation then does not contain them.
    """

    loop_index: int
    variable: int | None


@dataclass(frozen=True)
class LoopEquation:
    """One scalar velocity equation of a loop: direction . (sum of a_v x_v + c) = 0.

    The angular velocities of the pairs of a loop add up to zero. x_v are the unknown rates
    of the variables v.

    Attributes
    ----------
    direction
        (3,) direction along which the component of the vector equation is taken.
    vectors
        (3,) vector a_v of each unknown variable v: the relative angular velocity of the
        links of its pair at unit rate. It has the sign +1 if the loop passes the pair from
        its first link to its second, and -1 in the opposite sense.
    known_part
        (3,) the vector c, the sum over all pairs with known rates.
    """

    direction: Exprs
    vectors: dict[int, Exprs]
    known_part: Exprs


class GroupEquations:
    """The solution of the velocity equations of one group of an assembly.

    A group is a set of bodies that are closed together, such as a dyad. The rates of its
    pairs follow from the velocities of earlier groups and of the inputs.

    Attributes
    ----------
    mechanism
        The mechanism.
    pairs
        Numbers of the pairs of the group.
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
            at which independent equations are chosen. It is called only if equations repeat
            each other.

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
        # For each loop its variables that occur in no other loop.
        exclusive_variables: list[list[int]] = []
        for loop in self.loops:
            variables: list[int] = []
            for pair, _ in reversed(loop):
                if loop_counts[pair] == 1 and pair in self.pairs:
                    variables += self._variables_of(pair)
            exclusive_variables.append(variables)
        group_variables = [v for pair in self.pairs for v in self._variables_of(pair)]
        # Equations that repeat each other are chosen one by one if they are few. Only if
        # they are many, two variables of each loop are eliminated first.
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
        """Return the numbers of the variables of a pair."""
        return self.mechanism.variables_of(pair)

    def _choose_equations(self, vectors: Floats) -> list[EquationChoice]:
        """Return independent scalar equations, one for each unknown.

        They are the pivots of a QR decomposition, at one configuration, of all equations
        that can be chosen.

        Parameters
        ----------
        vectors
            (variables, 3) vectors of all variables at this configuration: relative angular
            velocities of the links of their pairs per unit rate.

        Raises
        ------
        EngineError
            If fewer equations are independent than there are unknowns.
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
        """Return the coefficients of the unknowns in all equations that can be chosen.

        Parameters
        ----------
        vectors
            (variables, 3) vectors of all variables at a closed configuration.

        Returns
        -------
        For each equation the coefficients (unknowns,), divided by the norm of the
        coefficients of all variables. Equations whose coefficients are rounding errors are
        left out.
        """
        row_by_equation: dict[EquationChoice, Floats] = {}
        for loop_index, loop in enumerate(self.loops):
            # For each variable +1 or -1 if the loop passes its pair, otherwise 0.
            senses = np.zeros(len(vectors))
            for pair, sense in loop:
                senses[list(self._variables_of(pair))] += sense
            # The vector equation of the loop: the sum of these vectors times rates is zero.
            loop_vectors = senses[:, None] * vectors
            directions = self._equation_directions(loop_index, senses, vectors)
            for equation, direction in directions.items():
                # The coefficients of all variables in this component of the equation.
                row = loop_vectors @ direction
                if not _is_rounding_error(row, direction):
                    row_size = float(np.linalg.norm(row))
                    row_by_equation[equation] = row[self.unknowns] / row_size
        return row_by_equation

    def _equation_directions(
        self, loop_index: int, senses: Floats, vectors: Floats
    ) -> dict[EquationChoice, Floats]:
        """Return the directions (3,) of the components of a loop's equation.

        Two variables of a loop can be private: they occur in no other loop. Then there is
        one direction, perpendicular to the vectors of both, so that the equation does not
        contain them. Otherwise there are the directions of the vectors of all variables of
        the loop. They span the equation, and do not depend on the choice of the ground
        axes.

        Parameters
        ----------
        loop_index
            Index of the loop.
        senses
            (variables,) +1 or -1 if the loop passes the pair of a variable, otherwise 0.
        vectors
            (variables, 3) vectors of all variables.
        """
        private = self.private_variables[loop_index]
        if private:
            first, second = private
            normal = np.cross(
                senses[first] * vectors[first], senses[second] * vectors[second]
            )
            return {EquationChoice(loop_index, None): normal}
        return {
            EquationChoice(loop_index, variable): vectors[variable]
            for variable in np.flatnonzero(senses).tolist()
        }

    def has_independent_equations(self, vectors: Floats) -> bool:
        """Return whether the equations that are solved determine the rates.

        If equations of the group are redundant, independent ones were chosen at one
        configuration. In other assembly modes the chosen equations can depend on each
        other.

        Parameters
        ----------
        vectors
            (variables, 3) vectors of all variables at another closed configuration.
        """
        if self.chosen_equations is None:
            return True
        row_by_equation = self._equation_rows(vectors)
        # An equation has no row if all its coefficients vanish in this configuration. It
        # then determines nothing.
        if any(equation not in row_by_equation for equation in self.chosen_equations):
            return False
        rows = np.array([row_by_equation[equation] for equation in self.chosen_equations])
        least_singular_value = np.linalg.svd(rows, compute_uv=False)[-1]
        return bool(least_singular_value >= MIN_INDEPENDENCE)

    def solve_rates(
        self, vectors: Sequence[Exprs], known_velocities: Sequence[Exprs]
    ) -> tuple[dict[int, Expr], Expr]:
        """Return the rates of the variables of the group times a determinant.

        The equation of each loop is sum of a_v x_v + c = 0, with the vectors a_v and the
        rates x_v of its unknown variables and a known vector c. Cramer's rule solves these
        equations without a division: with the determinant D, it gives D x_v.

        Parameters
        ----------
        vectors
            (3,) vectors of all variables of the mechanism.
        known_velocities
            (3,) for each pair of the mechanism the part of its relative angular velocity
            that does not depend on the unknown rates.

        Returns
        -------
        rates
            By variable of the group, its rate times the determinant.
        scale
            The determinant D.
        """
        # For each loop the vectors a_v, by variable, and the vector c.
        loop_vectors: list[dict[int, Exprs]] = []
        known_parts: list[Exprs] = []
        for loop in self.loops:
            by_variable: dict[int, Exprs] = {}
            for pair, sense in loop:
                if pair in self.pairs:
                    for v in self._variables_of(pair):
                        by_variable[v] = vectors[v] * float(sense)
            loop_vectors.append(by_variable)
            known_parts.append(
                vector_sum(known_velocities[pair] * float(sense) for pair, sense in loop)
            )
        equations = self._collect_equations(vectors, loop_vectors, known_parts)

        # The coefficients of the unknowns in the scalar equations, one row per equation.
        matrix: list[list[Expr]] = []
        for equation in equations:
            row: list[Expr] = []
            for v in self.unknowns:
                is_contained = v in equation.vectors
                row.append(
                    dot(equation.direction, equation.vectors[v]) if is_contained else 0.0
                )
            matrix.append(row)
        right_side = [
            dot(equation.direction, equation.known_part) for equation in equations
        ]
        scale = determinant(matrix)
        matrix_cofactors = cofactors(matrix)
        rates: dict[int, Expr] = {}
        for k, variable in enumerate(self.unknowns):
            column = [row[k] for row in matrix_cofactors]
            rates[variable] = -1.0 * dot(right_side, column)
        # The variables that were eliminated from the equations of their loop.
        for private, by_variable, known_part in zip(
            self.private_variables, loop_vectors, known_parts, strict=True
        ):
            if private:
                private_rates = _solve_private_rates(
                    private, by_variable, known_part, scale, rates
                )
                rates |= zip(private, private_rates, strict=True)
        return rates, scale

    def _collect_equations(
        self,
        vectors: Sequence[Exprs],
        loop_vectors: Sequence[dict[int, Exprs]],
        known_parts: Sequence[Exprs],
    ) -> list[LoopEquation]:
        """Return the scalar equations for the unknowns.

        The vector equation of a loop is sum of a_v x_v + c = 0, with the vectors a_v and
        the rates x_v of its unknown variables v. A scalar equation is its component along a
        direction. There are three kinds of directions:

        - A loop may have two private variables, which occur in no other loop. The direction
          is perpendicular to both of their vectors, so that the equation is free of them.
        - A loop without private variables gives three equations, along the ground axes.
        - If some equations repeat others, the constructor has chosen independent ones. They
          are components of the first kind, or along the vector of a variable of the loop.

        Parameters
        ----------
        vectors
            (3,) vectors of all variables of the mechanism: the relative angular velocity of
            the links of a pair at unit rate.
        loop_vectors
            For each loop the vectors (3,) of its unknown variables, times +1 or -1, the
            sense in which the loop passes the pair.
        known_parts
            For each loop the known vector c (3,).
        """

        def normal_to_private(loop_index: int) -> Exprs:
            """Return the direction perpendicular to both private vectors of a loop."""
            first, second = self.private_variables[loop_index]
            by_variable = loop_vectors[loop_index]
            return cross(by_variable[first], by_variable[second])

        # The index of the loop and the direction of each equation.
        directions: list[tuple[int, Exprs]] = []
        if self.chosen_equations is None:
            for loop_index, private in enumerate(self.private_variables):
                if private:
                    directions.append((loop_index, normal_to_private(loop_index)))
                else:
                    directions += [(loop_index, axis) for axis in GROUND_DIRECTIONS]
        else:
            for loop_index, variable in self.chosen_equations:
                if variable is None:
                    directions.append((loop_index, normal_to_private(loop_index)))
                else:
                    directions.append((loop_index, vectors[variable]))
        return [
            LoopEquation(direction, loop_vectors[loop_index], known_parts[loop_index])
            for loop_index, direction in directions
        ]


def _is_rounding_error(coefficients: Floats, direction: Floats) -> bool:
    """Return whether all coefficients of a scalar velocity equation are rounding errors.

    The equation then determines nothing. This is so if the direction is perpendicular to
    two parallel axes, or if it is normal to the plane of all axes of the loop.

    Parameters
    ----------
    coefficients
        (variables,) components of the vectors of the variables along the direction.
    direction
        (3,) direction of the component of the loop's vector equation, of any length.
    """
    row_size = float(np.linalg.norm(coefficients))
    direction_size = float(np.linalg.norm(direction))
    smallest_size = MIN_INDEPENDENCE * max(direction_size, MIN_DIRECTION_SIZE)
    return not row_size > smallest_size


def _solve_private_rates(
    private: Sequence[int],
    vectors: dict[int, Exprs],
    known_part: Exprs,
    scale: Expr,
    rates: Mapping[int, Expr],
) -> tuple[Expr, Expr]:
    """Return the rates x and y, times D, of the private variables of a loop.

    Private variables occur in no other loop. The rates of the other variables of the group
    are solved already, times the determinant D of its equations. The private rates satisfy
    the vector equation of the loop,

        x a + y b + s = 0,

    with the vectors a and b of the private variables. s is D times the known vector c, plus
    the sum of vector times rate of all other unknown variables of the loop. The component
    of the equation along a x b contains neither x nor y. It was used to solve the other
    rates, so s is in the plane of a and b. Two components remain, which give x and y.

    Parameters
    ----------
    private
        Numbers of the two private variables.
    vectors
        (3,) vectors of the unknown variables of the loop, times +1 or -1, the sense in
        which the loop passes the pair.
    known_part
        (3,) the known vector c of the loop.
    scale
        The determinant D.
    rates
        Rates times D of the variables that are solved already, by variable.
    """
    a, b = (vectors[v] for v in private)
    other_variables = [v for v in vectors if v not in private]
    # A group with a single loop of three unknown variables is a dyad. Two of them are
    # private, so only one rate of the group is solved already, and it is of this loop.
    is_dyad = len(rates) == 1 and len(other_variables) == 1
    if is_dyad:
        (third_variable,) = other_variables
        return _solve_private_rates_of_dyad(a, b, vectors[third_variable], known_part)
    # The vector s.
    other_terms = known_part * scale
    for variable in other_variables:
        other_terms = other_terms + vectors[variable] * rates[variable]
    # With n = a x b, the vectors n x b and a x n are at right angles to b and to a. So the
    # scalar products of x a + y b + s = 0 with these give x = (n x b) . s / |n|^2 and
    # y = (a x n) . s / |n|^2.
    # The quotients with vectors are formed first, since they depend on a and b alone. This
    # function is called again with another s for each input and for accelerations. All
    # calls then share the expressions of the quotients.
    normal = cross(a, b)
    inverse_square = 1.0 / dot(normal, normal)
    return (
        dot(cross(normal, b) * inverse_square, other_terms),
        dot(cross(a, normal) * inverse_square, other_terms),
    )


def _solve_private_rates_of_dyad(
    a: Exprs, b: Exprs, d: Exprs, known_part: Exprs
) -> tuple[Expr, Expr]:
    """Return the rates x and y, times D, of the private variables of a dyad.

    A dyad has one loop with three unknown rates: x a + y b + z d + c = 0. Its component
    along a x b is the equation (a x b) . d z + (a x b) . c = 0, whose determinant is
    D = (a x b) . d. By Cramer's rule D x = b . (c x d) and D y = -a . (c x d). These
    formulas need no division and not the rate z. They keep all digits, whereas digits may
    cancel in the sum z d + c.

    Parameters
    ----------
    a, b, d
        (3,) vectors of the two private variables and of the third variable.
    known_part
        (3,) the known vector c.
    """
    normal = cross(known_part, d)
    return dot(b, normal), -1.0 * dot(a, normal)
