"""The quantities of the rows of designs, as expressions with sizes, masses and loads.

One set of expressions applies to all designs of a mechanism: the sizes that differ are
symbols. `spherekit.velocities.row_quantities` lists the names of the quantities.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import count

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, Names
from spherekit.errors import EngineError
from spherekit.mechanism.friction import check_no_reaction_friction
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_dependence import wound_pairs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
    function,
    iterate_nodes,
    sign_of,
    symbols,
)
from spherekit.symbolic.vector_algebra import (
    Exprs,
    cofactors,
    cross,
    determinant,
    singular_values,
    vector,
)
from spherekit.tolerances import NO_MOTION
from spherekit.velocities.axis_rotations import PairRotations
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.dyad_expressions import pair_angle, place_by_inputs
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.load_expressions import LoadState, component_forces
from spherekit.velocities.load_numbers import masses_and_loads, replace_numbers
from spherekit.velocities.pose_expressions import LinkOrientation
from spherekit.velocities.row_quantities import (
    QuantityTable,
    make_quantity_table,
    sample_names,
)
from spherekit.velocities.transmission_angle import COMPONENTS, transmission_angle
from spherekit.wording import listing, nearest

MakePairs = Callable[[Mapping[str, Expr]], PairRotations]
"""Function that returns the rotations of all pairs from symbols of sizes, by name."""


class DesignExpressions:
    """The quantities of the rows of all designs of a mechanism, as expressions.

    A design is the mechanism with other sizes, masses or loads. A row is one configuration
    of a design with rates and accelerations of its inputs. Inputs are counted by their
    index in `inputs`. A *moving* input has the rate 1 while the others rest.

    Attributes
    ----------
    mechanism, inputs
        The mechanism, and the names of its input pairs.
    structure
        The kinematics, with symbols for the sizes that differ.
    sample_symbols
        Symbols of a sample of the motion: angles, rates and accelerations of all inputs,
        then the time.
    configuration_symbols
        In closed form, symbols of the signs of the dyads. A dyad (two links in series) can
        be closed in two ways, and the sign of the dyad chooses one of the ways.
        Otherwise symbols of all pair variables.
    size_symbols
        Symbols of the sizes that differ, then of the numbers of masses and loads that
        differ.
    variables
        Without a closed form, expressions of all variables: their symbols, and linear
        functions of these for pairs that follow the inputs through wheels.
    triple_squares
        In closed form, for each dyad the square of the triple product of its axes.
    table_symbols
        By the name of each torque table, the symbol of the present torque (N m) of the
        table.
    revolution_symbols
        By the name of each passive pair on whose angle loads depend: the symbol of the
        angle of the whole revolutions of the pair (rad), which is added to the angle of
        the configuration.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: Sequence[str],
        sizes: Sequence[str] = (),
        make_pairs: MakePairs | None = None,
        closed_form: bool | None = None,
        differing: Sequence[int] = (),
        closed: Floats | None = None,
        pointing: Mapping[str, str | Exprs] | None = None,
        by_rank: bool = False,
    ) -> None:
        """Place the links and write the equations.

        Parameters
        ----------
        mechanism, inputs
            The mechanism, and the names of its input pairs.
        sizes
            Names of the sizes that differ.
        make_pairs
            Returns the rotations of the pairs with symbols for these sizes.
        closed_form
            Whether links are placed by the signs of dyads. By default they are if all
            groups are dyads.
        differing
            Indices of the numbers of masses and loads that differ, in the order of
            `list_numbers`.
        closed
            (variables,) a closed configuration (rad) of the mechanism, if one is known.
        pointing
            The directions of outputs in which designs differ, by the name of the output.
            A direction is the name of a pair whose axis it is, or its components (3,) in
            link axes.
        by_rank
            Whether the rank of the velocity equations has shown that there is one degree of
            freedom for each input, although counting links and pairs gives fewer.

        Raises
        ------
        EngineError
            If there are no expressions for the pairs or groups of the mechanism.
        """
        # Inputs, groups of links and pair rotations, with symbols for the sizes that
        # differ.
        size_symbols = symbols(sizes)
        pairs = None
        if make_pairs:
            pairs = make_pairs(dict(zip(sizes, size_symbols, strict=True)))
        self.mechanism = mechanism
        self.inputs = [*inputs]
        self._pointing = pointing or {}
        self.structure = KinematicStructure.from_mechanism(
            mechanism, input_pairs=inputs, pairs=pairs, closed=closed, by_rank=by_rank
        )
        structure = self.structure
        self.sample_symbols = symbols(sample_names(inputs))
        if closed_form is None:
            closed_form = structure.assembly.has_closed_form
        # Links are placed by inputs and signs of dyads (closed form), or by all variables.
        self.triple_squares: list[Expr] = []
        self.variables: list[Expr] = []
        self._placed: list[LinkOrientation] = []
        if closed_form:
            self.configuration_symbols = symbols(
                f"sign_{k + 1}" for k in range(len(structure.groups))
            )
            placement = place_by_inputs(
                structure, self.sample_symbols[: len(inputs)], self.configuration_symbols
            )
            self._placed = placement.orientations
            self.triple_squares = placement.triple_squares
        else:
            self.configuration_symbols = symbols(mechanism.variable_names)
            # Angles of pairs that follow the inputs through wheels.
            follower_angles = structure.follower_angles(
                [self.configuration_symbols[v] for v in structure.inputs]
            )
            self.variables = [
                follower_angles.get(v, symbol)
                for v, symbol in enumerate(self.configuration_symbols)
            ]

        # Numbers of masses and loads that differ become symbols. The numbers are visited in
        # the order in which `differing` counts them.
        number_symbols = symbols(f"number_{k}" for k in differing)
        symbol_by_index = dict(zip(differing, number_symbols, strict=True))
        indices = count()
        self._tensors, self._load_components = replace_numbers(
            masses_and_loads(mechanism),
            lambda number: symbol_by_index.get(next(indices), number),
        )
        self.size_symbols = (*size_symbols, *number_symbols)
        self.table_symbols = {
            load.name: symbols([f"torque_{load.name}"])[0]
            for load in mechanism.loads
            if isinstance(load, TorqueTable)
        }
        self.revolution_symbols = {
            pair: symbols([f"turns_of_{pair}"])[0]
            for pair in wound_pairs(mechanism)
            if pair not in inputs
        }

    @cached_property
    def coordinate_rates(self) -> CoordinateRates:
        """The homogeneous rates of all variables while each input moves.

        Homogeneous rates are the rates times the determinant of the velocity equations.
        They are finite even where the determinant vanishes.
        """
        return CoordinateRates(self.structure, self.variables, self._placed)

    @property
    def middle_pairs(self) -> Names:
        """The middle pair of each dyad, in the order of the signs; empty without signs."""
        if not self.triple_squares:
            return ()
        groups = self.structure.assembly.groups
        return tuple(self.structure.mechanism.names_of(group.middle for group in groups))

    @property
    def has_closed_form(self) -> bool:
        """Whether the links are placed by the signs of dyads."""
        return bool(self.triple_squares) or not self.configuration_symbols

    @property
    def profile_symbols(self) -> list[ExpressionNode]:
        """Symbols of profiles at their contacts: arguments after the configuration."""
        return [
            symbol
            for side in self.structure.pairs.sides_with_symbols
            for symbol in (*side.contact_symbols, side.last_derivative)
        ]

    def differentiate_by_sizes(self, items: Sequence[Expr]) -> list[list[Expr]]:
        """Return derivatives with respect to each size, while the loops stay closed.

        A size is a number of the mechanism that varies between designs, such as an arc of a
        link, a mass or a number of a load. The inputs are constant. If a size grows, the
        pair variables have to change, so that the loops stay closed.

        A profile is the curve along which a link touches another link. If the curve is not
        a circle, symbols describe it at the point of contact: tangent, point, curvature,
        and the derivative of the curvature. These symbols are called profile columns. A
        change of the design can also change the profile, and so the values of these
        symbols. The caller needs the derivatives with respect to them for the chain rule.

        Parameters
        ----------
        items
            The expressions to differentiate.

        Returns
        -------
        For each size, then for each profile column, the derivative of each expression. In
        closed form (with formulas for all pair variables), the result has the derivatives
        by sizes only.

        Raises
        ------
        EngineError
            If an expression contains the second derivative of the curvature of a profile.
        """
        # In closed form, the pair variables are formulas of inputs and sizes, so the loops
        # stay closed.
        if self.has_closed_form:
            return [differentiate(items, {size: 1.0}) for size in self.size_symbols]
        self._refuse_second_curvature_derivative(items)
        # Partial derivatives with respect to each pair variable, because the pair
        # variables change with the sizes.
        by_variable = [
            self._differentiate_by_variable(items, v)
            for v in range(len(self.configuration_symbols))
        ]
        profile_columns = [
            symbol
            for side in self.structure.pairs.sides_with_symbols
            for symbol in side.contact_symbols
        ]
        return [
            self._differentiate_along_closed_loops(items, symbol, by_variable)
            for symbol in (*self.size_symbols, *profile_columns)
        ]

    def _refuse_second_curvature_derivative(self, items: Sequence[Expr]) -> None:
        """Raise `EngineError` if expressions have no derivatives with respect to sizes.

        A profile is a curve along which a link touches another. If it is not a circle, it
        has symbols for its curvature k at the contact and for dk/ds and d2k/ds2, with the
        arc length s. A change of a size can move the contact along the profile. The
        derivative of d2k/ds2 with respect to the size then contains d3k/ds3, for which
        there is no symbol. Only linearised motions contain d2k/ds2.
        """
        symbols_in_items = set(iterate_nodes(items))
        sides = self.structure.pairs.sides_with_symbols
        # `last_derivative` is the symbol of d2k/ds2.
        if any(side.last_derivative in symbols_in_items for side in sides):
            raise EngineError(
                f"{self.mechanism.name}: the derivatives of a linearised motion with "
                "respect to sizes exist only for profiles that are circles; compare "
                "designs with a sweep"
            )

    def _differentiate_along_closed_loops(
        self, items: Sequence[Expr], symbol: ExpressionNode, by_variable: list[list[Expr]]
    ) -> list[Expr]:
        """Return total derivatives with respect to a symbol, with inputs at rest.

        If the symbol grows, the pair variables v have to change, so that the loops stay
        closed. The total derivative is the partial derivative with respect to the
        symbol, plus the sum over all v of (dv / dsymbol) times the partial derivative
        with respect to v.

        Parameters
        ----------
        items
            The expressions.
        symbol
            A size of the mechanism, or a number of a profile (contact curve) at its
            contact, such as the curvature.
        by_variable
            For each pair variable, the partial derivatives of all expressions.
        """
        rates = self.coordinate_rates
        # The rates at which the growing symbol opens the loops.
        opening_rates = rates.closure_residual_rates(symbol)
        # The rates of all variables that close the loops again. Those of inputs are zero.
        variable_derivatives = rates.solve_loops(opening_rates)
        total = differentiate(items, {symbol: 1.0})
        for variable_derivative, partial in zip(
            variable_derivatives, by_variable, strict=True
        ):
            total = [
                x + y * variable_derivative for x, y in zip(total, partial, strict=True)
            ]
        return total

    def _differentiate_by_variable(
        self, items: Sequence[Expr], variable: int
    ) -> list[Expr]:
        """Return the derivatives of expressions with respect to a pair variable.

        If the variable moves a contact along a profile (curve on a link), the tangent, the
        point, the curvature and its derivative at the contact change with the variable.
        Each of these quantities is a symbol with a rate.
        """
        rates: dict[ExpressionNode, Expr] = {self.configuration_symbols[variable]: 1.0}
        for side in self.structure.pairs.sides_with_symbols:
            if side.track.variable == variable:
                rates |= zip(side.contact_symbols, side.column_derivatives, strict=True)
        return differentiate(items, rates)

    @cached_property
    def _moments(self) -> InputMoments:
        """Inertia matrix at the inputs, and the input torques that inertia requires."""
        link_number = self.mechanism.link_number
        tensors = {
            link_number[link]: np.array(rows, object) for link, rows in self._tensors
        }
        return InputMoments(self.coordinate_rates, tensors)

    def quantity(self, name: str) -> Expr:
        """Return the expression of a quantity with a given name, one of `row_quantities`.

        Quantities are results for one configuration, such as velocities and torques.

        Raises
        ------
        EngineError
            If there is no such quantity, or if the name is ambiguous.
        """
        table = self._quantity_table
        if name not in table:
            raise EngineError(
                f'{self.mechanism.name}: there is no quantity "{name}"'
                f"{nearest(name, table) or '.'} Quantities: {listing(table)}"
            )
        # The table states which method of this class returns the quantity, and with which
        # arguments. If the method returns a vector, the table has the index of a component.
        row_quantity = table[name]
        value = getattr(self, row_quantity.method)(*row_quantity.arguments)
        if row_quantity.component is None:
            return value
        return value[row_quantity.component]

    @cached_property
    def _quantity_table(self) -> QuantityTable:
        """Table of all quantities that can be computed for a row, by their names."""
        return make_quantity_table(self.mechanism, self.inputs, self.structure.assembly)

    def refuse_ambiguous_name(self, name: str, first: str, second: str) -> Expr:
        """Raise `EngineError` because two quantities have the same name.

        Names of quantities are names of links or pairs joined by underscores, which may
        also occur in the names themselves. The table of quantities says for each name which
        method computes it. For an ambiguous name, the table states this method. The method
        never returns, but has the return type of the other methods.

        Parameters
        ----------
        name
            The name of both quantities.
        first, second
            What the name can mean, such as ``pole (1, 2_3)``.
        """
        raise EngineError(
            f'{self.mechanism.name}: "{name}" can mean {first} or {second}; give links or '
            "pairs other names"
        )

    def sample_variable(self, index: int) -> Expr:
        """Return the symbol of an angle, rate or acceleration of an input, or of the time.

        `index` is the position in `sample_symbols`: angles, rates and accelerations of all
        inputs, then the time.
        """
        return self.sample_symbols[index]

    @cached_property
    def _variable_rates(self) -> list[list[Expr]]:
        """For each moving input the rates of all variables while it has the rate 1."""
        inverse_scale = 1.0 / self.coordinate_rates.scale
        return [[rate * inverse_scale for rate in tau] for tau in self.coordinate_rates.tau]

    @cached_property
    def _link_velocities(self) -> list[list[Exprs]]:
        """For each moving input the angular velocities (3,) of all links at its rate 1."""
        inverse_scale = 1.0 / self.coordinate_rates.scale
        return [[x * inverse_scale for x in w] for w in self.coordinate_rates.w]

    @cached_property
    def _link_velocity_derivatives(self) -> list[list[Exprs]]:
        """Derivatives (3,) of the `_link_velocities` with respect to the moving input."""
        return [
            self.coordinate_rates.bias_accelerations(rates, w)
            for rates, w in zip(self._variable_rates, self._link_velocities, strict=True)
        ]

    def determinant(self) -> Expr:
        """Return the determinant of the velocity equations.

        The determinant vanishes in configurations in which the inputs do not determine the
        rates of all variables.
        """
        return self.coordinate_rates.scale

    def rate(self, pair: str, moving: int) -> Expr:
        """Return the rate of a pair's variable per unit rate of a moving input."""
        tau = self.coordinate_rates.tau[moving]
        return tau[self._variable(pair)] / self.coordinate_rates.scale

    def axis(self, pair: str) -> Exprs:
        """Return the axis (3,) of an R pair in ground axes."""
        return self.coordinate_rates.vectors[self._variable(pair)]

    def orientation(self, link: str, row: int, column: int) -> Expr:
        """Return an entry of the rotation from link axes to ground axes."""
        placed = self.coordinate_rates.placed[self.mechanism.link(link)]
        return placed.direction(np.eye(3)[column])[row]

    def angular_velocity(self, kind: str, link: str, moving: int) -> Exprs:
        """Return the angular velocity (3,) of a link in ground axes, or its derivative.

        One input moves, the others rest.

        Parameters
        ----------
        kind
            "" for the angular velocity per unit rate of the moving input. "_dq" for the
            derivative of this velocity with respect to the moving input q.
        link
            Name of the link.
        moving
            Index of the moving input.
        """
        vectors = self._link_velocity_derivatives if kind else self._link_velocities
        return vectors[moving][self.mechanism.link(link)]

    def _output_links(self, name: str) -> tuple[int, int]:
        """Return the index of an output's link, and of the link from which it is seen."""
        (output,) = (output for output in self.mechanism.outputs if output.name == name)
        return self.mechanism.link(output.link), self.mechanism.link(output.relative_to)

    def _output_direction(self, name: str) -> Exprs | None:
        """Return the direction (3,) of an output in ground axes; None if it has none."""
        (output,) = (output for output in self.mechanism.outputs if output.name == name)
        if output.direction is None:
            return None
        direction = self._pointing.get(name, np.array(output.direction))
        if isinstance(direction, str):
            return self.axis(direction)
        link, _ = self._output_links(name)
        return self.coordinate_rates.placed[link].direction(direction)

    def direction(self, name: str) -> Exprs:
        """Return the direction (3,) of an output, in the axes of its reference link.

        The motion of the output is measured relative to this link.
        """
        _, base = self._output_links(name)
        # The rotation from axes of the reference link to ground axes.
        rotation = self.coordinate_rates.placed[base].direction(np.eye(3))
        return rotation.T @ self._output_direction(name)

    def _output_jacobian(self, name: str) -> list[Exprs]:
        """Return the columns (3,) of the Jacobian of an output, one for each input.

        A column is the angular velocity of the output's link, relative to its reference
        link, per unit rate of one input while the others rest. If there are two inputs and
        the output is a pointing direction, a column is the rate of this direction.
        """
        link, base = self._output_links(name)
        velocities = [w[link] - w[base] for w in self._link_velocities]
        direction = self._output_direction(name)
        if direction is None or len(velocities) != 2:
            return velocities
        return [cross(velocity, direction) for velocity in velocities]

    def condition_number(self, name: str) -> Expr:
        """Return the condition number of the Jacobian of an output.

        The condition number is the ratio of the largest to the smallest singular value of
        the matrix of output velocities per unit rate of each input.
        """
        columns = self._output_jacobian(name)
        if len(columns) > 3:
            # The transposed matrix has the same singular values, and only three columns.
            columns = [*np.transpose(columns)]
        largest, *_, least = singular_values(columns)
        return largest / least

    def jacobian_determinant(self, name: str) -> Expr:
        """Return the determinant of the square Jacobian of an output.

        With three inputs its columns are the angular velocities of the output per unit rate
        of each input. With two inputs the columns are the rates of the direction in which
        the output points, and the determinant is the area of the parallelogram of the two
        rates. The sign of the area depends on the order of the inputs.
        """
        first, second, *further_columns = self._output_jacobian(name)
        third = further_columns[0] if further_columns else self._output_direction(name)
        # With two inputs, only an output that is a pointing direction has a determinant.
        assert third is not None
        return dot(cross(first, second), third)

    def inertia(self, first: int, second: int) -> Expr:
        """Return an entry of the inertia matrix (kg m2), for two inputs."""
        inverse_scale = 1.0 / self.coordinate_rates.scale
        moments = self._moments
        factor = inverse_scale * inverse_scale
        return moments.matrix[first][second] * factor * moments.unit

    def inertia_rate(self) -> Expr:
        """Return the derivative dB/dq (kg m2/rad) of the inertia B of a single input q.

        The inertia forces need the torque B ddq + (dB/dq) dq^2 / 2 at the input. At the
        rate dq = 1 and without acceleration this is half of dB/dq, so the result is twice
        this torque.
        """
        return 2.0 * self._moments.inertia_torque(0, [1.0], [0.0])

    def relative_loop_residual(self) -> Expr:
        """Return by how much the computed rates violate the loop equations.

        If equations are redundant, the rates are computed from equations that are
        independent at one configuration. Where the chosen equations depend on each other,
        the computed rates violate the remaining equations. The caller then uses rates from
        another choice of equations. Elsewhere the result is zero up to rounding.

        Returns
        -------
        The norm of all residuals. For each input, the residuals of the loops are computed
        in the motion in which only this input moves. They are divided by the norm of the
        rates of this motion.
        """
        rates = self.coordinate_rates
        total: Expr = 0.0
        # For each input: the rates tau of all variables and the angular velocities w of all
        # links. Both contain a factor (a determinant), which cancels in the ratio below.
        for tau, w in zip(rates.tau, rates.w, strict=True):
            pair_velocities = rates.pair_velocities(tau)
            residual_square: Expr = 0.0
            # A chord is the pair at which a loop is cut. Its two links get their velocities
            # along the two sides of the loop. The two velocities must differ by the
            # velocity of the pair.
            for chord in rates.tree.chords:
                first, second = rates.tree.ends[chord]
                residual = w[first] - w[second] + pair_velocities[chord]
                residual_square = residual_square + dot(residual, residual)
            total = total + residual_square / dot(tau, tau)
        return function("sqrt", total)

    @cached_property
    def _inverse_inertia(self) -> list[list[Expr]]:
        """The inverse of the inertia matrix, 1/(kg m2)."""
        # The inertia matrix is `matrix` times its unit, divided by the square of the scale.
        matrix = self._moments.matrix
        scale = self.coordinate_rates.scale
        factor = scale * scale / (self._moments.unit * determinant(matrix))
        return [[x * factor for x in row] for row in cofactors(matrix)]

    def kinetic_energy(self) -> Expr:
        """Return the kinetic energy of all links (J)."""
        scaled_speeds = self.coordinate_rates.motion_rates(self._speeds).scaled_speeds
        momenta = [dot(row, scaled_speeds) for row in self._moments.matrix]
        return dot(scaled_speeds, momenta) * (0.5 * self._moments.unit)

    def coefficient(self, link_name: str, other_name: str, kind: str, moving: int) -> Expr:
        """Return a velocity or acceleration coefficient of two links.

        The velocity coefficient is the size of the relative angular velocity per unit rate
        of the moving input. If an R pair joins the links, the velocity coefficient is the
        rate of the pair's variable, with a sign. The acceleration coefficient is the
        derivative of the velocity coefficient with respect to the moving input.

        Parameters
        ----------
        link_name
            Name of the moving link.
        other_name
            Name of the link relative to which it moves.
        kind
            "velocity" or "acceleration".
        moving
            Index of the moving input.
        """
        link = self.mechanism.link(link_name)
        other = self.mechanism.link(other_name)
        # None if no R pair joins the links.
        variable = self.mechanism.angle_between(link, other)
        w = self._link_velocities[moving]
        relative_velocity = w[link] - w[other]
        if kind == "velocity":
            if variable is None:
                return function("sqrt", dot(relative_velocity, relative_velocity))
            # The variable is the rotation of the pair's second link relative to its first.
            # The opposite order of the links reverses the sign.
            first, _ = self.mechanism.ends[self.mechanism.variable_owners[variable]]
            sense = 1.0 if first == other else -1.0
            return self._variable_rates[moving][variable] * sense
        # Two links that never move relative to each other have no direction of motion.
        if self._rest_together(link_name, other_name, moving):
            return 0.0
        # The relative angular velocity is c u, with the coefficient c from above. The unit
        # vector u is the axis of the pair or, without a pair, the direction of the motion.
        # The derivative is c' u + c u'. Because u' is perpendicular to u, the component of
        # the derivative along u is c'.
        dw = self._link_velocity_derivatives[moving]
        direction = self._relative_direction(link_name, other_name, moving)
        return dot(dw[link] - dw[other], direction)

    def pole(self, link_name: str, other_name: str, moving: int) -> Exprs:
        """Return the unit vector (3,) of the pole axis of two links in ground axes.

        The pole axis is the axis of the relative rotation of the links. The unit vector
        times the velocity coefficient is the angular velocity of the first link relative to
        the second, per unit rate of the moving input. The result is NaN if the links never
        move relative to each other while the other inputs are locked. Links can also be at
        relative rest in single configurations. The result is NaN there, unless an R pair
        joins the links: its axis is then the pole axis in all configurations.

        Parameters
        ----------
        link_name, other_name
            The two links.
        moving
            Index of the moving input.
        """
        if self._rest_together(link_name, other_name, moving):
            return vector([np.nan] * 3)
        direction = self._relative_direction(link_name, other_name, moving)
        link = self.mechanism.link(link_name)
        other = self.mechanism.link(other_name)
        has_common_pair = self.mechanism.angle_between(link, other) is not None
        if has_common_pair:
            # The axis of a pair is also defined where the pair rests.
            return direction
        return direction * self._one_or_nan_at_rest(link, other, moving)

    def _one_or_nan_at_rest(self, link: int, other: int, moving: int) -> Expr:
        """Return a factor for a pole: 1, or NaN where two links are at relative rest.

        Links at relative rest have no pole axis. Their computed relative velocity is a
        rounding error, which still has a direction. The caller multiplies this direction by
        the factor, so that it becomes NaN.

        Links rest if their relative velocity is less than `NO_MOTION` times a reference
        velocity. The reference is the velocity of the link with the larger index. It is at
        least 1, the rate of the moving input. Runs of an analysis use the same limit.

        Parameters
        ----------
        link, other
            Indices of the two links.
        moving
            Index of the moving input.
        """
        w = self._link_velocities[moving]
        reference_velocity = w[max(link, other)]
        relative_velocity = w[link] - w[other]
        square_limit = NO_MOTION**2 * function(
            "maximum", 1.0, dot(reference_velocity, reference_velocity)
        )
        square = dot(relative_velocity, relative_velocity)
        # For resting links the sign is -1, and its root is NaN. For other links the sign
        # and its root are 1.
        return function("sqrt", sign_of(square - square_limit))

    def _relative_direction(self, link_name: str, other_name: str, moving: int) -> Exprs:
        """Return the axis (3,) of the R pair of two links, or the direction of motion.

        The direction of the motion is the direction of the relative angular velocity
        while one input (`moving`) has the rate 1 and the others rest.
        """
        link = self.mechanism.link(link_name)
        other = self.mechanism.link(other_name)
        variable = self.mechanism.angle_between(link, other)
        if variable is not None:
            return self.coordinate_rates.vectors[variable]
        w = self._link_velocities[moving]
        size = self.coefficient(link_name, other_name, "velocity", moving)
        return (w[link] - w[other]) * (1.0 / size)

    def _rest_together(self, link_name: str, other_name: str, moving: int) -> bool:
        """Return whether two links rest relative to each other at all configurations.

        One input (`moving`) moves while the others rest. Links rest together if the resting
        inputs lock them to each other. The difference of the angular velocities of such
        links is zero as an expression.
        """
        w = self._link_velocities[moving]
        relative_velocity = (
            w[self.mechanism.link(link_name)] - w[self.mechanism.link(other_name)]
        )
        return not any(isinstance(x, ExpressionNode) or x != 0.0 for x in relative_velocity)

    @property
    def _speeds(self) -> Sequence[Expr]:
        """The rates of the inputs (rad/s), a part of the sample."""
        return self.sample_symbols[len(self.inputs) : 2 * len(self.inputs)]

    def torque(self, index: int) -> Expr:
        """Return the torque (N m) that an input needs at the rates of the sample."""
        accelerations = self.sample_symbols[2 * len(self.inputs) : -1]
        return self._needed_torque(index, accelerations)

    def _needed_torque(self, index: int, accelerations: Sequence[Expr]) -> Expr:
        """Return the torque (N m) of an input at given accelerations of all inputs."""
        resistance = self._moments.inertia_torque(index, self._speeds, accelerations)
        return resistance - self.generalized_force(index)

    def free_acceleration(self, index: int) -> Expr:
        """Return the acceleration (rad/s2) of an input while no input has a torque."""
        no_accelerations = [0.0] * len(self.inputs)
        torques = (
            self._needed_torque(k, no_accelerations) for k in range(len(self.inputs))
        )
        return -1.0 * dot(self._inverse_inertia[index], torques)

    def linearised(self, kind: str, index: int, other: int) -> Expr:
        """Return a derivative of an input's acceleration, for linearised equations.

        The motion is linearised about the present sample. Let M be the inertia matrix, a
        the accelerations of the inputs, and T the torques that the motion needs. Small
        changes of the applied torques or of the motion change the accelerations by
        da = M^-1 (dT_applied - dT). Here dT is the change of T at constant accelerations.
        A change of an input angle also changes the other pair angles, so that the loops
        stay closed.

        Parameters
        ----------
        kind
            The derivative with respect to the angle ("A_q"), the rate ("A_dq") or the
            torque ("B_torque") of an input.
        index
            Index of the input that accelerates.
        other
            Index of the input with the angle, rate or torque.
        """
        if kind == "B_torque":
            return self._inverse_inertia[index][other]
        input_count = len(self.inputs)
        torques = [self.torque(k) for k in range(input_count)]
        # The torques are formulas of symbols. To differentiate them, `rates` says how fast
        # each symbol changes.
        if kind == "A_dq":
            # Only the rate of the other input changes. `sample_symbols` has the angles of
            # all inputs, then their rates.
            rate_symbol = self.sample_symbols[input_count + other]
            rates: dict[ExpressionNode, Expr] = {rate_symbol: 1.0}
        else:
            # The angle of the other input changes, and with it the configuration.
            rates = self._symbol_rates(other)
        changes = differentiate(torques, rates)
        return -1.0 * dot(self._inverse_inertia[index], changes)

    def _symbol_rates(self, moving: int) -> dict[ExpressionNode, Expr]:
        """Return the rates of all symbols that change as one input moves at unit rate.

        These symbols are:

        - the angle of the input;
        - the pair (joint) variables, if there are no formulas for them (closed form);
        - the tangent, the point, the curvature and the derivative of the curvature of some
          profiles (contact curves) at their contacts. These symbols are called profile
          columns. They depend on the arc length, which is a pair variable. A mechanism with
          profile columns has no closed form.

        Parameters
        ----------
        moving
            Index of the input.
        """
        # `sample_symbols` begins with the angles of the inputs.
        rates: dict[ExpressionNode, Expr] = {self.sample_symbols[moving]: 1.0}
        if not self.has_closed_form:
            rates |= zip(
                self.configuration_symbols, self._variable_rates[moving], strict=True
            )
        # A side is one of the two profiles of a contact. The rate of a profile column is
        # its derivative with respect to arc length times the rate of the arc length.
        for side in self.structure.pairs.sides_with_symbols:
            # The arc length at which the contact is on this profile is a pair variable.
            arc_length = self.configuration_symbols[side.track.variable]
            speed = rates[arc_length]
            column_rates = (x * speed for x in side.column_derivatives)
            rates |= zip(side.contact_symbols, column_rates, strict=True)
        return rates

    def generalized_force(self, moving: int) -> Expr:
        """Return the generalised force of all loads on an input (N m).

        The generalised force is the power of the loads while this input has the rate 1 and
        the others rest.

        Parameters
        ----------
        moving
            Index of this input.

        Raises
        ------
        ModelError
            If the friction of a load depends on reactions, which are not computed here.
        """
        self._refuse_reaction_friction(moving)
        rates = self.coordinate_rates
        load_state = self._load_state()
        # To avoid divisions, `rates` has the rates times the determinant of the velocity
        # equations, `scale`. The forces that follow from them have the same factor. So the
        # sum of the forces is divided by the determinant.
        forces = (
            component_forces(components, load_state)[moving]
            for components in self._load_components
        )
        return sum(forces, 0.0) / rates.scale

    def _load_state(self) -> LoadState:
        """Return the motion as expressions: everything on which loads can depend."""
        rates = self.coordinate_rates
        # `_angles` gives the angles of passive pairs, which no input drives, without whole
        # revolutions. Loads such as springs also depend on the number of revolutions. It is
        # a symbol in `revolution_symbols`: the angle (rad) of all whole revolutions of a
        # pair.
        angles = self._angles()
        revolutions = {
            self._variable(pair): angle * (1.0 / TURN)
            for pair, angle in self.revolution_symbols.items()
        }
        return LoadState(
            mechanism=self.mechanism,
            placed=rates.placed,  # orientations of all links
            # For each input, the rates of all variables and the angular velocities of all
            # links while this input moves at unit rate, times the determinant of the
            # velocity equations (`scale`), which avoids divisions.
            tau=rates.tau,
            w=rates.w,
            variables=angles,
            revolutions=[revolutions.get(v, 0.0) for v in range(len(angles))],
            # Time derivatives of all variables, without the factor `scale`. `_speeds` are
            # the symbols of the rates of the inputs.
            rates=rates.motion_rates(self._speeds).variable_rates,
            # The symbols of a sample end with the time.
            time=self.sample_symbols[-1],
            # Some loads jump or have a kink where an expression (a condition) is zero. Such
            # loads depend on the sign of the condition.
            sign_of_condition=sign_of,
            # If a table gives a torque, the present torque is a symbol.
            table_torque=self.table_symbols.__getitem__,
        )

    def _refuse_reaction_friction(self, moving: int) -> None:
        """Raise `ModelError` if the friction of a load depends on reactions in pairs.

        The expressions of this class become a kernel, a compiled function that evaluates
        many designs at once. A kernel does not compute reactions, so it cannot compute such
        friction. A run of a design computes both. The message therefore advises to use the
        option `--reduce`, which runs each design and reads the tables of the run.

        Parameters
        ----------
        moving
            Index of the input whose torque is required. The example in the message reads
            this torque from a table.
        """
        # What to read, as the option expects it: "analysis.table: expression". The
        # analysis eksergian is the one for a single input.
        if len(self.inputs) == 1:
            torque = "eksergian.eksergian: abs(tau)"
        else:
            torque = f"dynamics.dynamics: abs(tau_{self.inputs[moving]})"
        check_no_reaction_friction(
            self.mechanism,
            caller="a formula for the torque",
            alternative=f'Either, in a sweep, use --reduce "max({torque})"',
        )

    def _angles(self) -> list[Expr]:
        """Return the angles of R pairs (rad) by variable, and 0 for variables of contacts.

        Loads such as springs depend on these angles. No load depends on variables of
        contacts, so 0 does no harm.
        """
        angles: list[Expr] = [0.0] * len(self.mechanism.variable_owners)
        # `Mechanism.angles` has the index of the variable of each R pair.
        for pair, variable in self.mechanism.angles.items():
            angles[variable] = self.angle(pair)
        return angles

    def _variable(self, pair: str) -> int:
        """Return the index of the (first) variable of a pair."""
        return self.mechanism.variables_of(self.mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the variable (rad) of an R pair.

        In closed form the angles of pairs that are no inputs are in [-pi, pi].
        """
        if pair in self.inputs:
            return self.sample_symbols[self.inputs.index(pair)]
        if not self.has_closed_form:
            return self.variables[self._variable(pair)]
        pair_number = self.mechanism.pair_number[pair]
        return pair_angle(self.structure, pair_number, self._placed)

    def transmission_angle(self, pair: str) -> Expr:
        """Return the transmission angle (rad) of a dyad, a measure of how well it moves.

        A dyad is two links that are joined by the middle one of three pairs (joints). Each
        link is an arc on the sphere. The transmission angle is the acute angle between the
        planes of the two arcs, which meet in the axis of the middle pair.

        Parameters
        ----------
        pair
            Name of the middle pair of a dyad.
        """
        number = self.mechanism.pair_number[pair]
        dyads = (group for group in self.structure.assembly.groups if group.is_dyad)
        # The dyad with this middle pair. There is exactly one.
        (group,) = (dyad for dyad in dyads if dyad.middle == number)
        # Unit vectors (3,) of the three axes of the dyad, in ground axes. `vectors` has for
        # each variable the angular velocity of its pair at unit rate, here the axis.
        dyad_axes = (
            self.coordinate_rates.vectors[self._variable_of_pair(pair_of_dyad)]
            for pair_of_dyad in group.dyad_pairs
        )
        # `COMPONENTS` has the operations on vectors whose components are expressions.
        return transmission_angle(COMPONENTS, *dyad_axes)

    def _variable_of_pair(self, pair_number: int) -> int:
        """Return the index of the (first) variable of a pair with a given index."""
        return self.mechanism.variables_of(pair_number)[0]
