"""All printed formulas of a mechanism of dyads: positions, coefficients, torques.

Each formula gives a quantity from quantities in earlier formulas, as in a paper (Di
Gregorio 2024).
"""

from collections.abc import Collection, Sequence
from typing import Any

from spherekit.arrays import Floats
from spherekit.exchange.latex_coefficients import CoefficientFormulas
from spherekit.exchange.latex_equation_of_motion import LatexEquationOfMotion
from spherekit.exchange.latex_formula_list import FormulaList
from spherekit.exchange.latex_positions import PositionFormulas
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.pole_plan import Plan
from spherekit.planning.pole_planner import plan
from spherekit.symbolic.expression_graph import ExpressionNode


class LatexFormulas:
    """The formulas of a mechanism that is given by the sizes of its links.

    Parameters
    ----------
    mechanism
        A mechanism of R pairs in which all links that are not driven form dyads. A dyad is
        two links that close a loop between known axes.
    ground_axes
        (3, 3) matrix whose columns are the axes i, j, k of the ground.
    free_sizes
        Numbers that stay symbols whatever their values. A number is ("arcs", (link, pair)),
        an arc of a link; ("angles", (link, pair)), an angle between two of its arcs;
        ("zeros", pair), the angle of a pair at which its variable reads zero; or ("mass",
        link). Links and pairs are given by names.

    Attributes
    ----------
    mechanism
        The mechanism.
    formula_list
        Formulas, meanings of symbols, and the quantities that users may ask for.
    positions
        Symbols of the positions.
    inputs
        Numbers of the driven pairs.
    input_suffixes
        For each input the text that ends the names of derivatives with respect to this
        input; empty if there is only one input.
    pole_plans
        For each input the plan of the poles (axes of relative rotations) while it moves.
    omitted_loads
        Names of loads that are left out, because their friction depends on reaction forces.
    free_symbols
        Symbols of the free sizes and masses.

    Raises
    ------
    EngineError
        If there is no closed form, a link has only one axis, an arc is 0 or 180 degrees or
        signed, or an input is on a link that no other inputs join to the ground.
    """

    def __init__(
        self, mechanism: Mechanism, ground_axes: Floats, free_sizes: Collection[Any]
    ) -> None:
        """Write all formulas: positions, poles and velocity coefficients, then torques.

        A pole is the axis of the relative rotation of two links. The velocity coefficient
        of a pole is the relative angular velocity of its links per unit rate of an input.

        Parameters
        ----------
        mechanism
            A mechanism of R pairs whose links follow from its inputs by dyads (two links
            that close a loop between known axes).
        ground_axes
            (3, 3) matrix whose columns are the axes i, j, k of the ground.
        free_sizes
            Keys of numbers in the mechanism file, such as ("zeros", name of a pair). These
            numbers are printed as symbols whatever their values, so that users can insert
            other values.
        """
        self.mechanism = mechanism
        assembly = plan_assembly(mechanism)
        self.inputs = assembly.inputs
        input_names = mechanism.names_of(self.inputs)
        self.formula_list = FormulaList(mechanism, len(input_names))
        # With several inputs, each derivative is with respect to one input while the others
        # are locked. The name of the derivative ends in the name of this input.
        self.input_suffixes = [""]
        if len(input_names) > 1:
            self.input_suffixes = [f"_by_{name}" for name in input_names]

        # Each of the following objects adds its formulas to `formula_list` when it is made,
        # and has the symbols that later formulas contain.
        self.positions = PositionFormulas(
            self.formula_list, mechanism, assembly, ground_axes, free_sizes
        )
        self.pole_plans: Sequence[Plan] = [
            plan(mechanism, poles=None, input_pair=name)  # all poles
            for name in input_names
        ]
        coefficients = CoefficientFormulas(
            self.formula_list,
            mechanism,
            self.positions,
            self.pole_plans,
            self.input_suffixes,
        )
        # Names of loads without a formula.
        self.omitted_loads: Sequence[str] = []
        # Symbols of the free sizes; the equation of motion adds the symbols of inertia
        # tensors.
        self.free_symbols: dict[Any, ExpressionNode] = {**self.positions.free_symbols}
        if mechanism.masses or mechanism.loads:
            self.formula_list.section = "Equation of motion"
            equation_of_motion = LatexEquationOfMotion(
                self.formula_list,
                mechanism,
                self.positions,
                coefficients,
                self.input_suffixes,
                free_sizes,
            )
            self.omitted_loads = equation_of_motion.omitted_loads
            self.free_symbols |= equation_of_motion.free_symbols
