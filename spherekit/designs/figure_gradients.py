"""Figures of merit of a design, with exact derivatives with respect to its variables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.design_evaluation import DesignEvaluator
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.synthesis_modes import SynthesisMode
from spherekit.designs.varied_mechanism import DesignPoint
from spherekit.geometry.vectors import all_finite, nans
from spherekit.runs.reductions import sample_weights
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import ArrayFunction, array_function
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    symbols,
)
from spherekit.symbolic.parsed_expressions import convert_to_graph


@dataclass(frozen=True)
class FigureValues:
    """Figures of merit of a design in one assembly mode, with their derivatives.

    A figure of merit is a number that rates a design (choice of sizes). It reduces the
    values of an expression at samples of the motion to one number, such as their maximum
    (the reduction ``"max"``). An assembly mode is one way to assemble the mechanism.

    Attributes
    ----------
    figures
        (figures,) figures in rad and SI units; NaN if the design is impossible or its
        configurations in this mode cannot be computed.
    gradients
        (figures, variables) derivatives with respect to the design variables, each variable
        in the unit in which the mechanism file states it. NaN if the figure is an input,
        such as the input at which the expression is least (the reduction ``"argmin"``).
    closing_fraction
        Fraction of the samples of the inputs at which the mechanism can be assembled in
        this mode.
    """

    figures: Floats
    gradients: Floats
    closing_fraction: float


class FigureGradients:
    """Computes figures of merit of a design, and derivatives with respect to its variables.

    Syntheses minimise figures of merit with these gradients. The derivative of a smallest
    or largest value is the derivative at the sample where this value occurs. Where two
    samples have the extreme value, the derivative of one of them is taken.

    Parameters
    ----------
    evaluator
        An evaluator of designs that has gradients.
    """

    def __init__(self, evaluator: DesignEvaluator) -> None:
        """Make functions of the quantities and figures, with their derivatives."""
        self.evaluator = evaluator
        figures = evaluator.figures
        self._kernel = DesignKernel(
            evaluator.varied_mechanism.make_expressions(), figures.columns, gradients=True
        )
        quantities = symbols([*figures.sample_names, *figures.columns])
        # `convert_to_graph` requires two nodes for each name, with and without whole
        # revolutions. Here the two nodes are equal.
        named = {node.arguments[0]: (node, node) for node in quantities}
        self._expressions = with_derivatives(
            [convert_to_graph(item, named) for item in figures.expressions], quantities
        )

    def evaluate(self, values: Floats, mode: SynthesisMode) -> FigureValues:
        """Return the figures of a design in an assembly mode, and their derivatives.

        A figure is a reduction, such as the maximum or mean, of an expression over samples.
        Its derivative is found by the chain rule, as a product of three factors: the
        derivatives of the reduction with respect to the values at the samples (the
        weights), of the expression with respect to its quantities, and of these quantities
        with respect to the variables.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.
        mode
            The assembly mode: one of the ways in which the links are put together.

        Returns
        -------
        Figures and derivatives, all NaN if the design is impossible.
        """
        kernel_figures = self.evaluator.figures
        merits = kernel_figures.merits
        figures = nans(len(merits))
        gradients = nans((len(merits), len(values)))
        design = self.evaluator.varied_mechanism.evaluate_design(values)
        if design is None:
            return FigureValues(figures, gradients, 0.0)
        samples = kernel_figures.rows.T
        position_arguments = mode.position_arguments(design, len(kernel_figures.rows))
        # If some profiles are not circles, the position arguments are pair variables. If
        # all profiles are circles, only the length of `pair_values` is used.
        columns = design.evaluate_gradients(
            self._kernel,
            samples,
            position_arguments,
            pair_values=position_arguments.T,
            revolution_offsets=self._revolution_offsets(design, position_arguments),
        )
        closes = columns.closes & all_finite(position_arguments, 0)
        with np.errstate(all="ignore"):
            outputs = self._expressions(np.concatenate([samples, columns.columns]))
        # Index 0 has the values of the expressions, then their derivatives with respect to
        # each number of the sample and each column.
        outputs = outputs.reshape(-1, len(merits), len(closes))
        first_column = 1 + len(kernel_figures.sample_names)
        is_closed_path = kernel_figures.samples.is_closed_path
        for k, merit in enumerate(merits):
            rows = kernel_figures.select_rows(merit)
            sample_values = np.where(closes[rows], outputs[0, k, rows], np.nan)
            figures[k] = kernel_figures.reduce_values(merit, sample_values[:, None])[0]
            weights = sample_weights(
                merit.reduction, sample_values, figures[k], is_closed_path
            )
            # Reductions such as "argmin" return an input. Their derivatives are not
            # computed.
            if weights is None:
                continue
            # Without a finite value, derivatives are NaN. If all weights are zero, such as
            # those of a root mean square of zeros, the derivatives are zero.
            if np.any(np.isfinite(sample_values)):
                weighted = np.flatnonzero(weights)
                rows = rows[weighted]
                # Indices: c column, v variable, n sample.
                gradients[k] = np.einsum(
                    "cn,vcn,n->v",
                    outputs[first_column:, k, rows],
                    columns.gradients[:, :, rows],
                    weights[weighted],
                )
        # `closes` has the samples first, then the points of single figures.
        sample_count = len(kernel_figures.samples.rows)
        closing_fraction = float(np.mean(closes[:sample_count]))
        return FigureValues(figures, gradients, closing_fraction)

    def _revolution_offsets(
        self, design: DesignPoint, position_arguments: Floats
    ) -> Floats:
        """Return the multiples of 2 pi to be added to angles on which loads depend.

        Configurations have angles in (-pi, pi]. Loads such as springs may depend on angles
        that count full revolutions.

        Parameters
        ----------
        design
            The design (choice of sizes).
        position_arguments
            (numbers, samples) numbers that determine the positions of the links in one
            assembly mode (way to assemble the mechanism). In closed form they are the signs
            of the dyads (groups of two links with three revolute pairs). Without a closed
            form, the numbers are the pair variables (rad).

        Returns
        -------
        (pairs, samples) offsets (rad) of the pairs in ``unwrapped_pairs`` of the kernel, on
        whose full revolutions loads depend.
        """
        if not self._kernel.unwrapped_pairs:
            # No load depends on revolutions.
            return np.zeros((0, position_arguments.shape[1]))
        if self._kernel.is_closed_form:
            # A dyad has the same sign everywhere in the mode, so the first column is
            # enough.
            signs = position_arguments[:, 0].tolist()
            return self._offsets_by_signs(design, signs)
        return self._offsets_by_configurations(design, position_arguments)

    def _offsets_by_signs(self, design: DesignPoint, signs: Sequence[float]) -> Floats:
        """Return the whole revolutions (rad) of pair angles in a mode given by signs.

        The offsets (unwrapped pairs, samples + points) are multiples of 2 pi, which make
        the angles continuous along the samples. `signs` has the sign of each dyad (two
        links with three R pairs), 1 or -1 for the two ways to assemble it.
        """
        # The evaluator computes offsets of several designs. Here there is one.
        prepared_of_designs = self._kernel.prepare(design.sizes[:, None])
        offsets_of_designs = self.evaluator.find_signed_mode_offsets(
            self._kernel, prepared_of_designs, signs
        )
        return offsets_of_designs[:, :, 0]

    def _offsets_by_configurations(
        self, design: DesignPoint, configurations: Floats
    ) -> Floats:
        """Return multiples of 2 pi that make angles of one assembly mode continuous.

        Angles of configurations are in (-pi, pi]. Loads such as springs depend on angles
        over whole revolutions, which are counted here.

        Parameters
        ----------
        design
            The design (choice of sizes).
        configurations
            (variables, samples + points) pair variables (rad) in one assembly mode (way to
            assemble the mechanism). Points are additional sets of inputs, at which single
            figures of merit (numbers that rate a design) are evaluated.

        Returns
        -------
        (unwrapped pairs, samples + points) offsets (rad), for pairs on which loads depend.
        """
        solver = self.evaluator.make_solver(
            self.evaluator.make_kernel_mechanism(design.values)
        )
        # The evaluator computes offsets of several modes. Here there is one.
        offsets_of_modes = self.evaluator.find_revolution_offsets(
            self._kernel, solver, configurations[:, :, None]
        )
        return offsets_of_modes[:, :, 0]


def with_derivatives(
    expressions: Sequence[Expr], variables: Sequence[ExpressionNode]
) -> ArrayFunction:
    """Return a function that evaluates expressions and their derivatives.

    It takes values (variables, n) and returns the expressions, then their derivatives with
    respect to the first variable, the second and so on: (expressions (1 + variables), n).
    """
    slopes = [
        slope
        for variable in variables
        for slope in differentiate(expressions, {variable: 1.0})
    ]
    return array_function([*expressions, *slopes], variables)
