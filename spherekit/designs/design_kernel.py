"""Functions that evaluate quantities of all designs of one topology at once.

The sizes of the designs are arguments of these functions. A column of their arguments is
one sample of one design in one assembly mode. Everything that depends only on the sizes is
computed once for each design (`prepare`) and not again at every sample (`evaluate`).
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.mechanism.load import TorqueTable
from spherekit.symbolic.compiler import available
from spherekit.symbolic.expression_evaluation import ArrayFunction, array_function
from spherekit.symbolic.expression_function import expression_function
from spherekit.symbolic.expression_graph import (
    Expr,
    dot,
    function,
    iterate_nodes,
    separate_constant_parts,
)
from spherekit.symbolic.vector_algebra import Exprs, constants, cross
from spherekit.velocities.design_expressions import DesignExpressions

MAX_LOOP_RESIDUAL = 1e-9
"""Largest error of the rates in the equations of a loop, relative to the rates.

Larger: rates have fewer digits. Smaller: rows near singular configurations, where some
digits are lost, have no rates.
"""


class DesignKernel:
    """Functions that compute quantities of many designs, samples and modes at once.

    Designs differ in sizes. An assembly mode is one way to assemble the links. `prepare`
    takes the sizes (sizes, n) of n designs. It returns (k, n) numbers that depend only on
    the sizes, so that these numbers are not computed again at every sample.

    `evaluate` takes one array, whose rows are these arguments in this order:

    1. the sample: inputs, their rates and accelerations, and the time (`sample_names`),
    2. the `position_arguments`,
    3. the numbers of the profiles of contacts, if these are not circles,
    4. the multiples of 2 pi (rad) to add to the angles of the `unwrapped_pairs`,
    5. what `prepare` returns.

    It returns these outputs, the last two of them only if they were requested:

    1. the `reach_count` numbers, which are not negative if every dyad (two links with
       three R pairs) closes,
    2. the `columns`,
    3. their derivatives with respect to each size, then each number of the profiles except
       the second derivative of the curvature (`gradients`),
    4. how much the rates violate the equations of the loops
       (`DesignExpressions.relative_loop_residual`).

    Parameters
    ----------
    expressions
        The mechanism as expressions of sizes, samples and position arguments.
    columns
        Names of quantities, as in `row_quantities`.
    gradients
        Whether derivatives of the columns with respect to the sizes and profiles are
        computed. The loops stay closed while these change.
    compiled
        Whether heyoka compiles the functions, if it is installed. Functions that are not
        compiled run on NumPy arrays.
    with_loop_residual
        Whether the kernel computes by how much the rates violate the equations of the
        loops.

    Attributes
    ----------
    position_arguments
        Variables that determine the positions of the links at a sample. In closed form they
        are the signs of the dyads, otherwise the variables of all pairs (rad).
    unwrapped_pairs
        Names of the pairs whose revolutions matter, because loads depend on them.
    prepare
        The function of sizes, see above.

    Raises
    ------
    EngineError
        If the mechanism does not have one of the quantities, or there are no `gradients`.
    """

    def __init__(
        self,
        expressions: DesignExpressions,
        columns: Sequence[str],
        gradients: bool = False,
        compiled: bool = True,
        with_loop_residual: bool = False,
    ) -> None:
        """Make the functions `prepare` and `evaluate` from the expressions."""
        outputs = [expressions.quantity(name) for name in columns]
        if gradients:
            outputs += [
                slope
                for slopes in expressions.differentiate_by_sizes(outputs)
                for slope in slopes
            ]
        if with_loop_residual:
            outputs.append(expressions.relative_loop_residual())
        self.position_arguments = expressions.configuration_symbols
        self.columns = tuple(columns)
        self.is_closed_form = expressions.has_closed_form
        self._is_compiled = compiled and available()

        # Only revolutions and tables on which the outputs depend become arguments.
        used_nodes = set(iterate_nodes(outputs))
        revolution_offsets = {
            pair: offset
            for pair, offset in expressions.revolution_symbols.items()
            if offset in used_nodes
        }
        self.unwrapped_pairs = tuple(revolution_offsets)
        # Torques that are tabulated over time are interpolated outside the expressions.
        table_torques = {
            name: torque
            for name, torque in expressions.table_symbols.items()
            if torque in used_nodes
        }
        self._torque_tables = [
            load
            for load in expressions.mechanism.loads
            if isinstance(load, TorqueTable) and load.name in table_torques
        ]
        self._time_row = len(expressions.sample_symbols) - 1

        # Arguments that differ from row to row of the same design.
        moving = [
            *expressions.sample_symbols,
            *expressions.configuration_symbols,
            *expressions.profile_symbols,
            *revolution_offsets.values(),
        ]
        passive_angles = [expressions.angle(pair) for pair in revolution_offsets]
        # `prepared` are the parts of the expressions that depend only on the sizes. The
        # `triple_squares` are negative where a dyad does not close.
        self._output_expressions, prepared = separate_constant_parts(
            [*expressions.triple_squares, *outputs, *passive_angles],
            [*table_torques.values(), *moving],
        )
        self._arguments = [*moving, *prepared]
        self._square_count = len(expressions.triple_squares)
        self._output_end = self._square_count + len(outputs)
        self.prepare = expression_function(
            [*prepared.values()], expressions.size_symbols, self._is_compiled
        )
        self._evaluate = expression_function(
            self._output_expressions[: self._output_end],
            [*table_torques.values(), *self._arguments],
            self._is_compiled,
        )

    def evaluate(self, rows: Floats) -> Floats:
        """Return the outputs (outputs, n) at arguments (arguments, n), see the class."""
        torques = [table.at(rows[self._time_row])[None] for table in self._torque_tables]
        return self._evaluate(np.concatenate([*torques, rows]) if torques else rows)

    @cached_property
    def evaluate_angles(self) -> ArrayFunction:
        """Function that returns angles (rad) of passive pairs, without whole revolutions.

        It takes the arguments of `evaluate` and ignores the revolution offsets. It returns
        the `reach_count` numbers, which are not negative if the dyads close, then the
        variables of the `unwrapped_pairs`. From these angles the revolution offsets are
        found.
        """
        # `_output_expressions`: reach numbers, then outputs of `evaluate`, then the angles.
        reach_numbers = self._output_expressions[: self._square_count]
        passive_angles = self._output_expressions[self._output_end :]
        return expression_function(
            [*reach_numbers, *passive_angles], self._arguments, self._is_compiled
        )

    @property
    def reach_count(self) -> int:
        """Number of outputs of `evaluate` that tell whether the links close.

        They come before the requested quantities. In closed form there is one for each
        dyad, which is negative if the dyad does not close. Without a closed form there are
        none.
        """
        return len(self.position_arguments) if self.is_closed_form else 0

    def evaluate_samples(
        self,
        samples: Floats,
        position_arguments: Floats,
        sizes: Floats,
        profile_columns: Floats | None = None,
        revolution_offsets: Floats | None = None,
    ) -> Floats:
        """Return quantities of designs at samples of the inputs, from their sizes.

        A design is a mechanism with values for its sizes. `evaluate` needs all arguments in
        one array, with numbers that `prepare` computes from the sizes. `evaluate_samples`
        puts the array together.

        Parameters
        ----------
        samples
            (3 * inputs + 1, n) inputs (rad), their rates (rad/s) and accelerations
            (rad/s2), and the time (s).
        position_arguments
            (w, n) numbers that determine the positions of the links at each sample. In
            closed form they are the signs of the dyads (two links with three revolute
            pairs, which can be assembled in two ways). Without a closed form, the numbers
            are the variables of all pairs (rad).
        sizes
            (sizes, n) sizes of the design of each sample, or (sizes, 1) if all samples
            belong to one design.
        profile_columns
            (9 * profiles, n) geometry of the contact profiles at their contact points:
            tangent (3), point (3), curvature and its first two derivatives. None if
            profiles are circles.
        revolution_offsets
            (unwrapped pairs, n) multiples of 2 pi (rad) that are added to angles in (-pi,
            pi]. The angles belong to pairs for which loads depend on whole revolutions. By
            default zero.

        Returns
        -------
        (outputs, n) outputs of `evaluate`. NumPy does not warn of NaN or infinite values.
        """
        count = samples.shape[1]
        arguments = [samples, position_arguments]
        if profile_columns is not None:
            arguments.append(profile_columns)
        if revolution_offsets is None:
            revolution_offsets = np.zeros((len(self.unwrapped_pairs), count))
        arguments.append(revolution_offsets)
        prepared = self.prepare(sizes)
        arguments.append(np.broadcast_to(prepared, (len(prepared), count)))
        with np.errstate(all="ignore"):
            return self.evaluate(np.concatenate(arguments))


class KernelOutputs(NamedTuple):
    """Outputs of one of the kernels of a `RedundantKernel`, at n configurations.

    A kernel is a function that computes quantities of a mechanism at many configurations.
    With redundant constraints, the loops give more velocity equations than are independent.
    Each kernel solves another choice of these equations for the rates of the pairs
    (joints). At each configuration the kernel with the smallest residual is used.

    Attributes
    ----------
    columns
        (columns, n) the quantities that were requested when the kernel was made.
    residual
        (n,) by how much the rates violate the velocity equations of all loops, relative to
        the rates.
    """

    columns: Floats
    residual: Floats


class RedundantKernel:
    """Computes quantities of one design with redundant constraints, like `DesignKernel`.

    Rates follow from independent equations, which are chosen at a configuration. At another
    configuration the chosen equations may depend on each other. Therefore there is a kernel
    (function of many samples) for each choice.

    Each sample is taken from the kernel whose rates violate the equations of all loops
    least. Quantities that follow from rates are NaN if every kernel exceeds
    `MAX_LOOP_RESIDUAL`.

    Parameters
    ----------
    expressions
        Expressions of the same design, as functions of the variables of pairs. Their
        equations are chosen at configurations of different modes.
    columns
        Names of quantities, as in `row_quantities`.
    """

    def __init__(
        self, expressions: Sequence[DesignExpressions], columns: Sequence[str]
    ) -> None:
        """Create functions (kernels) for a design with redundant constraints.

        The loops of links then give more equations for the rates than are independent. Each
        kernel solves some independent ones. At some configurations its rates violate the
        other equations, and another kernel must be used.

        Parameters
        ----------
        expressions
            The quantities as expressions. Each item solves the equations that were
            independent at one configuration.
        columns
            Names of the quantities to compute.
        """
        # (columns,) whether the quantity follows from rates. If so, it is taken from the
        # kernel with the least error of the rates. Others are the same in every kernel.
        self._follows_from_rates = _find_rate_columns(expressions[0], columns)
        # One kernel is enough for items that solve the same equations.
        distinct_expressions = _select_distinct_choices(expressions)
        self._kernels = [
            DesignKernel(
                chosen,
                columns,
                # For a single design, compiling would take longer than it saves.
                compiled=False,
                # The last output tells by how much the rates violate the equations of all
                # loops.
                with_loop_residual=True,
            )
            for chosen in distinct_expressions
        ]
        # `prepare` computes what depends only on variable sizes. One design has no variable
        # sizes, so one call is enough.
        no_sizes = np.empty((0, 1))
        self._prepared = [kernel.prepare(no_sizes) for kernel in self._kernels]

    @property
    def unwrapped_pairs(self) -> tuple[str, ...]:
        """Names of the pairs on whose whole revolutions loads depend.

        All kernels of the design have the same pairs.
        """
        return self._kernels[0].unwrapped_pairs

    @property
    def reach_count(self) -> int:
        """Number of outputs that tell whether the links close: none.

        Only a kernel that computes positions in closed form has such outputs.
        """
        return 0

    def prepare(self, sizes: Floats) -> Floats:
        """Return an empty array (0, n): the one design was prepared by the constructor."""
        return np.empty((0, sizes.shape[1]))

    def evaluate(self, rows: Floats) -> Floats:
        """Return the columns (quantities) of one design at n configurations.

        With redundant constraints, the loops give more equations for the rates than are
        independent. Each kernel (function of configurations) solves a selection of these
        equations. At some configurations the selected equations become dependent, and the
        rates violate the others. So each configuration takes the kernel with the smallest
        violation.

        Parameters
        ----------
        rows
            (arguments, n) arguments 1 to 4 of `DesignKernel.evaluate`. For example, they
            contain the inputs and the pair variables (rad).

        Returns
        -------
        (columns, n) quantities. Those that follow from rates are NaN where no kernel
        satisfies the equations of all loops to `MAX_LOOP_RESIDUAL`.
        """
        # `_prepared` has the numbers of each kernel that do not depend on configurations.
        outputs_of_kernels = [
            self._evaluate_kernel(kernel, prepared, rows)
            for kernel, prepared in zip(self._kernels, self._prepared, strict=True)
        ]
        columns = np.full((len(self._follows_from_rates), rows.shape[1]), np.nan)
        # Columns that follow only from positions are the same in every kernel. They are
        # taken from the last one.
        is_independent = ~self._follows_from_rates
        columns[is_independent] = outputs_of_kernels[-1].columns[is_independent]

        # Choose the kernel of the other columns, for each configuration.
        rate_columns = np.flatnonzero(self._follows_from_rates)
        smallest_residual = np.full(rows.shape[1], np.inf)
        for outputs in outputs_of_kernels:
            is_better = outputs.residual < smallest_residual
            is_allowed = outputs.residual <= MAX_LOOP_RESIDUAL
            chosen = np.flatnonzero(is_better & is_allowed)
            smallest_residual[chosen] = outputs.residual[chosen]
            for k in rate_columns:
                columns[k, chosen] = outputs.columns[k, chosen]
        return columns

    def _evaluate_kernel(
        self, kernel: DesignKernel, prepared: Floats, rows: Floats
    ) -> KernelOutputs:
        """Return the quantities of one kernel (function) at n configurations.

        The loops of links give more equations than are needed to determine the rates of
        pairs. Each kernel of the design solves another selection of these equations. The
        last output of a kernel is the residual of all equations, which shows whether the
        selection was good.

        Parameters
        ----------
        kernel
            One of the kernels of the design.
        prepared
            (k, 1) arguments of this kernel that follow only from the sizes.
        rows
            (arguments, n) the other arguments, for example inputs and pair variables (rad).
        """
        # The sizes are the same at all configurations.
        repeated = np.broadcast_to(prepared, (len(prepared), rows.shape[1]))
        outputs = kernel.evaluate(np.concatenate([rows, repeated]))
        return KernelOutputs(columns=outputs[:-1], residual=outputs[-1])


def _find_rate_columns(expressions: DesignExpressions, columns: Sequence[str]) -> Bools:
    """Return a mask of the columns (quantities) that follow from rates of pairs (joints).

    The equations of the rates can be chosen in several ways, with a kernel for each. The
    caller takes these columns from the kernel with the least error of the rates. Other
    columns are the same in every kernel.

    The rates solve linear equations. By Cramer's rule they are quotients with the
    determinant of the equations as denominator. So a quantity depends on rates if its
    expression contains this determinant.

    Parameters
    ----------
    expressions
        The quantities of a design as expressions.
    columns
        Names of quantities.

    Returns
    -------
    (columns,) mask.
    """
    determinant = expressions.coordinate_rates.scale
    follows_from_rates = []
    for name in columns:
        # All subexpressions of the quantity.
        nodes = set(iterate_nodes([expressions.quantity(name)]))
        follows_from_rates.append(determinant in nodes)
    return np.array(follows_from_rates, bool)


def _select_distinct_choices(
    expressions: Sequence[DesignExpressions],
) -> list[DesignExpressions]:
    """Return expressions that solve different equations for the rates, without repetition.

    With redundant constraints, there are more equations for the rates than independent
    ones. Each item of `expressions` solves the equations that were chosen as independent at
    one configuration. The caller makes a kernel (function of configurations) from each
    returned item. For items with the same chosen equations one kernel is enough, so only
    the first of them is returned.
    """
    expressions_by_choice: dict[str, DesignExpressions] = {}
    for candidate in expressions:
        # A group is a set of links whose positions are found together. Some of its
        # variables occur in one loop only. These private variables are eliminated from the
        # equations first. Independent equations are then chosen from the remaining ones.
        choice = repr(
            [
                (group.private_variables, group.chosen_equations)
                for group in candidate.structure.groups
            ]
        )
        expressions_by_choice.setdefault(choice, candidate)
    return list(expressions_by_choice.values())


def arc_function(expressions: DesignExpressions) -> tuple[tuple[int, ...], ArrayFunction]:
    """Return a function that computes the arcs of links from the sizes of designs.

    The arc of a link with two axes is the angle between them.

    Parameters
    ----------
    expressions
        The mechanism as symbolic expressions of its sizes.

    Returns
    -------
    links
        Indices of the links with two axes.
    function
        Function of sizes (sizes, n) that returns the arcs (links, n), in [0, pi] rad.
    """
    mechanism = expressions.mechanism
    pairs = expressions.structure.pairs
    # The axes (unit vectors) of each link, in axes of the link.
    axes_by_link: dict[int, list[Exprs]] = {k: [] for k in range(len(mechanism.links))}
    for pair, joined_links in enumerate(mechanism.ends):
        is_contact = pair in pairs.sides  # a contact has profiles and no axes
        if is_contact:
            continue
        for link, axis in zip(joined_links, pairs.axes(pair), strict=True):
            # Components may be numbers or expressions of sizes. `constants` rounds numbers
            # near 0, 1 or -1, which simplifies products. Expressions stay as they are.
            axes_by_link[link].append(constants(axis))
    links = []
    arcs: list[Expr] = []
    for link, axes in axes_by_link.items():
        if len(axes) == 2:
            first, second = axes
            # arc = atan2(|a x b|, a . b), accurate for small arcs too.
            normal = cross(first, second)
            sine = np.sqrt(dot(normal, normal))
            links.append(link)
            arcs.append(function("atan2", sine, dot(first, second)))
    return tuple(links), array_function(arcs, expressions.size_symbols)
