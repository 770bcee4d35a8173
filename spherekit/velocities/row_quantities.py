"""Names and units of the quantities that can be computed for the rows of designs.

A row is one configuration of one design of a mechanism, with rates and accelerations of its
inputs. `spherekit.velocities.design_expressions` computes the quantities.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any, NamedTuple

from spherekit.conventions import Names
from spherekit.errors import CountError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import (
    Assembly,
    driven_at,
    driven_pairs,
    plan_assembly,
)
from spherekit.wording import listing

LINEARISATION_UNITS = {"A_q": "1/s2", "A_dq": "1/s", "B_torque": "1/(kg m2)"}
"""Units of the derivatives of an input's acceleration at given torques: with respect to an
input (A_q), to the rate of an input (A_dq) and to a torque (B_torque)."""


def sample_names(inputs: Sequence[str]) -> Names:
    """Return the names of the values that form a sample of a motion.

    The names are ``q``, ``dq``, ``ddq`` (angle, rate and acceleration of the input; rad, s)
    and ``t`` (the time). With several inputs the names are ``q_PAIR`` for each input, then
    ``dq_PAIR`` for each, then ``ddq_PAIR`` for each, then ``t``.

    Parameters
    ----------
    inputs
        Names of the input pairs.
    """
    endings = [""] if len(inputs) == 1 else [f"_{pair}" for pair in inputs]
    return (*(kind + ending for kind in ("q", "dq", "ddq") for ending in endings), "t")


def row_quantities(mechanism: Mechanism) -> dict[str, str]:
    """Return the quantities that rows of designs have, with the unit of each.

    A row is one configuration of one design of a mechanism. The quantities are:

    - ``q``, ``dq``, ``ddq``, ``t``: the sample, that is the angle, the rate and the
      acceleration of the input, and the time.
    - ``theta_PAIR``, ``rate_PAIR``, ``axis_PAIR_x``: for R pairs the angle, its derivative
      with respect to q, and the axis in ground axes.
    - ``transmission_angle_PAIR``: for the middle pair of a dyad (two links in series).
    - ``orientation_LINK_xy``: row x and column y of the rotation from link to ground axes.
    - ``angular_velocity_LINK_x``, ``angular_velocity_dq_LINK_x``: per unit rate of q, and
      the derivative with respect to q.
    - ``velocity_coefficient_LINK_OTHER``, ``acceleration_coefficient_LINK_OTHER``: the
      relative angular velocity of two links along its axis, per unit rate of q, and its
      derivative with respect to q.
    - ``pole_LINK_OTHER_x``: the unit vector of this axis. NaN if locked inputs hold the
      links together. NaN also in rows in which the links rest relative to each other. If an
      R pair joins the links, its axis is known at rest, too, and is not NaN.
    - ``direction_OUTPUT_x``: for outputs that are directions, in the axes of the reference
      link of the output.
    - ``condition_number_OUTPUT``: with several inputs, the condition number of the
      Jacobian of the output. Its columns are the angular velocities of the output per unit
      rate of each input. If the output is a direction and there are two inputs, the columns
      are the rates of this direction.
    - ``jacobian_determinant_OUTPUT``: the determinant of this Jacobian. It exists if there
      are three inputs, or two inputs and an output that is a direction.
    - ``determinant`` of the velocity equations: 0 if the inputs do not determine the rates
      of all variables.

    With masses:

    - ``B``, ``dB_dq``: the equivalent inertia, which is twice the kinetic energy at unit
      rate of the input, and its derivative.
    - ``kinetic_energy``.
    - ``torque``: the driving torque of the sample's motion.
    - ``free_acceleration``: the acceleration of the input without a torque.
    - ``A_q``, ``A_dq``, ``B_torque``: the derivatives of the acceleration of the input
      with respect to q, to dq and to the torque, while the other two are constant.

    With masses or loads:

    - ``generalized_force``: the power of the loads per unit rate of the input.

    With several inputs, names of quantities that depend on the moving input end in
    ``_by_PAIR``. Inertias are ``B_PAIR_by_PAIR``, and ``free_acceleration_PAIR`` is the
    acceleration of one input while no input has a torque.
    """
    inputs = mechanism.names_of(driven_pairs(mechanism))
    table = make_quantity_table(mechanism, inputs, _plan_groups(mechanism))
    return {name: quantity.unit for name, quantity in table.items()}


@dataclass(frozen=True)
class RowQuantity:
    """Says how a quantity of a configuration, such as a velocity, is computed.

    A row is one configuration of one design of the mechanism. A kernel (compiled functions)
    evaluates expressions of the quantities for many rows.

    Attributes
    ----------
    unit
        Unit of the quantity, empty for a pure number.
    method
        Name of the method of `DesignExpressions` that returns the expression of the
        quantity.
    arguments
        The arguments of this method.
    component
        Index of the component, if the method returns a vector. Otherwise None.
    """

    unit: str
    method: str
    arguments: tuple[Any, ...]
    component: int | None = None

    @property
    def meaning(self) -> str:
        """The method, then the links and pairs among its arguments, for messages."""
        method = self.method.replace("_", " ")
        names = [x for x in self.arguments if isinstance(x, str) and x]
        return f"{method} ({listing(names)})" if names else method


class QuantityTable(dict[str, RowQuantity]):
    """Declarations of all quantities that can be computed for a configuration, by name.

    A row is one configuration of one design of the mechanism, with the rates and
    accelerations of its inputs. Methods of `DesignExpressions` compute the quantities.
    """

    def add(
        self,
        name: str,
        unit: str,
        method: str,
        *arguments: Any,
        component: int | None = None,
    ) -> None:
        """Add a quantity with its unit and the method that computes it.

        Names of links and pairs can contain underscores, so two quantities can have the
        same name. An example is ``pole_1_2_3_x``, which can be links "1" and "2_3", or
        "1_2" and "3". Adding both quantities raises no error, but asking for the name does.

        Parameters
        ----------
        name
            Name of the quantity.
        unit
            Its unit, empty for a pure number.
        method, arguments
            Name and arguments of the method of `DesignExpressions` that returns the
            expression of the quantity.
        component
            Index of the component (0 to 2) if the method returns a vector.
        """
        quantity = RowQuantity(unit, method, arguments, component)
        other = self.get(name)
        if other is None:
            self[name] = quantity
        elif other.method != "refuse_ambiguous_name":
            # The quantity becomes a method that raises an error with the meanings of both.
            # Further quantities with this name do not change the error.
            meanings = (name, other.meaning, quantity.meaning)
            self[name] = RowQuantity(unit, "refuse_ambiguous_name", meanings)

    def add_vector(
        self, name: str, unit: str, method: str, *arguments: Any, ending: str = ""
    ) -> None:
        """Add the components x, y and z of a vector to the table, as three quantities.

        Their names are `name`, then ``_x``, ``_y`` or ``_z``, then `ending`. The other
        parameters are the same as in `add`.
        """
        for index, axis in enumerate("xyz"):
            self.add(f"{name}_{axis}{ending}", unit, method, *arguments, component=index)


class MovingInput(NamedTuple):
    """An input that moves at unit rate while the other inputs rest.

    Attributes
    ----------
    name_ending
        The ending of the names of quantities that depend on this input: ``_by_21`` for
        the input at pair 21. It is empty in a mechanism with one input.
    position
        Its position among the inputs.
    """

    name_ending: str
    position: int


def make_quantity_table(
    mechanism: Mechanism, inputs: Sequence[str], assembly: Assembly
) -> QuantityTable:
    """Return the table of all quantities that can be computed for rows of a mechanism.

    A row is one configuration with the rates and accelerations of its inputs. For example,
    ``theta_32`` is the angle of pair 32. If there are several inputs, ``rate_32_by_21`` is
    the rate of this angle per unit rate of the input at pair 21. For each name the table
    has the unit, and the method of `DesignExpressions` that computes the quantity, with its
    arguments.

    Parameters
    ----------
    mechanism
        The mechanism.
    inputs
        Names of its input pairs.
    assembly
        Its groups: sets of links that are closed together, one group after another.
    """
    table = QuantityTable()
    # The sample: angles, rates and accelerations of all inputs, then the time.
    sample_units = [unit for unit in ("rad", "rad/s", "rad/s2") for _ in inputs]
    for index, (name, unit) in enumerate(
        zip(sample_names(inputs), [*sample_units, "s"], strict=True)
    ):
        table.add(name, unit, "sample_variable", index)
    # With one input, names do not say which input moves.
    has_one_input = len(inputs) == 1
    moving_inputs = [
        MovingInput("" if has_one_input else f"_by_{pair}", position)
        for position, pair in enumerate(inputs)
    ]
    _add_kinematic_quantities(table, mechanism, moving_inputs, assembly)
    _add_output_quantities(table, mechanism, len(inputs))
    table.add("determinant", "", "determinant")
    if mechanism.masses or mechanism.loads:
        for ending, moving in moving_inputs:
            table.add(f"generalized_force{ending}", "N m", "generalized_force", moving)
    if mechanism.masses:
        _add_dynamic_quantities(table, inputs, moving_inputs)
    return table


def _add_kinematic_quantities(
    table: QuantityTable,
    mechanism: Mechanism,
    moving_inputs: Sequence[MovingInput],
    assembly: Assembly,
) -> None:
    """Add the angles, rates, velocities and poles of pairs (joints) and links to a table.

    Each call of `add` states a name, its unit, a method of `DesignExpressions` and the
    arguments of this method. `add_vector` adds three components.

    Parameters
    ----------
    table
        The table, which is changed in place.
    mechanism, assembly
        The mechanism, and the groups of links that are placed one after another. A group
        of two links joined by a pair is a dyad, with a transmission angle at this pair.
    moving_inputs
        The inputs. Some quantities depend on which input moves. Their names have the ending
        of this input, such as ``_by_21`` for the input at pair 21. With one input, the
        ending is empty.
    """
    links = mechanism.links
    revolute_pairs = [pair.name for pair in mechanism.pairs if pair.kind.has_axis]
    for pair in revolute_pairs:
        table.add(f"theta_{pair}", "rad", "angle", pair)
    for pair, (ending, moving) in product(revolute_pairs, moving_inputs):
        table.add(f"rate_{pair}{ending}", "", "rate", pair, moving)
    for pair in _middle_pair_names(mechanism, assembly):
        table.add(f"transmission_angle_{pair}", "rad", "transmission_angle", pair)
    # The motion of each link relative to each other link, for each moving input. Rates are
    # per unit rate of this input, so velocity coefficients have no unit.
    relative_motions = [*product(permutations(links, 2), moving_inputs)]
    for kind, unit in (("velocity", ""), ("acceleration", "1/rad")):
        for (link, reference), (ending, moving) in relative_motions:
            name = f"{kind}_coefficient_{link}_{reference}{ending}"
            table.add(name, unit, "coefficient", link, reference, kind, moving)
    for pair in revolute_pairs:
        table.add_vector(f"axis_{pair}", "", "axis", pair)
    for (link, reference), (ending, moving) in relative_motions:
        name = f"pole_{link}_{reference}"
        table.add_vector(name, "", "pole", link, reference, moving, ending=ending)
    for link, (row, column) in product(links, product(range(3), repeat=2)):
        name = f"orientation_{link}_{'xyz'[row]}{'xyz'[column]}"
        table.add(name, "", "orientation", link, row, column)
    # The angular velocity per unit rate of the moving input, and ("_dq") the derivative of
    # this velocity with respect to the angle of the input.
    for link, (ending, moving) in product(links, moving_inputs):
        for kind, unit in (("", ""), ("_dq", "1/rad")):
            name = f"angular_velocity{kind}_{link}"
            table.add_vector(
                name, unit, "angular_velocity", kind, link, moving, ending=ending
            )


def _add_output_quantities(
    table: QuantityTable, mechanism: Mechanism, input_count: int
) -> None:
    """Add the quantities of outputs to a table, which is changed in place.

    An output is the orientation of a link relative to another one, or a direction fixed in
    this link (a pointing output). Its Jacobian has a column (3,) for each input. The column
    is the angular velocity of the link, or with two inputs and a pointing output, the rate
    of the direction. With one input no condition number is added, because that of a single
    column is always 1.

    With three inputs, the determinant is that of the three columns. With two inputs and a
    pointing output, it is that of the two columns and the direction. Its absolute value is
    the area of the parallelogram of the two columns. In other cases there is none.

    Parameters
    ----------
    table
        The table. Each call of `add` states a name, a unit (here none), a method of
        `DesignExpressions` and its arguments.
    mechanism
        The mechanism with its outputs.
    input_count
        Number of inputs.
    """
    for output in mechanism.outputs:
        is_pointing = output.direction is not None
        if is_pointing:
            table.add_vector(f"direction_{output.name}", "", "direction", output.name)
        if input_count != 1:
            name = f"condition_number_{output.name}"
            table.add(name, "", "condition_number", output.name)
        if input_count == 3 or (input_count == 2 and is_pointing):
            name = f"jacobian_determinant_{output.name}"
            table.add(name, "", "jacobian_determinant", output.name)


def _add_dynamic_quantities(
    table: QuantityTable,
    inputs: Sequence[str],
    moving_inputs: Sequence[MovingInput],
) -> None:
    """Add the quantities that depend on masses to a table.

    The quantities are the inertia matrix, driving torques, accelerations of inputs without
    torques (``free_acceleration``), derivatives of accelerations, and the kinetic energy.
    Each call of `add` states a name, its unit, a method of `DesignExpressions` and the
    arguments of this method. A name ends in the pair of its input. A matrix has two
    endings: the row, then the column.

    Parameters
    ----------
    table
        The table, which is changed in place.
    inputs
        Names of the input pairs.
    moving_inputs
        For each input an ending of names, such as ``_by_21`` for the input at pair 21, and
        its index. With one input, the ending is empty.
    """
    has_one_input = len(inputs) == 1
    # With one input, the inertia is the equivalent inertia B: twice the kinetic energy at
    # unit rate of the input. With several inputs, the inertia is a matrix with entries
    # B_PAIR_by_PAIR.
    for (row, pair), (ending, column) in product(enumerate(inputs), moving_inputs):
        name = "B" if has_one_input else f"B_{pair}{ending}"
        table.add(name, "kg m2", "inertia", row, column)
    # The derivative dB/dq is a quantity only if there is a single input.
    if has_one_input:
        table.add("dB_dq", "kg m2/rad", "inertia_rate")
    for ending, moving in moving_inputs:
        table.add(f"torque{ending}", "N m", "torque", moving)
    for index, pair in enumerate(inputs):
        pair_ending = "" if has_one_input else f"_{pair}"
        name = f"free_acceleration{pair_ending}"
        table.add(name, "rad/s2", "free_acceleration", index)
        # The equation of motion is linearised. The acceleration of this input has
        # derivatives with respect to the angle (A_q), the rate (A_dq) and the torque
        # (B_torque) of each input.
        for (kind, unit), (ending, other) in product(
            LINEARISATION_UNITS.items(), moving_inputs
        ):
            name = f"{kind}{pair_ending}{ending}"
            table.add(name, unit, "linearised", kind, index, other)
    table.add("kinetic_energy", "J", "kinetic_energy")


def middle_pairs(mechanism: Mechanism) -> Names:
    """Return the pairs with a ``transmission_angle``: those in the middle of dyads."""
    return _middle_pair_names(mechanism, _plan_groups(mechanism))


def _plan_groups(mechanism: Mechanism) -> Assembly:
    """Return the groups of a mechanism from its graph of links and pairs alone.

    A group is a set of links that are closed together, such as a dyad.

    Names of quantities do not depend on sizes, so no configuration is computed. If counting
    links and pairs gives too few degrees of freedom, the groups are planned as if the rank
    of the equations had shown enough.
    """
    try:
        return plan_assembly(mechanism)
    except CountError:
        return plan_assembly(driven_at(mechanism), by_rank=True)


def _middle_pair_names(mechanism: Mechanism, assembly: Assembly) -> Names:
    """Return the names of the middle pairs of all dyads, in solving order."""
    dyads = (group for group in assembly.groups if group.is_dyad)
    return tuple(mechanism.names_of(group.middle for group in dyads))
