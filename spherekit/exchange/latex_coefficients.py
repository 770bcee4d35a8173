r"""Printed formulas of poles, velocity coefficients and acceleration coefficients.

While one input moves at the rate 1 and the others are locked, link j has the angular
velocity w_j = m_j u_j relative to the ground, where u_j is the direction of its pole and
m_j its velocity coefficient. Angular velocities of links i and j differ along the pole u_ij
of the two links,

    m_j u_j = m_i u_i + m_ij u_ij,

which gives m_j from m_i by Aronhold and Kennedy. Accelerations are the derivatives of these
formulas with respect to an input, in which the axes of pairs move with their links.
"""

from collections.abc import Mapping, Sequence
from itertools import permutations

from spherekit.errors import EngineError
from spherekit.exchange.latex_formula_list import (
    Formula,
    FormulaList,
    cross_product,
    inner_product,
    is_negated,
)
from spherekit.exchange.latex_positions import PositionFormulas
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import (
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
    roman_numeral,
)
from spherekit.planning.pole_sequence import group_by_circle
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    substitute,
)
from spherekit.wording import listing


class CoefficientFormulas:
    """Formulas of the motion of all links per unit rate of each input.

    A velocity coefficient is the angular velocity of a link about its pole (axis of its
    rotation) per unit rate of an input. An acceleration coefficient is the derivative of a
    velocity coefficient with respect to the input. The constructor writes formulas to the
    list: poles, velocity coefficients, acceleration coefficients, then coefficients between
    moving links.

    Parameters
    ----------
    formula_list
        The list to which formulas are added, with the formulas of the positions.
    mechanism
        The mechanism.
    positions
        Formulas of the positions of the mechanism.
    pole_plans
        For each input the plan (order of computation) of the poles while it moves.
    input_suffixes
        For each input the text that ends the names of quantities while it moves.

    Raises
    ------
    EngineError
        If a pole follows only from velocity equations that are solved together.
    """

    def __init__(
        self,
        formula_list: FormulaList,
        mechanism: Mechanism,
        positions: PositionFormulas,
        pole_plans: Sequence[Plan],
        input_suffixes: Sequence[str],
    ) -> None:
        """Add all formulas of velocities to a LaTeX document, section by section.

        There are formulas for each input, which moves while the others are locked. A pole
        is the axis about which one link rotates relative to another. A velocity coefficient
        is the angular velocity about the pole, a number, per unit rate of the input. An
        acceleration coefficient is the derivative of a velocity coefficient.

        Parameters
        ----------
        formula_list
            The list to which formulas are added, with the formulas of the positions.
        mechanism, positions
            The mechanism, and the formulas of its positions.
        pole_plans
            For each input the steps in which poles follow from poles that are known.
        input_suffixes
            For each input the text that ends the names of quantities while it moves; empty
            for the only input.
        """
        self._formula_list = formula_list
        self._mechanism = mechanism
        self._positions = positions
        self._pole_plans = pole_plans
        self._input_suffixes = input_suffixes

        # All lists have one item for each input. A body consists of links that can't move
        # relative to each other while only this input moves.
        input_indices = range(len(pole_plans))
        # `formula_list.section` is the section of the document that gets new formulas.
        self._poles = [self._write_poles(index) for index in input_indices]
        formula_list.section = "Velocity coefficients"
        # The velocity coefficient (a number) and the angular velocity (a vector) of each
        # body, relative to the ground. `_write_velocities` adds an item to both lists.
        self._coefficients_by_body: list[dict[int, Expr]] = []
        self._velocities_by_body: list[dict[int, Expr]] = []
        for index in input_indices:
            self._write_velocities(index)
        formula_list.section = "Acceleration coefficients"
        # The formulas to differentiate, without the derivatives that are added below.
        earlier_formulas = list(formula_list.formulas.items())
        # The derivatives with respect to the input, by the symbol that is differentiated.
        self._derivatives_by_term = [
            self._write_derivatives(index, earlier_formulas) for index in input_indices
        ]
        # Coefficients of two links that both move relative to the ground. The method also
        # names all coefficients, such as "velocity_coefficient_2_1".
        formula_list.section = "Coefficients between moving links"
        # The velocity coefficient of each two links, by their numbers.
        self._coefficients_by_links: list[dict[tuple[int, int], Expr]] = [
            {} for _ in input_indices
        ]
        for index in input_indices:
            self._name_coefficients(index)

    def angular_velocity(self, input_index: int, link: int) -> Expr:
        """Return the angular velocity of a link per unit rate of an input, ground axes."""
        body = self._pole_plans[input_index].body[link]
        return self._velocities_by_body[input_index][body]

    def derivative(self, expression: Expr, input_index: int) -> Expr:
        """Return the derivative of an expression with respect to an input.

        The other inputs stay locked.

        The expression may contain axes of pairs (joints), poles (axes of relative
        rotations) and velocity coefficients. The expression must not contain inputs
        directly.
        """
        return differentiate([expression], self._derivatives_by_term[input_index])[0]

    def pair_coefficient(self, input_index: int, pair: int) -> Expr:
        """Return the derivative of the variable of a pair with respect to an input."""
        first, second = self._mechanism.ends[pair]
        return self._coefficients_by_links[input_index][second, first]

    def _write_poles(self, input_index: int) -> dict[Pole, Expr]:
        """Write formulas of the poles while one input moves and the others are locked.

        A body is a set of links that are rigid with each other while the other inputs are
        locked. The pole of two bodies is the axis of their relative rotation. If a pair
        (joint) joins the bodies, the pole is its axis, called primary. Otherwise the pole
        is the line common to two planes (Aronhold and Kennedy). Each plane is spanned by
        the poles of the two bodies relative to a third body. The line is the cross product
        of the normals of the two planes. Poles are found in passes; each pass uses the
        poles of earlier passes.

        Returns
        -------
        The unit vector of each pole, by its two bodies.
        """
        formula_list = self._formula_list
        pole_plan = self._pole_plans[input_index]
        mark = formula_list.input_mark(input_index)  # shows the moving input in symbols
        condition = ""
        if formula_list.has_several_inputs:
            input_text = self._positions.input_angles[input_index].arguments[0]
            condition = f" while ${input_text}$ moves"
        poles: dict[Pole, Expr] = {}
        for step in pole_plan.steps:
            if isinstance(step, PrimaryPole):
                poles[step.pole] = self._positions.pair_axes[step.pair]
                continue
            if not isinstance(step, LinePole):
                raise EngineError(
                    f"{self._mechanism.name}: the poles of links "
                    f"{listing(map(pole_plan.name, step.links))} are found only by solving "
                    "the velocity equations of an irreducible part together, for which no "
                    "formula is printed; export to another language"
                )
            smaller_body, larger_body = step.pole
            label = formula_list.join_labels(larger_body, smaller_body)
            # The title has the number of the pass in which the pole becomes known.
            formula_list.section = (
                f"Poles of pass {roman_numeral(step.pass_number)}{condition}"
            )
            # `via` are all third bodies whose two poles are known. Third bodies that turn
            # about one axis (`coaxial`) with one of the two bodies give the same plane.
            # Such bodies form a group, and one body of each group is used.
            third_body_groups = group_by_circle(step.via, step.pole, pole_plan.coaxial)
            normals: list[Expr] = []
            for third_body, *_ in third_body_groups[:2]:
                pole_a = poles[pole_of(smaller_body, third_body)]
                pole_b = poles[pole_of(larger_body, third_body)]
                normals.append(
                    formula_list.write_indexed(
                        r"\mathbf{n}",
                        f"{label}|{formula_list.link_labels[third_body]}",
                        cross_product(pole_a, pole_b),
                        mark=mark,
                    )
                )
            line = formula_list.write_indexed(
                r"\mathbf{v}", label, cross_product(*normals), mark=mark
            )
            length = formula_list.write_indexed(
                "v", label, function("norm", line), mark=mark
            )
            poles[step.pole] = formula_list.write_indexed(
                r"\mathbf{u}", label, line / length, mark=mark
            )
        return poles

    def _write_velocities(self, input_index: int) -> None:
        """Write the velocity coefficients and angular velocities of all bodies.

        A body is a set of links that are rigid with each other while one input moves. Body
        j has the angular velocity m_j u_j relative to the ground, per unit rate of the
        input. Here u_j is the direction of its pole (axis of rotation) and m_j its velocity
        coefficient. The coefficient m_j follows from the coefficient m_t of another body t:
        m_j = m_t N / D, with N = c . (u_jt x u_t), D = c . (u_jt x u_j) and c = u_j x u_t.
        This is the equation m_j u_j = m_t u_t + m_jt u_jt, multiplied by u_jt and then by
        c, where jt is the motion of j relative to t.
        """
        formula_list = self._formula_list
        pole_plan = self._pole_plans[input_index]
        poles = self._poles[input_index]
        mark = formula_list.input_mark(input_index)
        ground = pole_plan.body[0]
        first, second = pole_plan.ends[pole_plan.input]
        # The rate of the input is 1: the rate of its second body relative to its first.
        coefficients: dict[int, Expr] = {second: 1.0} if first == ground else {first: -1.0}
        velocities: dict[int, Expr] = {ground: 0.0}
        self._coefficients_by_body.append(coefficients)
        self._velocities_by_body.append(velocities)
        moving_bodies = {*pole_plan.bodies} - {ground}
        # False sorts before True, so the body with a known coefficient comes first.
        driven_body_first = sorted(moving_bodies, key=lambda body: body not in coefficients)
        for body in driven_body_first:
            axis = poles[pole_of(body, ground)]
            label = formula_list.join_labels(body, ground)
            if body not in coefficients:
                # The third body t is the first with a known coefficient. If all three
                # bodies had a common axis, N and D would be zero.
                third_body = next(
                    known_body
                    for known_body in coefficients
                    if not any(
                        {known_body, body, ground} <= coaxial_bodies
                        for coaxial_bodies, _ in pole_plan.coaxial
                    )
                )
                relative_axis = poles[pole_of(body, third_body)]
                third_axis = poles[pole_of(third_body, ground)]
                normal = formula_list.write_indexed(
                    r"\mathbf{c}", label, cross_product(axis, third_axis), mark=mark
                )
                numerator = formula_list.write_indexed(
                    "N",
                    label,
                    inner_product(normal, cross_product(relative_axis, third_axis)),
                    mark=mark,
                )
                denominator = formula_list.write_indexed(
                    "D",
                    label,
                    inner_product(normal, cross_product(relative_axis, axis)),
                    mark=mark,
                )
                coefficients[body] = formula_list.write_indexed(
                    "m",
                    label,
                    coefficients[third_body] * numerator / denominator,
                    mark=mark,
                )
            velocities[body] = formula_list.write_indexed(
                r"\mathbf{w}",
                formula_list.link_labels[body],
                coefficients[body] * axis,
                mark=mark,
            )

    def _write_derivatives(
        self, input_index: int, earlier_formulas: Sequence[tuple[ExpressionNode, Formula]]
    ) -> Mapping[ExpressionNode, Expr]:
        """Write the derivatives of axes, poles and coefficients with respect to an input.

        A pole is the axis of relative rotation of two links. A velocity coefficient is the
        angular velocity of this rotation per unit rate of the input.

        Parameters
        ----------
        input_index
            The input that moves.
        earlier_formulas
            Symbols and formulas up to the velocity coefficients.

        Returns
        -------
        The derivative of each symbol.
        """
        # The derivative of the axis of a pair (joint) is a cross product. So the formula of
        # the axis, in the section "Positions", is not differentiated.
        derivative_by_symbol = self._write_axis_derivatives(input_index)
        # Each formula contains only symbols of earlier formulas, so the derivatives that it
        # needs are already known.
        for symbol, formula in earlier_formulas:
            if formula.section == "Positions":
                continue
            # Each of these formulas has one expression.
            derivative = _differentiate_right_side(
                symbol, formula.rows[0], derivative_by_symbol
            )
            derivative_by_symbol[symbol] = self._formula_list.write(
                self._formula_list.derivative_symbol(symbol, input_index), derivative
            )
        return derivative_by_symbol

    def _write_axis_derivatives(self, input_index: int) -> dict[ExpressionNode, Expr]:
        """Write the derivatives of the axes of all pairs (joints) with respect to an input.

        An axis is fixed in both links of its pair. The derivative of the axis is the cross
        product of the angular velocity of a link (per unit rate of the input) and the axis.

        Returns
        -------
        The derivative of the symbol of each axis.
        """
        formula_list = self._formula_list
        derivative_by_axis: dict[ExpressionNode, Expr] = {}
        for pair, axis in enumerate(self._positions.pair_axes):
            velocity = self._find_simpler_velocity(input_index, pair)
            derivative_by_axis[axis] = formula_list.write(
                formula_list.derivative_symbol(axis, input_index),
                cross_product(velocity, axis),
            )
        return derivative_by_axis

    def _find_simpler_velocity(self, input_index: int, pair: int) -> Expr:
        """Return the angular velocity of one link of a pair, for the shorter formula.

        The axis of the pair is fixed in both links, so either angular velocity can be used
        to differentiate it. A link at rest is preferred, then an angular velocity without a
        minus sign.
        """
        first_link, second_link = self._mechanism.ends[pair]
        first_velocity = self.angular_velocity(input_index, first_link)
        second_velocity = self.angular_velocity(input_index, second_link)
        # A link at rest has the number 0.0 as angular velocity.
        if first_velocity == 0.0 or second_velocity == 0.0:
            return 0.0
        if is_negated(first_velocity) and not is_negated(second_velocity):
            return second_velocity
        return first_velocity

    def _name_coefficients(self, input_index: int) -> None:
        """Store expressions of poles, velocities and coefficients by names for users.

        Users ask for a quantity by a name such as ``velocity_coefficient_2_1``. In the
        formulas the quantity is a symbol, such as m_21. This function stores the expression
        of each name.

        A coefficient of two links a and b describes the rotation of a relative to b per
        unit rate of the input. The coefficient is 0 if both links are rigid with each
        other. If one link is at rest, the coefficients relative to the ground are used,
        which have formulas already. Otherwise the formulas of the coefficients are written
        here: the components of the relative angular velocity, and of its derivative, along
        the pole (axis of the relative rotation).
        """
        formula_list = self._formula_list
        links = self._mechanism.links
        suffix = self._input_suffixes[input_index]
        mark = formula_list.input_mark(input_index)  # shows the moving input in symbols
        body = self._pole_plans[input_index].body  # number of the body of each link
        coefficients = self._coefficients_by_body[
            input_index
        ]  # coefficients relative to the ground
        for link, name in enumerate(links):
            velocity = self.angular_velocity(input_index, link)
            formula_list.name_quantity("angular_velocity", name + suffix, velocity)
            formula_list.name_quantity(
                "angular_velocity_dq",
                name + suffix,
                self.derivative(velocity, input_index),
            )
        for a, b in permutations(range(len(links)), 2):
            axis: Expr = 0.0
            coefficient: Expr = 0.0
            coefficient_derivative: Expr = 0.0
            if body[a] != body[b]:
                axis = self._poles[input_index][pole_of(body[a], body[b])]
                velocity_a = self.angular_velocity(input_index, a)
                velocity_b = self.angular_velocity(input_index, b)
                # The angular velocity of a link at rest is the number 0, no expression.
                if 0.0 in (velocity_a, velocity_b):
                    b_rests = velocity_b == 0.0
                    coefficient = (
                        coefficients[body[a]] if b_rests else -1.0 * coefficients[body[b]]
                    )
                    coefficient_derivative = self.derivative(coefficient, input_index)
                else:
                    coefficient = formula_list.write_indexed(
                        "m",  # letter of velocity coefficients
                        formula_list.join_labels(a, b),
                        inner_product(velocity_a - velocity_b, axis),
                        mark=mark,
                    )
                    # The derivative of the axis is at right angles to the difference of
                    # velocities, which lies along the axis, so this derivative drops out.
                    change = self.derivative(velocity_a, input_index) - self.derivative(
                        velocity_b, input_index
                    )
                    coefficient_derivative = formula_list.write(
                        formula_list.derivative_symbol(coefficient, input_index),
                        inner_product(change, axis),
                    )
            self._coefficients_by_links[input_index][a, b] = coefficient
            owner = f"{links[a]}_{links[b]}{suffix}"
            formula_list.name_quantity("pole", owner, axis)
            formula_list.name_quantity("velocity_coefficient", owner, coefficient)
            formula_list.name_quantity(
                "acceleration_coefficient", owner, coefficient_derivative
            )


def _differentiate_right_side(
    term: ExpressionNode,
    right_side: Expr,
    derivative_by_term: Mapping[ExpressionNode, Expr],
) -> Expr:
    """Return the derivative of the right-hand side of a formula, as short as possible.

    The derivative of a quotient contains the quotient: (a / b)' = (a' - (a / b) b') / b. If
    the right-hand side is a quotient, the derivative has the symbol `term` in its place.

    Parameters
    ----------
    term, right_side
        The symbol and the expression that the formula equates.
    derivative_by_term
        The derivative of each symbol in the expression.
    """
    (derivative,) = differentiate([right_side], derivative_by_term)
    (short_derivative,) = substitute([derivative], {right_side: term})
    return short_derivative
