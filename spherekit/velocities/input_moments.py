"""Moments at the inputs that the inertia of the links requires.

The torque at input i follows from Newton's and Euler's equations of all links, projected
onto the velocities w_ji of the links j that a unit rate of this input causes while the
other inputs rest:

    torque_i = sum over j of w_ji . (I_j a_j + w_j x I_j w_j) - Q_i.

Q_i is the power of the loads at the velocities w_ji; it is not computed here. I_j are the
inertia tensors, w_j and a_j the angular velocities and accelerations.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot
from spherekit.symbolic.vector_algebra import Exprs, cross
from spherekit.velocities.axis_rotations import Entries
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.pose_expressions import LinkOrientation


@dataclass(frozen=True)
class MovingLink:
    """Angular velocities and momenta of one link while a single input moves.

    Vectors have components along three unit vectors fixed in the link (its basis, see
    `LinkOrientation`). Velocities are multiplied by the determinant D of the velocity
    equations, so that they need no division.

    Attributes
    ----------
    link
        Index j of the link.
    orientation
        Orientation of the link.
    velocities
        (3,) for each input i the vector y_i = D w_ji. Here w_ji is the angular velocity of
        the link while input i moves at the rate 1 and the others rest.
    momenta
        (3,) for each input the angular momentum I y_i. The inertia tensor I of the link is
        divided by a unit of inertia (`InputMoments.unit`), so that its numbers are near
        one.
    """

    link: int
    orientation: LinkOrientation
    velocities: list[Exprs]
    momenta: list[Exprs]

    def momentum(self, scaled_speeds: Sequence[Expr]) -> Exprs:
        """Return the angular momentum h = sum of s_k I y_k while all inputs move.

        I y_k are the `momenta`, with the unit of inertia of this class. `scaled_speeds` are
        s_k, the rates of the inputs divided by the determinant D.
        """
        return np.asarray(dot(self.momenta, scaled_speeds))

    def acceleration_moment(self, i: int, acceleration: Exprs) -> Expr:
        """Return D times the moment at input i that an angular acceleration b requires.

        The link needs the moment I b. Because of equal power, this takes the moment
        w_ji . I b at input i. Times D it is y_i . I b. The tensor I is symmetric, so this
        is also I y_i . b, with the `momenta` I y_i. `acceleration` are the components (3,)
        of b along the basis of the link.
        """
        return dot(self.momenta[i], acceleration)

    def gyroscopic_product(self, i: int, k: int, momentum: Exprs) -> Expr:
        """Return h . (y_i x y_k), with the angular momentum h (3,) of the link.

        y_i and y_k are the `velocities` of inputs i and k, each with the factor D. The sum
        of s_k times this product over the inputs k is D times the gyroscopic moment of the
        link at input i. The product changes its sign if i and k are exchanged.
        """
        return dot(cross(self.velocities[i], self.velocities[k]), momentum)


class InputMoments:
    """Inertia matrix at the inputs, and the input torques due to inertia, as expressions.

    All expressions are divided by a unit of inertia, so that numbers have sizes near one.

    Attributes
    ----------
    unit
        The unit of inertia, kg m2.
    """

    def __init__(
        self,
        coordinate_rates: CoordinateRates,
        tensors: Mapping[int, Entries],
        unit: float = 0.0,
    ) -> None:
        """Derive expressions of the velocities and momenta of all links, for each input.

        Only one input moves, at unit rate. The velocities are multiplied by the determinant
        of the velocity equations, so that they need no division. Components are along three
        unit vectors fixed in the link (its basis, see `LinkOrientation`).

        Parameters
        ----------
        coordinate_rates
            Rates of variables and links while each input moves.
        tensors
            (3, 3) by index of the link, the inertia tensor in link axes, kg m2.
        unit
            The unit of inertia, kg m2, if the caller uses one for other quantities, too.
            With 0 it is the largest number in the tensors of moving links.
        """
        self._coordinate_rates = coordinate_rates
        # Link 0 is the ground, which does not move.
        sizes = (_largest_number(tensor) for link, tensor in tensors.items() if link)
        largest_size = max(sizes, default=0.0)
        self.unit = unit or largest_size or 1.0
        # `tau` has an entry for each input: the rates of all variables.
        input_count = len(coordinate_rates.tau)
        self._links: list[MovingLink] = []
        for link, tensor in tensors.items():
            if not link or not np.any(tensor):
                continue
            orientation = coordinate_rates.placed[link]
            velocities = [
                coordinate_rates.link_velocity(i, link) for i in range(input_count)
            ]
            # The inertia tensor in the axes of the basis, in the unit of inertia.
            inertia = _tensor_along_basis(orientation, tensor / self.unit)
            momenta = [inertia @ velocity for velocity in velocities]
            self._links.append(MovingLink(link, orientation, velocities, momenta))

    @property
    def matrix(self) -> list[list[Expr]]:
        """The inertia matrix reduced to the inputs, times D^2 / `unit`, as expressions.

        D is the determinant of the velocity equations. The factor D^2 avoids divisions.
        Entry (i, k) is the sum of y_i . I y_k over all links. Here y_i is D times the
        angular velocity of a link while input i moves at unit rate. I is the inertia tensor
        of the link divided by `unit`, so that its numbers are near one.
        """
        # `tau` has the rates of all variables for each input. Only its length is used.
        input_count = len(self._coordinate_rates.tau)
        matrix: list[list[Expr]] = []
        for i in range(input_count):
            row: list[Expr] = []
            for k in range(input_count):
                # With sorted indices, entries (i, k) and (k, i) get the same expression.
                larger = max(i, k)
                smaller = min(i, k)
                entry: Expr = 0.0
                # `velocities` are the y_i of a link, and `momenta` the I y_k.
                for link in self._links:
                    entry = entry + dot(link.velocities[larger], link.momenta[smaller])
                row.append(entry)
            matrix.append(row)
        return matrix

    def velocity_moments(
        self, bias_accelerations: Sequence[Exprs], scaled_speeds: Sequence[Expr]
    ) -> list[Expr]:
        """Return D times the moments that inertia needs at constant rates of the inputs.

        There is one moment for each input, the sum over all links, divided by `unit`. D is
        the determinant of the velocity equations. The velocities are known as multiples of
        1 / D, so the factor D avoids divisions. The caller removes it.

        A link has the angular velocity w and the angular acceleration b while all inputs
        move. The link with the inertia tensor I needs two moments: I b, and the gyroscopic
        moment w x h with the angular momentum h = I w. The moment at input i follows from
        equal power while only input i moves. Let y_i be D times the angular velocity of the
        link while input i moves at unit rate and the others rest. So D times the moments at
        input i are

            y_i . (I b)   and   y_i . (w x h).

        The angular velocity is a sum over the inputs: w = sum of s_k y_k, where s_k is the
        rate of input k divided by D. The second term is therefore the sum of s_k g_ik, with

            g_ik = y_i . (y_k x h) = h . (y_i x y_k).

        If i and k are exchanged, only the sign changes: g_ki = -g_ik. One product is
        therefore enough for each pair of inputs.

        Parameters
        ----------
        bias_accelerations
            (3,) for each link, its angular acceleration b at constant rates of the inputs,
            in ground axes.
        scaled_speeds
            s_i of each input.
        """
        inputs = range(len(scaled_speeds))
        moments: list[Expr] = [0.0 for _ in inputs]
        # Sums of g_ik over the links, by the pair of inputs (k, i) with k < i.
        gyroscopic_sums: dict[tuple[int, int], Expr] = dict.fromkeys(
            combinations(inputs, 2), 0.0
        )
        for link in self._links:
            # The components of b along axes that are fixed in the link, and h.
            acceleration = link.orientation.components(bias_accelerations[link.link])
            momentum = link.momentum(scaled_speeds)
            for i in inputs:
                # Add y_i . (I b).
                moments[i] = moments[i] + link.acceleration_moment(i, acceleration)
            for (k, i), previous_sum in gyroscopic_sums.items():
                product = link.gyroscopic_product(i, k, momentum)
                gyroscopic_sums[k, i] = previous_sum + product
        # Input i gets s_k g_ik, and input k gets s_i g_ki = -s_i g_ik.
        for (k, i), gyroscopic_sum in gyroscopic_sums.items():
            moments[i] = moments[i] + scaled_speeds[k] * gyroscopic_sum
            moments[k] = moments[k] - scaled_speeds[i] * gyroscopic_sum
        return moments

    def inertia_torque(
        self, input_index: int, speeds: Sequence[Expr], accelerations: Sequence[Expr]
    ) -> Expr:
        """Return the moment (N m) at an input that the inertia of the links requires.

        Loads are not included. The moment at input i is

            moment_i = sum over k of M_ik q''_k + h_i,

        with the inertia matrix M, the accelerations q'' of the inputs, and the moment h_i
        at constant rates of the inputs.

        Parameters
        ----------
        input_index
            The input i.
        speeds, accelerations
            Rates and accelerations of all inputs.
        """
        # The velocities at unit rate of one input are stored with the factor D, the
        # determinant of the velocity equations. M_ik contains two of these velocities, and
        # h_i one. So the known numbers are D^2 M_ik and D h_i, and the moment is
        # moment_i = (sum over k of (D^2 M_ik) (q''_k / D) + D h_i) / D.
        velocity_moment_times_d = self._velocity_moments_at(speeds)[input_index]
        inverse_determinant = 1.0 / self._coordinate_rates.scale  # 1 / D
        accelerations_by_d = [x * inverse_determinant for x in accelerations]
        matrix_row_times_d2 = self.matrix[input_index]
        acceleration_moment_times_d = dot(matrix_row_times_d2, accelerations_by_d)
        moment_times_d = acceleration_moment_times_d + velocity_moment_times_d
        # `matrix` and the moments h are divided by the unit of inertia, `unit` (kg m2).
        return moment_times_d * inverse_determinant * self.unit

    def _velocity_moments_at(self, speeds: Sequence[Expr]) -> list[Expr]:
        """Return the inertia moments of all inputs, times D, at constant rates of them."""
        coordinate_rates = self._coordinate_rates
        motion_rates = coordinate_rates.motion_rates(speeds)
        bias_accelerations = coordinate_rates.bias_accelerations(
            motion_rates.variable_rates, motion_rates.w
        )
        return self.velocity_moments(bias_accelerations, motion_rates.scaled_speeds)


def _largest_number(tensor: Entries) -> float:
    """Return the largest absolute value of the numbers in a tensor, without expressions."""
    numbers = [abs(float(x)) for x in tensor.flat if not isinstance(x, ExpressionNode)]
    return max(numbers, default=0.0)


def _tensor_along_basis(orientation: LinkOrientation, tensor: Entries) -> Exprs:
    """Return an inertia tensor (3, 3), given in link axes, in the axes of the link's basis.

    `LinkOrientation.basis_tensor` replaces numbers that are nearly zero by exact zeros. The
    tensor of a light link beside a heavy one would vanish. It is therefore scaled first, so
    that its largest number is between 1 and 2. The scale is a power of 2, which causes no
    rounding errors. A tensor with expressions is not scaled.
    """
    has_expressions = any(isinstance(x, ExpressionNode) for x in tensor.flat)
    if has_expressions:
        return orientation.basis_tensor(tensor)
    _, exponent = math.frexp(_largest_number(tensor))
    scale = math.ldexp(1.0, exponent - 1)
    return orientation.basis_tensor(tensor / scale) * scale
