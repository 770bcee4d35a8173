"""Enclosures of the pole axes and velocity coefficients of certified modes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from spherekit.arrays import Array
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import Ball, lower_magnitude, solve_balls


@dataclass(frozen=True)
class EnclosedPole:
    """The pole of two links while one input moves and the other inputs are locked.

    The pole is the axis of their relative rotation. The relative angular velocity at unit
    rate of the input is `coefficient` times `direction`. Both are balls: numbers with a
    proven bound of their error.

    Attributes
    ----------
    input_pair
        Index of the pair (joint) of the moving input.
    link, relative_to
        Index of the link that moves, and of the link relative to which it is seen.
    direction
        (3,) unit vector along the pole axis in ground axes, three balls. None if the links
        may be at relative rest.
    coefficient
        The velocity coefficient (relative angular speed per unit rate of the input), a
        ball. The coefficient is not negative.
    """

    input_pair: int
    link: int
    relative_to: int
    direction: Array | None
    coefficient: Ball


def enclose_poles(
    equations: ArcEquations, variables: Sequence[Ball]
) -> Iterator[EnclosedPole]:
    """Yield the poles of each two links, for each moving input, in one configuration.

    The pole of two links is the axis of their relative rotation while one input moves at
    unit rate and the other inputs are locked. The relative angular velocity is a
    coefficient (its magnitude) times a direction.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    variables
        Values (rad) of all variables, as narrow balls (numbers with a bound of their
        error).
    """
    for input_number, pair in enumerate(equations.construction.input_pairs):
        angular_velocities = _link_angular_velocities(equations, variables, input_number)
        for relative_to, link in combinations(range(len(angular_velocities)), 2):
            relative = angular_velocities[link] - angular_velocities[relative_to]
            # A square is not negative, but its ball can contain negative numbers.
            coefficient = (relative @ relative).nonnegative_part().sqrt()
            direction = None
            # The direction is unknown if the relative velocity may be zero.
            if lower_magnitude(coefficient) > 0.0:
                direction = relative / coefficient
            yield EnclosedPole(
                input_pair=pair,
                link=link,
                relative_to=relative_to,
                direction=direction,
                coefficient=coefficient,
            )


def _link_angular_velocities(
    equations: ArcEquations, variables: Sequence[Ball], input_number: int
) -> Array:
    """Return the angular velocities of all links at unit rate of one input.

    The other inputs are locked. The caller subtracts the angular velocities of two links to
    find their pole. In the difference it does not matter that all of them are relative to
    the root, the link that is placed first. All numbers are balls, which have a proven
    bound of their error.

    Parameters
    ----------
    equations
        The closure equations of the mechanism. Its sizes are the decimal numbers that its
        file states.
    variables
        Balls (rad) of all variables at a configuration: the unknown angles, the inputs, and
        the angles that follow from the inputs through wheels.
    input_number
        Index of the moving input among the inputs.

    Returns
    -------
    (links, 3) balls, components in ground axes.
    """
    # (equations, variables) derivatives of the closure equations. Columns are in the order
    # of the variables: unknowns, inputs, followers (angles that wheels determine).
    _, slopes = equations.evaluate(variables)
    construction = equations.construction
    structure = equations.decimal_mechanism.structure
    unknown_count = construction.unknown_count
    input_rates = exact_balls(np.eye(construction.input_count)[input_number])
    # A row for each follower: its rates at unit rates of the inputs.
    ratios = equations.decimal_mechanism.follower_ratios()
    rates = [*input_rates, *(row[input_number] for row in ratios)]
    if unknown_count:
        # The equations F(x, q) = 0 give F_x x' = -F_q q' for the rates x' of the unknowns.
        right_side = -(slopes[:, unknown_count:] @ rates)
        unknown_rates = solve_balls(slopes[:, :unknown_count], right_side[:, None])[:, 0]
        rates = [*unknown_rates, *rates]
    # Orientations of the links relative to the root, with their first derivatives.
    orientations = equations.link_orientations(variables, order=1)
    angular_velocities = exact_balls(np.zeros((structure.body_count, 3)))
    for link, jet in orientations.items():
        # A jet has the orientation R under the key (), and under (j,) its derivative with
        # respect to variable j. The sum of the parts is R'.
        parts = [
            jet[(variable,)] * rate
            for variable, rate in enumerate(rates)
            if (variable,) in jet
        ]
        # Couplers, added links that replace sliding contacts, are not returned. The numbers
        # of couplers follow the numbers of the links of the mechanism.
        if parts and link < structure.body_count:
            # R' R^T is the cross-product matrix of the angular velocity.
            spin = sum(parts) @ jet[()].T
            angular_velocities[link] = spin[2, 1], spin[0, 2], spin[1, 0]
    # The rows are vectors in root axes. R_ground rotates from ground axes to root axes, so
    # its transpose changes a column to ground axes. For rows this is the product with
    # R_ground from the right. The ground is link 0.
    ground_orientation = orientations[0][()]
    return angular_velocities @ ground_orientation
